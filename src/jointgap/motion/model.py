"""A linkage with its bearings, drive and effects, ready to be simulated."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jointgap.config import Simulate
from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.config.scenario import FreeDrive, MeasuredDrive, MotorDrive
from jointgap.core.errors import InputError
from jointgap.core.records import Record
from jointgap.linkage.compiled import Variant, parameters_of
from jointgap.linkage.drive import angle_pieces
from jointgap.linkage.parameters import (
    CRANK,
    DRIVE_KINDS,
    MOTOR,
    NO_FORMULAS,
    NO_KNOTS,
    NO_TABLE,
    DriveParameters,
    Parameters,
    knots_record,
)
from jointgap.linkage.topology import FRAME, Linkage, number
from jointgap.motion.integrate import TAKEN_WIDTH, Samples, begin, room_for
from jointgap.motion.runge_kutta import VELOCITY_TIME
from jointgap.motion.workspace import (
    BLOCK,
    CORNERS,
    HERE,
    MOST_CHANNELS,
    MOST_CONTACTS,
    MOST_KEPT,
    MOST_PARAMETERS,
    MOST_STATES,
    WORKSPACE,
)

Columns = dict[str, np.ndarray]
"""Values (n,) by name."""

_FIELDS = (
    "crank",
    "turning",
    "sites",
    "forces",
    "along",
    "moments",
    "reactions",
    "parameters",
    "kept",
    "channels",
)

_LINE = 64
"""Size of a line of the processor's cache [bytes]."""

_OF_PIN = {
    "{}_normal_force": "N",
    "{}_friction_force": "N",
    "r_{}": "m",
    "r_{}_dot": "m/s",
    "r_{}_ddot": "m/s^2",
    "gamma_{}": "rad",
    "gamma_{}_dot": "rad/s",
    "gamma_{}_ddot": "rad/s^2",
}
"""Quantities of a loose revolute joint."""

_OF_SLIDE = {
    "{}_contacts": "",
    "{}_friction_force": "N",
    "{}_offset": "m",
    "{}_offset_dot": "m/s",
    "{}_offset_ddot": "m/s^2",
    "{}_tilt": "rad",
    "{}_tilt_dot": "rad/s",
    "{}_tilt_ddot": "rad/s^2",
}
"""Quantities of a loose slide."""


_WITHOUT = (NO_FORMULAS, NO_KNOTS, NO_TABLE)


