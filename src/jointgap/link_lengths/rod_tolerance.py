"""What the tolerance of the rod's length does to the error, the motion in the joints frozen."""

from scipy.optimize import brentq

from jointgap.link_lengths.objective import Objective

_MOST = 0.01
"""Share of the rod's length up to which a deviation is looked at."""


def it7(length: float) -> float:
    """Width of the tolerance IT7 for a length [m]: 16 tolerance units of ISO 286-1, not rounded to its steps."""
    mm = 1e3 * length
    unit = 0.45 * mm ** (1 / 3) + 0.001 * mm if mm <= 500.0 else 0.004 * mm + 2.1
    return 16e-6 * unit


def effect(objective: Objective, lengths: tuple[float, float], tolerance: float | None) -> dict[str, float]:
    """Columns of the table optimise_optima on the rod's tolerance."""
    crank, rod = map(float, lengths)
    width = it7(rod) if tolerance is None else tolerance
    original = float(objective.measures(objective.original).rms)

    def rms(deviation: float) -> float:
        return max(float(objective.measures((crank, rod + side * deviation)).rms) for side in (-1, 1))

    allowed = 0.0
    if rms(0.0) < original:
        most = _MOST * rod
        allowed = most if rms(most) <= original else brentq(lambda deviation: rms(deviation) - original, 0.0, most)
    return {"rod_tolerance": width, "rms_rod_off": rms(width / 2), "rod_deviation_allowed": float(allowed)}
