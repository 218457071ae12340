"""One-line messages for failed and interrupted jobs of the workflow: job, reason and log."""

import logging
import re
import signal
from pathlib import Path

_OURS = "jointgap: error: "  # prefix of error messages of `jointgap.app.cli`
_SAID_AGAIN = re.compile(
    "Shutting down, this might take some time|Removing output files of failed job|Exiting because a"
    " job execution failed|WorkflowError:\nAt least one job did not complete successfully"
)
_STATUS = re.compile(r"returned non-zero exit status (\d+)|died with <Signals\.(\w+)")
_STOPPING = (
    "Terminating processes on user request",
    "Will exit after finishing currently running jobs",
)
_INTERRUPTING = ("SIGINT", "SIGTERM", "SIGHUP")
_LIMITS = ("SIGKILL", "SIGXCPU")
_OTHER_PROGRAMS = re.compile(
    r"Error: |\S*(bash|env|srun|slurmstepd): "
)  # of the option parser, the shell, SLURM
_LONGEST = 300  # [characters] of the reason from other programs


class OneLineForAFailedJob(logging.Filter):
    """A filter of Snakemake's logger that shortens the twenty lines about a failed job to one.

    However many jobs an interruption ends, one line says so. Not used with `--show-failed-logs`.
    """

    def __init__(self) -> None:
        super().__init__()
        self._messages: dict[int, str] = {}
        self._status: dict[
            int, str
        ] = {}  # exit status or signal by thread: Snakemake logs it before the job's name
        self._interrupted = False

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the `record` is shown; one about a failed job or an interruption is rewritten."""
        event = getattr(getattr(record, "event", None), "name", None)
        text = str(record.msg)
        if event == "JOB_INFO":
            self._messages[record.jobid] = record.rule_msg or record.rule_name
        elif event == "JOB_ERROR":
            status = self._status.pop(record.thread, "")
            if self._interrupted or status in _INTERRUPTING:
                return self._interrupt(record)
            self._rewrite(record, status)
        elif event == "ERROR" and "CalledProcessError" in text and (found := _STATUS.search(text)):
            self._status[record.thread] = found[2] or _status(int(found[1]))
            return False
        elif text.startswith(_STOPPING):
            return self._interrupt(record)
        return not _SAID_AGAIN.match(text)

    def _interrupt(self, record: logging.LogRecord) -> bool:
        """Rewrite the first record of an interruption; whether it is the first."""
        first, self._interrupted = not self._interrupted, True
        record.msg, record.args, record.event = "interrupted; the same command resumes", (), None
        return first

    def _rewrite(self, record: logging.LogRecord, status: str) -> None:
        job = self._messages.get(record.jobid, record.rule_name)
        logs = [Path(path) for path in record.log or ()]
        why = next(
            filter(None, map(reason_in, logs)),
            f"ended with {status or 'an error'}, without a message",
        )
        if status in _LIMITS:
            why = (
                f"ended with {status}, as when memory or a time limit is exceeded; the same command"
                " resumes"
            )
        where = f" (log: {', '.join(map(str, logs))})" if logs else ""
        record.msg, record.args, record.event = f"failed: {job}: {why}{where}", (), None


def _status(code: int) -> str:
    """Name of the signal that ended a program of a shell with exit status `code`, else the status
    in words."""
    signals = {128 + each.value: each.name for each in signal.Signals}
    return signals.get(code, f"exit status {code}")


def reason_in(log: Path) -> str:
    """Reason of a failed job from its log: jointgap's error message, else the exception of a
    traceback, else the error message of another program; '' if there is none: other lines
    (progress, remarks, results) are no reason.
    """
    try:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    ours = [line.strip().removeprefix(_OURS) for line in lines if line.strip().startswith(_OURS)]
    if ours:
        return ours[0] + (f" (and {len(ours) - 1} more in the log)" if len(ours) > 1 else "")
    reasons, in_traceback = [""], False
    for line in lines:
        if line.startswith("Traceback (most recent call last)"):
            in_traceback = True
        elif in_traceback and line.strip() and not line.startswith(" "):
            reasons.append(line)
            in_traceback = False
        elif _OTHER_PROGRAMS.match(line):
            reasons.append(line)
    return reasons[-1].strip()[:_LONGEST]
