"""What varies over many designs: sweeps, what decides their measures, unreported settings, robust lengths."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, FiniteFloat, WithJsonSchema, field_validator, model_validator

from jointgap.core.errors import did_you_mean
from jointgap.core.schema import BEST_LENGTHS, MEASURES, PRINTED_OPTIMA, Column
from jointgap.core.section import Section, Seed, whole_number
from jointgap.core.units import Angle, OpenFraction, quantity

ALL_MEASURES = (*MEASURES.columns, *BEST_LENGTHS.columns, *PRINTED_OPTIMA.columns)


def measured(best_lengths: bool, printed_numbers: bool) -> tuple[Column, ...]:
    """What is measured of each design of a sweep."""
    return (
        *MEASURES.columns,
        *(BEST_LENGTHS.columns if best_lengths or printed_numbers else ()),
        *(PRINTED_OPTIMA.columns if printed_numbers else ()),
    )


MOST_DESIGNS = 10_000_000
"""Designs of a sweep: at some milliseconds each they take a processor a day."""

_GRID_VALUES = 1000

Amount = Annotated[
    FiniteFloat | str,
    WithJsonSchema({"type": ["number", "string"], "description": "number in SI, or number with a unit"}),
]
"""A number with or without a unit; which unit it takes is known once it is known what it sets."""


class Uniform(Section):
    """Every value between two ends alike."""

    distribution: Literal["uniform"] = "uniform"
    from_: Amount = Field(alias="from", description="lower end")
    to: Amount = Field(description="upper end")
    number: whole_number(ge=2, le=_GRID_VALUES) | None = Field(
        None, description="values evenly apart, ends included; of a grid alone"
    )


class LogUniform(Section):
    """Every ratio alike: as much between 1 and 2 as between 2 and 4."""

    distribution: Literal["log_uniform"]
    from_: Amount = Field(alias="from", description="lower end, above zero")
    to: Amount = Field(description="upper end")
    number: whole_number(ge=2, le=_GRID_VALUES) | None = Field(
        None, description="values with one ratio from each to the next, ends included; of a grid alone"
    )


class Normal(Section):
    """Normally distributed, cut off at the ends where these are given: a tolerance."""

    distribution: Literal["normal"]
    mean: Amount = Field(description="mean before the cut")
    deviation: Amount = Field(description="standard deviation before the cut, above zero")
    from_: Amount | None = Field(None, alias="from", description="lower end; none when absent")
    to: Amount | None = Field(None, description="upper end; none when absent")


class Triangular(Section):
    """Likeliest at a peak and falling to nothing at two ends."""

    distribution: Literal["triangular"]
    from_: Amount = Field(alias="from", description="lower end")
    peak: Amount = Field(description="likeliest value, between the ends")
    to: Amount = Field(description="upper end")


class Values(Section):
    """A list of values, each as likely as the others; numbers, or words such as crank and rod."""

    distribution: Literal["values"] = "values"
    values: tuple[bool | float | int | str, ...] = Field(min_length=1, max_length=_GRID_VALUES, description="the list")

    @field_validator("values")
    @classmethod
    def _none_twice(cls, values: tuple) -> tuple:
        if len(set(values)) < len(values):
            raise ValueError(f"{list(values)} lists a value twice; give each once")
        return values


def with_distribution(spec: Any) -> Any:
    """What is left out: a bare list is a list of values, and a range without a distribution is uniform."""
    if isinstance(spec, list | tuple):
        return {"distribution": "values", "values": spec}
    if isinstance(spec, Mapping) and "distribution" not in spec:
        return {"distribution": "values" if "values" in spec else "uniform", **spec}
    return spec


Distribution = Annotated[
    Uniform | LogUniform | Normal | Triangular | Values,
    Field(discriminator="distribution"),
]


class Sweep(Section):
    """Many designs, each simulated and measured: what varies, how, and how many."""

    parameters: dict[str, Distribution] = Field(
        {},
        description="what varies, by a word (speed; clearance, friction, restitution, stiffness: of all loose "
        "joints) or by the path of a key such as mechanism.crank.length: a list of values, or from and to with a "
        "distribution (uniform, log_uniform, normal, triangular)",
    )
    design: Literal["sobol", "latin_hypercube", "grid"] = Field(
        "sobol",
        description="sobol: a sequence that fills the ranges evenly and can be grown; latin_hypercube; grid: every "
        "combination of lists and of ranges with a number",
    )
    number: whole_number(ge=1, le=MOST_DESIGNS) = Field(
        1024, description="designs; of a grid all combinations, whatever stands here"
    )
    seed: Seed = Field(0, description="seed of the drawing")
    window: tuple[Angle, Angle] = Field(
        (0.0, 2 * math.pi),
        description="crank angles of the first revolution over which the error of the transmission angle is measured, "
        "beside the last revolution",
    )
    best_lengths: bool = Field(
        False,
        description="measure too the best lengths by the paper's method: the crank's length, and its ratio to the "
        "rod's, where the RMS of the error is least if the motion in the joints stays as it is, and how far it falls "
        "there",
    )
    printed_numbers: bool = Field(
        False,
        description="of the paper's mechanism alone: measure the best lengths, and what its printed optima come out "
        "as; then parameters "
        "may be window_start, window_end, error_measure and revolution too: how the error is counted, which it does "
        "not say",
    )
    designs_per_job: whole_number(ge=1, le=100_000) = Field(
        5000, description="designs that one job simulates and writes to one file"
    )

    @model_validator(mode="before")
    @classmethod
    def _distributions_are_named(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("parameters"), dict):
            return data | {"parameters": {key: with_distribution(spec) for key, spec in data["parameters"].items()}}
        return data

    @model_validator(mode="after")
    def _window_lies_in_the_revolution(self):
        low, high = self.window
        if not 0 <= low < high <= 2 * math.pi * (1 + 1e-12):
            raise ValueError(f"window [{low:g}, {high:g}] rad must grow and lie in the first revolution, 0 to 360 deg")
        return self

    @model_validator(mode="after")
    def _a_grid_says_its_values(self):
        if self.design != "grid":
            return self
        for key, spec in self.parameters.items():
            if not isinstance(spec, Values) and getattr(spec, "number", None) is None:
                raise ValueError(f"parameters.{key}: a grid needs a list of values, or from, to and number")
        if self.designs > MOST_DESIGNS:
            raise ValueError(f"the grid has {self.designs} combinations, more than {MOST_DESIGNS}; give fewer values")
        return self

    @property
    def designs(self) -> int:
        """How many designs there are."""
        if self.design != "grid":
            return self.number
        return math.prod(len(s.values) if isinstance(s, Values) else s.number for s in self.parameters.values())


class Sensitivity(Section):
    """Sobol indices of the measures of a sweep, from a surrogate of each."""

    measures: tuple[str, ...] = Field(
        (), description="columns of the sweep's designs such as piston_pin_peak_force; every measure when empty"
    )
    seed: Seed = Field(0, description="seed of which designs are held out, and of the intervals")

    @field_validator("measures")
    @classmethod
    def _measures_are_columns(cls, measures: tuple[str, ...]) -> tuple[str, ...]:
        known = [column.name for column in ALL_MEASURES]
        for name in measures:
            if name not in known:
                raise ValueError(f"'{name}' is no measure of a sweep; {did_you_mean(name, known)}")
        if len(set(measures)) < len(measures):
            raise ValueError(f"{list(measures)} lists a measure twice; give each once")
        return measures


class InferSettings(Section):
    """The settings that the paper does not print, inferred from the numbers that it prints."""

    removed: ClassVar = dict.fromkeys(
        ("deviation", "trained", "iterations", "seed"), "designs are accepted by `within` alone; leave it out"
    )

    within: OpenFraction = Field(
        0.05,
        description="share of a printed number within which it is reproduced; of the ratio of the lengths, share of "
        "its change from the original one",
    )


class OptimiseRobust(Section):
    """Lengths of crank and rod that keep the transmission angle best whatever is uncertain turns out to be."""

    uncertain: dict[str, Distribution] = Field(
        {},
        description="what is uncertain and how, as in sweep.parameters; crank_length and rod_length here are "
        "tolerances, which are added to the lengths that are searched",
    )
    revolution: Literal["first", "settled"] = Field(
        "settled",
        description="where the RMS of the error is taken: first, over optimise.window of it; settled, over "
        "optimise.ensemble.settled_revolution",
    )
    measure: Literal["mean_plus_deviations", "quantile"] = Field(
        "mean_plus_deviations", description="what of the errors of all draws is minimised"
    )
    deviations: quantity("", ge=0, le=100) = Field(
        2.0, description="of mean_plus_deviations: how many standard deviations are added to the mean"
    )
    quantile: OpenFraction = Field(0.95, description="of quantile: the share of the draws that lie below it")
    probability: OpenFraction = Field(
        0.95, description="share of the draws in which each of optimise.constraints has to hold"
    )
    draws: whole_number(ge=2, le=10_000) = Field(
        32, description="draws of what is uncertain, the same for every candidate"
    )
    grid: whole_number(ge=3, le=100) = Field(9, description="points along each length at which the search begins")
    population: whole_number(ge=4, le=10_000) = Field(16, description="candidates of a generation")
    generations: whole_number(ge=1, le=10_000) = Field(12, description="generations of each search after the first")
    fresh_draws: whole_number(ge=16, le=1_000_000) = Field(
        512, description="further draws, on which the lengths found are compared"
    )
    resamples: whole_number(ge=100, le=100_000) = Field(
        2000, description="bootstrap samples of the fresh draws, for the intervals"
    )
    seed: Seed = Field(0, description="seed of the draws, the search and the intervals")

    @field_validator("uncertain", mode="before")
    @classmethod
    def _distributions_are_named(cls, uncertain: Any) -> Any:
        if isinstance(uncertain, dict):
            return {key: with_distribution(spec) for key, spec in uncertain.items()}
        return uncertain
