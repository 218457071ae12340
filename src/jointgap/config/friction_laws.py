"""Parameters of the friction laws by name; the laws themselves are in
`jointgap.contact.friction`."""

from typing import NamedTuple


class FrictionLaw(NamedTuple):
    """A friction law."""

    code: int  # value of `JointParameters.friction_law` in the compiled equations
    reads: tuple[str, ...] = ()  # keys of a contact besides friction and friction_speed
    slope_at_zero: float | None = (
        None  # of the coefficient over friction, by the speed over friction_speed
    )


_STRIBECK = ("static_friction", "stribeck_speed")

FRICTION_LAWS = {
    "coulomb": FrictionLaw(0, slope_at_zero=1.0),
    "threlfall": FrictionLaw(1, slope_at_zero=3.0),
    "ambrosio": FrictionLaw(2, ("dead_band_speed",)),
    "bengisu_akay": FrictionLaw(3, _STRIBECK),
    "lugre": FrictionLaw(
        4, (*_STRIBECK, "viscous_friction", "bristle_stiffness", "bristle_damping")
    ),
}
"""Laws with equal friction, and friction_speed proportional to this slope, have the same slope at
zero speed."""

FRICTION_KEYS = ("dead_band_speed", *FRICTION_LAWS["lugre"].reads)
"""Keys of a contact that only some laws read."""
