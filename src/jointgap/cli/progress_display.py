"""Progress on the standard error output: bars in a terminal, a line now and then where it is a file, such as a log."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from jointgap.progress import heard_by

_SECONDS_OF_SILENCE = 2.0  # work that is over sooner shows nothing
_SECONDS_BETWEEN_LINES = 60.0
_SECONDS_BETWEEN_UPDATES = 0.1


@contextmanager
def progress_shown() -> Iterator[None]:
    """Show how far long work has come until the block ends."""
    terminal = sys.stderr.isatty() and os.environ.get("TERM", "dumb") != "dumb"
    display = _Bars() if terminal else _Lines()
    with heard_by(display.hear):
        try:
            yield
        finally:
            display.end()


class _Lines:
    def __init__(self) -> None:
        self._last = time.monotonic()

    def hear(self, what: str, done: int, total: int | None) -> None:
        now = time.monotonic()
        if now - self._last >= _SECONDS_BETWEEN_LINES:
            self._last = now
            print(f"jointgap: {what}: {done}{f' of {total}' if total else ''}", file=sys.stderr, flush=True)

    def end(self) -> None:
        pass


class _Bars:
    def __init__(self) -> None:
        self._start = time.monotonic()
        self._progress: Any = None
        self._tasks: dict[str, Any] = {}
        self._told: dict[str, float] = {}

    def hear(self, what: str, done: int, total: int | None) -> None:
        now = time.monotonic()
        over = done == total
        if now - self._start < _SECONDS_OF_SILENCE:
            return
        if over:
            if what in self._tasks:
                self._progress.remove_task(self._tasks.pop(what))
            return
        if now - self._told.get(what, 0.0) < _SECONDS_BETWEEN_UPDATES:
            return
        self._told[what] = now
        if self._progress is None:
            self._progress = _started()
        if what not in self._tasks:
            self._tasks[what] = self._progress.add_task(what, total=total)
        self._progress.update(self._tasks[what], completed=done, total=total)

    def end(self) -> None:
        if self._progress is not None:
            self._progress.stop()


def _started() -> Any:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    # what the command answers goes where it was sent, not to the terminal of the bars
    progress = Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=sys.stdout.isatty())
    progress.start()
    return progress
