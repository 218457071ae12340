"""Whether a motion repeats after a number of revolutions."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jointgap.errors import InputError

REPEATS = 1e-3
"""Share of the smallest clearance within which a motion is said to repeat: the depth of a contact, and no more."""


@dataclass(frozen=True)
class Periodicity:
    """The verdict and the numbers behind it.

    Attributes
    ----------
    distances : (m,) array
        By number n of revolutions, from 1: largest distance of the clearance vectors over the last n revolutions from those
        over the n before [m].
    clearance : float
        Smallest clearance [m].
    """

    distances: np.ndarray
    clearance: float

    @property
    def period(self) -> int | None:
        """Smallest number of revolutions after which the motion repeats; None where it does not."""
        repeats = np.flatnonzero(self.distances <= REPEATS * self.clearance)
        return int(repeats[0]) + 1 if len(repeats) else None

    @property
    def verdict(self) -> str:
        """One sentence for the user."""
        nearest = self.period or int(np.argmin(self.distances)) + 1
        away = self.distances[nearest - 1]
        words = f"{away:.2g} m, {away / self.clearance:.2g} of the clearance"
        if self.period is None:
            return f"no period within {_revolutions(len(self.distances))}: after {nearest} it comes back nearest, to {words}"
        return f"period {self.period}: it repeats after {_revolutions(self.period)} to {words}"


def _revolutions(number: int) -> str:
    return f"{number} revolution{'s' * (number > 1)}"


def periodicity(vectors: ArrayLike, per_turn: int, clearance: float) -> Periodicity:
    """Compare the last n revolutions with the n before, for every n that there is room for.

    Parameters
    ----------
    vectors : (n, d) array_like
        Clearance vectors of all loose joints at samples uniform in crank angle [m].
    per_turn : int
        Samples per revolution; n - 1 is a multiple of it.
    clearance : float
        Smallest clearance [m].

    Raises
    ------
    InputError
        Less than two revolutions.
    """
    vectors = np.asarray(vectors)
    revolutions = (len(vectors) - 1) // per_turn
    if revolutions < 2:
        raise InputError(f"a period cannot be told from {revolutions} revolution; simulate two or more that count")
    distances = []
    for n in range(1, revolutions // 2 + 1):
        length = n * per_turn
        apart = vectors[-length - 1 :] - vectors[-2 * length - 1 : -length]
        distances.append(np.linalg.norm(apart, axis=1).max())
    return Periodicity(np.array(distances), clearance)
