"""Simulation of a linkage from its file: the general form of its model, and its quantities."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config import Simulate
from jointgap.config.linkage_file import LinkageFile, Pin, Slide
from jointgap.config.scenario import check_clearance_tolerance, check_drive
from jointgap.contact.bearings import bearing_parameters, corner_parameters
from jointgap.contact.parameters import JointParameters
from jointgap.core.errors import SimulationError
from jointgap.core.records import record
from jointgap.linkage.assembly import check_turning, ideal_pose, signs_of
from jointgap.linkage.compiled import Kind, variant_of
from jointgap.linkage.from_file import linkage_of_file
from jointgap.linkage.parameters import DriveParameters, Parameters
from jointgap.linkage.topology import Joint, Linkage, number
from jointgap.motion.effects import (
    compiled_effects,
    crank_radius,
    laws_of,
    rubs_in,
    with_changed_bodies,
)
from jointgap.motion.model import Columns, Model, corner_names, drive_records
from jointgap.motion.simulation import (
    Trajectory,
    crank_angles,
    event_frame,
    integrate_to_angles,
    mirrored_drive,
    modes_of,
    observed,
)

_POSES = 720  # Of the ideal motion, in which bodies swing


def linkage_model(file: LinkageFile, options: Simulate, drawn_at: float | None = None) -> Model:
    """The model of a linkage file under a drive; the stated angles of its bodies are those at the
    crank angle `drawn_at` [rad], by default at the start.

    Raises
    ------
    InputError
        The linkage cannot be built or does not turn fully, or the drive or the tolerance does not
        suit it.
    """
    file = file.applied()
    linkage = linkage_of_file(file)
    signs = signs_of(linkage, options.start_angle if drawn_at is None else drawn_at)
    clearances = {name: joint.clearance for name, joint in file.loose_joints.items()}
    check_turning(linkage, signs, _play(file, linkage))
    check_drive(file, options)
    check_clearance_tolerance(clearances, options)
    drive, knots = drive_records(options)
    joints: dict[str, Mapping[str, Any]] = {}
    for name, given in file.joints.items():
        if given.loose or isinstance(given, Pin):
            parameters = _bearings(linkage, linkage.joints[name], given)
            joints |= {each: part._asdict() for each, part in parameters.items()}
    records = compiled_effects(file.effects, drive, joints, crank_radius(linkage))
    linkage = with_changed_bodies(linkage, records["bodies"])
    is_free = options.drive.FREES_CRANK
    if is_free:
        linkage = linkage.with_inertia(linkage.crank, drive.rotor_inertia)
    bearings = {name: record(JointParameters(**part)) for name, part in records["joints"].items()}
    farthest = _farthest(file, linkage, signs)
    laws = laws_of(records, file.sites, farthest, partial(_swing, linkage, signs))
    p = Parameters(
        record(DriveParameters(**records["drive"])),
        knots,
        laws.slides,
        laws.pivots,
        laws.formulas,
        laws.table,
    )
    kind = Kind(is_free, laws.pushed, laws.load_friction or rubs_in(bearings))
    return Model(linkage, bearings, p, variant_of(linkage, signs, kind))


def _farthest(file: LinkageFile, linkage: Linkage, signs: Sequence[float]) -> dict[str, float]:
    """Farthest place [m] of each body with gas pressure on its slide of the frame."""
    found = {}
    for effect in file.effects:
        if effect.LAW_NAME != "gas_pressure":
            continue
        joint, middle, reach = linkage.joints[file.sites.slides[effect.BODY]], math.pi, math.pi
        for _ in range(3):  # ever closer to the crank angle there
            angles = middle + np.linspace(-reach, reach, 721)
            places = ideal_pose(linkage, signs, angles).travel(joint)[0]
            middle, reach = angles[np.argmax(places)], reach / 180.0
        found[effect.BODY] = float(np.max(places))
    return found


def _swing(linkage: Linkage, signs: Sequence[float], body: str) -> tuple[float, float]:
    """Mean angle [rad] of a body in the ideal motion, without its turns in a turn of the crank, and
    these."""
    crank = np.linspace(0.0, 2.0 * math.pi, _POSES + 1)
    cosine, sine = ideal_pose(linkage, signs, crank).directions[body]
    angles = np.unwrap(np.arctan2(sine, cosine))
    turns = round((angles[-1] - angles[0]) / (2.0 * math.pi))
    return math.remainder(np.mean((angles - turns * crank)[:-1]), 2.0 * math.pi), float(turns)


def linkage_remarks(file: LinkageFile, options: Simulate) -> tuple[str, ...]:
    """Remarks on dead points."""
    linkage = linkage_of_file(file)
    signs = signs_of(linkage, options.start_angle)
    return tuple(check_turning(linkage, signs, _play(file, linkage)))


def _play(file: LinkageFile, linkage: Linkage) -> float:
    """Distance [m] by which all clearances together may shift a joint; a slide also by its tilt."""
    play = sum(joint.clearance for joint in file.loose_joints.values())
    for slide in file.loose_joints.values():
        if isinstance(slide, Slide):
            points = linkage.bodies[slide.slide[1]].points.values()
            arm = max(math.hypot(*map(number, point)) for point in points)
            play += 2.0 * slide.clearance / slide.length * arm
    return play


def check_walls(file: LinkageFile, columns: Columns) -> None:
    """SimulationError where a corner is deeper in a wall than its clearance."""
    for name, slide in file.loose_joints.items():
        if not isinstance(slide, Slide):
            continue
        reach = np.abs(columns[f"{name}_offset"]) + 0.5 * slide.length * np.abs(
            np.sin(columns[f"{name}_tilt"])
        )
        depth = float(np.max(reach)) - slide.clearance
        if depth > slide.clearance:
            raise SimulationError(
                f"joints.{name}: a corner is {depth:.3g} m inside its wall, more than the clearance"
                f" of {slide.clearance:g} m; give the contact a larger stiffness than"
                f" {slide.contact.stiffness:g}"
            )


def _bearings(linkage: Linkage, joint: Joint, given: Pin | Slide) -> dict[str, JointParameters]:
    """Parameters of the contacts of a joint; the largest mass that can rebound there is that
    of all moving bodies, without the crank unless it is the crank's own pivot."""
    beyond = [
        body for body in linkage.moving if joint.name == linkage.drive or body != linkage.crank
    ]
    mass = sum(linkage.bodies[body].mass for body in beyond)
    if isinstance(given, Pin):
        has_journal = joint.body.body == given.journal
        return {joint.name: bearing_parameters(given, has_journal, mass)}
    corners = zip(corner_names(joint.name), _CORNERS, strict=True)
    return {name: corner_parameters(given, corner, mass) for name, corner in corners}


