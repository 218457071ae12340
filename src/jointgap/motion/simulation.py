"""Integration of a model to crank angles: samples, events, errors."""

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Simulate
from jointgap.contact.joints import FLIGHT
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.joints import JOINT
from jointgap.core.records import Record
from jointgap.core.schema import EVENTS
from jointgap.linkage.drive import crank_motion, crank_times
from jointgap.linkage.parameters import MEASURED
from jointgap.motion.integrate import (
    DONE,
    EVENT,
    EVENT_NAMES,
    MODES,
    NOT_FINITE,
    STALLED,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
    Samples,
    integrate,
    mode_numbers,
)
from jointgap.motion.model import Columns, Model, Workspace, beginning
from jointgap.motion.sampling import fill_samples
from jointgap.motion.workspace import HERE

STEPS_PER_REVOLUTION = 1_000_000
"""Largest mean number of steps per revolution: seconds on one core. Typical are some thousands; 10
000 to 50 000 with a journal that whirls by friction; some 100 000 at 3 rpm or with stiff bristles;
600 000 for a film combined with all other effects.
"""

COARSEST_PUBLISHED = 1e-8
"""Largest tolerance [m] for a contact of the published form. Its damping by the approach speed is
permanent, so the equations are stiff after a slow impact, and an explicit method with a larger
tolerance takes up to twenty times as many steps."""

FAILURES = {
    TOO_MANY_STEPS: "requires more than {limit} steps",
    STEP_TOO_SMALL: "requires a step below the resolution of time",
    NOT_FINITE: "gave a number that is not finite",
    STALLED: "ended because the motor stalls",
}
FAILURE_ADVICE = {
    STALLED: "give the drive more torque, speed or inertia, less load, or fewer revolutions",
    NOT_FINITE: (
        "check the effects and formulas (a root of a negative number, self-locking friction) and "
        "whether a contact is so soft that the rod leaves the slide"
    ),
}

_CREEPING = 1e-3
"""Share of a motor's no_load_speed below which it has stalled; with smooth friction laws the crank
never stops."""


@dataclass(frozen=True)
class Trajectory:
    """One simulated motion."""

    samples: (
        pd.DataFrame
    )  # One row per sample, columns of the table ``trajectory``; NaN where undefined
    events: pd.DataFrame  # One row per beginning or end of contact, columns of the table ``events``
    steps: int  # Integration steps, including rejected ones


def observed(model: Model, found: Samples) -> Columns:
    """All quantities (n,) of the samples, by name."""
    return evaluated(model, found, 0)[0]


def evaluated(
    model: Model, found: Samples, positions: int | None = None
) -> tuple[Columns, np.ndarray]:
    """`observed`, and second rates (n, positions) of the first or all positions."""
    n, workspace = found.times.size, model.workspace()
    values = np.empty((n, len(model.columns)))
    accelerations = np.empty((n, model.positions if positions is None else positions))
    fill_samples(model.p, workspace.k, found, model.bodies, values, accelerations)
    columns = model.completed(model, dict(zip(model.columns, values.T, strict=True)))
    return columns, accelerations


def modes_of(model: Model, found: Samples, joints: Collection[str]) -> Columns:
    """Modes by words at the samples: columns ``crank_pin_mode``, ..."""
    ideal = np.zeros(found.times.size, np.int64)
    by_joint = {
        name: mode_numbers(found, model.contacts.index(name)) if name in model.contacts else ideal
        for name in joints
    }
    words = np.array(MODES, dtype=object)
    return {f"{name}_mode": words[modes] for name, modes in by_joint.items()}


def crank_angles(options: Simulate) -> np.ndarray:
    """Crank angles [rad] of the samples, both ends included."""
    turned = np.arange(options.revolutions * options.samples_per_revolution + 1) * (
        2 * math.pi / options.samples_per_revolution
    )
    return options.start_angle + turned


def mirrored_drive(options: Simulate) -> Simulate:
    """The drive of the mirror image in the line y = 0."""
    return options.model_copy(update={"speed": -options.speed, "start_angle": -options.start_angle})


def integrate_to_angles(
    model: Model,
    start: np.ndarray,
    angles: np.ndarray,
    tolerance: float,
    steps_per_revolution: int | None = None,
) -> Samples:
    """Integrate from the state `start` and sample at the crank angles `angles` (n,) [rad], the
    first being the start angle."""
    workspace = beginning(model, start, crank_times(model.p, angles[:1])[0])
    return integrate_on(model, workspace, angles, tolerance, steps_per_revolution)[0]


