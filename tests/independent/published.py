"""The slider-crank of Flores and co-authors: one loose joint, between rod and slider; see
docs/simulation.md."""

import math

import pandas as pd

from jointgap.config import Mechanism, Simulate
from jointgap.motion.slider_crank import simulate

SPEED = 5000 * 2 * math.pi / 60
CRANK, ROD = 0.05, 0.12
BEARING_RADIUS, CLEARANCE = 0.01, 0.5e-3
SAMPLES = 7200  # in a revolution


def mechanism(clearance=CLEARANCE, friction=0.0) -> Mechanism:
    """Without friction it does not matter which body carries the journal."""
    steel = {"law": "lankarani_nikravesh", "youngs_modulus": 207e9, "poisson_ratio": 0.3}
    steel |= {"restitution": 0.9, "memory": "published", "friction": friction}
    pin = {"journal": "slider", "bearing_radius": BEARING_RADIUS, "contact": steel}
    pin["journal_radius"] = BEARING_RADIUS - clearance
    return Mechanism.model_validate(
        {
            "crank": {"length": CRANK, "mass": 0.30, "inertia": 1e-4, "mass_centre": CRANK / 2},
            "rod": {"length": ROD, "mass": 0.21, "inertia": 2.5e-4, "mass_centre": ROD / 2},
            "slider": {"mass": 0.14},
            "joints": {"crank_pivot": "ideal", "crank_pin": "ideal", "piston_pin": pin},
        }
    )


def run(revolutions=2, speed=SPEED, perturbation=None, **changed) -> pd.DataFrame:
    """Samples of a simulation from dead centre; `changed` as for `mechanism`."""
    options = Simulate(
        speed=speed, revolutions=revolutions, samples_per_revolution=SAMPLES, tolerance=1e-12
    )
    return simulate(mechanism(**changed), options, perturbation).samples
