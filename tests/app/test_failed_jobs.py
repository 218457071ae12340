"""One line for a failed job of the workflow: job, reason and log."""

import logging
from enum import Enum

import pytest

from jointgap.app.failed_jobs import OneLineForAFailedJob


class Event(Enum):  # as snakemake_interface_logger_plugins.common.LogEvent
    JOB_INFO = "job_info"
    JOB_ERROR = "job_error"
    ERROR = "error"


FILES = ", ".join(f"results/campaigns/mine/decide/table_{number}.parquet" for number in range(30))
INTERRUPTED = ["interrupted; the same command resumes"]
SIMULATE = "failed: mine: simulate the contact"


def shown(*messages) -> list[str]:
    """The lines that a logger with the filter shows."""
    lines, logger, handler = [], logging.Logger("of a test"), logging.Handler()
    logger.addFilter(OneLineForAFailedJob())
    handler.emit = lambda record: lines.append(record.getMessage())
    logger.addHandler(handler)
    for message, event, attributes in messages:
        logger.error(message, extra={"event": event} | attributes)
    return lines


def shown_of_a_failed_job(log, status="returned non-zero exit status 2.", before=()) -> list[str]:
    """The lines after that of the rule; the messages `before` come before the job's end."""
    job = {"jobid": 3, "rule_name": "simulate"}
    called = f"RuleException:\nCalledProcessError in file ...:\nCommand 'jointgap ...' {status}"
    removed = "Removing output files of failed job simulate since they might be corrupted"
    return shown(
        ("rule", Event.JOB_INFO, job | {"rule_msg": "mine: simulate the contact"}),
        *((text, None, {}) for text in before),
        (called, Event.ERROR, {}),
        ("Error in rule simulate, jobid: 3", Event.JOB_ERROR, job | {"log": [str(log)]}),
        (f"{removed}:\n{FILES}", None, {}),
        ("Shutting down, this might take some time.", None, {}),
        ("Exiting because a job execution failed. Look above for error messages", None, {}),
        ("WorkflowError:\nAt least one job did not complete successfully.", None, {}),
    )[1:]


COMPILING = "jointgap: compiling the simulation for this machine, once (about 60 s) ...\n"
UNKNOWN = "ended with exit status 2, without a message"
TRACEBACK = "Traceback (most recent call last):\n  File 'a.py', line 3, in f\n    f(\n"


@pytest.mark.parametrize(
    "text, reason",
    [
        ("jointgap: a remark\njointgap: error: the motor stalls\n\n", "the motor stalls"),
        (f"{TRACEBACK}ValueError: x\n\nDuring ...:\n\n{TRACEBACK}OSError: y\nleft\n", "OSError: y"),
        ("jointgap: error: one\njointgap: error: two\n", "one (and 1 more in the log)"),
        (f"{COMPILING}/usr/bin/bash: line 1: no\n", "/usr/bin/bash: line 1: no"),
        ("Usage: jointgap fit\n\nError: No such option: --prt\n", "Error: No such option: --prt"),
        (f"{COMPILING}jointgap: fits: 3 of 40\n", UNKNOWN),
        (f"figures and tables: results/a\n{FILES}\n", UNKNOWN),
        (None, UNKNOWN),
    ],
)
def test_a_failed_job_is_one_line_with_its_reason(tmp_path, text, reason):
    log = tmp_path / "simulate.log"
    if text is not None:
        log.write_text(text)
    assert shown_of_a_failed_job(log) == [f"{SIMULATE}: {reason} (log: {log})"]


BY_CTRL_C = "Terminating processes on user request, this might take some time."
IN_THE_END = "Will exit after finishing currently running jobs (scheduler)."


@pytest.mark.parametrize(
    "status, before",
    [
        ("died with <Signals.SIGINT: 2>.", ()),
        ("died with <Signals.SIGTERM: 15>.", ()),
        ("returned non-zero exit status 130.", ()),
        ("returned non-zero exit status 1.", (BY_CTRL_C,)),
        ("returned non-zero exit status 143.", (IN_THE_END, IN_THE_END)),
    ],
)
def test_an_interruption_is_one_line(tmp_path, status, before):
    assert shown_of_a_failed_job(tmp_path / "fit.log", status, before) == INTERRUPTED
    assert shown((BY_CTRL_C, None, {})) == INTERRUPTED


@pytest.mark.parametrize(
    "status, name",
    [
        ("died with <Signals.SIGKILL: 9>.", "SIGKILL"),
        ("returned non-zero exit status 137.", "SIGKILL"),
        ("returned non-zero exit status 152.", "SIGXCPU"),
    ],
)
def test_a_job_that_a_limit_ends_is_reported_with_the_signal(tmp_path, status, name):
    log = tmp_path / "fit.log"
    log.write_text("jointgap: fits: 3 of 40\n")
    (line,) = shown_of_a_failed_job(log, status)
    assert line.startswith(f"{SIMULATE}: ended with {name}, as when memory or a time limit is")
