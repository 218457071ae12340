"""Errors that a user can mend."""

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Something the user gave cannot be used; the message names it and says what to do."""


class SimulationError(RuntimeError):
    """A simulation could not go on; the message holds time, crank angle and state."""


def did_you_mean(word: str, accepted: Iterable[str]) -> str:
    """A hint at the nearest known name, or the list of known names when none is near.

    Parameters
    ----------
    word : str
        What the user wrote.
    accepted : iterable of str
        What would have been accepted.

    Returns
    -------
    str
        A sentence such as ``did you mean 'friction'?``.
    """
    names = sorted(accepted)
    near = difflib.get_close_matches(word, names, n=1, cutoff=0.6)
    if near:
        return f"did you mean '{near[0]}'?"
    return f"known here: {', '.join(names)}"
