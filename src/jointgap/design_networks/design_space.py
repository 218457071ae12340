"""The designs that networks know: lengths of crank and rod in a box, and the parameters that vary besides."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from jointgap.config import DrivenMechanism, Mechanism, Scenario, Simulate
from jointgap.config.sweep_config import Uniform
from jointgap.config.varied_values import with_values
from jointgap.core.errors import InputError
from jointgap.designs.robust import LENGTHS, OF_THE_COMPUTATION, OFFSET, PATHS_OF_LENGTHS
from jointgap.designs.sampling import Axis, Designs, axes_of
from jointgap.lengths.region import Region, depends_on_offset, geometric

SOURCE = "design_networks.parameters"
"""What errors call the place where a parameter stands."""

_AT_ONCE = 64  # designs whose values are worked out together
_TRIED = 64
"""Designs of which one at least has to be possible."""


@dataclass(frozen=True)
class Design:
    """One design."""

    values: dict[str, Any]  # By key, lengths not among them [SI]
    lengths: tuple[float, float]  # (L2, L3) [m]
    mechanism: Mechanism  # At these lengths
    simulate: Simulate

    def at(self, lengths: Iterable[float]) -> "Design":
        """The same with other `lengths` (2,) [m]."""
        crank, rod = map(float, lengths)
        return Design(self.values, (crank, rod), self.mechanism.with_lengths(crank, rod), self.simulate)


@dataclass(frozen=True)
class DesignSpace:
    """What designs vary; make it with `design_space`."""

    base: DrivenMechanism  # Mechanism, its effects applied, and simulation, where nothing varies
    region: Region  # Of the lengths that are searched. Designs are drawn from its whole box
    axes: tuple[Axis, ...]  # Crank and rod length, then the other parameters
    settled_revolution: int  # Whose motion counts, from 1

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the loose joints."""
        return self.base.mechanism.loose

    @property
    def original(self) -> tuple[float, float]:
        """Lengths that were designed, (L2, L3) [m]."""
        return self.base.mechanism.crank.length, self.base.mechanism.rod.length

    def drawn(self, number: int, seed: int) -> Iterator[Design]:
        """Designs that fill the ranges evenly, the beginning of a scrambled Sobol sequence of `seed`; those of the
        first `number` that are possible.
        """
        sequence = self._sequence(number, seed)
        for first in range(0, number, _AT_ONCE):
            yield from self._possible(sequence.values(first, min(_AT_ONCE, number - first)))

    def fresh(self, number: int, seed: list[int]) -> Iterator[Design]:
        """Designs each independent of the others, of the `number` that a generator with `seed` draws those that are
        possible.
        """
        quantiles = np.random.default_rng(seed).random((number, len(self.axes)))
        columns = [axis.at(part) for axis, part in zip(self.axes, quantiles.T, strict=True)]
        keys = [axis.key for axis in self.axes]
        return self._possible(dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True))

    def inputs(self, design: Design, lengths: np.ndarray) -> np.ndarray:
        """What a network is told of a design at `lengths` (m, 2) [m]: each parameter in [-1, 1], (m, axes)."""
        told = np.empty((len(lengths), len(self.axes)))
        columns = [*lengths.T, *(np.full(len(lengths), design.values[axis.key]) for axis in self.axes[2:])]
        for place, (axis, values) in enumerate(zip(self.axes, columns, strict=True)):
            told[:, place] = _standard(axis, values)
        return told

    def _possible(self, drawn: Iterable[dict[str, Any]]) -> Iterator[Design]:
        for values in drawn:
            try:
                yield self._design(values)
            except InputError:
                continue

    def _design(self, values: dict[str, Any]) -> Design:
        others = {key: value for key, value in values.items() if key not in LENGTHS}
        scenario = with_values(self.base, others, SOURCE)
        lengths = tuple(values[key] for key in LENGTHS)
        return Design(others, lengths, scenario.mechanism.with_lengths(*lengths), scenario.simulate)

    def check(self) -> None:
        """InputError where none of the first designs is possible, that of the first."""
        values = self._sequence(_TRIED, 0).values(0, _TRIED)
        if next(self._possible(values), None) is None:
            self._design(values[0])

    def _sequence(self, number: int, seed: int) -> Designs:
        return Designs(self.base, self.axes, "sobol", number, seed, (0.0, 2.0 * np.pi))


def _standard(axis: Axis, values: np.ndarray) -> np.ndarray:
    """Values (n,) as shares of what is likely, from -1 to 1: a range by its distribution, a list between its ends."""
    if axis.values is not None:
        low, high = min(axis.values), max(axis.values)
        return 2.0 * (np.asarray(values, dtype=float) - low) / (high - low) - 1.0
    return 2.0 * axis.law.cdf(values) - 1.0


def design_space(scenario: Scenario) -> DesignSpace:
    """The designs that the section `design_networks` of a `scenario` asks for."""
    base = DrivenMechanism(mechanism=scenario.mechanism.applied(), simulate=scenario.simulate)
    parameters = scenario.design_networks.parameters
    if not base.mechanism.loose:
        raise InputError(
            "design_networks: all joints are ideal, so there is no motion in joints to learn; make a joint loose"
        )
    if not parameters:
        raise InputError(
            f"{SOURCE}: nothing varies besides the lengths; give parameters with ranges, such as clearance: "
            "{from: 0.2 mm, to: 1 mm}"
        )
    for key in (*PATHS_OF_LENGTHS, *LENGTHS):
        if key in parameters:
            raise InputError(
                f"{SOURCE}.{key}: lengths lie in the first of optimise.boxes, which they fill; leave it out"
            )
    for key in OF_THE_COMPUTATION & parameters.keys():
        raise InputError(f"{SOURCE}.{key}: is how the motion is computed, and no property of a design; leave it out")
    if OFFSET in parameters and (key := depends_on_offset(scenario.optimise.constraints)):
        raise InputError(
            f"{SOURCE}.{OFFSET}: optimise.constraints.{key} is computed with the nominal offset; leave out one of them"
        )
    others = axes_of(base, parameters, SOURCE)
    for axis in others:
        _check_known(axis)
    name, box = next(iter(scenario.optimise.boxes.items()))
    region = Region.of(box, scenario.optimise.ratio_limit).under(
        geometric(scenario.optimise.constraints, base.mechanism.slider.offset), name
    )
    ends = zip(LENGTHS, region.lower, region.upper, strict=True)
    lengths = axes_of(base, {key: Uniform(**{"from": low, "to": high}) for key, low, high in ends}, SOURCE)
    space = DesignSpace(base, region, (*lengths, *others), scenario.optimise.ensemble.settled_revolution)
    space.check()
    return space


def _check_known(axis: Axis) -> None:
    """Whether a parameter is a number that varies."""
    if axis.values is None:
        return
    for value in axis.values:
        if isinstance(value, bool) or not isinstance(value, float | int):
            raise InputError(
                f"{SOURCE}.{axis.key}: {value!r} is no number, and a network knows numbers alone; leave it out, and "
                "train networks for each such mechanism"
            )
    if len(axis.values) < 2:
        raise InputError(f"{SOURCE}.{axis.key}: one value does not vary; give several, or a range")
