"""What varies over many designs: sweeps, their sensitivities, unreported settings, robust lengths."""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, FiniteFloat, WithJsonSchema

from jointgap.core.schema import BEST_LENGTHS, MEASURES, PRINTED_OPTIMA, Column
from jointgap.core.section import ConfigModel, Seed, distinct, whole_number
from jointgap.core.units import Angle, OpenFraction, quantity

ALL_MEASURES = (*MEASURES.columns, *BEST_LENGTHS.columns, *PRINTED_OPTIMA.columns)
Measure = Literal[tuple(column.name for column in ALL_MEASURES)]


def measured(best_lengths: bool, printed_numbers: bool) -> tuple[Column, ...]:
    """What is measured of each design of a sweep."""
    lengths = BEST_LENGTHS.columns if best_lengths or printed_numbers else ()
    return (*MEASURES.columns, *lengths, *(PRINTED_OPTIMA.columns if printed_numbers else ()))


MOST_DESIGNS = 10_000_000  # of a sweep: at some milliseconds each they take a processor a day
MOST_VALUES = 1000  # of a list or a span: each is combined with those of others

GridNumber = whole_number(ge=2, le=MOST_VALUES)

Amount = Annotated[
    FiniteFloat | str,
    WithJsonSchema({"type": ["number", "string"], "description": "number in SI, or number with a unit"}),
]
"""A number with or without a unit; which unit it takes is known once it is known what it sets."""


def _in_first_revolution(window: tuple[float, float]) -> tuple[float, float]:
    low, high = window
    if low >= high:
        raise ValueError(f"[{low:g}, {high:g}] is upside down or empty; write the lower bound first")
    if low < 0 or high > 2 * math.pi * (1 + 1e-12):
        raise ValueError(f"[{low:g}, {high:g}] rad leaves the first revolution, 0 to 360 deg; give angles within it")
    return window


Window = Annotated[tuple[Angle, Angle], AfterValidator(_in_first_revolution)]


class Range(ConfigModel):
    """Two ends."""

    from_: Amount = Field(alias="from", description="lower end")
    to: Amount = Field(description="upper end")


class Uniform(Range):
    """Every value between two ends alike."""

    distribution: Literal["uniform"] = "uniform"
    number: GridNumber | None = Field(None, description="of a grid alone: values evenly apart, ends included")


class LogUniform(Range):
    """Every ratio alike: as much between 1 and 2 as between 2 and 4; the lower end is above zero."""

    distribution: Literal["log_uniform"]
    number: GridNumber | None = Field(None, description="of a grid alone: values with one ratio between neighbours")


class Normal(ConfigModel):
    """Normally distributed, cut off at the ends where these are given: a tolerance."""

    distribution: Literal["normal"]
    mean: Amount = Field(description="mean before the cut")
    deviation: Amount = Field(description="standard deviation before the cut, above zero")
    from_: Amount | None = Field(None, alias="from", description="lower end; none when absent")
    to: Amount | None = Field(None, description="upper end; none when absent")


class Triangular(Range):
    """Likeliest at a peak and falling to nothing at two ends."""

    distribution: Literal["triangular"]
    peak: Amount = Field(description="likeliest value, between the ends")


class Values(ConfigModel):
    """A list of values, each as likely as the others; numbers, or words such as crank and rod."""

    distribution: Literal["values"] = "values"
    values: Annotated[tuple[bool | float | int | str, ...], AfterValidator(distinct)] = Field(
        min_length=1, max_length=MOST_VALUES, description="the list"
    )


def _with_distribution(spec: Any) -> Any:
    """What is left out: a bare list is a list of values, and a range without a distribution is uniform."""
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
    """Many designs, each simulated and measured: what varies, how, and how many."""

    parameters: dict[str, Distribution] = Field({}, description="what varies, by a word or by the path of a key")
    design: Literal["sobol", "latin_hypercube", "grid"] = Field("sobol", description="grid: every combination")
    number: whole_number(ge=1, le=MOST_DESIGNS) = Field(1024, description="designs; of a grid all combinations")
    seed: Seed = Field(0, description="seed of the drawing")
    window: Window = Field((0.0, 2 * math.pi), description="crank angles over which the error is measured")
    best_lengths: bool = Field(False, description="measure the best lengths too, with unchanged joint motion")
    printed_numbers: bool = Field(False, description="of the paper's mechanism: measure what it prints of its optima")
    designs_per_job: whole_number(ge=1, le=100_000) = Field(5000, description="designs of one job and one file")

    def errors(self) -> Iterator[str]:
        if self.design == "grid":
            for key, spec in self.parameters.items():
                if not isinstance(spec, Values) and getattr(spec, "number", None) is None:
                    yield f"parameters.{key}: a grid needs a list of values, or from, to and number"
            if self.designs > MOST_DESIGNS:
                yield f"the grid has {self.designs} combinations, more than {MOST_DESIGNS}; give fewer values"

    @property
    def designs(self) -> int:
        """How many designs there are."""
        if self.design != "grid":
            return self.number
        return math.prod(len(s.values) if isinstance(s, Values) else s.number for s in self.parameters.values())


class Sensitivity(ConfigModel):
    """Sobol indices of the measures of a sweep, from a surrogate of each."""

    measures: Annotated[tuple[Measure, ...], AfterValidator(distinct)] = Field((), description="all when empty")
    seed: Seed = Field(0, description="seed of which designs are held out, and of the intervals")


class InferSettings(ConfigModel):
    """The settings that the paper does not print, inferred from the numbers that it prints."""

    removed: ClassVar = dict.fromkeys(
        ("deviation", "trained", "iterations", "seed"), "designs are accepted by `within` alone; leave it out"
    )
    within: OpenFraction = Field(0.05, description="largest relative error of a reproduced number")


class OptimiseRobust(ConfigModel):
    """Optimisation of the link lengths for the transmission angle under uncertainty."""

    uncertain: dict[str, Distribution] = Field({}, description="as in sweep.parameters; of lengths their tolerances")
    revolution: Literal["first", "settled"] = Field("settled", description="revolution of the error")
    measure: Literal["mean_plus_deviations", "quantile"] = Field("mean_plus_deviations", description="objective")
    deviations: quantity("", ge=0, le=100) = Field(2.0, description="standard deviations added to the mean")
    quantile: OpenFraction = Field(0.95, description="quantile of the error, for measure quantile")
    probability: OpenFraction = Field(0.95, description="required probability of each constraint")
    draws: whole_number(ge=2, le=10_000) = Field(32, description="samples of the search, common to all candidates")
    grid: whole_number(ge=3, le=100) = Field(9, description="initial points along each length")
    population: whole_number(ge=4, le=10_000) = Field(16, description="candidates of a generation")
    generations: whole_number(ge=1, le=10_000) = Field(12, description="generations of each search after the first")
    fresh_draws: whole_number(ge=16, le=1_000_000) = Field(512, description="independent samples for the validation")
    resamples: whole_number(ge=100, le=100_000) = Field(2000, description="bootstrap samples, for the intervals")
    seed: Seed = Field(0, description="seed of the samples, the search and the intervals")
