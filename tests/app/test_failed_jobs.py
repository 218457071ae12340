"""A failed job is told in one line: which, why, and where its log lies; an interruption in one line
altogether."""

import logging
from enum import Enum

from jointgap.app.failed_jobs import OneLineForAFailedJob
from tests.catalogue import each


class Event(Enum):  # as snakemake_interface_logger_plugins.common.LogEvent
    JOB_INFO = "job_info"
    JOB_ERROR = "job_error"
    ERROR = "error"


FILES = ", ".join(f"results/campaigns/mine/decide/table_{number}.parquet" for number in range(30))


def shown(*messages) -> list[tuple]:
    """What a logger with the filter shows, record by record."""
    told, logger, handler = [], logging.Logger("of a test"), logging.Handler()
    logger.addFilter(OneLineForAFailedJob())
    handler.emit = lambda record: told.append((record.event, record.getMessage()))
    logger.addHandler(handler)
    for message, event, more in messages:
        logger.error(message, extra={"event": event} | more)
    return told


def shown_of_a_failed_job(log, ended="returned non-zero exit status 2.", first=()) -> list[tuple]:
    """The same after the rule's own line; `first` comes before the job's end."""
    job = {"jobid": 3, "rule_name": "simulate"}
    return shown(
        ("rule", Event.JOB_INFO, job | {"rule_msg": "mine: simulate the contact"}),
        *first,
        (
            f"RuleException:\nCalledProcessError in file ...:\nCommand 'jointgap ...' {ended}",
            Event.ERROR,
            {},
        ),
        ("Error in rule simulate, jobid: 3", Event.JOB_ERROR, job | {"log": [str(log)]}),
        (
            f"Removing output files of failed job simulate since they might be corrupted:\n{FILES}",
            None,
            {},
        ),
        ("Shutting down, this might take some time.", None, {}),
        ("Exiting because a job execution failed. Look above for error messages", None, {}),
        ("WorkflowError:\nAt least one job did not complete successfully.", None, {}),
    )[1:]


def test_a_failed_job_is_one_line_with_the_reason_as_far_as_it_is_known(tmp_path):
    log = tmp_path / "simulate.log"

    def told(text, why):
        log.unlink(missing_ok=True)
        if text is not None:
            log.write_text(text)
        assert shown_of_a_failed_job(log) == [
            (None, f"failed: mine: simulate the contact: {why} (log: {log})")
        ]

    compiling = "jointgap: compiling the simulation for this machine, once (about 60 s) ...\n"
    unknown = "ended with exit status 2, without a message"
    traceback = "Traceback (most recent call last):\n  File 'a.py', line 3, in f\n    f(\n"
    cases = [
        ("jointgap: a remark\njointgap: error: the motor stalls\n\n", "the motor stalls"),
        (f"{traceback}MemoryError\n", "MemoryError"),
        (
            (
                f"{traceback}ValueError: x\n\nDuring handling ...:\n\n{traceback}OSError: y\nleft"
                " over\n"
            ),
            "OSError: y",
        ),
        ("jointgap: error: one\njointgap: error: two\n", "one (and 1 more in the log)"),
        (
            f"{compiling}/usr/bin/bash: line 1: jointgap: command not found\n",
            "/usr/bin/bash: line 1: jointgap: command not found",
        ),
        (
            "Usage: jointgap fit [OPTIONS] CAMPAIGN\n\nError: No such option: --prt\n",
            "Error: No such option: --prt",
        ),
        (compiling, unknown),
        (f"{compiling}jointgap: fits: 3 of 40\n", unknown),
        (f"figures and tables: results/a\n{FILES}\n", unknown),
        ("", unknown),
        (None, unknown),
    ]
    each(told, cases)


INTERRUPTED = [(None, "interrupted; the same command resumes")]


def test_an_interrupted_run_says_so_in_one_line_with_neither_a_log_nor_the_files_that_are_removed(
    tmp_path,
):
    log = tmp_path / "fit.log"
    log.write_text("jointgap: compiling the simulation for this machine, once (about 60 s) ...\n")

    def told(ended, *first):
        before = [(text, None, {}) for text in first]
        assert shown_of_a_failed_job(log, ended, before) == INTERRUPTED

    by_ctrl_c = "Terminating processes on user request, this might take some time."
    in_the_end = "Will exit after finishing currently running jobs (scheduler)."
    cases = [
        ("died with <Signals.SIGINT: 2>.",),
        ("died with <Signals.SIGTERM: 15>.",),
        ("returned non-zero exit status 130.",),
        ("returned non-zero exit status 143.",),
        ("returned non-zero exit status 1.", by_ctrl_c),
        ("returned non-zero exit status 143.", in_the_end, in_the_end),
    ]
    each(told, cases)
    assert shown((by_ctrl_c, None, {})) == INTERRUPTED


def test_a_job_that_a_limit_ends_is_told_with_the_signal_and_not_with_the_last_line_of_its_log(
    tmp_path,
):
    log = tmp_path / "fit.log"
    log.write_text("jointgap: fits: 3 of 40\n")
    why = "as when memory or a time limit is exceeded; the same command resumes"

    def told(ended, name):
        (line,) = shown_of_a_failed_job(log, ended)
        assert (
            line[1] == f"failed: mine: simulate the contact: ended with {name}, {why} (log: {log})"
        )

    cases = [
        ("died with <Signals.SIGKILL: 9>.", "SIGKILL"),
        ("returned non-zero exit status 137.", "SIGKILL"),
    ]
    each(told, [*cases, ("returned non-zero exit status 152.", "SIGXCPU")])
