"""Mechanisms and runs that the tests of the dynamics share."""

import math

import numpy as np

from jointgap.config import Mechanism, Simulate
from jointgap.contact.joints import CONTACT
from jointgap.core.joints import PINS
from jointgap.motion.integrate import Samples
from jointgap.motion.model import Model, Workspace, beginning
from jointgap.motion.rates import evaluate
from jointgap.motion.runge_kutta import step
from jointgap.motion.simulation import integrate_to_angles
from jointgap.motion.slider_crank import model_of, start_state
from jointgap.motion.workspace import HERE, THERE

SPEED = 20 * math.pi
CRANK, ROD, CENTRE = 0.15, 0.564, 0.282
ALL = ("crank_pivot", *PINS)

MOTOR = {"kind": "motor", "stall_torque": 60.0, "no_load_speed": 1.5 * SPEED, "inertia": 0.02}
LUGRE = {
    "friction_law": "lugre",
    "friction": 0.1,
    "static_friction": 0.15,
    "stribeck_speed": 0.05,
    "bristle_stiffness": 1e4,
    "bristle_damping": 1.0,
    "viscous_friction": 0.6,
}


BODIES = {
    "crank": {"length": CRANK, "mass": 0.3704, "inertia": 1.458e-3, "mass_centre": 0.075},
    "rod": {"length": ROD, "mass": 0.773, "inertia": 2.482e-2, "mass_centre": CENTRE},
    "slider": {"mass": 0.4482, "offset": 0.0},
}


def joint(loose: bool, journal: str, radius: float, clearance: float, contact) -> dict:
    """A joint of a mechanism file; `journal` is the body that carries it."""
    radii = {"journal_radius": radius, "bearing_radius": radius + clearance}
    return {"loose": loose, "journal": journal, "contact": contact, **radii}


def effect(name: str, site: str | None = None, **parameters) -> dict:
    """An entry of a mechanism's effects."""
    return {"name": name, "parameters": parameters} | ({"site": site} if site else {})


def mechanism(
    *effects: dict,
    loose=PINS,
    friction=0.0,
    restitution=0.46,
    law="lankarani_nikravesh",
    journals=("crank", "slider"),
    clearance=1e-3,
    offset=0.0,
    gravity=False,
    crank=None,
    **contact,
) -> Mechanism:
    """The paper's slider-crank with a crank pivot that may be loose too; `contact` holds further
    keys of the contact, `crank` of the crank.
    """
    rebound = {} if law == "penalty" else {"restitution": restitution}
    steel = {"law": law, "friction": friction} | rebound | contact
    carriers = dict(zip(ALL, ("frame", *journals), strict=True))
    radii = dict(zip(ALL, (0.010, 0.007, 0.007), strict=True))
    own = {
        "crank": BODIES["crank"] | (crank or {}),
        "slider": BODIES["slider"] | {"offset": offset},
        "joints": {
            name: joint(name in loose, carriers[name], radii[name], clearance, steel)
            for name in ALL
        },
        "effects": [*effects, *([{"name": "gravity"}] if gravity else [])],
    }
    return Mechanism.model_validate(BODIES | own)


def options(**changed) -> Simulate:
    defaults = {"speed": SPEED, "revolutions": 1, "samples_per_revolution": 360}
    return Simulate(**defaults | {"tolerance": 1e-12} | changed)


def integrated(
    made: Mechanism, degrees, tolerance=1e-12, start_angle=0.0, **changed
) -> tuple[Model, Samples]:
    """`made` from its start, sampled at crank angles `degrees` after it (the first must be 0)."""
    model = model_of(made, options(start_angle=start_angle, **changed))
    angles = start_angle + np.radians(np.asarray(degrees, dtype=float))
    return model, integrate_to_angles(model, start_state(model), angles, tolerance)


def free_impact(made: Mechanism, mass: float, speed: float) -> tuple[Model, np.ndarray]:
    """Impact and separation (2, 9) of a rod of `mass` [kg] that hits a crank at rest head-on at
    `speed` [m/s], its mass centre in the pin.
    """
    still = made.model_copy(
        update={
            "crank": made.crank.model_copy(update={"length": 0.0, "mass_centre": 0.0}),
            "rod": made.rod.model_copy(update={"mass": mass, "mass_centre": 0.0}),
        }
    )
    model = model_of(still, options(speed=1.0))
    model.bearings["piston_pin"].clearance = 10.0
    start = state_of(model, crank_pin=(0.0, 0.0, 0.0, speed), piston_pin=(0.0, 0.0, 0.0, speed))
    until = model.bearings["crank_pin"].clearance / speed + 0.02
    return model, integrate_to_angles(model, start, np.array([0.0, until]), 1e-14).events[:2]


def state_of(model: Model, **vectors: tuple[float, float, float, float]) -> np.ndarray:
    """A state with given clearance vectors and rates, by joint."""
    y = model.start()
    for name, (x, y_, vx, vy) in vectors.items():
        place, rate = model.vector(y, name)
        place[:], rate[:] = (x, y_), (vx, vy)
    return y


def in_contact(
    model: Model, time: float, y: np.ndarray, joint: str, approach: float, begin: float
) -> Workspace:
    """An integration from the state `y`, with one `joint` in contact since `begin` [s]."""
    workspace = beginning(model, y, time)
    k, j = workspace.k, model.loose.index(joint)
    k.modes[j], k.approaches[j], k.begins[j] = CONTACT, approach, begin
    evaluate(model.p, k, HERE)
    return workspace


def order(model: Model, here: Workspace, time_map, begin: float, end: float, counts) -> float:
    """Order at which the velocities after `count` equal steps from s = `begin` to `end`
    converge."""

    def velocities(count):
        there = here.copy()
        k, s = there.k, begin
        for s1 in np.linspace(begin, end, count + 1)[1:]:
            step(model.p, k, THERE, time_map, s, s1 - s)
            k.y[HERE], k.time[HERE], s = k.y[THERE], k.time[THERE], s1
            evaluate(model.p, k, HERE)
        return k.y[HERE, model.positions : 2 * model.positions].copy()

    exact = velocities(20 * counts[-1])
    errors = [np.abs(velocities(count) - exact).max() for count in counts]
    return -np.polyfit(np.log(counts), np.log(errors), 1)[0]
