"""The designs of a sweep: parameters with their distributions, and the values of each design."""

import hashlib
import json
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import stats
from scipy.stats import qmc

from jointgap.config import DrivenMechanism, Scenario, Simulate
from jointgap.config.designs import LogUniform, Normal, Sweep, Triangular, Uniform, Values, measured
from jointgap.config.variations import unit_of, with_values
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import JOINTS
from jointgap.core.schema import Column
from jointgap.core.units import to_si
from jointgap.lengths.objective import MEASURES
from jointgap.paper.printed import departures

COUNTING = {"window_start": "rad", "window_end": "rad", "error_measure": "", "revolution": ""}
"""Parameters that say how the error is counted, with their units; '' for words and whole numbers, which are listed."""

_ROUNDING = 1e-9  # [rad]


@dataclass(frozen=True)
class ErrorCounting:
    """How the error of the transmission angle is counted."""

    window: tuple[float, float]  # First and last crank angle of the revolution [rad]
    measure: str = "rms"  # One of `jointgap.lengths.objective.MEASURES`, of which the reduction is told
    revolution: int = 1  # From 1 on, the transient

    @classmethod
    def of(
        cls, values: Mapping[str, Any], window: tuple[float, float], simulate: Simulate, source: str
    ) -> "ErrorCounting":
        """Of a design."""
        start, end = values.get("window_start", window[0]), values.get("window_end", window[1])
        measure, revolution = values.get("error_measure", "rms"), values.get("revolution", 1)
        if not 0.0 <= start < end <= 2.0 * math.pi + _ROUNDING:
            raise InputError(
                f"{source}, window_start = {start:g}, window_end = {end:g}: the window must grow and lie in a "
                "revolution, 0 to 360 deg"
            )
        if measure not in MEASURES:
            raise InputError(
                f"{source}.error_measure = {measure!r}: no such measure; {did_you_mean(str(measure), MEASURES)}"
            )
        if revolution not in range(1, simulate.revolutions + 1):
            raise InputError(
                f"{source}.revolution = {revolution!r}: must be a whole number from 1 to simulate.revolutions, "
                f"{simulate.revolutions}"
            )
        return cls((float(start), float(end)), measure, int(revolution))


def check_counting(sweep: Sweep, simulate: Simulate, source: str) -> None:
    """Whether the parameters of a `sweep` that say how the error is counted can be drawn; InputError where not."""
    for key in COUNTING.keys() & sweep.parameters.keys():
        if not sweep.printed_numbers:
            raise InputError(
                f"{source}.{key}: says how the paper's printed numbers are counted; set sweep.printed_numbers to true, "
                "or leave it out"
            )
        if COUNTING[key]:
            continue
        values = getattr(sweep.parameters[key], "values", None)
        if values is None:
            raise InputError(f"{source}.{key}: has no range; list its values, such as {key}: [...]")
        for value in values:
            ErrorCounting.of({key: value}, sweep.window, simulate, source)


SOURCE = "sweep.parameters"
"""What errors call the place where a parameter stands."""

_FARTHEST_TAIL = 5.0
"""Standard deviations: one value in three million of a normal distribution lies farther out, so none is meant."""

_TRIED = 64
"""Designs of which one at least has to be possible."""


@dataclass(frozen=True)
class Axis:
    """One parameter of a sweep."""

    key: str  # Word or path, as `jointgap.config.variations.with_values` takes it
    unit: str  # SI unit; '' for pure numbers and words
    values: tuple | None = None  # Of a list, as the configuration gives them, or of a grid [SI]
    law: Any = None  # Of a range [SI]

    def at(self, quantiles: np.ndarray) -> list:
        """Values at `quantiles`, (n,) in [0, 1)."""
        if self.values is not None:
            return [self.values[int(place)] for place in np.floor(quantiles * len(self.values))]
        # 14 digits: the same on every machine, though powers and logarithms differ in the last bit.
        return [float(f"{value:.14g}") for value in self.law.ppf(quantiles)]

    @property
    def column(self) -> Column:
        """What holds its values in the table of designs."""
        kinds = {type(value) for value in self.values or (0.0,)}
        kind = "bool" if kinds == {bool} else "text" if str in kinds else "float"
        return Column(self.key, self.unit or ("1" if kind == "float" else ""), f"{self.key}, swept", kind)


