"""The stages' sections and the scenario that joins them to a mechanism."""

import math
from typing import Annotated, Any

from pydantic import Field, NonNegativeInt, PositiveInt, field_validator, model_validator

from jointgap.config.consistency import check_drive, check_tolerance
from jointgap.config.drive_config import ConstantDrive, Drive
from jointgap.config.mechanism_config import Mechanism
from jointgap.config.sweep_config import Runs, Study
from jointgap.quantities import (
    Angle,
    OpenFraction,
    PositiveAngularSpeed,
    PositiveLength,
    PositiveNumber,
    quantity,
)
from jointgap.section import Section

Interval = tuple[PositiveLength, PositiveLength]
MOST_SAMPLES = 20_000_000
"""Samples of a run: with all columns they take some 10 GB."""

SampleCount = Annotated[int, Field(ge=1, le=MOST_SAMPLES)]

ROUNDING = 1e-9  # [m] 564 mm and 0.564 m are one length


def _upside_down(name: str, low: float, high: float) -> None:
    if low >= high:
        raise ValueError(f"{name} [{low:g}, {high:g}] is upside down or empty; write the lower bound first")


class Simulate(Section):
    """How the mechanism is driven and sampled."""

    speed: PositiveAngularSpeed = Field(20 * math.pi, description="speed of the crank; a motor starts with it")
    drive: Drive = Field(ConstantDrive(), description="what turns the crank: constant speed, measured angle or a motor")
    start_angle: quantity("rad", ge=-1e4, le=1e4) = Field(
        0.0, description="crank angle at the start; 0 = crank along +x"
    )
    revolutions: SampleCount = Field(
        4, description="revolutions simulated; the first starts with coincident joint centres"
    )
    samples_per_revolution: SampleCount = Field(3600, description="samples, uniform in crank angle")
    tolerance: quantity("m", gt=0, le=1e-7) = Field(
        1e-12,
        description="local error of positions that an integration step may make; 1e-4 of the smallest clearance at most",
    )

    @model_validator(mode="after")
    def _samples_can_be_held(self):
        samples = self.revolutions * self.samples_per_revolution
        if samples > MOST_SAMPLES:
            raise ValueError(
                f"revolutions {self.revolutions} times samples_per_revolution {self.samples_per_revolution} is more than "
                f"{MOST_SAMPLES:g} samples, which memory does not hold; lower one of them"
            )
        return self


class Surrogate(Section):
    """The paper's networks, four for each loose joint, and the second surrogate."""

    hidden: Annotated[tuple[PositiveInt, ...], Field(min_length=1)] = Field(
        (10, 10, 10, 10), description="neurons of each hidden layer"
    )
    training_points: Annotated[int, Field(ge=3)] = Field(
        361, description="points over the first revolution, both ends included"
    )
    iterations: PositiveInt = Field(20_000, description="Levenberg-Marquardt iterations at most, default seed")
    seeds: Annotated[tuple[NonNegativeInt, ...], Field(min_length=1)] = Field(
        (0, 1, 2, 3, 4), description="seeds of the starts; the first is the default, whatever its result"
    )
    seed_iterations: PositiveInt = Field(2_000, description="iterations at most of the other seeds")

    clearance_sampling: Annotated[int, Field(ge=4)] = Field(
        100, description="samples that the second surrogate chooses its points from, as a multiple of the simulation's"
    )

    @model_validator(mode="after")
    def _seeds_differ(self):
        if len(set(self.seeds)) < len(self.seeds):
            raise ValueError(f"seeds {list(self.seeds)} repeat a seed; give each once")
        return self


class Box(Section):
    """Bounds of the link lengths."""

    crank_length: Interval = Field(description="lower and upper bound of the crank's length")
    rod_length: Interval = Field(description="lower and upper bound of the rod's length")

    @model_validator(mode="after")
    def _bounds_are_ordered(self):
        _upside_down("crank_length", *self.crank_length)
        _upside_down("rod_length", *self.rod_length)
        if self.crank_length[1] >= self.rod_length[0]:
            raise ValueError(
                f"crank_length reaches {self.crank_length[1]:g} m and rod_length goes down to {self.rod_length[0]:g} m: "
                "the crank could not turn; keep every rod longer than every crank"
            )
        return self


class Genetic(Section):
    """Genetic algorithm with the paper's settings."""

    population: Annotated[int, Field(ge=4)] = Field(20, description="individuals")
    generations: PositiveInt = Field(50, description="generations")
    elites: NonNegativeInt = Field(2, description="best individuals that live on unchanged")
    crossover_fraction: OpenFraction = Field(
        0.8, description="share of the other children made by crossover; the rest mutate"
    )
    seed: NonNegativeInt = Field(0, description="seed")

    @model_validator(mode="after")
    def _elites_leave_room(self):
        if self.elites >= self.population:
            raise ValueError(f"elites {self.elites} leave no room in a population of {self.population}; lower elites")
        return self


class Ensemble(Section):
    """Slightly perturbed starts by which an optimum is simulated again."""

    members: Annotated[int, Field(ge=2)] = Field(15, description="simulations for each pair of lengths")
    perturbation: PositiveLength = Field(1e-7, description="standard deviation of the perturbed starting positions")
    settled_revolution: PositiveInt = Field(4, description="revolution that counts as settled (1 = the first)")
    seed: NonNegativeInt = Field(0, description="seed")


