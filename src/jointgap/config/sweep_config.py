"""What a sweep varies: parameters with their ranges, distributions or lists, and how many designs are drawn of them."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, FiniteFloat, WithJsonSchema, field_validator, model_validator

from jointgap.core.units import Angle
from jointgap.counts import Seed, count
from jointgap.section import Section

MOST_DESIGNS = 10_000_000
"""Designs of a sweep: at some milliseconds each they take a processor a day."""

_GRID_VALUES = 1000

Amount = Annotated[
    FiniteFloat | str,
    WithJsonSchema({"type": ["number", "string"], "description": "number in SI, or number with a unit"}),
]
"""A number with or without a unit; which unit it takes is known once it is known what it sets."""

DesignsOfSweep = count(
    MOST_DESIGNS, "at some milliseconds each so many take a processor more than a day; sweep fewer parameters"
)
DesignsOfJob = count(100_000, "a job that is killed begins its designs anew, so let it be half an hour's work at most")


class Uniform(Section):
    """Every value between two ends alike."""

    distribution: Literal["uniform"] = "uniform"
    from_: Amount = Field(alias="from", description="lower end")
    to: Amount = Field(description="upper end")
    number: count(_GRID_VALUES, "each is combined with those of the other parameters", least=2) | None = Field(
        None, description="values evenly apart, ends included; of a grid alone"
    )


class LogUniform(Section):
    """Every ratio alike: as much between 1 and 2 as between 2 and 4."""

    distribution: Literal["log_uniform"]
    from_: Amount = Field(alias="from", description="lower end, above zero")
    to: Amount = Field(description="upper end")
    number: count(_GRID_VALUES, "each is combined with those of the other parameters", least=2) | None = Field(
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
    number: DesignsOfSweep = Field(1024, description="designs; of a grid all combinations, whatever stands here")
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
    designs_per_job: DesignsOfJob = Field(5000, description="designs that one job simulates and writes to one file")

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
