"""The transmission angle, equations (10) and (17)."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from jointgap.errors import InputError

_SIGNS = {1: 1.0, 2: 1.0, 3: -1.0}


def clearance_lift(vectors: Mapping[str, ArrayLike]) -> np.ndarray:
    """What the clearances add to the height that the rod has to span.

    Parameters
    ----------
    vectors : mapping of str to array_like, shape (n,)
        Lengths ``r1``, ``r2``, ``r3`` [m] and directions ``gamma1``, ``gamma2``, ``gamma3`` [rad] of the clearance
        vectors of the loose joints; ideal joints are left out. A direction is not looked at where the length is zero.

    Returns
    -------
    ndarray, shape (n,)
        r1 sin gamma1 + r2 sin gamma2 - r3 sin gamma3 [m]; the number 0 where all joints are ideal.
    """
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
    """Angle between the rod and the direction across the slide.

    Parameters
    ----------
    crank_length, rod_length : array_like
        L2, L3 [m]; may broadcast against the crank angles.
    crank_angle : array_like, shape (n,)
        theta2 [rad].
    lift : array_like, shape (n,)
        From `clearance_lift` [m]; 0 without clearance (equation 17).
    offset : float
        The slide is the line y = offset [m]; 0 in the paper.

    Returns
    -------
    ndarray
        mu [rad]: 90 deg plus the rod angle.

    Raises
    ------
    InputError
        The rod cannot reach the slide; names the worst crank angle.
    """
    cosine = (crank_length * np.sin(crank_angle) + lift - offset) / rod_length
    check_reach(cosine, crank_angle, rod_length)
    return np.arccos(cosine)


def check_reach(cosine: np.ndarray, crank_angle: ArrayLike, rod_length: ArrayLike) -> None:
    """Raise an `InputError` where the height to span, in rod lengths, is 1 or more; undefined samples pass.

    Parameters
    ----------
    cosine : ndarray
        Height to span over the rod's length.
    crank_angle, rod_length : array_like
        [rad], [m]; they broadcast with `cosine`.
    """
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
