"""The designs of a sweep: parameters with their distributions, and the values of each design."""

import hashlib
import json
import math
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np
from scipy import stats
from scipy.stats import qmc

from jointgap.config import DrivenMechanism, Mechanism, Scenario
from jointgap.config.designs import Sweep, Values, measured
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.variations import OF_LOOSE_JOINTS, paths_of, si_number, unit_of, with_values
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import JOINTS
from jointgap.core.schema import Column
from jointgap.lengths.objective import MEASURES
from jointgap.motion.linkage import linkage_remarks
from jointgap.paper.printed import departures

SOURCE = "sweep.parameters"
"""The section of swept parameters in error messages."""

ERROR_PARAMETERS = {
    "window_start": "rad",
    "window_end": "rad",
    "error_measure": "",
    "revolution": "",
}
"""Parameters that define the error in the printed numbers, with their units; '' for words and whole
numbers, which need a list."""

PERTURBATION = 1e-7  # [m] standard deviation of the clearance vectors at a perturbed start
_ROUNDING = 1e-9  # [rad]
# [standard deviations] beyond: one in three million values of a normal distribution
_FARTHEST_TAIL = 5.0
_MOST_TRIALS = 64  # designs searched for a feasible one


class ErrorDefinition(NamedTuple):
    """Definition of the error of the transmission angle in the paper's printed numbers."""

    window: tuple[float, float]  # First and last crank angle of the revolution [rad]
    measure: str  # One of `jointgap.lengths.objective.MEASURES`
    revolution: int  # From 1; 1 is the transient


@dataclass(frozen=True)
class Axis:
    """One parameter of a sweep."""

    key: str  # Word or path, as in `jointgap.config.variations.with_values`
    unit: str  # SI unit; '' for pure numbers and words
    values: tuple | None = None  # Of a list, as configured, or of a grid [SI]
    law: Any = None  # Of a range [SI], a scipy distribution

    @property
    def varies(self) -> bool:
        return self.values is None or len(self.values) > 1

    @property
    def is_logarithmic(self) -> bool:
        """Whether it is a range with a log-uniform distribution."""
        return self.values is None and self.law.dist.name == "loguniform"

    def at(self, quantiles: np.ndarray) -> list:
        """Values at `quantiles`, (n,) in [0, 1)."""
        if self.values is not None:
            return [self.values[int(index)] for index in quantiles * len(self.values)]
        # 14 digits: powers and logarithms differ between machines in the last bit
        return [float(f"{value:.14g}") for value in self.law.ppf(quantiles)]

    @cached_property
    def column(self) -> Column:
        """Its column in the table of designs."""
        types = {type(value) for value in self.values or (0.0,)}
        kind = "bool" if types == {bool} else "text" if str in types else "float"
        unit = self.unit or ("1" if kind == "float" else "")
        return Column(self.key, unit, f"{self.key}, swept", kind)


def values_at(axes: tuple[Axis, ...], quantiles: np.ndarray) -> list[dict[str, Any]]:
    """Values by key of n designs, from their `quantiles` (n, axes) in [0, 1)."""
    columns = [axis.at(column) for axis, column in zip(axes, quantiles.T, strict=True)]
    keys = [axis.key for axis in axes]
    return [dict(zip(keys, values, strict=True)) for values in zip(*columns, strict=True)]


