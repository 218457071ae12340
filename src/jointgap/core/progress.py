"""Progress of long computations: loops report it, and a listener such as `jointgap.app.cli` may
show it."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")

Listener = Callable[[str, int, int | None], None]
"""Receives the name of the items (plural), the number done, and the total (``None`` if unknown)."""

_listeners: list[Listener] = []


def report_progress(task: str, count: int, total: int | None = None) -> None:
    """Report that `done` of `total` are done."""
    for listener in _listeners:
        listener(task, count, total)


def with_progress(items: Iterable[Item], task: str, total: int | None = None) -> Iterator[Item]:
    """The `items`, with a report before the first and after each."""
    if total is None and hasattr(items, "__len__"):
        total = len(items)
    count = 0
    report_progress(task, count, total)
    for item in items:
        yield item
        count += 1
        report_progress(task, count, total)
    report_progress(task, count, count)


@contextmanager
def progress_listener(listener: Listener) -> Iterator[None]:
    """Call a `listener` with all reports until the block ends."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def parts(number: int, per_job: int) -> dict[str, tuple[int, int]]:
    """Split `number` items into parts of `per_job` each; the last part has the remainder."""
    firsts = range(0, number, per_job)
    return {
        f"part_{part:06d}": (start, min(per_job, number - start))
        for part, start in enumerate(firsts)
    }
