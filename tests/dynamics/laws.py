"""One loose joint for the tests of its laws."""

from jointgap.dynamics.model.parameters import JointParameters


def joint(**changed) -> JointParameters:
    """A steel journal of 7 mm in a bearing of 8 mm on the body: elastic, dry, without friction but for what is
    `changed`.
    """
    values = {
        "loose": True,
        "clearance": 1e-3,
        "body_radius": 0.008,
        "partner_radius": 0.007,
        "stiffness": 3.6e10,
        "friction_speed": 1e-3,
        "stribeck_speed": 0.0,
        "film_clearance": 0.0,
    }
    return JointParameters(**{**values, **changed})
