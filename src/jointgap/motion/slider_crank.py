"""Simulation of a slider-crank: the short form of its model, start and quantities."""

import math
from collections.abc import Collection

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Simulate, check_drive, check_tolerance
from jointgap.contact.bearings import bearing_parameters
from jointgap.contact.parameters import JointParameters
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.joints import JOINT, JOINTS
from jointgap.core.records import record
from jointgap.core.schema import TRAJECTORY
from jointgap.linkage.compiled import Kind, variant_of
from jointgap.linkage.from_file import linkage_of_slider_crank
from jointgap.linkage.parameters import DriveParameters, Parameters
from jointgap.linkage.topology import FRAME
from jointgap.motion.effects import compiled_effects, laws_of, rubs_in, with_changed_bodies
from jointgap.motion.integrate import NOT_FINITE
from jointgap.motion.model import Columns, Model, drive_records
from jointgap.motion.simulation import (
    FAILURE_ADVICE,
    Trajectory,
    crank_angles,
    event_frame,
    integrate_to_angles,
    mirrored_drive,
    modes_of,
    observed,
)


def joint_parameters(mechanism: Mechanism, name: str) -> JointParameters:
    """Parameters of the joint `name` of a `mechanism` without effects."""
    joint = mechanism.joint(name)
    if joint is None:
        return JointParameters()
    # total mass beyond the joint: the largest mass that can rebound there
    beyond = ("crank", "rod", "slider") if name == "crank_pivot" else ("rod", "slider")
    mass = sum(getattr(mechanism, body).mass for body in beyond)
    return bearing_parameters(joint, joint.journal == JOINT[name].body, mass)


def model_of(mechanism: Mechanism, options: Simulate) -> Model:
    """The model of `mechanism`, with its effects, under the drive of `options`.

    Raises
    ------
    InputError
        The drive, the tolerance or a contact does not suit the mechanism.
    """
    if options.speed < 0:
        raise InputError(
            f"simulate.speed {options.speed:g} rad/s is clockwise, which only single simulations"
            " support; mirror the mechanism (opposite sign of slider.offset, gravity_direction and"
            " phases) and give a positive speed"
        )
    made = mechanism.applied()
    check_drive(made, options)
    check_tolerance(made, options)
    drive, knots = drive_records(options)
    made.check_contacts(max(abs(drive.speed), options.highest_speed))
    joints = {name: joint_parameters(made, name)._asdict() for name in JOINTS}
    records = compiled_effects(made.effects, drive, joints, made.crank.length)
    bearings = {name: record(JointParameters(**records["joints"][name])) for name in JOINTS}
    linkage = with_changed_bodies(linkage_of_slider_crank(made), records["bodies"])
    is_free = options.drive.FREES_CRANK
    if is_free:
        linkage = linkage.with_inertia(linkage.crank, drive.rotor_inertia)
    outermost = math.sqrt((made.crank.length + made.rod.length) ** 2 - made.slider.offset**2)
    laws = laws_of(records, made.sites, {"slider": outermost}, lambda body: (0.0, 0.0))
    p = Parameters(
        drive=record(DriveParameters(**records["drive"])),
        knots=knots,
        slides=laws.slides,
        pivots=laws.pivots,
        formulas=laws.formulas,
        table=laws.table,
    )
    rubs = laws.load_friction or rubs_in(bearings)
    kind = Kind(is_free, laws.pushed, rubs)
    return Model(linkage, bearings, p, variant_of(linkage, (1.0,), kind), short_form)


_NAMES = {
    each.format(f"_{name}"): each.format(joint.number)
    for name, joint in JOINT.items()
    for quantity in ("r", "gamma")
    for each in (f"{quantity}{{}}", f"{quantity}{{}}_dot", f"{quantity}{{}}_ddot")
}
"""Names of clearance vectors by number."""


def short_form(model: Model, columns: Columns) -> Columns:
    """The quantities of a slider-crank: with its numbered clearances, those of ideal joints too."""
    found = {_NAMES.get(name, name): values for name, values in columns.items()}
    count = found["time"].size
    zeros, undefined = np.zeros(count), np.full(count, math.nan)
    found["transmission_angle"] = math.pi / 2 + found["rod_angle"]
    found.setdefault("rod_deflection", zeros)
    for name, joint in JOINT.items():
        if name in model.loose:
            continue
        x, y = found[f"{name}_force_x"], found[f"{name}_force_y"]
        found[f"{name}_normal_force"] = np.sqrt(x * x + y * y)
        found[f"{name}_friction_force"] = zeros
        for rate in ("", "_dot", "_ddot"):
            found[f"r{joint.number}{rate}"] = zeros
            found[f"gamma{joint.number}{rate}"] = undefined
    return found


def lengths_of(model: Model) -> tuple[float, float, float]:
    """Lengths of crank and rod, and the offset of the slide [m]."""
    bodies = model.linkage.bodies
    crank, rod = bodies["crank"].points["crank_pin"][0], bodies["rod"].points["piston_pin"][0]
    return crank, rod, bodies[FRAME].points["guide"][1]


def clearance_vectors(model: Model, states: np.ndarray) -> np.ndarray:
    """Clearance vectors r2, r3, r1 (n, 6) [m] at samples."""
    return np.hstack([model.vector(states, name)[0] for name in JOINTS])


def rod_sine(model: Model, crank_angle: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Sine (n,) of the rod's angle at samples."""
    crank, rod, offset = lengths_of(model)
    pivot, pin, piston = (
        model.vector(states, name)[0][:, 1] for name in ("crank_pivot", "crank_pin", "piston_pin")
    )
    return (offset + piston - crank * np.sin(crank_angle) - pin - pivot) / rod


def rod_and_slider(
    model: Model, crank_angle: np.ndarray, states: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rod angle [rad] and slider position [m] of samples."""
    crank, rod, _ = lengths_of(model)
    pivot, pin, piston = (
        model.vector(states, name)[0][:, 0] for name in ("crank_pivot", "crank_pin", "piston_pin")
    )
    sine = rod_sine(model, crank_angle, states)
    end = crank * np.cos(crank_angle) + pin + pivot
    return np.arcsin(sine), end + rod * np.sqrt(1.0 - sine**2) - piston


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


def _clockwise(mechanism: Mechanism, options: Simulate, perturbation) -> Trajectory:
    """`simulate` for a clockwise crank, by its mirror image."""
    if perturbation is not None:
        perturbation = mirrored(perturbation)
    seen = simulate(mechanism.applied().mirrored(), mirrored_drive(options), perturbation)
    samples = seen.samples.copy()
    for name in samples:
        if turns_sign(name):
            samples[name] = -samples[name]
    samples["transmission_angle"] = math.pi - samples["transmission_angle"]
    return Trajectory(
        samples, seen.events.assign(crank_angle=-seen.events["crank_angle"]), seen.steps
    )


def mirrored(vectors) -> np.ndarray:
    """Clearance vectors of the mirror image."""
    return np.asarray(vectors, dtype=float) * np.resize([1.0, -1.0], np.shape(vectors))


def turns_sign(name: str) -> bool:
    """Whether a column of the trajectory changes its sign in the mirror image in the line y = 0."""
    across = name.endswith(("_y", "_friction_force", "_torque")) or name.startswith(
        ("crank_a", "crank_s", "gamma")
    )
    return (
        across
        or (name.startswith(("guide_", "rod_a")) and "acceleration_x" not in name)
        or name == "rod_deflection"
    )


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
