"""The equations of motion of a linkage as compiled functions.

Between `pose` and `dynamics` ordinary compiled code evaluates the laws of contacts and effects: the
one writes their arguments, the other reads their forces. `sample` writes all quantities of a
motion. A variant is a topology with its set of loose joints and its kind of drive; lengths, masses
and fits are parameters, so they never make another one.
"""

import ctypes
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from jointgap.linkage.equations import (
    Arithmetic,
    Crank,
    Dynamics,
    JointForce,
    Number,
    Pair,
    Pose,
    across,
    add,
    dot,
    negative,
    times,
)
from jointgap.linkage.joint_forces import balance
from jointgap.linkage.machine_code import Code, Graph, MachineCode, Store, kept
from jointgap.linkage.topology import Joint, Linkage


class Kind(NamedTuple):
    """What a variant computes besides contacts."""

    is_free: bool = False  # The torque turns the crank
    pushed: tuple[str, ...] = ()  # Joints with forces of effects: slides, then pivots
    rubs: bool = False  # Forces depend on the reactions of ideal joints


PLAIN = Kind()


@dataclass(frozen=True)
class Variant:
    """Compiled equations of the linkages of one form.

    Memory is one array of numbers with the fields

    - `parameters`;
    - `state`: clearance vectors of the loose joints, then the crank's angle if it is free, then the
      deflections of bending bodies; their rates;
    - `crank`: cosine, sine, speed, acceleration (unused where it is free);
    - `turning`: angular velocity of body and partner of each loose joint, then of each rubbing one,
      of a slide that of the body and the speed along it, written by `pose`;
    - `sites`: coordinate and rate of the pushed joints, written by `pose`;
    - `forces`: fx, fy, moment on body and partner of each loose joint (of a slide along, across,
      moment, nothing), and the torque on the crank, read by `dynamics`;
    - `along`: forces along, or moments at, the pushed joints, read by `dynamics`;
    - `moments`: friction moment on the body of each rubbing joint, read by `dynamics`;
    - `rates`: second rates of the state, written by `dynamics`;
    - `reactions`: fx, fy of each rubbing joint, force across each pushed joint if it is an ideal
      slide of the frame, written by `dynamics`;
    - `kept`: between the functions;
    - `channels`: written by `sample`, see `channels`.
    """

    signs: tuple[float, ...]
    kind: Kind
    names: tuple[str, ...]  # Of the parameters
    sizes: Mapping[str, int]  # Of the fields
    codes: Mapping[str, Code]
    channels: Mapping[str, str]  # Names and units of what `sample` writes

    @property
    def begin(self) -> dict[str, int]:
        """Place of the first number of each field."""
        ends = np.cumsum([0, *self.sizes.values()])
        return dict(zip(self.sizes, map(int, ends), strict=False))

    @property
    def size(self) -> int:
        return sum(self.sizes.values())

    def memory(self, linkage: Linkage) -> np.ndarray:
        """Memory with the parameters of a linkage of this form."""
        memory = np.zeros(self.size)
        self.fields(memory)["parameters"][:] = parameters_of(self, linkage)
        return memory

    def fields(self, memory: np.ndarray) -> dict[str, np.ndarray]:
        """The fields of a memory, as views."""
        begin = self.begin
        return {name: memory[begin[name] : begin[name] + size] for name, size in self.sizes.items()}

    def machine_code(self, begin: tuple[tuple[str, int], ...]) -> MachineCode:
        """The functions for a memory whose fields begin at these numbers."""
        if begin not in self._built:
            self._built[begin] = MachineCode(self.codes, dict(begin))
        return self._built[begin]

    @cached_property
    def _built(self) -> dict[tuple[tuple[str, int], ...], MachineCode]:
        return {}

    def run(self, name: str, memory: np.ndarray) -> None:
        """Run a function, by machine code unless that is switched off."""
        if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
            self.codes[name].run(self.fields(memory))
            return
        code = self.machine_code(tuple(self.begin.items()))
        ctypes.CFUNCTYPE(None, ctypes.c_int64)(code.addresses[name])(memory.ctypes.data)


def variant_of(linkage: Linkage, signs: Sequence[float], kind: Kind = PLAIN) -> Variant:
    """The variant of a linkage. Linkages of one form share it."""
    key = (linkage.form, tuple(signs), kind)
    if key not in _VARIANTS:
        while len(_VARIANTS) >= _MOST_VARIANTS:
            del _VARIANTS[next(iter(_VARIANTS))]
        _VARIANTS[key] = build_variant(linkage, signs, kind)
    return _VARIANTS[key]


