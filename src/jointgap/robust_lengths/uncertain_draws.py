"""Draws of what is uncertain: a mechanism each, whose lengths are still to be given, and the tolerances of these."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import qmc

from jointgap.config import DrivenMechanism, Mechanism, Scenario, Simulate
from jointgap.config.varied_values import with_values
from jointgap.core.errors import InputError
from jointgap.designs.design_of_experiments import Axis, axes_of
from jointgap.lengths.region import depends_on_offset

SOURCE = "optimise_robust.uncertain"
"""What errors call the place where something uncertain stands."""

LENGTHS = ("crank_length", "rod_length")
"""Words whose values are added to the lengths that are searched."""

PATHS_OF_LENGTHS = {
    f"mechanism.{link}.{key}": f"{link}_length" for link in ("crank", "rod") for key in ("length", "mass_centre")
}
"""By path the word for a length whose mass centre goes with it."""

OF_THE_COMPUTATION = {"simulate.revolutions", "simulate.samples_per_revolution", "simulate.tolerance"}
"""Paths of how a motion is computed, which is no property of a mechanism."""

OFFSET = "mechanism.slider.offset"
"""Path of what constraints of the lengths are worked out with."""

_LARGEST_TOLERANCE = 0.1
"""Share of a length beyond which what is added to it is no tolerance but, in all likelihood, the length itself."""

_FRESH = 1  # beside the seed: the stream of the fresh draws, which have nothing in common with those of the search


@dataclass(frozen=True)
class Draw:
    """One way in which the uncertain may turn out."""

    values: dict[str, Any]  # By key; of lengths what is added to them [m]
    mechanism: Mechanism  # At its nominal lengths
    simulate: Simulate
    tolerance: tuple[float, float] = (0.0, 0.0)  # What is added to (L2, L3) [m]


@dataclass(frozen=True)
class Uncertain:
    """What is uncertain in a scenario; make it with `uncertain_of`."""

    base: DrivenMechanism  # Mechanism, its effects applied, and simulation, at nominal values
    axes: tuple[Axis, ...]
    seed: int

    @property
    def nominal(self) -> Draw:
        """Nothing differs from the scenario."""
        return Draw({}, self.base.mechanism, self.base.simulate)

    def for_search(self, count: int) -> tuple[Draw, ...]:
        """`count` draws that fill what may be evenly: the beginning of a scrambled Sobol sequence."""
        power = (count - 1).bit_length()  # a sequence is balanced in whole powers of two
        return self._draws(qmc.Sobol(len(self.axes), scramble=True, rng=self.seed).random_base2(power)[:count])

    def fresh(self, count: int) -> tuple[Draw, ...]:
        """`count` draws, each independent of the others and of those of the search; errors as of `for_search`."""
        return self._draws(np.random.default_rng([self.seed, _FRESH]).random((count, len(self.axes))))

    def _draws(self, quantiles: np.ndarray) -> tuple[Draw, ...]:
        columns = [axis.at(part) for axis, part in zip(self.axes, quantiles.T, strict=True)]
        keys = [axis.key for axis in self.axes]
        return tuple(self._draw(dict(zip(keys, row, strict=True))) for row in zip(*columns, strict=True))

    def _draw(self, values: dict[str, Any]) -> Draw:
        others = {key: value for key, value in values.items() if key not in LENGTHS}
        try:
            scenario = with_values(self.base, others, SOURCE)
        except InputError as error:
            raise InputError(f"{error}; a draw that is impossible: cut the distribution off with from and to") from None
        crank, rod = (values.get(key, 0.0) for key in LENGTHS)
        return Draw(values, scenario.mechanism, scenario.simulate, (crank, rod))


def uncertain_of(scenario: Scenario) -> Uncertain:
    """What the section `optimise_robust` of a `scenario` calls uncertain."""
    options = scenario.optimise_robust
    if not options.uncertain:
        raise InputError(
            f"{SOURCE}: nothing is uncertain, so there is nothing to be robust against; give parameters with "
            "distributions, such as friction: {from: 0.02, to: 0.15}"
        )
    for key, word in PATHS_OF_LENGTHS.items():
        if key in options.uncertain:
            raise InputError(
                f"{SOURCE}.{key}: lengths are searched, and mass centres go with them; give {word} with the tolerance "
                "that is added, such as {distribution: normal, mean: 0 mm, deviation: 0.05 mm}"
            )
    for key in OF_THE_COMPUTATION & options.uncertain.keys():
        raise InputError(f"{SOURCE}.{key}: is how the motion is computed, and not uncertain; leave it out")
    if OFFSET in options.uncertain and (key := depends_on_offset(scenario.optimise.constraints)):
        raise InputError(
            f"{SOURCE}.{OFFSET}: optimise.constraints.{key} is computed with the nominal offset; leave out one of them"
        )
    base = DrivenMechanism(mechanism=scenario.mechanism.applied(), simulate=scenario.simulate)
    axes = axes_of(base, options.uncertain, SOURCE)
    for axis in axes:
        if axis.values is not None and len(axis.values) < 2:
            raise InputError(f"{SOURCE}.{axis.key}: one value is not uncertain; give several, or a distribution")
        if axis.key in LENGTHS:
            _check_tolerance(axis, scenario)
    return Uncertain(base, axes, options.seed)


def _check_tolerance(axis: Axis, scenario: Scenario) -> None:
    """Whether what is added to a length is small beside it."""
    shortest = min(getattr(box, axis.key)[0] for box in scenario.optimise.boxes.values())
    largest = max(abs(value) for value in axis.at(np.array([0.001, 0.5, 0.999])))
    if largest > _LARGEST_TOLERANCE * shortest:
        raise InputError(
            f"{SOURCE}.{axis.key}: the length is searched, and what stands here is added to it; values up to "
            f"{1e3 * largest:g} mm are no tolerance of a length of {1e3 * shortest:g} mm or more: give the departure "
            "from nominal, such as mean: 0 mm"
        )


def law_in_words(axis: Axis, factor: float = 1.0) -> str:
    """How a parameter is distributed, for a table."""
    if axis.values is not None:
        shown: Sequence = [f"{factor * v:.4g}" if isinstance(v, float) else str(v) for v in axis.values]
        return f"one of {', '.join(shown)}"
    low, middle, high = (f"{factor * value:.4g}" for value in axis.at(np.array([0.025, 0.5, 0.975])))
    return f"{_LAWS[axis.law.dist.name]}: median {middle}, 95 % of it {low} to {high}"


_LAWS = {"uniform": "uniform", "loguniform": "log-uniform", "truncnorm": "normal",
         "triang": "triangular"}  # fmt: skip
