"""A failed job of the workflow in one line: which it was, why, and where its log lies."""

import logging
import re
from pathlib import Path

_OURS = "jointgap: error: "  # how `jointgap.app.cli` begins what it says of a mistake
_SAID_AGAIN = re.compile(
    "Shutting down, this might take some time|WorkflowError:\nAt least one job did not complete successfully"
)
_STATUS = re.compile(r"returned non-zero exit status (\d+)|died with <(Signals\.\w+)")
_LONGEST = 300  # [characters] of a reason that is not ours


class OneLineForAFailedJob(logging.Filter):
    """A filter of Snakemake's logger: the twenty lines about a failed job, and those at the end, are one.

    `--show-failed-logs` asks for all of it: then the filter is not set.
    """

    def __init__(self) -> None:
        super().__init__()
        self._messages: dict[int, str] = {}
        self._status: dict[int, str] = {}  # by thread: Snakemake says how a command ended before it says of which job

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the `record` is shown; one of a failed job is rewritten."""
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
        why = next(reasons, f"ended with {status}, and left no reason" if status else "left no reason")
        where = f" (log: {', '.join(map(str, logs))})" if logs else ""
        record.msg, record.args, record.event = f"failed: {job}: {why}{where}", (), None


def reason_in(log: Path) -> str:
    """Why a job failed, by its log: what `jointgap` said of a mistake, else the last line; empty where there is
    none.
    """
    try:
        lines = [line.strip() for line in log.read_text(encoding="utf-8", errors="replace").splitlines()]
    except OSError:
        return ""
    lines = [line for line in lines if line]
    ours = [line.removeprefix(_OURS) for line in lines if line.startswith(_OURS)]
    if ours:
        return ours[0] + (f" (and {len(ours) - 1} more in the log)" if len(ours) > 1 else "")
    return lines[-1][:_LONGEST] if lines else ""