def integrate_on(
    model: Model,
    earlier: Workspace,
    angles: np.ndarray,
    tolerance: float,
    steps_per_revolution: int | None = None,
    records: bool = False,
) -> tuple[Samples, Workspace]:
    """Continue an integration exactly from the end of another one; `records` its accepted steps
    in the workspace."""
    p, workspace = model.p, earlier.copy()
    workspace.k.records = records
    times = crank_times(p, angles)
    if p.drive.kind == MEASURED:
        _check_reached(model, times, angles)
    samples = model.room_for(times)
    revolutions = max((angles[-1] - earlier.crank_angle) / (2 * math.pi), 1.0)
    limit = math.ceil((steps_per_revolution or STEPS_PER_REVOLUTION) * revolutions)
    fine, k = _fine_enough(model, tolerance), workspace.k
    status, events, steps, workspace.taken = integrate(p, k, samples, angles, fine, limit)
    if status != DONE:
        raise SimulationError(_failure(model, k, status, events, tolerance, limit))
    return samples._replace(events=events, steps=steps), workspace


def _failure(
    model: Model, k: Record, status: int, events: np.ndarray, tolerance: float, limit: int
) -> str:
    """Error message of a failed integration."""
    advice = (
        f"use a larger tolerance than {tolerance:g} m, or check the causes of stiffness:"
        " stiffness, restitution, friction_speed or bristle_stiffness of the contacts, a small"
        " mass, an effect or its formula"
    )
    failure = FAILURES[status].format(limit=limit)
    if status == STALLED and not model.drive.stall_torque:
        failure = "ended because the free crank stops"
    if status == TOO_MANY_STEPS:
        contacts = _format_contacts(model, k, events)
        advice = f"{contacts}; {advice}, or friction that makes a journal whirl"
        fastest = max(model.drive.no_load_speed, model.drive.speed)
        if model.is_free and abs(_crank_speed(model, k)) < _CREEPING * fastest:
            advice = f"the crank almost stands still; {FAILURE_ADVICE[STALLED]}"
    return (
        f"the simulation {failure} at time {k.time[HERE]:.9g} s,"
        f" crank angle {math.degrees(k.angle[HERE]):.6g} deg ({_format_state(model, k)});"
        f" {FAILURE_ADVICE.get(status, advice)}"
    )


def _check_reached(model: Model, times: np.ndarray, angles: np.ndarray) -> None:
    """InputError where a measured angle does not pass the samples one after the other."""
    reached = crank_motion(model.p, times[-1])[0]
    if (np.diff(times) <= 0).any() or abs(reached - angles[-1]) > 1e-9 * max(abs(angles[-1]), 1.0):
        raise InputError(
            f"the measured crank angle ends at {math.degrees(reached):.9g} deg and {times[-1]:.9g}"
            f" s, the samples at {math.degrees(angles[-1]):.9g} deg; reduce the revolutions or give"
            " a longer record"
        )


def _fine_enough(model: Model, tolerance: float) -> float:
    joints = [model.bearings[name] for name in model.contacts]
    published = any(joint.damping > 0 and math.isinf(joint.memory_time) for joint in joints)
    return min(tolerance, COARSEST_PUBLISHED) if published else tolerance


def _crank_speed(model: Model, k: Record) -> float:
    """At the start of the last step [rad/s]."""
    if model.is_free:
        return float(model.crank_state(k.y[HERE])[1])
    return crank_motion(model.p, k.time[HERE])[1]


def _format_state(model: Model, k: Record) -> str:
    text = f"state in SI: crank speed {_crank_speed(model, k):.9g}"
    for name in model.loose:
        (x, y), (vx, vy) = model.vector(k.y[HERE], name)
        label = f"r{JOINT[name].number}" if name in JOINT else name
        text += f"; {label} {x:.9g}, {y:.9g}, rate {vx:.9g}, {vy:.9g}"
    return text


def _format_contacts(model: Model, k: Record, events: np.ndarray) -> str:
    """Contacts of each loose joint, to find the one that requires the steps."""
    begun, texts = events[events[:, EVENT.index("begins")] == 1], []
    for name in model.pins:
        j = model.contacts.index(name)
        (x, y), (vx, vy) = model.vector(k.y[HERE], name)
        count = int((begun[:, EVENT.index("joint")] == j).sum())
        doing = f"{JOINT[name].words if name in JOINT else name}: {count} contacts"
        if k.modes[j] != FLIGHT:
            turns = (x * vy - y * vx) / (x * x + y * y) / _crank_speed(model, k)
            doing += f", in contact, circling its clearance {turns:.3g} times per turn of the crank"
        texts.append(doing)
    for j, name in enumerate(model.contacts[len(model.pins) :], len(model.pins)):
        count = int((begun[:, EVENT.index("joint")] == j).sum())
        texts.append(f"{name}: {count} contacts")
    return ", ".join(texts) or "no joint is loose"


def event_frame(model: Model, found: Samples) -> pd.DataFrame:
    """The table ``events``."""
    rows = dict(zip(EVENT, found.events.T, strict=True))
    rows["joint"] = np.array([*model.contacts, ""], dtype=object)[rows["joint"].astype(int)]
    rows["event"] = EVENT_NAMES[rows.pop("begins").astype(int)]
    return pd.DataFrame({column.name: rows[column.name] for column in EVENTS.columns})
