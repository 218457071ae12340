"""Other numerics that are as good as the usual ones: what they make of a prediction is no disagreement."""

from collections.abc import Callable

from jointgap.dynamics.model.friction import FRICTION_LAWS
from jointgap.dynamics.model.parameters import Parameters
from jointgap.joints import JOINTS

NUMERICS = (
    "friction regularised by Threlfall's law",
    "a tenth of the tolerance",
)
"""In words."""


def otherwise(numerics: int) -> tuple[float, Callable[[Parameters], None]]:
    """Factor of the tolerance, and what changes the numbers of a simulation, for a place in `NUMERICS` counted from 1."""
    if numerics == 1:
        return 1.0, _threlfall
    return (0.1 if numerics == 2 else 1.0), lambda p: None


def _threlfall(p: Parameters) -> None:
    for name in JOINTS:
        joint = getattr(p, name)
        if joint.friction_law == FRICTION_LAWS["coulomb"]:
            joint.friction_law = FRICTION_LAWS["threlfall"]
            joint.friction_speed *= 3.0  # the same slope at zero speed
