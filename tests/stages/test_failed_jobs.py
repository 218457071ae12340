"""A failed job is told in one line: which, why, and where its log lies."""

import logging
from enum import Enum

from jointgap.app.failed_jobs import OneLineForAFailedJob
from tests.catalogue import each


class Event(Enum):  # as snakemake_interface_logger_plugins.common.LogEvent
    JOB_INFO = "job_info"
    JOB_ERROR = "job_error"
    ERROR = "error"


def shown_of_a_failed_job(log) -> list[tuple]:
    """What a logger with the filter shows after the rule's own line, record by record."""
    told, logger, handler = [], logging.Logger("of a test"), logging.Handler()
    logger.addFilter(OneLineForAFailedJob())
    handler.emit = lambda record: told.append((record.event, record.getMessage()))
    logger.addHandler(handler)
    exit_status = "CalledProcessError in file ...:\nCommand 'jointgap ...' returned non-zero exit status 2."
    job = {"jobid": 3, "rule_name": "simulate"}
    for message, event, more in (
        ("rule", Event.JOB_INFO, job | {"rule_msg": "mine: simulate the contact"}),
        (f"RuleException:\n{exit_status}", Event.ERROR, {}),
        ("Error in rule simulate, jobid: 3", Event.JOB_ERROR, job | {"log": [str(log)]}),
        ("Shutting down, this might take some time.", None, {}),
        ("WorkflowError:\nAt least one job did not complete successfully.", None, {}),
    ):
        logger.error(message, extra={"event": event} | more)
    return told[1:]


def test_a_failed_job_is_one_line_with_the_reason_as_far_as_it_is_known(tmp_path):
    log = tmp_path / "simulate.log"

    def told(text, why):
        log.unlink(missing_ok=True)
        if text is not None:
            log.write_text(text)
        assert shown_of_a_failed_job(log) == [(None, f"failed: mine: simulate the contact: {why} (log: {log})")]

    cases = [
        ("jointgap: a remark\njointgap: error: the motor stalls\n\n", "the motor stalls"),
        ("Traceback (most recent call last):\n  ...\nMemoryError\n", "MemoryError"),
        ("jointgap: error: one\njointgap: error: two\n", "one (and 1 more in the log)"),
        ("", "ended with exit status 2, without a message"),
        (None, "ended with exit status 2, without a message"),
    ]
    each(told, cases)
