"""The transmission angle, equations (10) and (17)."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from jointgap.errors import InputError

_SIGNS = {1: 1.0, 2: 1.0, 3: -1.0}


def clearance_lift(vectors: Mapping[str, ArrayLike]) -> np.ndarray:
    """What the clearances add to the height that the rod has to span."""
    lift = np.zeros(())
    for number, sign in _SIGNS.items():
        if (name := f"r{number}") in vectors:
            length = np.asarray(vectors[name])
            lift = lift + sign * np.where(length == 0.0, 0.0, length * np.sin(vectors[f"gamma{number}"]))
    return lift


def transmission_angle(
    crank_length: ArrayLike,
    rod_length: ArrayLike,
    crank_angle: ArrayLike,
    lift: ArrayLike = 0.0,
    offset: float = 0.0,
) -> np.ndarray:
    """Angle between the rod and the direction across the slide."""
    cosine = (crank_length * np.sin(crank_angle) + lift - offset) / rod_length
    check_reach(cosine, crank_angle, rod_length)
    return np.arccos(cosine)


def check_reach(cosine: np.ndarray, crank_angle: ArrayLike, rod_length: ArrayLike) -> None:
    """Raise an `InputError` where the height to span, in rod lengths, is 1 or more; undefined samples pass."""
    span = np.abs(cosine)
    if not np.any(span >= 1.0):
        return
    worst = np.unravel_index(np.nanargmax(span), span.shape)
    angle = np.real(np.broadcast_to(crank_angle, span.shape)[worst])
    length = np.broadcast_to(rod_length, span.shape)[worst]
    raise InputError(
        f"the rod of {1e3 * length:g} mm cannot reach the slide at crank angle {np.degrees(angle):.4g} deg: its crank "
        f"end is {1e3 * length * span[worst]:.6g} mm off the slide's line; shorten the crank or lengthen the rod"
    )
