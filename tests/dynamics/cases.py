"""Mechanisms and runs that the tests of the dynamics share."""

import math

import numpy as np

from jointgap.config import Mechanism, Simulate
from jointgap.dynamics.observe import COLUMNS, observe
from jointgap.dynamics.parameters import Parameters, parameters
from jointgap.dynamics.simulate import March, run_march
from jointgap.dynamics.start import start_state

SPEED = 20 * math.pi


def mechanism(
    friction=0.0,
    restitution=0.46,
    law="lankarani_nikravesh",
    journals=("crank", "slider"),
    bearing_radius=0.008,
    offset=0.0,
    gravity=False,
    **contact,
) -> Mechanism:
    """The paper's slider-crank; `contact` holds further keys of the contact, e.g. its stiffness."""
    steel = {"law": law, "restitution": restitution, "friction": friction, **contact}
    pins = [
        {"journal": journal, "journal_radius": 0.007, "bearing_radius": bearing_radius, "contact": steel}
        for journal in journals
    ]
    return Mechanism.model_validate(
        {
            "crank": {"length": 0.15, "mass": 0.3704, "inertia": 1.458e-3, "mass_centre": 0.075},
            "rod": {"length": 0.564, "mass": 0.773, "inertia": 2.482e-2, "mass_centre": 0.282},
            "slider": {"mass": 0.4482, "offset": offset},
            "joints": {"crank_pin": pins[0], "piston_pin": pins[1]},
            "effects": [{"name": "gravity"}] if gravity else [],
        }
    )


def options(**changed) -> Simulate:
    return Simulate(**{"speed": SPEED, "revolutions": 1, "samples_per_revolution": 360, "tolerance": 1e-12, **changed})


def marched(made: Mechanism, degrees, tolerance=1e-12, start_angle=0.0) -> tuple[Parameters, March]:
    """`made` from its start, sampled at crank angles `degrees` after it (the first must be 0)."""
    p = parameters(made, SPEED, start_angle)
    times = np.radians(np.asarray(degrees, dtype=float)) / SPEED
    return p, run_march(p, start_state(p), times, tolerance)


def observed(p: Parameters, run: March, times: np.ndarray) -> dict[str, np.ndarray]:
    """Everything to be seen of `run` at its samples, by column."""
    seen = observe(p, times, run.states, run.modes, run.approaches, run.directions)
    return dict(zip(COLUMNS, seen.T, strict=True))