@dataclass(frozen=True)
class Designs:
    """All designs of a sweep, none of which is held until it is asked for; make it with `designs_of`."""

    base: DrivenMechanism  # Mechanism, its effects applied, and simulation, where nothing is swept
    axes: tuple[Axis, ...]
    kind: str  # sobol, latin_hypercube or grid
    number: int
    seed: int
    window: tuple[float, float]  # Of the transmission angle's error [rad]
    best_lengths: bool = False
    printed_numbers: bool = False

    @property
    def measured(self) -> tuple[Column, ...]:
        """Columns of what is measured of each design."""
        return measured(self.best_lengths, self.printed_numbers)

    def values(self, first: int, count: int) -> list[dict[str, Any]]:
        """Values by key of the designs from number `first` on, `count` of them."""
        columns = [axis.at(part) for axis, part in zip(self.axes, self._quantiles(first, count).T, strict=True)]
        return [dict(zip((axis.key for axis in self.axes), row, strict=True)) for row in zip(*columns, strict=True)]

    def scenario(self, values: dict[str, Any]) -> DrivenMechanism:
        """Mechanism and simulation of a design; InputError where it is impossible."""
        if self.printed_numbers:
            self.counting(values)  # complains where it is impossible
        return with_values(self.base, {key: value for key, value in values.items() if key not in COUNTING}, SOURCE)

    def counting(self, values: Mapping[str, Any]) -> ErrorCounting:
        """How the error of a design is counted for the printed numbers; InputError where that is impossible."""
        return ErrorCounting.of(values, self.window, self.base.simulate, SOURCE)

    @cached_property
    def digest(self) -> str:
        """Twelve digits that change with anything that a design's row depends on: in the configuration, and in the file
        of a measured drive.

        Of a sequence that can be grown the number of designs is no part of it. Nor is the code: the workflow makes
        parts anew where that has changed.
        """
        told = {
            "mechanism": self.base.mechanism.model_dump(mode="json"),
            "simulate": self.base.simulate.model_dump(mode="json"),
            "drive": getattr(self.base.simulate.drive, "content", ""),
            "axes": [[a.key, a.unit, a.values, a.law and [a.law.dist.name, a.law.kwds]] for a in self.axes],
            "design": [self.kind, self.seed, None if self.kind == "sobol" else self.number],
            "window": self.window,
        } | {name: True for name in ("best_lengths", "printed_numbers") if getattr(self, name)}
        return hashlib.sha256(json.dumps(told, sort_keys=True, default=float).encode()).hexdigest()[:12]

    def _quantiles(self, first: int, count: int) -> np.ndarray:
        """(count, axes) in [0, 1)."""
        d = len(self.axes)
        if self.kind == "sobol":
            engine = qmc.Sobol(d, scramble=True, rng=self.seed)
            if first:
                engine.fast_forward(first)
            with warnings.catch_warnings():
                # It warns where a first part of a sequence is no power of two; these are parts of a longer one.
                warnings.filterwarnings("ignore", "The balance properties", UserWarning)
                return engine.random(count)
        if self.kind == "latin_hypercube":
            return qmc.LatinHypercube(d, rng=self.seed).random(self.number)[first : first + count]
        sizes = [len(axis.values) for axis in self.axes]
        places = np.stack(np.unravel_index(np.arange(first, first + count), sizes), axis=1)
        return (places + 0.5) / sizes


def designs_of(scenario: Scenario) -> Designs:
    """The designs that the section `sweep` of a `scenario` asks for."""
    sweep = scenario.sweep
    if not sweep.parameters:
        raise InputError(
            f"{SOURCE}: nothing is swept; give parameters with ranges or lists, such as clearance: "
            "{from: 0.1 mm, to: 0.5 mm}"
        )
    base = DrivenMechanism(mechanism=scenario.mechanism.applied(), simulate=scenario.simulate)
    check_counting(sweep, base.simulate, SOURCE)
    axes = axes_of(base, sweep.parameters, SOURCE, sweep.design == "grid")
    designs = Designs(
        base,
        axes,
        sweep.design,
        sweep.designs,
        sweep.seed,
        sweep.window,
        best_lengths=sweep.best_lengths or sweep.printed_numbers,
        printed_numbers=sweep.printed_numbers,
    )
    _check_possible(designs)
    return designs


def axes_of(base: DrivenMechanism, parameters: Mapping[str, Any], source: str, grid: bool = False) -> tuple[Axis, ...]:
    """The parameters of a section, in SI."""
    axes = tuple(_axis(base, key, spec, grid, source) for key, spec in parameters.items())
    for axis in axes:
        _check_width(axis, source)
    _check_overlaps(axes, source)
    return axes


