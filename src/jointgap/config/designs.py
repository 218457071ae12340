"""Variations over many designs: sweeps, sensitivities, unreported settings, robust lengths."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, FiniteFloat, WithJsonSchema

from jointgap.core.joints import JOINTS
from jointgap.core.schema import (
    BEST_LENGTHS,
    MEASURES,
    MEASURES_OF_LINKAGE,
    PRINTED_OPTIMA,
    Column,
)
from jointgap.core.section import ConfigModel, Seed, distinct, whole_number
from jointgap.core.sites import SLIDER_CRANK, Sites
from jointgap.core.units import Angle, OpenFraction, quantity
from jointgap.core.words import format_name

MOST_DESIGNS = 10_000_000  # per sweep: a processor needs a day at some milliseconds each
MOST_VALUES = 1000  # per list or range: combined with those of others

GridNumber = whole_number(ge=2, le=MOST_VALUES)

Amount = Annotated[
    FiniteFloat | str,
    WithJsonSchema(
        {"type": ["number", "string"], "description": "number in SI, or number with a unit"}
    ),
]
"""A number with or without a unit, which is checked when the parameter is known."""


def in_order(ends: tuple[float, float], is_open: bool = False) -> tuple[float, float]:
    """The `ends` of a range; ValueError where it is in the wrong order, or `is_open` and empty."""
    low, high = ends
    if low > high or (is_open and low == high):
        raise ValueError("is in the wrong order or empty; write the lower bound first")
    return ends


def _in_first_revolution(window: tuple[float, float]) -> tuple[float, float]:
    low, high = in_order(window, True)
    if low < 0 or high > 2 * math.pi * (1 + 1e-12):
        raise ValueError(
            f"[{low:g}, {high:g}] rad exceeds the first revolution, 0 to 360 deg; give angles"
            " within it"
        )
    return window


Window = Annotated[tuple[Angle, Angle], AfterValidator(_in_first_revolution)]


class Range(ConfigModel):
    """An interval."""

    from_: Amount = Field(alias="from", description="lower end")
    to: Amount = Field(description="upper end")


class Uniform(Range):
    """A uniform distribution."""

    distribution: Literal["uniform"] = "uniform"
    number: GridNumber | None = Field(
        None, description="for a grid: number of equidistant values, ends included"
    )


class LogUniform(Range):
    """A uniform distribution of the logarithm; the lower end is above zero."""

    distribution: Literal["log_uniform"]
    number: GridNumber | None = Field(
        None, description="for a grid: number of geometrically spaced values"
    )


class Normal(ConfigModel):
    """A normal distribution, truncated where ends are given."""

    distribution: Literal["normal"]
    mean: Amount = Field(description="mean before truncation")
    deviation: Amount = Field(description="standard deviation before truncation, above zero")
    from_: Amount | None = Field(None, alias="from", description="lower end; none by default")
    to: Amount | None = Field(None, description="upper end; none by default")


class Triangular(Range):
    """A triangular distribution."""

    distribution: Literal["triangular"]
    peak: Amount = Field(description="mode, between the ends")


class Values(ConfigModel):
    """A list of equally likely values: numbers, or words such as crank and rod."""

    distribution: Literal["values"] = "values"
    values: Annotated[tuple[bool | float | int | str, ...], AfterValidator(distinct)] = Field(
        min_length=1, max_length=MOST_VALUES, description="the list"
    )


def _with_distribution(spec: Any) -> Any:
    """The full form of a list of values, and of a range, whose default distribution is uniform."""
    if isinstance(spec, list | tuple):
        return {"distribution": "values", "values": spec}
    if isinstance(spec, Mapping) and "distribution" not in spec:
        return {"distribution": "values" if "values" in spec else "uniform", **spec}
    return spec


Distribution = Annotated[
    Uniform | LogUniform | Normal | Triangular | Values,
    Field(discriminator="distribution"),
    BeforeValidator(_with_distribution),
]


class Sweep(ConfigModel):
    """A parameter sweep: varied parameters, design and number."""

    parameters: dict[str, Distribution] = Field(
        {}, description="varied parameters, by a word or by the path of a key"
    )
    design: Literal["sobol", "latin_hypercube", "grid"] = Field(
        "sobol", description="grid: all combinations"
    )
    number: whole_number(ge=1, le=MOST_DESIGNS) = Field(
        1024, description="number of designs; not for a grid"
    )
    seed: Seed = Field(0, description="seed of the samples")
    window: Window = Field(
        (0.0, 2 * math.pi), description="crank angles over which the error is computed"
    )
    best_lengths: bool = Field(
        False, description="compute the best lengths too, with unchanged joint motion"
    )
    printed_numbers: bool = Field(
        False, description="compute the numbers that the paper prints of its optima"
    )
    starts: whole_number(ge=1, le=10_000) = Field(
        1, description="starts per design: all but the first perturbed by 0.1 um"
    )
    trajectories: Annotated[tuple[whole_number(ge=0), ...], AfterValidator(distinct)] = Field(
        (), description="numbers of the designs whose samples and events are written too"
    )
    designs_per_job: whole_number(ge=1, le=100_000) = Field(
        5000, description="designs per job and file"
    )

    def errors(self) -> Iterator[str]:
        if self.design == "grid":
            for key, spec in self.parameters.items():
                if not isinstance(spec, Values) and getattr(spec, "number", None) is None:
                    yield (
                        f"parameters.{key}: a grid requires a list of values, or from, to and"
                        " number"
                    )
        if self.designs * self.starts > MOST_DESIGNS:
            yield (
                f"{self.designs} designs with {self.starts} start(s) each are more than"
                f" {MOST_DESIGNS} simulations; give fewer values or starts"
            )
        if self.trajectories and max(self.trajectories) >= self.designs:
            yield (
                f"trajectories: there is no design {max(self.trajectories)}; the last one is"
                f" {self.designs - 1}"
            )

    @property
    def designs(self) -> int:
        """Number of designs."""
        if self.design != "grid":
            return self.number
        return math.prod(
            len(s.values) if isinstance(s, Values) else s.number for s in self.parameters.values()
        )


def measured(sites: Sites, sweep: Sweep) -> tuple[Column, ...]:
    """Columns of the measures of each design of a mechanism with these bodies and joints."""
    if sites != SLIDER_CRANK:
        return tuple(_measures_of_linkage(sites))
    printed = PRINTED_OPTIMA.columns if sweep.printed_numbers else ()
    lengths = BEST_LENGTHS.columns if printed or sweep.best_lengths else ()
    return (*MEASURES.columns, *lengths, *printed)


_ROTARY = {"m": "rad", "m/s^2": "rad/s^2"}


def _measures_of_linkage(sites: Sites) -> Iterator[Column]:
    """The measures of a slider-crank with the names of a linkage: of its output body in place of
    the slider, and of each joint in place of the crank pin; and those of every linkage."""
    turns, output = sites.output not in sites.slides, format_name(sites.output)
    words = {"slider": output, "stroke": f"stroke of the {output}"}
    if turns:
        words |= {"stroke": f"swing of the {output}", "acceleration": "angular acceleration"}
        words |= {"outer dead centre": f"largest angle of the {output}"}
        words |= {"inner dead centre": f"smallest angle of the {output}"}
    for column in (*MEASURES.columns, *MEASURES_OF_LINKAGE.columns):
        if column.name.startswith(JOINTS):
            continue
        text = re.sub("|".join(words), lambda found: words[found[0]], column.description)
        name = column.name.replace("stroke", "swing") if turns else column.name
        unit = _ROTARY.get(column.unit, column.unit) if turns else column.unit
        yield replace(column, name=name, unit=unit, description=text)
    of_joint = [column for column in MEASURES.columns if column.name.startswith("crank_pin")]
    slides = (*sites.slides.values(), *sites.tracks)
    for joint in (*sites.revolutes, *slides):
        words = f"{'slide' if joint in slides else 'joint'} {format_name(joint)}"
        for column in of_joint:
            text = column.description.replace("the crank pin", words).replace("crank pin", words)
            yield replace(column, name=column.name.replace("crank_pin", joint), description=text)


class Sensitivity(ConfigModel):
    """Sobol indices of the measures of a sweep, from a surrogate of each."""

    measures: Annotated[tuple[str, ...], AfterValidator(distinct)] = Field(
        (), description="columns of the sweep; all when empty"
    )
    seed: Seed = Field(0, description="seed of the test designs and of the intervals")


class InferSettings(ConfigModel):
    """Inference of settings that the paper does not print, from the numbers that it prints."""

    removed: ClassVar = dict.fromkeys(
        ("deviation", "trained", "iterations", "seed"),
        "designs are accepted by `within` only; remove this key",
    )
    within: OpenFraction = Field(0.05, description="largest relative error of a reproduced number")


class OptimiseRobust(ConfigModel):
    """Optimisation of the link lengths for the transmission angle under uncertainty."""

    removed: ClassVar = {"revolution": "the settled revolution counts; remove this key"}
    uncertain: dict[str, Distribution] = Field(
        {}, description="as in sweep.parameters; of lengths their tolerances"
    )
    measure: Literal["mean_plus_deviations", "quantile"] = Field(
        "mean_plus_deviations", description="objective"
    )
    deviations: quantity("", ge=0, le=100) = Field(
        2.0, description="standard deviations added to the mean"
    )
    quantile: OpenFraction = Field(0.95, description="quantile of the error, for measure quantile")
    probability: OpenFraction = Field(0.95, description="required probability of each constraint")
    draws: whole_number(ge=2, le=10_000) = Field(
        32, description="samples of the search, common to all candidates"
    )
    grid: whole_number(ge=3, le=100) = Field(9, description="initial points along each length")
    population: whole_number(ge=4, le=10_000) = Field(16, description="candidates of a generation")
    generations: whole_number(ge=1, le=10_000) = Field(12, description="generations of the search")
    fresh_draws: whole_number(ge=16, le=1_000_000) = Field(
        512, description="independent samples for the validation"
    )
    resamples: whole_number(ge=100, le=100_000) = Field(
        2000, description="bootstrap samples, for the intervals"
    )
    seed: Seed = Field(0, description="seed of the samples, the search and the intervals")
