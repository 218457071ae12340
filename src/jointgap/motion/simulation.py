"""Simulation of one mechanism: a slider-crank or any planar linkage."""

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.contact.joints import FLIGHT
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.joints import JOINT, JOINTS
from jointgap.core.records import Record
from jointgap.core.schema import EVENTS, TRAJECTORY
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
from jointgap.motion.model import (
    Columns,
    Model,
    Workspace,
    beginning,
    corner_names,
    linkage_model,
)
from jointgap.motion.sampling import fill_samples
from jointgap.motion.slider_crank import lengths_of, model_of
from jointgap.motion.workspace import HERE


def perturbed_start(vectors: np.ndarray, loose: Collection[str]) -> np.ndarray:
    """Initial clearance vectors, of one start or several: `vectors` in loose joints, zero in ideal
    ones."""
    return np.where(np.repeat([joint in loose for joint in JOINTS], 2), vectors, 0.0)


def start_state(model: Model, perturbation=None) -> np.ndarray:
    """State (states,) of a slider-crank with given clearance vectors and zero rates; by default the
    ideal mechanism's positions and velocities."""
    vectors = np.zeros(4) if perturbation is None else np.asarray(perturbation, dtype=float)
    if vectors.shape not in ((4,), (6,)) or not np.isfinite(vectors).all():
        raise InputError(
            f"perturbation {vectors.tolist()} must be four or six finite lengths in m: r2 x, r2 y,"
            " r3 x, r3 y, r1 x, r1 y"
        )
    vectors = np.append(vectors, np.zeros(6 - vectors.size))
    y = model.start()
    for joint in JOINT.values():
        vector = vectors[joint.components]
        length = math.hypot(*vector)
        if length > 0 and joint.name not in model.loose:
            raise InputError(
                f"perturbation of the {joint.words}: r{joint.number} is {length:g} m, but the joint"
                " is ideal; set it to 0"
            )
        clearance = model.bearings[joint.name].clearance
        if length >= clearance:
            raise InputError(
                f"perturbation of the {joint.words}: {length:g} m is not less than its clearance of"
                f" {clearance:g} m; a simulation starts without contact"
            )
        model.vector(y, joint.name)[0][:] = vector
    crank, rod, offset = lengths_of(model)
    angle = model.drive.start_angle
    rise = offset + vectors[3] - crank * math.sin(angle) - vectors[1] - vectors[5]
    if abs(rise) >= rod:
        raise InputError(
            f"the rod of {rod:g} m does not reach the slide {abs(rise):g} m away at crank angle"
            f" {math.degrees(angle):g} deg; lengthen the rod or shorten the crank"
        )
    return y


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
    STALLED: "give the motor more torque or inertia, or less load",
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


def simulate(mechanism: Mechanism, options: Simulate, perturbation=None) -> Trajectory:
    """Simulate a slider-crank with loose or ideal joints.

    The motion starts with coincident joint centres and the velocities of the ideal mechanism.
    """
    if options.speed < 0:
        return _clockwise(mechanism, options, perturbation)
    model = model_of(mechanism, options)
    angles = crank_angles(options)
    run = integrate_to_angles(model, start_state(model, perturbation), angles, options.tolerance)
    columns = observed(model, run)
    _check_finite(columns, run.times)
    columns |= modes_of(model, run, JOINTS)
    columns["crank_angle"] = angles  # exact; a motor's simulated crank angle has rounding errors
    frame = pd.DataFrame({column.name: columns[column.name] for column in TRAJECTORY.columns})
    return Trajectory(samples=frame, events=event_frame(model, run), steps=run.steps)


def modes_of(model: Model, found: Samples, joints: Collection[str]) -> Columns:
    """Modes by words at the samples: columns ``crank_pin_mode``, ..."""
    ideal = np.zeros(found.times.size, np.int64)
    by_joint = {
        name: mode_numbers(found, model.contacts.index(name)) if name in model.contacts else ideal
        for name in joints
    }
    words = np.array(MODES, dtype=object)
    return {f"{name}_mode": words[modes] for name, modes in by_joint.items()}