_CORNERS = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
"""Sides of the corners along and across a slide: counter-clockwise from the front."""


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
        See `linkage_model`.
    SimulationError
        The integration fails; the message has time, crank angle and state.
    """
    if options.speed < 0:
        return _linkage_clockwise(file, options)
    model = linkage_model(file, options)
    angles = crank_angles(options)
    run = integrate_to_angles(model, model.start(), angles, options.tolerance)
    columns = published(model, observed(model, run)) | modes_of(model, run, model.pins)
    check_walls(file, columns)
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
    - a slide: ``SLIDE_force``, across it, and ``SLIDE_moment``, if loose also ``_contacts``,
      ``_friction_force``, ``_offset``, ``_tilt`` and rates;
    - a revolute joint: ``JOINT_force_x``, ``_force_y``, if loose also ``_normal_force``,
      ``_friction_force``, ``_mode``, ``r_JOINT``, ``gamma_JOINT`` and rates;
    - ``shaking_force_x``, ``_y``: sum of the forces on the frame.
    """
    of_frame = ("frame_force_x", "frame_force_y")
    found = {name: values for name, values in columns.items() if name not in of_frame}
    for name, values in found.items():
        if name.endswith("_angle") and name != "crank_angle":
            found[name] = _continuous(values)
    return found


def _continuous(angles: np.ndarray) -> np.ndarray:
    """Angles (n,) [rad] without jumps; their mean is within half a turn unless the body turns."""
    found = np.unwrap(angles)
    if np.ptp(found) < 2.0 * math.pi:
        found -= 2.0 * math.pi * round(float(np.mean(found)) / (2.0 * math.pi))
    return found


def _linkage_clockwise(file: LinkageFile, options: Simulate) -> Trajectory:
    """`simulate_linkage` for a clockwise crank, by the mirror image in the line y = 0."""
    seen = simulate_linkage(file.mirrored(), mirrored_drive(options))
    samples = seen.samples.copy()
    for name in turned_by_mirror(file, samples.attrs["units"]):
        samples[name] = -samples[name]
    other_side = {
        name: mirrored
        for slide in file.slides
        for name, mirrored in zip(corner_names(slide), corner_names(slide)[::-1], strict=True)
    }
    events = seen.events.assign(crank_angle=-seen.events["crank_angle"])
    events["joint"] = events["joint"].replace(other_side)
    return Trajectory(samples, events, seen.steps)


def turned_by_mirror(file: LinkageFile, units: Mapping[str, str]) -> set[str]:
    """Quantities of a trajectory, given with their `units`, that change their sign in the mirror
    image in the line y = 0."""
    across = {f"{name}_force" for name in file.slides}
    across |= {f"{name}_force_y" for name in (*file.shared_by_two, "shaking")}
    across |= {f"{name}_friction_force" for name in file.loose_pins}
    across |= {f"{name}_offset{rate}" for name in file.slides for rate in ("", "_dot", "_ddot")}
    across |= {
        f"{name}_{what}_y"
        for name in file.bodies
        for what in ("position", "velocity", "acceleration")
    }
    return {
        name for name, unit in units.items() if name in across or unit.startswith(("rad", "N*m"))
    }
