"""One-line messages for failed jobs of the workflow: job, reason and log."""

import logging
import re
from pathlib import Path

_OURS = "jointgap: error: "  # prefix of error messages of `jointgap.app.cli`
_SAID_AGAIN = re.compile(
    "Shutting down, this might take some time|WorkflowError:\nAt least one job did not complete successfully"
)
_STATUS = re.compile(r"returned non-zero exit status (\d+)|died with <(Signals\.\w+)")
_LONGEST = 300  # [characters] of the reason from other programs


class OneLineForAFailedJob(logging.Filter):
    """A filter of Snakemake's logger that shortens the twenty lines about a failed job to one.

    Not used with `--show-failed-logs`.
    """

    def __init__(self) -> None:
        super().__init__()
        self._messages: dict[int, str] = {}
        self._status: dict[int, str] = {}  # exit status by thread: Snakemake logs it before the job's name

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the `record` is shown; one about a failed job is rewritten."""
        event = getattr(getattr(record, "event", None), "name", None)
        text = str(record.msg)
        if event == "JOB_INFO":
            self._messages[record.jobid] = record.rule_msg or record.rule_name
        elif event == "JOB_ERROR":
            self._rewrite(record)
        elif event == "ERROR" and "CalledProcessError" in text and (found := _STATUS.search(text)):
            self._status[record.thread] = f"exit status {found[1]}" if found[1] else found[2]
            return False
        return not _SAID_AGAIN.match(text)

    def _rewrite(self, record: logging.LogRecord) -> None:
        job = self._messages.get(record.jobid, record.rule_name)
        logs = [Path(path) for path in record.log or ()]
        status = self._status.pop(record.thread, "")
        reasons = filter(None, map(reason_in, logs))
        why = next(reasons, f"ended with {status}, without a message" if status else "no message")
        where = f" (log: {', '.join(map(str, logs))})" if logs else ""
        record.msg, record.args, record.event = f"failed: {job}: {why}{where}", (), None


def reason_in(log: Path) -> str:
    """Reason of a failed job from its log: jointgap's error message, else the last line; '' for an empty log."""
    try:
        lines = [line.strip() for line in log.read_text(encoding="utf-8", errors="replace").splitlines()]
    except OSError:
        return ""
    lines = [line for line in lines if line]
    ours = [line.removeprefix(_OURS) for line in lines if line.startswith(_OURS)]
    if ours:
        return ours[0] + (f" (and {len(ours) - 1} more in the log)" if len(ours) > 1 else "")
    return lines[-1][:_LONGEST] if lines else ""