@dataclass(frozen=True)
class Designs:
    """All designs of a sweep, evaluated on demand; created by `designs_of`."""

    base: DrivenMechanism  # Mechanism, with effects applied, and simulation, before the sweep
    axes: tuple[Axis, ...]
    sweep: Sweep
    source: str = SOURCE  # Section in error messages

    @property
    def number(self) -> int:
        """Number of designs."""
        return self.sweep.designs

    @property
    def measured(self) -> tuple[Column, ...]:
        """Columns of the measures of each design."""
        return measured(self.base.mechanism.sites, self.sweep)

    def values(self, begin: int, count: int) -> list[dict[str, Any]]:
        """Values by key of `count` designs from number `begin`."""
        dimensions, seed = len(self.axes), self.sweep.seed
        if self.sweep.design == "sobol":
            engine = qmc.Sobol(dimensions, scramble=True, rng=seed)
            if begin:
                engine.fast_forward(begin)
            with warnings.catch_warnings():
                # about parts whose size is no power of two; these belong to a longer sequence
                warnings.filterwarnings("ignore", "The balance properties", UserWarning)
                quantiles = engine.random(count)
        elif self.sweep.design == "latin_hypercube":
            samples = qmc.LatinHypercube(dimensions, rng=seed).random(self.number)
            quantiles = samples[begin : begin + count]
        else:
            sizes = [len(axis.values) for axis in self.axes]
            indices = np.unravel_index(np.arange(begin, begin + count), sizes)
            quantiles = (np.stack(indices, axis=1) + 0.5) / sizes
        return values_at(self.axes, quantiles)

    def scenario(self, values: Mapping[str, Any]) -> DrivenMechanism:
        """Mechanism and simulation of a design; InputError where it is infeasible."""
        self.error_definition(values)
        changes = {key: value for key, value in values.items() if key not in ERROR_PARAMETERS}
        return with_values(self.base, changes, self.source)

    def starts(self, mechanism: Mechanism | LinkageFile) -> Iterator[dict[str, np.ndarray]]:
        """Initial clearance vectors (2,) [m] by loose joint, of each start of a design: zero, then
        normally distributed."""
        random = np.random.default_rng(self.sweep.seed)
        names = mechanism.loose if isinstance(mechanism, LinkageFile) else JOINTS
        vectors = random.normal(0.0, PERTURBATION, (self.sweep.starts, len(names), 2))
        vectors[0] = 0.0
        for start in vectors:
            by_joint = zip(names, start, strict=True)
            yield {name: vector for name, vector in by_joint if name in mechanism.loose}

    def error_definition(self, values: Mapping[str, Any]) -> ErrorDefinition:
        """Definition of the error for a design; InputError where it is invalid."""
        start, end = self.sweep.window
        start, end = values.get("window_start", start), values.get("window_end", end)
        measure, revolution = values.get("error_measure", "rms"), values.get("revolution", 1)
        turns = self.base.simulate.revolutions
        if not 0.0 <= start < end <= 2.0 * math.pi + _ROUNDING:
            raise InputError(
                f"{SOURCE}, window_start = {start:g}, window_end = {end:g}: the window must be"
                " increasing and within 0 to 360 deg"
            )
        if measure not in MEASURES:
            raise InputError(
                f"{SOURCE}.error_measure = {measure!r}: no such measure;"
                f" {did_you_mean(str(measure), MEASURES)}"
            )
        if revolution not in range(1, turns + 1):
            raise InputError(
                f"{SOURCE}.revolution = {revolution!r}: must be an integer from 1 to"
                f" simulate.revolutions, {turns}"
            )
        return ErrorDefinition((float(start), float(end)), measure, int(revolution))

    @cached_property
    def digest(self) -> str:
        """Twelve hexadecimal digits of everything that determines a row, except the code; the
        number of designs counts only where it changes the samples."""
        sweep = self.sweep
        content = {
            "mechanism": self.base.mechanism.model_dump(mode="json"),
            "simulate": self.base.simulate.model_dump(mode="json"),
            "drive": getattr(self.base.simulate.drive, "content", ""),
            "axes": [
                [a.key, a.unit, a.values, a.law and [a.law.dist.name, a.law.kwds]]
                for a in self.axes
            ],
            "design": [sweep.design, sweep.seed, None if sweep.design == "sobol" else self.number],
            "window": sweep.window,
        }
        content |= {"starts": sweep.starts} if sweep.starts > 1 else {}
        content |= {"best_lengths": True} if sweep.best_lengths or sweep.printed_numbers else {}
        content |= {"printed_numbers": True} if sweep.printed_numbers else {}
        text = json.dumps(content, sort_keys=True, default=float)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def designs_of(scenario: Scenario) -> Designs:
    """The designs of the section `sweep` of a `scenario`; InputError where none is feasible."""
    sweep = scenario.sweep
    if not sweep.parameters:
        raise InputError(
            f"{SOURCE}: is empty; give parameters with ranges or lists, such as clearance: {{from:"
            " 0.1 mm, to: 0.5 mm}"
        )
    error_keys = ERROR_PARAMETERS.keys() & sweep.parameters.keys()
    if error_keys and not sweep.printed_numbers:
        raise InputError(
            f"{SOURCE}.{min(error_keys)}: defines the error of the paper's printed numbers; set"
            " sweep.printed_numbers to true, or remove this parameter"
        )
    base = DrivenMechanism(mechanism=scenario.mechanism.applied(), simulate=scenario.simulate)
    is_grid = sweep.design == "grid"
    axes = axes_of(base, sweep.parameters, SOURCE, ERROR_PARAMETERS, is_grid)
    designs = Designs(base, axes, sweep)
    for axis in designs.axes:
        for value in axis.values if ERROR_PARAMETERS.get(axis.key) == "" else ():
            designs.error_definition({axis.key: value})
    errors = []
    for values in designs.values(0, min(_MOST_TRIALS, designs.number)):
        try:
            feasible = designs.scenario(values)
            _check_assembly(feasible, values)
            break
        except InputError as error:  # a row of the table with this reason
            errors.append(error)
    else:
        raise errors[0]
    if sweep.printed_numbers and (differences := departures(feasible.mechanism, feasible.simulate)):
        raise InputError(
            "sweep.printed_numbers: the paper's numbers do not apply to this mechanism"
            f" ({'; '.join(differences)}); remove it, or sweep only settings that the paper does"
            " not print"
        )
    return designs


def _check_assembly(design: DrivenMechanism, values: Mapping[str, Any]) -> None:
    """InputError where the linkage of a design cannot be assembled or turned."""
    if isinstance(design.mechanism, LinkageFile):
        try:
            linkage_remarks(design.mechanism, design.simulate)
        except InputError as error:
            words = ", ".join(f"{key} = {value}" for key, value in values.items())
            raise InputError(f"{SOURCE}, {words}: {error}") from None


