"""Errors that end the command with one message."""

import difflib
import unicodedata
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

_OBEYED = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Unicode categories that terminals interpret: control characters, writing direction, line
breaks."""


_LONGEST = 2000  # [characters] of a line; longer values are shortened


def visible(text: str) -> str:
    """`text` on one line, shortened in the middle; characters that a terminal interprets are
    escaped, such as ``\\x1b``.
    """
    shown = "".join(
        repr(sign)[1:-1] if unicodedata.category(sign) in _OBEYED else sign for sign in text
    )
    if len(shown) <= _LONGEST:
        return shown
    return f"{shown[: _LONGEST // 2]} ... {shown[-_LONGEST // 4 :]}"  # the end says what to do


class InputError(ValueError):
    """An invalid input; each line contains the key or file and what to do, with special characters
    escaped.

    Parameters
    ----------
    *lines : str
        Usually one.
    """

    def __init__(self, *lines: str):
        super().__init__(*map(visible, lines))

    def __str__(self) -> str:
        return "\n".join(self.args)


class UnusableRun(InputError):
    """One of several runs is invalid; the others are not affected."""

    def __init__(self, kind: str, message: str):
        super().__init__(message)
        self.kind = kind


class MissingPackage(InputError, ImportError):
    """A package of an optional part of jointgap is not installed."""


@contextmanager
def needs(feature: str, extra: str) -> Iterator[None]:
    """Context for imports of optional packages: the error for a missing one says how to install
    it."""
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or str(error)).partition(".")[0]
        # pip keeps the installed jointgap and adds the packages of the extra
        group = "" if extra in ("learn", "workflow") else f" {extra}"
        raise MissingPackage(
            f"{feature} requires {package}: pip install 'jointgap[{extra}]' (in a clone:"
            f" scripts/set-up{group})"
        ) from error


class SimulationError(RuntimeError):
    """A simulation failed; the message contains time, crank angle and state."""


def did_you_mean(word: object, accepted: Iterable[object]) -> str:
    """A hint: the accepted name with the most similar spelling, or all names if none is similar."""
    names = sorted(map(str, accepted))
    near = difflib.get_close_matches(str(word), names, n=1)
    return f"did you mean '{near[0]}'?" if near else f"known here: {', '.join(names)}"
