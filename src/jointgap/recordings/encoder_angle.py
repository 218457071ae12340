"""A crank angle as an encoder tells it, made to run on over turns and across gaps."""

import math

import numpy as np

TURN = 2.0 * math.pi


def running_on(time: np.ndarray | None, angle: np.ndarray, speed: float) -> np.ndarray:
    """Angles that run on, of angles that fall back after one turn or several, or run on themselves.

    Every step is known but for whole turns. With times, the number of turns is the one nearest to what the mean speed lets
    expect, so that gaps and few samples a turn do no harm. Without, a step is taken as less than half a turn.

    Parameters
    ----------
    time : (n,) array or None
        [s], rising.
    angle : (n,) array
        [rad]; NaN in gaps.
    speed : float
        Expected [rad/s].

    Returns
    -------
    (n,) array
        [rad]; begins where `angle` does.
    """
    known = np.flatnonzero(np.isfinite(angle))
    found = np.full(angle.shape, np.nan)
    if not known.size:
        return found
    steps = np.diff(angle[known])
    if time is None:
        whole = _nearest(steps, np.zeros(steps.size))
    else:
        lapse = np.diff(time[known])
        whole = _nearest(steps, speed * lapse)
        short = speed * lapse < TURN / 4
        if short.any():  # across gaps the speed as measured is a better guide than the nominal one
            whole = _nearest(steps, whole[short].sum() / lapse[short].sum() * lapse)
    found[known] = angle[known[0]] + np.append(0.0, np.cumsum(whole))
    return found


def _nearest(steps: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """`steps` and as many whole turns as bring them nearest to what is `expected`."""
    return steps + TURN * np.round((expected - steps) / TURN)
