"""Mechanisms that other codes simulate too."""

import math

import numpy as np

from jointgap.config import Mechanism, Simulate
from jointgap.motion.slider_crank import simulate

SPEED = 20 * math.pi
POSITIONS = ["rod_position_x", "rod_position_y", "rod_angle", "slider_position"]

JOURNALS = {"crank_pivot": "frame", "crank_pin": "crank", "piston_pin": "slider"}


def mechanism(
    loose=("crank_pin", "piston_pin"), offset=0.0, restitution=0.46, journals=JOURNALS, **contact
) -> Mechanism:
    """The paper's slider-crank with some of its joints loose; `contact` holds further keys of their
    contact."""
    steel = {"law": "lankarani_nikravesh", "restitution": restitution, "memory": "published"}
    steel |= contact
    joint = {"journal_radius": 0.007, "bearing_radius": 0.008, "contact": steel}
    return Mechanism.model_validate(
        {
            "crank": {"length": 0.15, "mass": 0.3704, "inertia": 1.458e-3, "mass_centre": 0.075},
            "rod": {"length": 0.564, "mass": 0.773, "inertia": 2.482e-2, "mass_centre": 0.25},
            "slider": {"mass": 0.4482, "offset": offset},
            "joints": {
                name: joint | {"journal": journals[name], "loose": name in loose}
                for name in JOURNALS
            },
        }
    )


def friction(coefficient=0.1, speed=0.01) -> dict:
    """Keys of a contact whose friction rises along a straight line up to `speed` [m/s]: Exudyn's
    law."""
    law = {"friction_law": "ambrosio", "friction_speed": speed, "dead_band_speed": 0.0}
    return {"friction": coefficient} | law


def options(**changed) -> Simulate:
    defaults = {"speed": SPEED, "revolutions": 1, "samples_per_revolution": 360}
    return Simulate(**defaults | {"tolerance": 1e-14} | changed)


def positions(made: Mechanism, start_angle=0.0, perturbation=None) -> np.ndarray:
    """Rod's mass centre, rod angle and slider at 0, 1 ... 360 degrees from the start, shape (361,
    4)."""
    return (
        simulate(made, options(start_angle=start_angle), perturbation).samples[POSITIONS].to_numpy()
    )
