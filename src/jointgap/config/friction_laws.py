"""The friction laws by name; as functions of the sliding speed they stand in `jointgap.dynamics.friction`."""

from typing import NamedTuple


class FrictionLaw(NamedTuple):
    """A friction law."""

    code: int  # what `JointParameters.friction_law` holds in the compiled equations
    reads: tuple[str, ...] = ()  # keys of a contact beyond friction and friction_speed
    slope_at_zero: float | None = None  # of the coefficient over friction and of the speed over friction_speed


_STRIBECK = ("static_friction", "stribeck_speed")

FRICTION_LAWS = {
    "coulomb": FrictionLaw(0, slope_at_zero=1.0),
    "threlfall": FrictionLaw(1, slope_at_zero=3.0),
    "ambrosio": FrictionLaw(2, ("dead_band_speed",)),
    "bengisu_akay": FrictionLaw(3, _STRIBECK),
    "lugre": FrictionLaw(4, (*_STRIBECK, "viscous_friction", "bristle_stiffness", "bristle_damping")),
}
"""Two laws with the same friction and with friction_speed proportional to the slope at zero rise alike at the start."""

FRICTION_KEYS = ("dead_band_speed", *FRICTION_LAWS["lugre"].reads)
"""Keys of a contact that not every law reads."""
