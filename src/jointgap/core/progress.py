"""How far long work has come: loops tell it here, and who started them may listen. Nobody does by default.

The numerical core tells; `jointgap.app.cli` listens for the command line."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")

Listener = Callable[[str, int, int | None], None]
"""Takes what is counted, in the plural; how many are done; and of how many, ``None`` where nobody knows."""

_listeners: list[Listener] = []


def tell(what: str, done: int, total: int | None = None) -> None:
    """Say that `done` of `total` are done."""
    for listener in _listeners:
        listener(what, done, total)


def followed(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """The `items`, with `tell` before the first and after each."""
    if total is None and hasattr(items, "__len__"):
        total = len(items)
    done = 0
    tell(what, done, total)
    for item in items:
        yield item
        done += 1
        tell(what, done, total)
    tell(what, done, done)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Have a `listener` told until the block ends."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


MOST_PARTS = 100
"""Jobs that share the fits of a campaign: beyond that there are more jobs than fits."""


def parts(number: int, per_job: int) -> dict[str, tuple[int, int]]:
    """The parts of `number` pieces of work, where a job does `per_job` of them and the last job what is left."""
    firsts = range(0, number, per_job)
    return {f"part_{part:06d}": (first, min(per_job, number - first)) for part, first in enumerate(firsts)}
