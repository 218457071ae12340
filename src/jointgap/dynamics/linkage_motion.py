"""Simulation of any planar linkage."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from jointgap.config import Simulate
from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.config.linkage_file import LinkageFile, Pin
from jointgap.config.scenario import MeasuredDrive, MotorDrive, check_clearance_tolerance
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.schema import EVENTS
from jointgap.dynamics.compile_mechanism import bearing_parameters, drive_parameters
from jointgap.dynamics.contact import damping_factor_at
from jointgap.dynamics.drive import angle_pieces, crank_motion, crank_times
from jointgap.dynamics.integrate import DONE, EVENT, EVENT_NAMES, MODES
from jointgap.dynamics.joints import joint_force
from jointgap.dynamics.linkage_engine import (
    MOST_STATES,
    WORKSPACE,
    LinkageParameters,
    Samples,
    integrate,
)
from jointgap.dynamics.numba_cache import compiled
from jointgap.dynamics.parameters import (
    DRIVE_KINDS,
    NO_KNOTS,
    JointParameters,
    Record,
    knots_record,
    record,
)
from jointgap.dynamics.runge_kutta import VELOCITY_TIME
from jointgap.dynamics.sampling import polar_rates
from jointgap.dynamics.simulation import (
    FAILURE_ADVICE,
    FAILURES,
    STEPS_PER_REVOLUTION,
    Trajectory,
    crank_angles,
)
from jointgap.linkage.assembly import check_turning, signs_of
from jointgap.linkage.compiled import Variant, parameters_of, variant_of
from jointgap.linkage.equations import (
    Arithmetic,
    Crank,
    Dynamics,
    JointForce,
    Pose,
    across,
    dot,
    subtract,
)
from jointgap.linkage.from_file import linkage_of_file
from jointgap.linkage.joint_forces import balance
from jointgap.linkage.topology import FRAME, Linkage, number
from jointgap.linkage.topology import Joint as LinkageJoint

_ON_ARRAYS = Arithmetic(sqrt=np.sqrt, cos_sin=lambda angle: (np.cos(angle), np.sin(angle)))


@dataclass(frozen=True)
class LinkageModel:
    """A linkage with its bearings and drive, ready to be simulated.

    Attributes
    ----------
    linkage : Linkage
    bearings : dict of str to JointParameters
        Of the loose joints.
    p : LinkageParameters
        The drive.
    variant : Variant
        The machine code of its equations.
    """

    linkage: Linkage
    bearings: dict[str, JointParameters]
    p: LinkageParameters
    variant: Variant

    @cached_property
    def joints(self) -> np.ndarray:
        """Records of the loose joints for compiled code."""
        rows = [record(bearing) for bearing in self.bearings.values()]
        kind = record(JointParameters()).dtype
        joints = np.zeros(max(len(rows), 1), kind)
        for i, row in enumerate(rows):
            joints[i] = row
        return joints

    @property
    def has_bristles(self) -> bool:
        code = FRICTION_LAWS["lugre"].code
        return any(bearing.friction_law == code for bearing in self.bearings.values())

    def workspace(self) -> tuple[Record, np.ndarray]:
        """What an integration works on, at its start: coincident joint centres, the velocities of
        the ideal linkage; and the array that owns it."""
        variant = self.variant
        half, contacts = variant.sizes["rates"], len(self.bearings)
        states = 2 * half + contacts * self.has_bristles
        fields = WORKSPACE.fields
        kept, parameters = (fields[name][0].shape[0] for name in ("kept", "parameters"))
        if states > MOST_STATES:
            most = (MOST_STATES - 2 * variant.is_free) // (4 + self.has_bristles)
            raise InputError(
                f"{contacts} joints are loose; here the simulation holds {most}: make the others"
                " ideal"
            )
        if variant.sizes["kept"] > kept or variant.sizes["parameters"] > parameters:
            raise InputError(
                f"{len(self.linkage.moving)} moving bodies are more than the simulation holds; give"
                " fewer, or make joints ideal"
            )
        owner = np.zeros(1, WORKSPACE)
        k = owner[0]
        k.parameters[: variant.sizes["parameters"]] = parameters_of(variant, self.linkage)
        k.place = owner.ctypes.data
        places = {"state": "z", "rates": "slope"} | {
            n: n for n in ("crank", "turning", "forces", "parameters", "kept")
        }
        begin = {name: fields[field][1] // 8 for name, field in places.items()}
        begin["rates"] += half
        code = variant.machine_code(tuple(begin.items()))
        k.pose, k.dynamics = code.addresses["pose"], code.addresses["dynamics"]
        k.states, k.half, k.contacts = states, half, contacts
        k.blocks, k.is_free, k.bristles = -(-states // 8), variant.is_free, self.has_bristles
        k.weights[:half], k.weights[half : 2 * half] = 1.0, VELOCITY_TIME
        k.weights[2 * half : states] = 1.0
        if variant.is_free:
            radius = self.crank_radius
            k.weights[half - 1], k.weights[2 * half - 1] = radius, VELOCITY_TIME * radius
            drive = self.p.drive
            k.y[0, half - 1], k.y[0, 2 * half - 1] = drive.start_angle, drive.speed
        k.approaches[:], k.begins[:] = math.inf, math.inf
        bodies = self.linkage.bodies
        for i, joint in enumerate(self.linkage.loose):
            k.joints[i] = self.joints[i]
            k.masses[i] = 0.5 * min(bodies[name].mass for name in joint.bodies if name != FRAME)
        return k, owner

    @property
    def crank_radius(self) -> float:
        """Largest distance [m] of two points of the crank."""
        points = [
            [*map(number, point)]
            for point in self.linkage.bodies[self.linkage.crank].points.values()
        ]
        return max((math.dist(one, other) for one in points for other in points), default=1.0)


def linkage_model(file: LinkageFile, options: Simulate) -> LinkageModel:
    """The model of a linkage file under a drive.

    Raises
    ------
    InputError
        The linkage cannot be built or does not turn fully, or the drive or the tolerance does not
        suit it.
    """
    linkage = linkage_of_file(file)
    signs = signs_of(linkage, options.start_angle)
    pins = file.loose
    clearances = {name: pin.clearance for name, pin in pins.items()}
    check_turning(linkage, signs, sum(clearances.values()))
    check_clearance_tolerance(clearances, options)
    pieces, end = angle_pieces(options) if isinstance(options.drive, MeasuredDrive) else (None, 0.0)
    drive = drive_parameters(options, pieces)
    drive = drive._replace(kind=DRIVE_KINDS.index(options.drive.kind))
    knots = NO_KNOTS if pieces is None else knots_record(pieces, end)
    is_free = isinstance(options.drive, MotorDrive)
    if is_free:
        linkage = linkage.with_inertia(linkage.crank, drive.rotor_inertia)
    variant = variant_of(linkage, signs, is_free)
    bearings = {
        joint.name: _bearing(linkage, joint.name, pins[joint.name]) for joint in linkage.loose
    }
    return LinkageModel(linkage, bearings, LinkageParameters(record(drive), knots), variant)


def linkage_remarks(file: LinkageFile, options: Simulate) -> tuple[str, ...]:
    """Remarks on dead points."""
    linkage = linkage_of_file(file)
    clearances = sum(pin.clearance for pin in file.loose.values())
    return tuple(check_turning(linkage, signs_of(linkage, options.start_angle), clearances))


def _bearing(linkage: Linkage, name: str, pin: Pin) -> JointParameters:
    """Parameters of a loose joint; the largest mass that can rebound there is that of all moving
    bodies, without the crank unless it is the crank's own pivot."""
    beyond = [body for body in linkage.moving if name == linkage.drive or body != linkage.crank]
    mass = sum(linkage.bodies[body].mass for body in beyond)
    return bearing_parameters(pin, linkage.joints[name].body.body == pin.journal, mass)


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
        Columns of the samples by rule, see `columns_of`; ``attrs["units"]`` has their units.

    Raises
    ------
    InputError
        See `linkage_model`.
    SimulationError
        The integration fails; the message has time, crank angle and state.
    """
    if options.speed < 0:
        return _clockwise(file, options)
    model = linkage_model(file, options)
    angles = crank_angles(options)
    found, events, steps = integrated(model, angles, options)
    columns = columns_of(model, found, events, angles)
    samples = pd.DataFrame({name: values for name, (values, _) in columns.items()})
    samples.attrs["units"] = {name: unit for name, (_, unit) in columns.items()}
    rows = dict(zip(EVENT, events.T, strict=True))
    rows["joint"] = np.array([*model.bearings, ""], dtype=object)[rows["joint"].astype(int)]
    rows["event"] = EVENT_NAMES[rows.pop("begins").astype(int)]
    frame = pd.DataFrame({column.name: rows[column.name] for column in EVENTS.columns})
    return Trajectory(samples, frame, steps)


def _clockwise(file: LinkageFile, options: Simulate) -> Trajectory:
    """`simulate_linkage` for a clockwise crank, by the mirror image in the line y = 0."""
    ahead = options.model_copy(
        update={"speed": -options.speed, "start_angle": -options.start_angle}
    )
    seen = simulate_linkage(file.mirrored(), ahead)
    samples, units = seen.samples.copy(), seen.samples.attrs["units"]
    across = {f"{name}_force" for name in file.slides}
    across |= {f"{name}_force_y" for name in (*file.shared_by_two, "shaking")}
    across |= {f"{name}_friction_force" for name in file.loose}
    across |= {f"{name}_acceleration_y" for name in file.bodies}
    for name, unit in units.items():
        if name in across or unit.startswith(("rad", "N*m")):
            samples[name] = -samples[name]
    events = seen.events.assign(crank_angle=-seen.events["crank_angle"])
    return Trajectory(samples, events, seen.steps)


def integrated(
    model: LinkageModel, angles: np.ndarray, options: Simulate
) -> tuple[Samples, np.ndarray, int]:
    """Samples at crank angles (n,) [rad], events and steps of one integration."""
    p, n, contacts = model.p, angles.size, len(model.bearings)
    k, _owner = model.workspace()
    times = crank_times(p, angles)
    k.time[0] = times[0]
    found = Samples(
        times,
        np.empty((n, k.states)),
        np.empty((n, contacts), np.int64),
        *(np.empty((n, contacts)) for _ in range(3)),
    )
    limit = math.ceil(STEPS_PER_REVOLUTION * max(options.revolutions, 1.0))
    status, events, steps = integrate(p, k, found, angles, options.tolerance, limit)
    if status != DONE:
        advice = FAILURE_ADVICE.get(
            status,
            f"use a larger tolerance than {options.tolerance:g} m, or check the stiffness of the"
            " contacts and their friction",
        )
        raise SimulationError(
            f"the simulation {FAILURES[status].format(limit=limit)} at time {k.time[0]:.9g} s,"
            f" crank angle {math.degrees(k.angle[0]):.6g} deg ({_state(model, k)}); {advice}"
        )
    return found, events, steps


def _state(model: LinkageModel, k: Record) -> str:
    """State at the start of the last step, in SI."""
    h, texts = model.variant.sizes["rates"], []
    for j, name in enumerate(model.bearings):
        x, y, v, w = (k.y[0, i] for i in (2 * j, 2 * j + 1, h + 2 * j, h + 2 * j + 1))
        texts.append(f"{name} {x:.9g}, {y:.9g}, rate {v:.9g}, {w:.9g}")
    if model.variant.is_free:
        texts.append(f"crank speed {k.y[0, 2 * h - 1]:.9g}")
    return "state in SI: " + "; ".join(texts or ["all joints ideal"])


# ---- channels


@compiled
def _joint_forces(joint, states, at, half, place, modes, damping, body_rate, partner_rate, forces):
    """Forces of a loose joint at samples, into `forces` (n, 6)."""
    for i in range(forces.shape[0]):
        bristle = states[i, place] if place >= 0 else 0.0
        found = joint_force(
            joint,
            modes[i],
            damping[i],
            states[i, at],
            states[i, at + 1],
            states[i, half + at],
            states[i, half + at + 1],
            body_rate[i],
            partner_rate[i],
            bristle,
        )
        for j in range(6):
            forces[i, j] = found[j]


@compiled
def _dampings(joint, approaches, begins, times, damping):
    for i in range(times.size):
        damping[i] = damping_factor_at(joint, approaches[i], begins[i], times[i])


@compiled
def _crank_motions(p, times, motion):
    for i in range(times.size):
        motion[i, 0], motion[i, 1], motion[i, 2] = crank_motion(p, times[i])


@compiled
def _polar(vectors, directions, found):
    for i in range(directions.size):
        v = vectors[i]
        rates = polar_rates((v[0], v[1], v[2], v[3], v[4], v[5]), directions[i])
        for j in range(6):
            found[i, j] = rates[j]


Columns = dict[str, tuple[np.ndarray, str]]
"""Values and units by name."""


def columns_of(
    model: LinkageModel, found: Samples, events: np.ndarray, angles: np.ndarray
) -> Columns:
    """All quantities of the samples, by the rule

    - ``time``; of the driven body ``crank_angle``, ``crank_speed``, ``crank_torque``;
    - a body on a slide of the frame: ``BODY_position``, ``_velocity``, ``_acceleration``;
    - another body: ``BODY_angle``, ``_angular_velocity``, ``_acceleration_x``, ``_acceleration_y``
      (mass centre);
    - a slide: ``SLIDE_force``, across it, and ``SLIDE_moment``;
    - a revolute joint: ``JOINT_force_x``, ``_force_y``, if loose also ``_normal_force``,
      ``_friction_force``, ``_mode``, ``r_JOINT``, ``gamma_JOINT`` and rates;
    - ``shaking_force_x``, ``_y``: sum of the forces on the frame.
    """
    linkage, n = model.linkage, angles.size
    pose, torque = _pose(model, found)
    laws = {
        name: _forces_in(model, j, joint, pose, found)
        for j, (name, joint) in enumerate(zip(model.bearings, linkage.loose, strict=True))
    }
    pushes = {name: JointForce(*forces[:, 2:].T) for name, forces in laws.items()}
    dynamics = Dynamics(pose, pushes, torque)
    needed = balance(dynamics, pushes, tuple(map(number, linkage.gravity)))
    rotor = model.p.drive.rotor_inertia
    columns: Columns = {
        "time": (found.times, "s"),
        "crank_angle": (angles, "rad"),
        "crank_speed": (pose.crank.speed, "rad/s"),
        "crank_torque": (needed.torque - rotor * dynamics.crank_acceleration, "N*m"),
    }
    for body in linkage.moving:
        if body != linkage.crank:
            columns |= _of_body(body, pose, dynamics)
    for name, joint in linkage.joints.items():
        x, y = needed.forces[name]
        if joint.kind == "slide":
            normal = across(pose.turned(joint.partner.body, pose.line(joint)))
            columns[f"{name}_force"] = normal[0] * x + normal[1] * y, "N"
            columns[f"{name}_moment"] = needed.moments[name], "N*m"
            continue
        columns |= {f"{name}_force_x": (x, "N"), f"{name}_force_y": (y, "N")}
        if name in laws:
            columns |= _of_loose_joint(model, name, dynamics, found, events, laws[name])
    for axis, component in zip("xy", needed.on_frame, strict=True):
        columns[f"shaking_force_{axis}"] = component, "N"
    return {
        name: (values if np.shape(values) == (n,) else np.full(n, values), unit)
        for name, (values, unit) in columns.items()
    }


def _pose(model: LinkageModel, found: Samples) -> tuple[Pose, np.ndarray | float]:
    """Poses of all samples, and the torque on a free crank."""
    states, half = found.states, model.variant.sizes["rates"]
    clearances = {
        name: tuple((states[:, at + 2 * j], states[:, at + 2 * j + 1]) for at in (0, half))
        for j, name in enumerate(model.bearings)
    }
    torque: np.ndarray | float = 0.0
    if model.variant.is_free:
        angle, speed, acceleration = states[:, half - 1], states[:, 2 * half - 1], None
        drive = model.p.drive
        torque = drive.stall_torque * (1.0 - speed / drive.no_load_speed)
    else:
        motion = np.empty((found.times.size, 3))
        _crank_motions(model.p, found.times, motion)
        angle, speed, acceleration = motion.T
    crank = Crank(np.cos(angle), np.sin(angle), speed, acceleration)
    return Pose(model.linkage, model.variant.signs, crank, clearances, _ON_ARRAYS), torque


def _forces_in(
    model: LinkageModel, j: int, joint: LinkageJoint, pose: Pose, found: Samples
) -> np.ndarray:
    """Results of `joint_force` in a loose joint, (n, 6)."""
    n, half = found.times.size, model.variant.sizes["rates"]
    damping, forces = np.empty(n), np.empty((n, 6))
    _dampings(model.joints[j], found.approaches[:, j], found.begins[:, j], found.times, damping)
    turning = (np.full(n, pose.speeds[body]) for body in (joint.body.body, joint.partner.body))
    bristle = 2 * half + j if model.has_bristles else -1
    modes = np.ascontiguousarray(found.modes[:, j])
    _joint_forces(
        model.joints[j], found.states, 2 * j, half, bristle, modes, damping, *turning, forces
    )
    return forces


def _of_body(body: str, pose: Pose, dynamics: Dynamics) -> Columns:
    linkage = pose.linkage
    if linkage.kinds[body] == "sliding":
        joint = linkage.joint_with_frame(body)
        line = pose.line(joint)
        (place, velocity), start = pose.point(*joint.body), pose.point(*joint.partner)[0]
        return {
            f"{body}_position": (dot(line, subtract(place, start)), "m"),
            f"{body}_velocity": (dot(line, velocity), "m/s"),
            f"{body}_acceleration": (dynamics.accelerations[body, "slide"], "m/s^2"),
        }
    cosine, sine = np.broadcast_arrays(*pose.directions[body])
    x, y = dynamics.acceleration(body)
    return {
        f"{body}_angle": (np.unwrap(np.arctan2(sine, cosine)), "rad"),
        f"{body}_angular_velocity": (pose.speeds[body], "rad/s"),
        f"{body}_acceleration_x": (x, "m/s^2"),
        f"{body}_acceleration_y": (y, "m/s^2"),
    }


_POLAR = [
    (f"{quantity}_{{}}{rate}", unit + per)
    for quantity, unit in (("r", "m"), ("gamma", "rad"))
    for rate, per in (("", ""), ("_dot", "/s"), ("_ddot", "/s^2"))
]
"""Names and units of a clearance vector in polar form."""


def _of_loose_joint(
    model: LinkageModel,
    name: str,
    dynamics: Dynamics,
    found: Samples,
    events: np.ndarray,
    forces: np.ndarray,
) -> Columns:
    j, half = [*model.bearings].index(name), model.variant.sizes["rates"]
    places = [2 * j, 2 * j + 1, half + 2 * j, half + 2 * j + 1]
    vectors = np.column_stack([found.states[:, places], *dynamics.rates[name]])
    polar = np.empty((len(vectors), 6))
    _polar(vectors, np.ascontiguousarray(found.directions[:, j]), polar)
    columns = {
        f"{name}_normal_force": (forces[:, 0], "N"),
        f"{name}_friction_force": (forces[:, 1], "N"),
        f"{name}_mode": (_modes(found.times, found.modes[:, j], events, j), ""),
    }
    return columns | {
        key.format(name): (values, unit)
        for (key, unit), values in zip(_POLAR, polar.T, strict=True)
    }


def _modes(times: np.ndarray, modes: np.ndarray, events: np.ndarray, j: int) -> np.ndarray:
    """Modes by words: a contact with at most one maximum of its penetration is an impact."""
    column = {name: i for i, name in enumerate(EVENT)}
    ends = events[(events[:, column["joint"]] == j) & (events[:, column["begins"]] == 0)]
    following = np.searchsorted(ends[:, column["time"]], times)
    maxima = np.append(ends[:, column["maxima"]], np.inf)[following]
    numbers = np.where(modes != 0, np.where(maxima <= 1, 2, 3), 1)
    return np.array(MODES, dtype=object)[numbers]