_VARIANTS: dict[tuple, Variant] = {}  # of this process
_MOST_VARIANTS = 256


def forget() -> None:
    """Drop all variants, so that the next ones are made anew."""
    _VARIANTS.clear()


def build_variant(linkage: Linkage, signs: Sequence[float], kind: Kind = PLAIN) -> Variant:
    """`variant_of`, made anew."""
    graph, places = Graph(), {}

    def parameter(name: str, _: float) -> Number:
        return graph.load("parameters", places.setdefault(name, len(places)))

    loose, rubbing = linkage.loose, linkage.rubbing if kind.rubs else ()
    half = positions(linkage, kind.is_free)
    state = [graph.load("state", i) for i in range(2 * half)]
    clearances = {
        joint.name: (
            (state[2 * n], state[2 * n + 1]),
            (state[half + 2 * n], state[half + 2 * n + 1]),
        )
        for n, joint in enumerate(loose)
    }
    first_bend = 2 * len(loose) + kind.is_free
    bends = {
        body: (state[i], state[half + i]) for i, body in enumerate(linkage.bending, first_bend)
    }
    cosine, sine, speed, acceleration = (graph.load("crank", i) for i in range(4))
    crank = Crank(cosine, sine, speed, None if kind.is_free else acceleration)
    arithmetic = Arithmetic(parameter, graph.root, graph.cos_sin, graph.angle)
    pose = Pose(linkage, signs, crank, clearances, arithmetic, bends)
    forces = {
        joint.name: _force(pose, joint, [graph.load("forces", 4 * n + i) for i in range(4)])
        for n, joint in enumerate(loose)
    }
    torque = graph.load("forces", 4 * len(loose))
    along = {name: graph.load("along", n) for n, name in enumerate(kind.pushed)}
    moments = {joint.name: graph.load("moments", n) for n, joint in enumerate(rubbing)}
    motion = Dynamics(pose, forces, torque, None, moments, along)
    pushed = [linkage.joints[name] for name in kind.pushed]
    written = {
        "turning": [each for joint in (*loose, *rubbing) for each in _turning(pose, joint)],
        "sites": [number for joint in pushed for number in pose.travel(joint)],
    }
    rates = {
        "rates": [
            *(each for joint in loose for each in motion.rates[joint.name]),
            *([motion.crank_acceleration] if kind.is_free else []),
            *motion.bend_accelerations.values(),
        ],
        "reactions": [
            *(each for joint in rubbing for each in motion.reactions[joint.name]),
            *(motion.guide_force(joint) for joint in pushed if kind.rubs),
        ],
    }
    channels = channels_of(motion, forces, moments, along)
    first, second, third = (
        [
            Store(name, index, graph.index(value))
            for name, values in stores.items()
            for index, value in enumerate(values)
        ]
        for stores in (written, rates, {"channels": [value for value, _ in channels.values()]})
    )
    between = kept(graph, first, second)
    first += [Store("kept", place, node) for place, node in enumerate(between)]
    kept_at = {node: place for place, node in enumerate(between)}
    sizes = {
        "parameters": len(places),
        "state": 2 * half,
        "crank": 4,
        "turning": 2 * (len(loose) + len(rubbing)),
        "sites": 2 * len(pushed),
        "forces": 4 * len(loose) + 1,
        "along": len(pushed),
        "moments": len(rubbing),
        "rates": half,
        "reactions": len(rates["reactions"]),
        "kept": len(between),
        "channels": len(channels),
    }
    codes = {
        "pose": Code(graph, tuple(first)),
        "dynamics": Code(graph, tuple(second), kept_at),
        "sample": Code(graph, tuple(third), kept_at),
    }
    units = {name: unit for name, (_, unit) in channels.items()}
    return Variant(tuple(signs), kind, tuple(places), sizes, codes, units)


def _force(pose: Pose, joint: Joint, numbers: Sequence[Number]) -> JointForce:
    """The force in a loose joint; in a slide from components along and across it."""
    x, y, on_body, on_partner = numbers
    if joint.kind == "revolute":
        return JointForce(x, y, on_body, on_partner)
    line = pose.line(joint)
    return JointForce(*add(times(x, line), times(y, across(line))), on_body)