class Optimise(Section):
    """The search for the link lengths."""

    window: tuple[Angle, Angle] = Field(
        (0.0, 2 * math.pi), description="crank angles after the start that the error counts"
    )
    boxes: Annotated[dict[str, Box], Field(min_length=1)] = Field(
        {
            "paper": {"crank_length": (0.147, 0.153), "rod_length": (0.555, 0.564)},
            "wide": {"crank_length": (0.147, 0.153), "rod_length": (0.55272, 0.57528)},
        },
        description="bounds by name; the first box is the main one",
    )
    ratio_limit: OpenFraction = Field(
        0.27, description="crank length minus ratio_limit times rod length must not be positive"
    )
    local_tolerance: PositiveNumber = Field(1e-8, description="stopping tolerance of the local optimiser")
    genetic: Genetic = Genetic()
    ensemble: Ensemble = Ensemble()

    @field_validator("boxes", mode="before")
    @classmethod
    def _boxes_set_to_null_are_left_out(cls, boxes: Any) -> Any:
        """What is laid over a configuration can only add boxes; null takes one of those below away."""
        return {name: box for name, box in boxes.items() if box is not None} if isinstance(boxes, dict) else boxes

    @model_validator(mode="after")
    def _window_lies_in_the_revolution(self):
        _upside_down("window", *self.window)
        if self.window[0] < 0 or self.window[1] > 2 * math.pi * (1 + 1e-12):
            raise ValueError(
                f"window [{self.window[0]:g}, {self.window[1]:g}] rad leaves the first revolution, 0 to 360 deg"
            )
        return self


class Figures(Section):
    """What the figures show."""

    animation_frames: PositiveInt = Field(120, description="frames of the animation of the first revolution")
    magnification: PositiveNumber = Field(40.0, description="how much the animation magnifies the clearances")


class Scenario(Section):
    """A mechanism and what is done with it: the input of every stage."""

    description: str = Field("", description="one sentence for the report: what this scenario is for")
    mechanism: Mechanism
    simulate: Simulate = Simulate()
    surrogate: Surrogate = Surrogate()
    optimise: Optimise = Optimise()
    figures: Figures = Figures()
    ensemble: Runs = Runs()
    study: Study = Study()

    @model_validator(mode="after")
    def _the_mechanism_can_be_simulated_so(self):
        if {"mechanism", "simulate"} <= self.model_fields_set:
            check_drive(self.mechanism, self.simulate)
            check_tolerance(self.mechanism.applied(), self.simulate)
        return self

    @model_validator(mode="after")
    def _training_points_are_samples(self):
        samples, intervals = self.simulate.samples_per_revolution, self.surrogate.training_points - 1
        if not {"simulate", "surrogate"} <= self.model_fields_set:
            return self  # a stage that reads one of them alone is given that one alone
        if samples % intervals or samples < 5 * intervals:
            raise ValueError(
                f"simulate.samples_per_revolution {samples} must be a multiple of surrogate.training_points - 1 = {intervals}, "
                "five times it at least, so that the held-out grid is finer than the training points and shares none of them"
            )
        return self

    @model_validator(mode="after")
    def _the_mechanism_lies_in_a_box(self):
        if not {"mechanism", "optimise"} <= self.model_fields_set:
            return self
        applied = self.mechanism.applied()
        lengths = crank, rod = applied.crank.length, applied.rod.length
        for box in self.optimise.boxes.values():
            bounds = zip(lengths, (box.crank_length, box.rod_length), strict=True)
            if all(low - ROUNDING <= length <= high + ROUNDING for length, (low, high) in bounds):
                return self
        raise ValueError(
            f"optimise.boxes ({', '.join(self.optimise.boxes)}): none holds the mechanism's own lengths, crank {1e3 * crank:g} mm and "
            f"rod {1e3 * rod:g} mm; give bounds around them, and set boxes that are of no use to null"
        )

    @model_validator(mode="after")
    def _settled_revolution_is_simulated(self):
        if not {"simulate", "optimise"} <= self.model_fields_set:
            return self
        if self.optimise.ensemble.settled_revolution > self.simulate.revolutions:
            raise ValueError(
                f"optimise.ensemble.settled_revolution {self.optimise.ensemble.settled_revolution} is more than the "
                f"{self.simulate.revolutions} revolutions of simulate.revolutions"
            )
        return self


# What each stage reads of a scenario: what changes elsewhere does not make it run again.
SECTIONS = {
    "simulate": ("mechanism", "simulate"),
    "surrogate": ("mechanism", "simulate", "surrogate"),
    "kinematics": ("mechanism", "simulate", "surrogate"),
    "optimise": ("mechanism", "simulate", "surrogate", "optimise"),
    "figures": ("mechanism", "simulate", "surrogate", "optimise", "figures"),
    "compare": ("description", "mechanism", "simulate", "surrogate", "optimise"),
    "ensemble": ("mechanism", "simulate", "ensemble"),
    "study": ("mechanism", "simulate", "study"),
    "track": ("description", "mechanism", "simulate", "surrogate", "optimise"),
}
