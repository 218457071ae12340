"""Errors that end with one clear message."""

import difflib
import unicodedata
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

_OBEYED = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Categories of signs that a terminal obeys instead of showing them: control, direction of writing, breaks of lines."""


_LONGEST = 2000  # [characters] of a line: a value that fills pages is not repeated whole


def visible(text: str) -> str:
    """`text` on one line, without its middle where it is long; signs that a terminal would obey are written out, such
    as ``\\x1b``.
    """
    shown = "".join(repr(sign)[1:-1] if unicodedata.category(sign) in _OBEYED else sign for sign in text)
    if len(shown) <= _LONGEST:
        return shown
    return f"{shown[: _LONGEST // 2]} ... {shown[-_LONGEST // 4 :]}"  # what to do stands at the end


class InputError(ValueError):
    """Something the user gave cannot be used; each of its lines names it and says what to do.

    What the user wrote is repeated in them, so they are made `visible`.

    Parameters
    ----------
    *lines : str
        Most errors have one.
    """

    def __init__(self, *lines: str):
        super().__init__(*map(visible, lines))

    def __str__(self) -> str:
        return "\n".join(self.args)


class UnusableRun(InputError):
    """One of several runs cannot be used; the others can."""

    def __init__(self, kind: str, message: str):
        super().__init__(message)
        self.kind = kind


class MissingPackage(InputError, ImportError):
    """A package that only a part of jointgap uses is not installed."""


@contextmanager
def needs(what: str, extra: str) -> Iterator[None]:
    """Around imports of packages that only a part of jointgap uses: where one is missing, says how to install it."""
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or str(error)).partition(".")[0]
        # pip takes the jointgap that is installed, from wherever it came, and adds the packages of the extra
        group = "" if extra in ("learn", "workflow") else f" {extra}"
        raise MissingPackage(
            f"{what} needs {package}: pip install 'jointgap[{extra}]' (in a clone: scripts/set-up{group})"
        ) from error


class SimulationError(RuntimeError):
    """A simulation could not go on; the message holds time, crank angle and state."""


def did_you_mean(word: object, accepted: Iterable[object]) -> str:
    """A hint at the nearest known name, or the list of known names when none is near."""
    names = sorted(map(str, accepted))
    near = difflib.get_close_matches(str(word), names, n=1, cutoff=0.6)
    if near:
        return f"did you mean '{near[0]}'?"
    return f"known here: {', '.join(names)}"