def _clockwise(mechanism: Mechanism, options: Simulate, perturbation) -> Trajectory:
    """`simulate` for a clockwise crank, by its mirror image."""
    behind = options.model_copy(
        update={"speed": -options.speed, "start_angle": -options.start_angle}
    )
    if perturbation is not None:
        perturbation = np.asarray(perturbation, dtype=float) * np.resize(
            [1.0, -1.0], np.shape(perturbation)
        )
    seen = simulate(mechanism.applied().mirrored(), behind, perturbation)
    samples = seen.samples.copy()
    for name in samples:
        if _turns_sign(name):
            samples[name] = -samples[name]
    samples["transmission_angle"] = math.pi - samples["transmission_angle"]
    return Trajectory(
        samples, seen.events.assign(crank_angle=-seen.events["crank_angle"]), seen.steps
    )


def _turns_sign(name: str) -> bool:
    """Whether a column of the trajectory changes its sign in the mirror image in the line y = 0."""
    across = name.endswith(("_y", "_friction_force", "_torque")) or name.startswith(
        ("crank_a", "crank_s", "gamma")
    )
    return (
        across
        or (name.startswith(("guide_", "rod_a")) and "acceleration_x" not in name)
        or name == "rod_deflection"
    )


def crank_angles(options: Simulate) -> np.ndarray:
    """Crank angles [rad] of the samples, both ends included."""
    turned = np.arange(options.revolutions * options.samples_per_revolution + 1) * (
        2 * math.pi / options.samples_per_revolution
    )
    return options.start_angle + turned


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
) -> tuple[Samples, Workspace]:
    """Continue an integration exactly from the end of another one."""
    p, workspace = model.p, earlier.copy()
    times = crank_times(p, angles)
    if p.drive.kind == MEASURED:
        _check_reached(model, times, angles)
    samples = model.room_for(times)
    revolutions = max((angles[-1] - earlier.crank_angle) / (2 * math.pi), 1.0)
    limit = math.ceil((steps_per_revolution or STEPS_PER_REVOLUTION) * revolutions)
    fine, k = _fine_enough(model, tolerance), workspace.k
    status, events, steps = integrate(p, k, samples, angles, fine, limit)
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
    if status == TOO_MANY_STEPS:
        contacts = _format_contacts(model, k, events)
        advice = f"{contacts}; {advice}, or friction that makes a journal whirl"
        if model.is_free and abs(_crank_speed(model, k)) < _CREEPING * model.drive.no_load_speed:
            advice = f"the crank almost stands still; {FAILURE_ADVICE[STALLED]}"
    return (
        f"the simulation {FAILURES[status].format(limit=limit)} at time {k.time[HERE]:.9g} s,"
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
    return ", ".join(texts) or "no joint is loose"


def _check_finite(columns: dict[str, np.ndarray], times: np.ndarray) -> None:
    """SimulationError where a quantity besides the motion, such as the torque on a prescribed
    crank, is not finite."""
    for name, values in columns.items():
        if name.startswith("gamma") or np.isfinite(values).all():
            continue
        sample = int(np.flatnonzero(~np.isfinite(values))[0])
        state = ", ".join(
            f"{key} {columns[key][sample]:.9g}"
            for key in ("crank_speed", "slider_position", "rod_angle")
        )
        raise SimulationError(
            f"{name} is not finite at time {times[sample]:.9g} s, crank angle"
            f" {math.degrees(columns['crank_angle'][sample]):.6g} deg (state in SI: {state});"
            f" {FAILURE_ADVICE[NOT_FINITE]}"
        )


def event_frame(model: Model, found: Samples) -> pd.DataFrame:
    """The table ``events``."""
    rows = dict(zip(EVENT, found.events.T, strict=True))
    rows["joint"] = np.array([*model.contacts, ""], dtype=object)[rows["joint"].astype(int)]
    rows["event"] = EVENT_NAMES[rows.pop("begins").astype(int)]
    return pd.DataFrame({column.name: rows[column.name] for column in EVENTS.columns})


# ---- any linkage


def simulate_linkage(file: LinkageFile, options: Simulate) -> Trajectory:
    """Simulate a planar linkage with loose or ideal joints.

    The motion starts with coincident joint centres and the velocities of the ideal linkage.

    Parameters
    ----------
    file : LinkageFile
        The linkage.
    options : Simulate
        Drive, duration and sampling.

    Returns
    -------
    Trajectory
        Columns of the samples by rule, see `published`; ``attrs["units"]`` has their units.

    Raises
    ------
    InputError
        See `jointgap.motion.model.linkage_model`.
    SimulationError
        The integration fails; the message has time, crank angle and state.
    """
    if options.speed < 0:
        return _linkage_clockwise(file, options)
    model = linkage_model(file, options)
    angles = crank_angles(options)
    run = integrate_to_angles(model, model.start(), angles, options.tolerance)
    columns = published(model, observed(model, run)) | modes_of(model, run, model.pins)
    columns["crank_angle"] = angles  # exact; a motor's simulated crank angle has rounding errors
    samples = pd.DataFrame(columns)
    samples.attrs["units"] = {name: model.units.get(name, "") for name in columns}
    return Trajectory(samples, event_frame(model, run), run.steps)


def published(model: Model, columns: Columns) -> Columns:
    """The quantities of a linkage's trajectory, by the rule

    - ``time``; of the driven body ``crank_angle``, ``crank_speed``, ``crank_acceleration``,
      ``crank_torque``;
    - a body on a slide of the frame: ``BODY_position``, ``_velocity``, ``_acceleration``;
    - another body: ``BODY_angle``, ``_angular_velocity``, ``_angular_acceleration``, and of its
      mass centre ``_position_x``, ``_velocity_x``, ``_acceleration_x``, and ``_y``;
    - a slide: ``SLIDE_force``, across it, and ``SLIDE_moment``;
    - a revolute joint: ``JOINT_force_x``, ``_force_y``, if loose also ``_normal_force``,
      ``_friction_force``, ``_mode``, ``r_JOINT``, ``gamma_JOINT`` and rates;
    - ``shaking_force_x``, ``_y``: sum of the forces on the frame.
    """
    found = {name: values for name, values in columns.items() if not name.startswith("frame_")}
    for name, values in found.items():
        if name.endswith("_angle") and name != "crank_angle":
            found[name] = np.unwrap(values)
    return found


def _linkage_clockwise(file: LinkageFile, options: Simulate) -> Trajectory:
    """`simulate_linkage` for a clockwise crank, by the mirror image in the line y = 0."""
    ahead = options.model_copy(
        update={"speed": -options.speed, "start_angle": -options.start_angle}
    )
    seen = simulate_linkage(file.mirrored(), ahead)
    samples, units = seen.samples.copy(), seen.samples.attrs["units"]
    across = {f"{name}_force" for name in file.slides}
    across |= {f"{name}_force_y" for name in (*file.shared_by_two, "shaking")}
    across |= {f"{name}_friction_force" for name in file.loose_pins}
    across |= {f"{name}_offset{rate}" for name in file.slides for rate in ("", "_dot", "_ddot")}
    across |= {
        f"{name}_{what}_y"
        for name in file.bodies
        for what in ("position", "velocity", "acceleration")
    }
    for name, unit in units.items():
        if name in across or unit.startswith(("rad", "N*m")):
            samples[name] = -samples[name]
    other_side = {
        name: mirrored
        for slide in file.slides
        for name, mirrored in zip(corner_names(slide), corner_names(slide)[::-1], strict=True)
    }
    events = seen.events.assign(crank_angle=-seen.events["crank_angle"])
    events["joint"] = events["joint"].replace(other_side)
    return Trajectory(samples, events, seen.steps)
