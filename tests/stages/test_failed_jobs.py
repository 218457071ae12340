"""A failed job is told in one line: which, why, and where its log lies."""

import logging
from enum import Enum

import pytest

from jointgap.app.failed_jobs import OneLineForAFailedJob


class Event(Enum):  # as snakemake_interface_logger_plugins.common.LogEvent
    JOB_INFO = "job_info"
    JOB_ERROR = "job_error"
    ERROR = "error"


@pytest.fixture
def shown():
    """What a logger with the filter shows, record by record."""
    told, logger = [], logging.Logger("of a test")
    logger.addFilter(OneLineForAFailedJob())
    handler = logging.Handler()
    handler.emit = lambda record: told.append((record.event, record.getMessage()))
    logger.addHandler(handler)

    def log(message, **extra):
        logger.error(message, extra={"event": None} | extra)
        return told

    return log


def failed(shown, log):
    """What is shown of a job that failed with this log."""
    shown("rule", event=Event.JOB_INFO, jobid=3, rule_msg="mine: simulate the contact", rule_name="simulate")
    shown(
        "RuleException:\nCalledProcessError in file ...:\nCommand 'jointgap ...' returned non-zero exit status 2.",
        event=Event.ERROR,
    )
    shown("Error in rule simulate, jobid: 3", event=Event.JOB_ERROR, jobid=3, rule_name="simulate", log=[str(log)])
    shown("Shutting down, this might take some time.")
    return shown("WorkflowError:\nAt least one job did not complete successfully.")[1:]


def test_a_failed_job_is_one_line_with_the_reason_that_jointgap_gave(shown, tmp_path):
    log = tmp_path / "simulate.log"
    log.write_text("jointgap: a remark\njointgap: error: the motor stalls\n\n")
    assert failed(shown, log) == [(None, f"failed: mine: simulate the contact: the motor stalls (log: {log})")]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("Traceback (most recent call last):\n  ...\nMemoryError\n", "MemoryError"),
        ("jointgap: error: one\njointgap: error: two\n", "one (and 1 more in the log)"),
        ("", "ended with exit status 2, and left no reason"),
        (None, "ended with exit status 2, and left no reason"),
    ],
)
def test_other_ends_are_told_as_far_as_they_are_known(shown, tmp_path, text, why):
    log = tmp_path / "simulate.log"
    if text is not None:
        log.write_text(text)
    assert failed(shown, log) == [(None, f"failed: mine: simulate the contact: {why} (log: {log})")]
