"""A loose joint for tests of its laws."""

import numpy as np
from scipy.integrate import quad
from scipy.special import betainc

from jointgap.contact.parameters import JointParameters


def faded_damping(numbers, approach, since) -> np.ndarray:
    """Damping [s/m] of a contact `since` [s] it began: a smooth step of ninth order is an
    incomplete beta integral."""
    share = np.clip((since - numbers.memory_time) / numbers.fading_time, 0.0, 1.0)
    step = betainc(5.0, 5.0, share)
    return (1 - step) * numbers.damping / approach + step * numbers.steady_contact_damping


def impact_duration(stiffness: float, exponent: float, mass: float, speed: float) -> float:
    """How long [s] an elastic impact lasts: twice the integral of dt = dd / d' from the balance of
    energy."""
    deepest = ((exponent + 1) * mass * speed**2 / (2 * stiffness)) ** (1 / (exponent + 1))
    # d = deepest sin^2(u) removes the singularity at the turning point
    half, _ = quad(
        lambda u: 2 * np.sin(u) * np.cos(u) / np.sqrt(1 - np.sin(u) ** (2 * exponent + 2)),
        0,
        np.pi / 2,
        epsrel=1e-12,
    )
    return 2 * half * deepest / speed


def joint(**changed) -> JointParameters:
    """A steel journal of 7 mm in a bearing of 8 mm: elastic, dry, frictionless by default."""
    radii = {"clearance": 1e-3, "body_radius": 0.008, "partner_radius": 0.007}
    law = {"stiffness": 3.6e10, "friction_speed": 1e-3, "stribeck_speed": 0.0}
    values = {"loose": True, "film_clearance": 0.0} | radii | law
    return JointParameters(**{**values, **changed})
