"""Errors that end the command with one message."""

import difflib
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
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


MEANINGS: dict[str, str] = {}
"""Descriptions of names that several modules suggest, such as effects."""

_MISSPELT, _SIMILAR = (
    0.85,
    0.6,
)  # least similarity of a mistyped word, and of a word of another meaning
_MOST_SUGGESTED = 12


def did_you_mean(word: object, accepted: Iterable[object]) -> str:
    """A hint: the accepted name of similar spelling, else those of similar meaning, else all of
    them.

    Meanings are the texts in `accepted`, if it maps names to texts, and `MEANINGS`.
    """
    texts = dict(accepted) if isinstance(accepted, Mapping) else dict.fromkeys(accepted)
    meanings = {
        str(name): text if isinstance(text, str) else MEANINGS.get(name, "")
        for name, text in texts.items()
    }
    names = sorted(meanings)
    near = difflib.get_close_matches(str(word), names, n=1, cutoff=_SIMILAR)
    if not near or difflib.SequenceMatcher(None, near[0], str(word)).ratio() < _MISSPELT:
        alike = _alike(str(word), meanings)
        near = alike if 0 < len(alike) <= _MOST_SUGGESTED else near
    if near:
        return f"did you mean {'one of ' * (len(near) > 1)}{', '.join(map(repr, near))}?"
    return f"known here: {', '.join(names)}"


def _alike(word: str, meanings: Mapping[str, str]) -> list[str]:
    """The names that share the rarest words with `word`; those of their `meanings` count half."""
    words_of = {name: (set(_words(name)), set(_words(text))) for name, text in meanings.items()}
    merits = dict.fromkeys(sorted(words_of), 0.0)
    for part in _words(word):
        having = {
            name: 1.0 if part in words else 0.5
            for name, (words, text) in words_of.items()
            if part in words | text
        }
        for name, weight in having.items():
            merits[name] += weight / len(having)
    best = max(merits.values(), default=0.0)
    return [name for name, merit in merits.items() if merit == best > 0.0]


def _words(text: str) -> list[str]:
    """Words of three letters or more in lower case, without the s of a plural."""
    return [word.removesuffix("s") for word in re.findall("[a-z]{3,}", text.lower())]
