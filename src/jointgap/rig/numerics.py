"""Other numerics that are as good as the usual ones: what they make of a prediction is no disagreement."""

from collections.abc import Callable

from jointgap.dynamics.friction import FRICTION_LAWS
from jointgap.dynamics.parameters import JOINTS, Parameters

NUMERICS = (
    "friction regularised over half the speed",
    "friction regularised over twice the speed",
    "friction regularised by Threlfall's law",
    "a tenth of the tolerance",
)
"""In words."""


def otherwise(numerics: int) -> tuple[float, Callable[[Parameters], None]]:
    """Factor of the tolerance, and what changes the numbers of a simulation, for a place in `NUMERICS` counted from 1."""
    if numerics in (1, 2):
        return 1.0, lambda p: _softer(p, 0.5 if numerics == 1 else 2.0)
    if numerics == 3:
        return 1.0, _threlfall
    return (0.1 if numerics == 4 else 1.0), lambda p: None


def _softer(p: Parameters, factor: float) -> None:
    for name in JOINTS:
        joint = getattr(p, name)
        joint.friction_speed *= factor
        joint.dead_band_speed *= factor
    p.effects.slider_sign_speed *= factor
    p.effects.crank_sign_speed *= factor


def _threlfall(p: Parameters) -> None:
    for name in JOINTS:
        joint = getattr(p, name)
        if joint.friction_law == FRICTION_LAWS["coulomb"]:
            joint.friction_law = FRICTION_LAWS["threlfall"]
            joint.friction_speed *= 3.0  # the same slope at zero speed