def _turning(pose: Pose, joint: Joint) -> tuple[Number, Number]:
    """Angular velocities of body and partner; in a slide of the frame that of the body, and the
    speed along it."""
    body = pose.speeds[joint.body.body]
    if joint.kind == "slide":
        return body, pose.slips[joint.name]
    return body, pose.speeds[joint.partner.body]


def positions(linkage: Linkage, is_free: bool) -> int:
    """Number of positions in the state."""
    return 2 * len(linkage.loose) + is_free + len(linkage.bending)


def channels_of(
    motion: Dynamics,
    forces: Mapping[str, JointForce],
    moments: Mapping[str, Number],
    along: Mapping[str, Number],
) -> dict[str, tuple[Number, str]]:
    """Quantities of a motion with their units, by name: first cosine and sine of each body with a
    direction."""
    pose, linkage = motion.pose, motion.linkage
    needed = balance(motion, forces, moments, along)
    found: dict[str, tuple[Number, str]] = {}

    def vector(name: str, components: Pair, unit: str) -> None:
        for axis, component in zip("xy", components, strict=True):
            found[f"{name}_{axis}"] = component, unit

    turning = [
        name
        for name in linkage.moving
        if name != linkage.crank and linkage.kinds[name] != "sliding"
    ]
    for name in turning:
        cosine, sine = pose.directions[name]
        found |= {f"{name}_cosine": (cosine, ""), f"{name}_sine": (sine, "")}
    found["crank_torque"] = needed.torque, "N*m"
    found["crank_acceleration"] = motion.crank_acceleration, "rad/s^2"
    for name in linkage.moving:
        if name in turning:
            place, velocity = pose.point(name, None)
            vector(f"{name}_position", place, "m")
            vector(f"{name}_velocity", velocity, "m/s")
            vector(f"{name}_acceleration", motion.acceleration(name), "m/s^2")
            found[f"{name}_angular_velocity"] = pose.speeds[name], "rad/s"
            found[f"{name}_angular_acceleration"] = motion.angular_acceleration(name), "rad/s^2"
        elif name != linkage.crank:
            place, velocity = pose.travel(linkage.joint_with_frame(name))
            found[f"{name}_position"] = place, "m"
            found[f"{name}_velocity"] = velocity, "m/s"
            found[f"{name}_acceleration"] = motion.accelerations[name, "slide"], "m/s^2"
    for name, joint in linkage.joints.items():
        if joint.kind == "slide":
            normal = across(pose.turned(joint.partner.body, pose.line(joint)))
            found[f"{name}_force"] = dot(normal, needed.forces[name]), "N"
            found[f"{name}_moment"] = needed.moments[name], "N*m"
        else:
            vector(f"{name}_force", needed.forces[name], "N")
    vector("frame_force", negative(needed.forces[linkage.drive]), "N")
    vector("shaking_force", needed.on_frame, "N")
    return found


def parameters_of(variant: Variant, linkage: Linkage) -> np.ndarray:
    """Values of a variant's parameters for a linkage of the same form."""
    try:
        return _parameters(variant, linkage, float)
    except ZeroDivisionError:  # of numbers that do not close; NumPy's go on, but are slower
        with np.errstate(all="ignore"):
            return _parameters(variant, linkage, np.float64)


def _parameters(variant: Variant, linkage: Linkage, kind: type) -> np.ndarray:
    values: dict[str, float] = {}

    def parameter(name: str, value: float) -> float:
        return values.setdefault(name, kind(value))

    nothing = (0.0, 0.0)
    still = {joint.name: (nothing, nothing) for joint in linkage.loose}
    crank = Crank(1.0, 0.0, 0.0, None if variant.kind.is_free else 0.0)
    # the numbers need not close: only the parameters count
    arithmetic = Arithmetic(parameter, lambda value: abs(value) ** 0.5 + 1e-9)
    bends = dict.fromkeys(linkage.bending, nothing)
    pose = Pose(linkage, variant.signs, crank, still, arithmetic, bends)
    forces = {joint.name: JointForce(0.0, 0.0) for joint in linkage.loose}
    along = dict.fromkeys(variant.kind.pushed, 0.0)
    channels_of(Dynamics(pose, forces, 0.0, along=along), forces, {}, along)
    return np.array([values[name] for name in variant.names])