def _set_by(base: DrivenMechanism, key: str, section: str) -> tuple[set[str], set[str]]:
    """Paths that a parameter sets, and those that determine the values of a word."""
    found = {".".join(path) for path in paths_of(base, key, f"{section}.{key}")}
    found |= {path.replace(".clearance", ".bearing_radius") for path in found}
    if key in OF_LOOSE_JOINTS:
        mechanism = base.mechanism
        joints = (*mechanism.sites.revolutes, *mechanism.sites.slides.values())
        ends = ("clearance", "bearing_radius") if key == "clearance" else (f"contact.{key}",)
        determining = {f"joints.{joint}.{end}" for joint in joints for end in (*ends, "loose")}
        determining |= {f"contacts.{contact}.{key}" for contact in mechanism.contacts}
        return found, {f"mechanism.{path}" for path in determining}
    is_word = "." not in key
    return found, {path.replace(".length", ".mass_centre") for path in found if is_word}


def axes_of(
    base: DrivenMechanism,
    parameters: Mapping[str, Any],
    section: str,
    units: Mapping[str, str],
    grid: bool = False,
) -> tuple[Axis, ...]:
    """Axes of the `parameters` in a `section`; `units` of those that are no keys of the
    mechanism."""
    axes = tuple(
        _axis(base, key, spec, section, units.get(key), grid) for key, spec in parameters.items()
    )
    for one, other in permutations(parameters.keys() - units.keys(), 2):
        found, determining = _set_by(base, one, section)
        if _set_by(base, other, section)[0] & (found | determining):
            raise InputError(f"{section}: {one} and {other} set the same value; give one of them")
    return axes


def _axis(
    base: DrivenMechanism, key: str, spec: Any, section: str, unit: str | None, grid: bool
) -> Axis:
    source, is_list = f"{section}.{key}", isinstance(spec, Values)
    if unit == "":
        if not is_list:
            raise InputError(f"{source}: accepts no range; list its values, such as {key}: [...]")
        return Axis(key, "", spec.values)
    if unit is None:
        try:
            unit = unit_of(base, key, section)
        except InputError:
            if not is_list:
                raise
            with_values(base, {key: spec.values[0]}, section)  # rejects unknown keys
            return Axis(key, "", spec.values)
    if not is_list:
        return _range_axis(key, unit, spec, source, grid)
    values = tuple(si_number(value, unit, source) for value in spec.values)
    if len(set(values)) < len(values):
        raise InputError(f"{source}: {list(spec.values)} contains equal values; give each once")
    return Axis(key, unit, values)


def _range_axis(key: str, unit: str, spec: Any, source: str, grid: bool) -> Axis:
    si = {
        name.rstrip("_"): si_number(value, unit, f"{source}.{name.rstrip('_')}")
        for name, value in spec
        if name not in ("distribution", "number") and value is not None
    }
    low, high, kind = si.get("from", -math.inf), si.get("to", math.inf), spec.distribution
    if not low < high:
        order = "are equal" if low == high else "are in the wrong order"
        raise InputError(
            f"{source}: from = {spec.from_} and to = {spec.to} {order}; from must be less than to"
        )
    if kind == "log_uniform" and low <= 0:
        raise InputError(
            f"{source}.from = {spec.from_!r}: a log_uniform range must begin above zero"
        )
    if grid:
        spaced = (np.geomspace if kind == "log_uniform" else np.linspace)(low, high, spec.number)
        return Axis(key, unit, tuple(float(f"{value:.12g}") for value in spaced))
    if kind == "normal":
        mean, deviation = si["mean"], si["deviation"]
        if deviation <= 0:
            raise InputError(f"{source}.deviation = {deviation!r}: must be above zero")
        a, b = (low - mean) / deviation, (high - mean) / deviation
        if a > _FARTHEST_TAIL or b < -_FARTHEST_TAIL:
            raise InputError(
                f"{source}: from and to exclude all values within {_FARTHEST_TAIL:g} standard"
                " deviations of the mean; give another mean, or a uniform range"
            )
        law = stats.truncnorm(a=a, b=b, loc=mean, scale=deviation)
    elif kind == "triangular":
        if not low <= si["peak"] <= high:
            raise InputError(f"{source}.peak = {spec.peak!r}: must lie between from and to")
        law = stats.triang(c=(si["peak"] - low) / (high - low), loc=low, scale=high - low)
    elif kind == "log_uniform":
        law = stats.loguniform(a=low, b=high)
    else:
        law = stats.uniform(loc=low, scale=high - low)
    axis = Axis(key, unit, law=law)
    quartile, other_quartile = axis.at(np.array([0.25, 0.75]))
    if quartile == other_quartile:
        raise InputError(
            f"{source}: all values round to {quartile:.14g} (14 digits); give a wider range"
        )
    return axis
