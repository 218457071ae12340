"""The equations of motion of a linkage as two compiled functions.

Between them ordinary compiled code evaluates the laws of contacts and effects: `pose` writes their
arguments, `dynamics` reads their forces. A variant is a topology with its set of loose joints and
its kind of drive; lengths, masses and fits are parameters, so they never make another one.
"""

import ctypes
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jointgap.linkage.equations import (
    Arithmetic,
    Crank,
    Dynamics,
    JointForce,
    Number,
    Pose,
)
from jointgap.linkage.machine_code import Code, Graph, MachineCode, Store, kept
from jointgap.linkage.topology import Linkage


@dataclass(frozen=True)
class Variant:
    """Compiled equations of the linkages of one form.

    Memory is one array of numbers with the fields

    - `parameters`;
    - `state`: clearance vectors of the loose joints, then the crank's angle if it is free; their
      rates;
    - `crank`: cosine, sine, speed, acceleration (unused where it is free);
    - `turning`: angular velocity of body and partner of each loose joint, written by `pose`;
    - `forces`: fx, fy, moment on body and partner of each loose joint, and the torque on the crank,
      read by `dynamics`;
    - `loads`: force x, y and moment of each moving body, read by `dynamics`;
    - `rates`: second rates of the state, written by `dynamics`;
    - `kept`: between the two functions.
    """

    signs: tuple[float, ...]
    is_free: bool
    loaded: tuple[str, ...]  # Bodies with loads
    names: tuple[str, ...]  # Of the parameters
    sizes: Mapping[str, int]  # Of the fields
    codes: Mapping[str, Code]

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


def variant_of(
    linkage: Linkage,
    signs: Sequence[float],
    is_free: bool = False,
    loaded: Sequence[str] = (),
) -> Variant:
    """The variant of a linkage; `is_free`: the torque turns the crank; `loaded`: bodies on which
    loads act. Linkages of one form share it."""
    key = (linkage.form, tuple(signs), is_free, tuple(loaded))
    if key not in _VARIANTS:
        while len(_VARIANTS) >= _MOST_VARIANTS:
            del _VARIANTS[next(iter(_VARIANTS))]
        _VARIANTS[key] = build_variant(linkage, signs, is_free, loaded)
    return _VARIANTS[key]


_VARIANTS: dict[tuple, Variant] = {}  # of this process
_MOST_VARIANTS = 256


def forget() -> None:
    """Drop all variants, so that the next ones are made anew."""
    _VARIANTS.clear()


def build_variant(
    linkage: Linkage, signs: Sequence[float], is_free: bool = False, loaded: Sequence[str] = ()
) -> Variant:
    """`variant_of`, made anew."""
    graph, places = Graph(), {}

    def parameter(name: str, _: float) -> Number:
        return graph.load("parameters", places.setdefault(name, len(places)))

    loose = linkage.loose
    half = 2 * len(loose) + is_free
    state = [graph.load("state", i) for i in range(2 * half)]
    clearances = {
        joint.name: (
            (state[2 * n], state[2 * n + 1]),
            (state[half + 2 * n], state[half + 2 * n + 1]),
        )
        for n, joint in enumerate(loose)
    }
    cosine, sine, speed, acceleration = (graph.load("crank", i) for i in range(4))
    crank = Crank(cosine, sine, speed, None if is_free else acceleration)
    arithmetic = Arithmetic(parameter, graph.root, graph.cos_sin)
    pose = Pose(linkage, signs, crank, clearances, arithmetic)
    forces = {
        joint.name: JointForce(*(graph.load("forces", 4 * n + i) for i in range(4)))
        for n, joint in enumerate(loose)
    }
    loads = {
        body: (
            (graph.load("loads", 3 * n), graph.load("loads", 3 * n + 1)),
            graph.load("loads", 3 * n + 2),
        )
        for n, body in enumerate(loaded)
    }
    torque = graph.load("forces", 4 * len(loose))
    motion = Dynamics(pose, forces, torque, loads)
    written = {
        ("turning", 2 * n + i): pose.speeds[place.body]
        for n, joint in enumerate(loose)
        for i, place in enumerate((joint.body, joint.partner))
    }
    rates = {
        ("rates", 2 * n + i): each
        for n, joint in enumerate(loose)
        for i, each in enumerate(motion.rates[joint.name])
    }
    if is_free:
        rates["rates", 2 * len(loose)] = motion.crank_acceleration
    first, second = (
        [Store(name, index, graph.index(value)) for (name, index), value in stores.items()]
        for stores in (written, rates)
    )
    between = kept(graph, first, second)
    first += [Store("kept", place, node) for place, node in enumerate(between)]
    kept_at = {node: place for place, node in enumerate(between)}
    sizes = {
        "parameters": len(places),
        "state": 2 * half,
        "crank": 4,
        "turning": 2 * len(loose),
        "forces": 4 * len(loose) + 1,
        "loads": 3 * len(loaded),
        "rates": half,
        "kept": len(between),
    }
    codes = {"pose": Code(graph, tuple(first)), "dynamics": Code(graph, tuple(second), kept_at)}
    return Variant(tuple(signs), is_free, tuple(loaded), tuple(places), sizes, codes)


def parameters_of(variant: Variant, linkage: Linkage) -> np.ndarray:
    """Values of a variant's parameters for a linkage of the same form."""
    values: dict[str, float] = {}

    def parameter(name: str, value: float) -> float:
        return values.setdefault(name, value)

    still = {joint.name: ((0.0, 0.0), (0.0, 0.0)) for joint in linkage.loose}
    crank = Crank(1.0, 0.0, 0.0, None if variant.is_free else 0.0)
    # the numbers need not close: only the parameters count
    arithmetic = Arithmetic(parameter, lambda value: abs(value) ** 0.5 + 1e-9)
    pose = Pose(linkage, variant.signs, crank, still, arithmetic)
    nothing = {joint.name: JointForce(0.0, 0.0) for joint in linkage.loose}
    Dynamics(pose, nothing, 0.0, {body: ((0.0, 0.0), 0.0) for body in variant.loaded})
    return np.array([values[name] for name in variant.names])