@dataclass(frozen=True)
class Model:
    """A linkage ready to be simulated.

    Attributes
    ----------
    linkage : Linkage
    bearings : dict of str to Record
        `JointParameters` of revolute joints, of all loose ones at least, and of the corners of
        loose slides.
    p : Parameters
        Drive and laws of effects.
    variant : Variant
        The machine code of its equations.
    completed : callable
        Makes the published quantities from the computed ones.
    """

    linkage: Linkage
    bearings: Mapping[str, Record]
    p: Parameters
    variant: Variant
    completed: Callable[["Model", Columns], Columns] = lambda _, columns: columns

    @property
    def drive(self) -> Record:
        return self.p.drive

    @cached_property
    def pushed(self) -> dict[str, Record]:
        """Laws of the pushed joints by name, and of the crank under that of the drive."""
        pivots = [name for name in self.variant.kind.pushed if name not in self.slides]
        of_slides = zip(self.slides, self.p.slides.laws, strict=False)
        of_pivots = zip(pivots, self.p.pivots.laws, strict=False)
        return {**dict(of_slides), **dict(of_pivots), self.linkage.drive: self.p.pivots.laws[CRANK]}

    @cached_property
    def slides(self) -> tuple[str, ...]:
        """The pushed slides."""
        joints = self.linkage.joints
        return tuple(name for name in self.variant.kind.pushed if joints[name].kind == "slide")

    @cached_property
    def loose(self) -> tuple[str, ...]:
        """Names of the loose joints, in the order of the states."""
        return tuple(joint.name for joint in self.linkage.loose)

    @property
    def is_free(self) -> bool:
        """Whether the torque turns the crank."""
        return self.variant.kind.is_free

    @property
    def positions(self) -> int:
        """Number of positions in the state."""
        return self.variant.sizes["rates"]

    @cached_property
    def has_bristles(self) -> bool:
        code = FRICTION_LAWS["lugre"].code
        return any(self.bearings[name].friction_law == code for name in self.contacts)

    @property
    def states(self) -> int:
        """Number of states: positions, their rates, bristles."""
        return 2 * self.positions + len(self.contacts) * self.has_bristles

    @cached_property
    def pins(self) -> tuple[str, ...]:
        """Names of the loose revolute joints."""
        return tuple(joint.name for joint in self.linkage.loose if joint.kind == "revolute")

    @cached_property
    def contacts(self) -> tuple[str, ...]:
        """Names of the contacts: of a revolute joint its own, of a slide those of its corners."""
        return tuple(
            name
            for joint in self.linkage.loose
            for name in (corner_names(joint.name) if joint.kind == "slide" else (joint.name,))
        )

    def room_for(self, times: np.ndarray) -> Samples:
        """Samples at `times` (n,) [s], to be filled."""
        return room_for(times, self.states, len(self.contacts), len(self.pins))

    def vector(self, states: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Clearance vector of a joint (of a slide offset and tilt) and its rate, (..., 2) each, in
        `states` (..., states); zeros of an ideal one."""
        if name not in self.loose:
            nothing = np.zeros((*states.shape[:-1], 2))
            return nothing, nothing
        at = 2 * self.loose.index(name)
        half = self.positions
        return states[..., at : at + 2], states[..., half + at : half + at + 2]

    def crank_state(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angle and speed of a free crank."""
        at = 2 * len(self.loose)
        return states[..., at], states[..., self.positions + at]

    @property
    def bodies(self) -> int:
        """Number of bodies with a direction, apart from the crank."""
        return sum(name.endswith("_cosine") for name in self.variant.channels)

    @cached_property
    def units(self) -> dict[str, str]:
        """Names and units of the quantities that `jointgap.motion.sampling.fill_samples`
        computes."""
        channels = [*self.variant.channels.items()]
        bodies = [name.removesuffix("_cosine") for name, _ in channels[: 2 * self.bodies : 2]]
        return {
            "time": "s",
            "crank_angle": "rad",
            "crank_speed": "rad/s",
            **{f"{body}_angle": "rad" for body in bodies},
            **dict(channels[2 * self.bodies :]),
            **{
                each.format(name): unit
                for name in self.loose
                for each, unit in (_OF_PIN if name in self.pins else _OF_SLIDE).items()
            },
            **{f"{body}_deflection": "m" for body in self.linkage.bending},
        }

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of `units`."""
        return tuple(self.units)

    def start(self) -> np.ndarray:
        """State (states,) with coincident joint centres and the velocities of the ideal
        linkage."""
        y = np.zeros(self.states)
        if self.is_free:
            at = 2 * len(self.loose)
            y[at], y[self.positions + at] = self.drive.start_angle, self.drive.speed
        return y

    def workspace(self) -> "Workspace":
        """What an integration works on."""
        workspace = Workspace(self._template)
        for i, name in enumerate(self.contacts):
            workspace.k.joints[i] = self.bearings[name]
        return workspace

    @property
    def content(self) -> bytes:
        """All its numbers; equal only for equal models."""
        bearings = (self.bearings[name].tobytes() for name in sorted(self.bearings))
        # records without content are large
        parts = (part.tobytes() for part in self.p if not any(part is each for each in _WITHOUT))
        return b"".join([self._template, *bearings, *parts])

    @cached_property
    def _template(self) -> bytes:
        variant, half, loose = self.variant, self.positions, self.linkage.loose
        self._check_sizes()
        owner = np.zeros(1, WORKSPACE)
        k = owner[0]
        k.parameters[: variant.sizes["parameters"]] = parameters_of(variant, self.linkage)
        places = {"state": "z", "rates": "slope"} | {name: name for name in _FIELDS}
        first = {name: WORKSPACE.fields[field][1] // 8 for name, field in places.items()}
        first["rates"] += half
        code = variant.machine_code(tuple(first.items()))
        for name, address in code.addresses.items():
            k[name] = address
        k.states, k.half, k.loose, k.pins = self.states, half, len(loose), len(self.pins)
        k.blocks, k.is_free, k.bristles = -(-k.states // BLOCK), self.is_free, self.has_bristles
        k.rubs, k.pushed = variant.kind.rubs, len(variant.kind.pushed)
        k.slides = len(self.slides)
        k.weights[:half], k.weights[half : 2 * half] = 1.0, VELOCITY_TIME
        k.weights[2 * half : k.states] = 1.0
        if self.is_free:
            at = 2 * len(loose)
            k.weights[at], k.weights[half + at] = self.reach, VELOCITY_TIME * self.reach
        k.approaches[:], k.begins[:] = math.inf, math.inf
        bodies = self.linkage.bodies
        for joint in loose:
            mass = 0.5 * min(bodies[name].mass for name in joint.bodies if name != FRAME)
            count = CORNERS if joint.kind == "slide" else 1
            k.masses[k.contacts : k.contacts + count] = mass
            k.contacts += count
        if variant.kind.rubs:
            rubbing = self.linkage.rubbing
            k.rubbing = len(rubbing)
            for i, joint in enumerate(rubbing):
                if bearing := self.bearings.get(joint.name):
                    k.levers[i] = bearing.pin_friction * bearing.pin_radius
        moving = (bodies[name].mass for name in self.linkage.moving if name != self.linkage.crank)
        k.inertia = self.reach * sum(moving)
        return owner.tobytes()

    def _check_sizes(self) -> None:
        sizes = self.variant.sizes
        if self.states > MOST_STATES:
            most = (MOST_STATES - 2 * self.is_free) // (4 + self.has_bristles)
            raise InputError(
                f"{len(self.loose)} joints are loose; here the simulation holds {most}: make the"
                " others ideal"
            )
        if len(self.contacts) > MOST_CONTACTS:
            raise InputError(
                f"the loose joints have {len(self.contacts)} contacts (a slide has {CORNERS}); the"
                f" simulation holds {MOST_CONTACTS}: make some of them ideal"
            )
        room = {"kept": MOST_KEPT, "parameters": MOST_PARAMETERS, "channels": MOST_CHANNELS}
        if any(sizes[name] > most for name, most in room.items()):
            raise InputError(
                f"{len(self.linkage.moving)} moving bodies are more than the simulation holds; give"
                " fewer, or make joints ideal"
            )

    @cached_property
    def reach(self) -> float:
        """Largest distance [m] of two points of the crank."""
        points = [
            [*map(number, point)]
            for point in self.linkage.bodies[self.linkage.crank].points.values()
        ]
        return max((math.dist(one, other) for one in points for other in points), default=1.0)


class Workspace:
    """The state of an integration, complete for an exact continuation."""

    def __init__(self, content: bytes):
        room = np.empty(len(content) + _LINE, np.uint8)
        begin = -room.ctypes.data % _LINE  # vectors across lines of the cache take twice as long
        room = room[begin : begin + len(content)]
        room[:] = np.frombuffer(content, np.uint8)
        self._owner = room.view(WORKSPACE)
        self.k: Record = self._owner[0]
        self.k.place = self._owner.ctypes.data
        self.taken = np.empty((0, TAKEN_WIDTH))
        """Accepted steps of the last integration, if recorded: see `jointgap.motion.integrate`."""

    def copy(self) -> "Workspace":
        return Workspace(self._owner.tobytes())

    @property
    def crank_angle(self) -> float:
        """At the start of the next step [rad]."""
        return float(self.k.angle[HERE])


def beginning(model: Model, y: np.ndarray, time: float) -> Workspace:
    """An integration at its start, with the state `y` (states,), all joints in flight."""
    workspace = model.workspace()
    k = workspace.k
    k.y[HERE, : y.size], k.time[HERE] = y, time
    begin(model.p, k, 0.1)
    return workspace


def corner_names(slide: str) -> tuple[str, ...]:
    """Names of the corners of a loose slide."""
    return tuple(f"{slide} corner {number}" for number in range(1, CORNERS + 1))


def drive_records(options: Simulate) -> tuple[DriveParameters, Record]:
    """The drive, and the pieces of a measured angle."""
    drive, speed, motor, knots = options.drive, options.speed, {}, NO_KNOTS
    if isinstance(drive, MeasuredDrive):
        pieces, end = angle_pieces(options)
        knots = knots_record(pieces, end)
        steady = len(pieces) == 1
        turned = pieces[-1] - pieces[0]
        speed = pieces[0, 5] if steady else turned[6] / turned[0]
    elif isinstance(drive, FreeDrive):
        motor = {"rotor_inertia": drive.inertia}
    elif isinstance(drive, MotorDrive):
        motor = {"stall_torque": drive.stall_torque, "no_load_speed": drive.no_load_speed}
        motor["rotor_inertia"] = drive.inertia
    kind = MOTOR if drive.FREES_CRANK else DRIVE_KINDS.index(drive.kind)
    return DriveParameters(kind, float(speed), options.start_angle, **motor), knots
