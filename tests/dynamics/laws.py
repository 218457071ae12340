"""One loose joint for the tests of its laws."""

from collections import namedtuple

JointParameters = namedtuple(
    "JointParameters",
    "loose clearance body_radius partner_radius side stiffness exponent damping penalty_damping penalty_depth "
    "friction_law friction friction_speed dead_band_speed static_friction stribeck_speed viscous_friction "
    "bristle_stiffness bristle_damping film_viscosity film_length film_clearance film_least pin_friction pin_radius",
)


def joint(**changed) -> JointParameters:
    """A steel journal of 7 mm in a bearing of 8 mm on the body: elastic, dry, without friction but for what is `changed`."""
    values = {
        "loose": True,
        "clearance": 1e-3,
        "body_radius": 0.008,
        "partner_radius": 0.007,
        "side": -1.0,
        "stiffness": 3.6e10,
        "exponent": 1.5,
        "damping": 0.0,
        "penalty_damping": 0.0,
        "penalty_depth": 0.0,
        "friction_law": 0,
        "friction": 0.0,
        "friction_speed": 1e-3,
        "dead_band_speed": 0.0,
        "static_friction": 0.0,
        "stribeck_speed": 0.0,
        "viscous_friction": 0.0,
        "bristle_stiffness": 0.0,
        "bristle_damping": 0.0,
        "film_viscosity": 0.0,
        "film_length": 0.0,
        "film_clearance": 0.0,
        "film_least": 0.0,
        "pin_friction": 0.0,
        "pin_radius": 0.0,
    }
    return JointParameters(**{**values, **changed})