def _axis(base: DrivenMechanism, key: str, spec: Any, grid: bool, section: str) -> Axis:
    source = f"{section}.{key}"
    if isinstance(spec, Values):
        return _listed_axis(base, key, spec, section)
    unit = COUNTING.get(key) or unit_of(base, key, section)

    def si(name: str) -> float | None:
        given = getattr(spec, name)
        try:
            return None if given is None else to_si(given, unit)
        except ValueError as error:
            raise InputError(f"{source}.{name.rstrip('_')} = {given!r}: {error}") from error

    low, high = si("from_"), si("to")
    if low is not None and high is not None and not low < high:
        order = "are the same, so it does not vary" if low == high else "stand the wrong way round"
        raise InputError(f"{source}: from = {spec.from_} and to = {spec.to} {order}; give from below to")
    if isinstance(spec, Normal):
        mean, deviation = si("mean"), si("deviation")
        if deviation <= 0:
            raise InputError(f"{source}.deviation = {spec.deviation!r}: must be above zero, or nothing varies")
        given = -math.inf if low is None else low, math.inf if high is None else high
        ends = [(end - mean) / deviation for end in given]
        if ends[0] > _FARTHEST_TAIL or ends[1] < -_FARTHEST_TAIL:
            raise InputError(
                f"{source}: from and to leave values more than {_FARTHEST_TAIL:g} deviations from the mean, which "
                "never come; give another mean, or a uniform range"
            )
        return Axis(key, unit, law=stats.truncnorm(a=ends[0], b=ends[1], loc=mean, scale=deviation))
    if isinstance(spec, Triangular):
        peak = si("peak")
        if not low <= peak <= high:
            raise InputError(f"{source}.peak = {spec.peak!r}: must lie between from and to")
        return Axis(key, unit, law=stats.triang(c=(peak - low) / (high - low), loc=low, scale=high - low))
    if isinstance(spec, LogUniform) and low <= 0:
        raise InputError(f"{source}.from = {spec.from_!r}: a log_uniform range begins above zero")
    if grid:
        spaced = np.geomspace if isinstance(spec, LogUniform) else np.linspace
        return Axis(key, unit, tuple(float(f"{value:.12g}") for value in spaced(low, high, spec.number)))
    if isinstance(spec, Uniform):
        return Axis(key, unit, law=stats.uniform(loc=low, scale=high - low))
    return Axis(key, unit, law=stats.loguniform(a=low, b=high))


def _listed_axis(base: DrivenMechanism, key: str, spec: Values, section: str) -> Axis:
    """A list of quantities in SI, or of words where they set no quantity."""
    if COUNTING.get(key) == "":
        return Axis(key, "", spec.values)
    try:
        unit = COUNTING.get(key) or unit_of(base, key, section)
    except InputError:
        with_values(base, {key: spec.values[0]}, section)  # complains where there is no such key at all
        return Axis(key, "", spec.values)
    values = []
    for value in spec.values:
        try:
            values.append(to_si(value, unit))
        except ValueError as error:
            raise InputError(f"{section}.{key} = {value!r}: {error}") from error
    if len(set(values)) < len(values):
        raise InputError(f"{section}.{key}: {list(spec.values)} gives one value in two ways; give each once")
    return Axis(key, unit, tuple(values))


_SAME = {
    "speed": ("simulate.speed",),
    "crank_length": ("mechanism.crank.length", "mechanism.crank.mass_centre"),
    "rod_length": ("mechanism.rod.length", "mechanism.rod.mass_centre"),
    **{
        word: tuple(f"mechanism.joints.{joint}.{end}" for joint in JOINTS for end in ends)
        for word, ends in {
            "clearance": ("bearing_radius", "loose"),
            "friction": ("contact.friction", "loose"),
            "restitution": ("contact.restitution", "loose"),
            "stiffness": ("contact.stiffness", "loose"),
        }.items()
    },
}
"""By word, the paths of what it sets, or of what decides what it sets."""


def _check_width(axis: Axis, source: str) -> None:
    """A distribution is not so narrow that its values are one number."""
    low, high = axis.at(np.array([0.25, 0.75])) if axis.law is not None else (0.0, 1.0)
    if low == high:
        raise InputError(
            f"{source}.{axis.key}: is so narrow that all its values are {low:.14g}, in 14 digits; make it wider"
        )


def _check_overlaps(axes: tuple[Axis, ...], source: str) -> None:
    """No number is set by a word and by a path at once: one of them would win in silence."""
    keys = {axis.key for axis in axes}
    for word, paths in _SAME.items():
        if word in keys and (twice := keys & set(paths)):
            raise InputError(f"{source}: {word} and {min(twice)} set the same number; give one of them")


def _check_possible(designs: Designs) -> None:
    """Of a sweep whose designs are all impossible, the first one's error, before anything is simulated.

    Single impossible designs are rows of the table with their reason.
    """
    errors, possible = [], None
    for values in designs.values(0, min(_TRIED, designs.number)):
        try:
            possible = designs.scenario(values)
            break
        except InputError as error:
            errors.append(error)
    if possible is None:
        raise errors[0]
    if designs.printed_numbers and (others := departures(possible.mechanism, possible.simulate)):
        raise InputError(
            f"sweep.printed_numbers: the paper's numbers do not speak of this mechanism ({'; '.join(others)}); leave "
            "it out, or sweep what the paper does not print alone"
        )
