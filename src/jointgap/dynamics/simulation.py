"""Simulation of one mechanism."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Simulate
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.joints import JOINT, JOINTS
from jointgap.core.schema import EVENTS, TRAJECTORY
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.drive import crank_motion, crank_times
from jointgap.dynamics.equations import AUXILIARY_STATES, STATES
from jointgap.dynamics.integrate import (
    DONE,
    EVENT,
    EVENT_NAMES,
    NOT_FINITE,
    STALLED,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
    Progress,
    beginning,
    integrate,
    sample_modes,
)
from jointgap.dynamics.joints import FLIGHT, clearances
from jointgap.dynamics.parameters import MEASURED, MOTOR, Parameters
from jointgap.dynamics.runge_kutta import Instant, room_for_stages
from jointgap.dynamics.sampling import SAMPLE, fill_samples


def perturbed_start(vectors: np.ndarray, loose: Collection[str]) -> np.ndarray:
    """Initial clearance vectors, of one start or several: `vectors` in loose joints, zero in ideal
    ones."""
    return np.where(np.repeat([joint in loose for joint in JOINTS], 2), vectors, 0.0)


def start_state(p: Parameters, perturbation=None) -> tuple[np.ndarray, np.ndarray]:
    """State with given clearance vectors and zero rates; by default the ideal mechanism's positions
    and velocities."""
    vectors = np.zeros(4) if perturbation is None else np.asarray(perturbation, dtype=float)
    if vectors.shape not in ((4,), (6,)) or not np.isfinite(vectors).all():
        raise InputError(
            f"perturbation {vectors.tolist()} must be four or six finite lengths in m: r2 x, r2 y,"
            " r3 x, r3 y, r1 x, r1 y"
        )
    vectors = np.append(vectors, np.zeros(6 - vectors.size))
    for joint in JOINT.values():
        length, numbers = math.hypot(*vectors[joint.components]), getattr(p, joint.name)
        if length > 0 and not numbers.loose:
            raise InputError(
                f"perturbation of the {joint.words}: r{joint.number} is {length:g} m, but the joint"
                " is ideal; set it to 0"
            )
        if length >= numbers.clearance:
            raise InputError(
                f"perturbation of the {joint.words}: {length:g} m is not less than its clearance of"
                f" {numbers.clearance:g} m; a simulation starts without contact"
            )
    b, d = p.bodies, p.drive
    rise = (
        b.slider_offset
        + vectors[3]
        - b.crank_length * math.sin(d.start_angle)
        - vectors[1]
        - vectors[5]
    )
    if abs(rise) >= b.rod_length:
        raise InputError(
            f"the rod of {b.rod_length:g} m does not reach the slide {abs(rise):g} m away at crank"
            f" angle {math.degrees(d.start_angle):g} deg; lengthen the rod or shorten the crank"
        )
    y, x = np.zeros(STATES), np.zeros(AUXILIARY_STATES)
    y[:4], x[:2] = vectors[:4], vectors[4:]
    x[2], x[6] = d.start_angle, d.speed
    return y, x


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


class IntegrationResult(NamedTuple):
    """Samples and events of one integration in the form of compiled code."""

    times: np.ndarray
    states: np.ndarray
    auxiliary_states: np.ndarray
    modes: np.ndarray
    approaches: np.ndarray
    begins: np.ndarray
    directions: np.ndarray
    events: np.ndarray
    steps: int

    def part(self, chosen: slice | np.ndarray) -> "IntegrationResult":
        """The `chosen` samples only, with all events."""
        return IntegrationResult(*(values[chosen] for values in self[:-2]), *self[-2:])

    def observed(self, p: Parameters) -> dict[str, np.ndarray]:
        """All quantities of the samples, by column of `jointgap.dynamics.sampling.SAMPLE`, (n,)
        each."""
        samples = np.empty(self.times.size, SAMPLE)
        fill_samples(p, self, samples)
        return {name: samples[name] for name in SAMPLE.names}


def simulate(mechanism: Mechanism, options: Simulate, perturbation=None) -> Trajectory:
    """Simulate a slider-crank with loose or ideal joints.

    The motion starts with coincident joint centres and the velocities of the ideal mechanism.
    """
    if options.speed < 0:
        return _clockwise(mechanism, options, perturbation)
    p = parameters(mechanism, options)
    angles = crank_angles(options)
    run = integrate_to_angles(p, start_state(p, perturbation), angles, options.tolerance)
    columns = run.observed(p)
    _check_finite(columns, run.times)
    columns |= sample_modes(p, run.times, run.modes, run.events)
    columns["crank_angle"] = angles  # exact; a motor's simulated crank angle has rounding errors
    frame = pd.DataFrame({column.name: columns[column.name] for column in TRAJECTORY.columns})
    return Trajectory(samples=frame, events=event_frame(run.events), steps=run.steps)


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
    p: Parameters,
    start: tuple[np.ndarray, np.ndarray],
    angles: np.ndarray,
    tolerance: float,
    steps_per_revolution: int | None = None,
) -> IntegrationResult:
    """Integrate from `start` and sample at the crank angles `angles` (n,) [rad], the first being
    the start angle."""
    progress = beginning(p, *start, crank_times(p, angles[:1])[0])
    return integrate_on(p, progress, angles, tolerance, steps_per_revolution)[0]


def integrate_on(
    p: Parameters,
    progress: Progress,
    angles: np.ndarray,
    tolerance: float,
    steps_per_revolution: int | None = None,
) -> tuple[IntegrationResult, Progress]:
    """Continue an integration exactly from the end of another one."""
    n = angles.size
    times = crank_times(p, angles)
    if p.drive.kind == MEASURED:
        _check_reached(p, times, angles)
    samples = IntegrationResult(
        times=times,
        states=np.empty((n, STATES)),
        auxiliary_states=np.empty((n, AUXILIARY_STATES)),
        modes=np.empty((n, 3), np.int64),
        approaches=np.empty((n, 3)),
        begins=np.empty((n, 3)),
        directions=np.empty((n, 3)),
        events=np.empty((0, len(EVENT))),
        steps=0,
    )
    revolutions = max((angles[-1] - progress.here.crank_angle) / (2 * math.pi), 1.0)
    limit = math.ceil((steps_per_revolution or STEPS_PER_REVOLUTION) * revolutions)
    fine, room = _fine_enough(p, tolerance), room_for_stages()
    status, end, events, steps = integrate(p, progress, samples, angles, fine, limit, room)
    if status != DONE:
        advice = (
            f"use a larger tolerance than {tolerance:g} m, or check the causes of stiffness:"
            " stiffness, restitution, friction_speed or bristle_stiffness of the contacts, a small"
            " mass, an effect or its formula"
        )
        if status == TOO_MANY_STEPS:
            advice = (
                f"{_format_contacts(p, end.here, events)}; {advice}, or friction that makes a"
                " journal whirl"
            )
            if p.drive.kind == MOTOR and abs(end.here.crank.speed) < _CREEPING * abs(
                p.drive.no_load_speed
            ):
                advice = f"the crank almost stands still; {FAILURE_ADVICE[STALLED]}"
        raise SimulationError(
            f"the simulation {FAILURES[status].format(limit=limit)} at time {end.here.time:.9g} s,"
            f" crank angle {math.degrees(end.here.crank_angle):.6g} deg"
            f" ({_format_state(p, end.here)}); {FAILURE_ADVICE.get(status, advice)}"
        )
    return samples._replace(events=events, steps=steps), end


def _check_reached(p: Parameters, times: np.ndarray, angles: np.ndarray) -> None:
    """InputError where a measured angle does not pass the samples one after the other."""
    reached = crank_motion(p, times[-1])[0]
    if (np.diff(times) <= 0).any() or abs(reached - angles[-1]) > 1e-9 * max(abs(angles[-1]), 1.0):
        raise InputError(
            f"the measured crank angle ends at {math.degrees(reached):.9g} deg and {times[-1]:.9g}"
            f" s, the samples at {math.degrees(angles[-1]):.9g} deg; reduce the revolutions or give"
            " a longer record"
        )


def _fine_enough(p: Parameters, tolerance: float) -> float:
    joints = [getattr(p, name) for name in JOINTS]
    published = any(
        joint.loose and joint.damping > 0 and math.isinf(joint.memory_time) for joint in joints
    )
    return min(tolerance, COARSEST_PUBLISHED) if published else tolerance


def _format_state(p: Parameters, end: Instant) -> str:
    vectors = [
        f"; r{joint.number} {x:.9g}, {y:.9g}, rate {vx:.9g}, {vy:.9g}"
        for joint, (x, y, vx, vy) in zip(JOINT.values(), clearances(*end[1:3]), strict=True)
        if getattr(p, joint.name).loose
    ]
    return f"state in SI: crank speed {end.crank.speed:.9g}" + "".join(vectors)


def _format_contacts(p: Parameters, end: Instant, events: np.ndarray) -> str:
    """Contacts of each loose joint, to find the one that requires the steps."""
    begun, texts = events[events[:, EVENT.index("begins")] == 1], []
    for joint, (ex, ey, vx, vy) in zip(JOINT.values(), clearances(*end[1:3]), strict=True):
        if not getattr(p, joint.name).loose:
            continue
        count = int((begun[:, EVENT.index("joint")] == joint.index).sum())
        doing = f"{joint.words}: {count} contacts"
        if end.modes[joint.index] != FLIGHT:
            turns = (ex * vy - ey * vx) / (ex * ex + ey * ey) / end.crank.speed
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


def event_frame(events: np.ndarray) -> pd.DataFrame:
    """The table ``events`` of rows as `jointgap.dynamics.integrate.EVENT` names them."""
    rows = dict(zip(EVENT, events.T, strict=True))
    rows["joint"] = np.array(JOINTS, dtype=object)[rows["joint"].astype(int)]
    rows["event"] = EVENT_NAMES[rows.pop("begins").astype(int)]
    return pd.DataFrame({column.name: rows[column.name] for column in EVENTS.columns})
