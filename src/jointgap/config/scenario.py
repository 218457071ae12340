"""A scenario: a mechanism, and the sections that say what each stage does with it."""

import math
from collections.abc import Mapping, Sequence
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from jointgap.config.designs import InferSettings, OptimiseRobust, Sensitivity, Sweep, measured
from jointgap.config.mechanism import Mechanism
from jointgap.core.errors import InputError
from jointgap.core.schema import PRINTED_OPTIMA
from jointgap.core.section import Section, Seed, Word, whole_number
from jointgap.core.units import (
    Angle,
    AngularSpeed,
    OpenFraction,
    PositiveAngle,
    PositiveAngularSpeed,
    PositiveLength,
    PositiveNumber,
    quantity,
    split_quantity,
    unit_factor,
)

Interval = tuple[PositiveLength, PositiveLength]

MOST_SAMPLES = 20_000_000
"""Samples of a run: with all columns they take some 10 GB."""

MOST_VALUES = 1000
"""Values of a span: each is simulated by itself, and combined with those of others."""

TOLERANCE_SHARE = 1e-4
"""Largest local error of positions as a share of a clearance: with more, steps jump over contacts."""

MOST_WEIGHTS = 5000
"""Weights of a network: the matrices of its training have as many rows or columns, some 200 MB."""

MOST_SEEDS = 100
"""Starts of a network, which are trained side by side."""

MOST_COMBINATIONS = 10_000
"""Combinations of varied values: each is a mechanism of its own in memory."""

SampleCount = whole_number(ge=1, le=MOST_SAMPLES)
Iterations = whole_number(ge=1, le=10_000_000)
Individuals = whole_number(ge=4, le=10_000)

_OWN_BOX, _OWN_SHARE, _OWN_DIGITS = "own", 0.05, 6
"""Name, half width as a share of the lengths, and digits [m] of the box around a mechanism's own lengths."""

_LENGTH_ROUNDING = 1e-9  # [m] 564 mm and 0.564 m are one length
_CLEARANCE_ROUNDING = 1e-9  # relative: a clearance is the difference of two radii


def _check_order(name: str, low: float, high: float) -> None:
    if low >= high:
        raise ValueError(f"{name} [{low:g}, {high:g}] is upside down or empty; write the lower bound first")


class ConstantDrive(Section):
    """The crank turns at simulate.speed, whatever it takes."""

    kind: Literal["constant"] = "constant"


class MeasuredDrive(Section):
    """The crank follows a measured angle over time, made smooth."""

    kind: Literal["measured"]
    file: str = Field(description="table of samples, CSV or Parquet; from the working folder or the configuration's")
    time: str = Field("time", description="column of the times in seconds")
    angle: str = Field("crank_angle", description="column of the crank angles")
    angle_unit: str = Field("rad", description="unit of the column of angles, e.g. deg or turn")
    resolution: PositiveAngle | None = Field(
        None, description="step of the encoder, to which the smooth angle keeps; null: not known"
    )

    @property
    def content(self) -> str:
        """Digest of what the file holds, which its path does not tell; empty where it is not there."""
        path = Path(self.file)
        return sha256(path.read_bytes()).hexdigest()[:12] if path.is_file() else ""

    @field_validator("angle_unit")
    @classmethod
    def _is_a_unit_of_angles(cls, unit: str) -> str:
        unit_factor(unit, "rad")
        return unit


class MotorDrive(Section):
    """A motor on the crank with a falling torque-speed line: M = stall_torque (1 - w / no_load_speed)."""

    kind: Literal["motor"]
    stall_torque: quantity("N*m", gt=0) = Field(description="torque at standstill")
    no_load_speed: PositiveAngularSpeed = Field(description="speed at which the torque is zero")
    inertia: quantity("kg*m^2", ge=0) = Field(
        0.0, description="moment of inertia of rotor and flywheel, on the crank's axis"
    )


Drive = Annotated[ConstantDrive | MeasuredDrive | MotorDrive, Field(discriminator="kind")]


class Simulate(Section):
    """How the mechanism is driven and sampled."""

    speed: AngularSpeed = Field(
        20 * math.pi, description="speed of the crank, negative clockwise; a motor starts with it, from rest with 0"
    )
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
        description="local error of positions that an integration step may make; 1e-4 of the smallest clearance at "
        "most",
    )

    @property
    def highest_speed(self) -> float:
        """Speed [rad/s] that the crank reaches, whichever way; 0 under a measured angle, which stands in a file."""
        if isinstance(self.drive, MeasuredDrive):
            return 0.0
        return max(abs(self.speed), self.drive.no_load_speed if isinstance(self.drive, MotorDrive) else 0.0)

    @model_validator(mode="after")
    def _turns(self):
        if self.speed == 0 and self.drive.kind == "constant":
            raise ValueError("speed 0: the crank does not turn; give a speed, or a motor, which starts from rest")
        if self.speed < 0 and self.drive.kind == "measured":
            raise ValueError("speed is negative, but a measured drive turns as its angles say; leave it out")
        return self

    @model_validator(mode="after")
    def _samples_can_be_held(self):
        samples = self.revolutions * self.samples_per_revolution
        if samples > MOST_SAMPLES:
            raise ValueError(
                f"revolutions {self.revolutions} times samples_per_revolution {self.samples_per_revolution} is more "
                "than "
                f"{MOST_SAMPLES:g} samples, which memory does not hold; lower one of them"
            )
        return self


def check_tolerance(mechanism: Mechanism, options: Simulate) -> None:
    """Whether the steps resolve the clearances."""
    if not mechanism.loose:
        return
    name = min(mechanism.loose, key=mechanism.clearance)
    clearance = mechanism.clearance(name)
    if options.tolerance > TOLERANCE_SHARE * clearance * (1 + _CLEARANCE_ROUNDING):
        raise InputError(
            f"simulate.tolerance {options.tolerance:g} m is more than {TOLERANCE_SHARE:g} of the clearance "
            f"{clearance:g} m of "
            f"{name}, the smallest of the loose joints: steps would jump over contacts; give "
            f"{TOLERANCE_SHARE * clearance:.3g} m "
            "at most, or make the joint ideal"
        )


def check_drive(mechanism: Mechanism, options: Simulate) -> None:
    """Whether the effects of a `mechanism` go with the drive of the simulation `options`."""
    for effect in mechanism.effects:
        if effect.DRIVE not in ("", options.drive.kind):
            raise InputError(
                f"mechanism.effects: {effect.name} goes with simulate.drive.kind {effect.DRIVE} alone, not with "
                f"{options.drive.kind}, whose speed is not prescribed so; leave out one of them"
            )


class Surrogate(Section):
    """The paper's networks, four for each loose joint; regularised ones beside them; the second surrogate."""

    hidden: Annotated[tuple[whole_number(ge=1, le=MOST_WEIGHTS), ...], Field(min_length=1)] = Field(
        (10, 10, 10, 10), description="neurons of each hidden layer"
    )
    training_points: whole_number(ge=3, le=10_001) = Field(
        361, description="points over the first revolution, both ends included"
    )
    iterations: Iterations = Field(300, description="Levenberg-Marquardt iterations at most, default seed")
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1, max_length=MOST_SEEDS)] = Field(
        (0,), description="seeds of the starts; the first is the default, whatever its result"
    )
    seed_iterations: Iterations = Field(300, description="iterations at most of the other seeds")

    regularised_neurons: whole_number(ge=4, le=500) = Field(
        100, description="neurons of a regularised network, whose errors hold between its training points"
    )
    regularised_iterations: Iterations = Field(
        100, description="Levenberg-Marquardt iterations at most, regularised networks"
    )
    clearance_sampling: whole_number(ge=4, le=MOST_SAMPLES) = Field(
        100, description="samples that the second surrogate chooses its points from, as a multiple of the simulation's"
    )

    @model_validator(mode="after")
    def _weights_can_be_trained(self):
        layers = (1, *self.hidden, 1)
        weights = sum((sources + 1) * neurons for sources, neurons in pairwise(layers))
        if weights > MOST_WEIGHTS:
            raise ValueError(
                f"hidden {list(self.hidden)[:10]} makes {weights} weights, more than {MOST_WEIGHTS}; training solves "
                "for all of them at once, in matrices that memory has to hold: take fewer neurons"
            )
        return self

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
        _check_order("crank_length", *self.crank_length)
        _check_order("rod_length", *self.rod_length)
        if self.crank_length[1] >= self.rod_length[0]:
            raise ValueError(
                f"crank_length reaches {self.crank_length[1]:g} m and rod_length goes down to {self.rod_length[0]:g} "
                "m: "
                "the crank could not turn; keep every rod longer than every crank"
            )
        return self


class Genetic(Section):
    """Genetic algorithm with the paper's settings."""

    population: Individuals = Field(20, description="individuals")
    generations: whole_number(ge=1, le=10_000) = Field(50, description="generations")
    elites: whole_number(ge=0, le=10_000) = Field(2, description="best individuals that live on unchanged")
    crossover_fraction: OpenFraction = Field(
        0.8, description="share of the other children made by crossover; the rest mutate"
    )
    seed: Seed = Field(0, description="seed")

    @model_validator(mode="after")
    def _elites_leave_room(self):
        if self.elites >= self.population:
            raise ValueError(f"elites {self.elites} leave no room in a population of {self.population}; lower elites")
        return self


class Ensemble(Section):
    """Slightly perturbed starts by which an optimum is simulated again."""

    members: whole_number(ge=2, le=10_000) = Field(15, description="simulations for each pair of lengths")
    perturbation: PositiveLength = Field(1e-7, description="standard deviation of the perturbed starting positions")
    settled_revolution: SampleCount = Field(4, description="revolution that counts as settled (1 = the first)")
    seed: Seed = Field(0, description="seed")


def _limits(kind: Any) -> Any:
    """Type of an exact value, or of the lower and upper bound of a range."""
    one = TypeAdapter(kind)

    def one_value_is_both_ends(value: Any) -> Any:
        """50 mm as [50 mm, 50 mm]: what is given as one value has to be met exactly."""
        if isinstance(value, list | tuple):
            return value
        try:
            return (one.validate_python(value),) * 2
        except ValidationError as error:  # of one value, so told once
            raise ValueError(error.errors()[0]["msg"].removeprefix("Value error, ")) from None

    ends = {"type": ["number", "string"]}
    both = {"type": "array", "items": ends, "minItems": 2, "maxItems": 2}
    return Annotated[
        tuple[kind, kind], BeforeValidator(one_value_is_both_ends), WithJsonSchema({"anyOf": [ends, both]})
    ]


class Constraints(Section):
    """What lengths have to meet besides their bounds: each a value, which is met exactly, or a range [lower, upper]."""

    crank_length: _limits(PositiveLength) | None = Field(
        None,
        description="length of the crank; where no boxes are given it keeps its own, and the rod alone is searched, "
        "unless the stroke or both dead centres are given",
    )
    stroke: _limits(PositiveLength) | None = Field(
        None, description="way of the slider between its dead centres, without clearance"
    )
    outer_dead_centre: _limits(PositiveLength) | None = Field(
        None, description="position of the slider's pin farthest from the crank pivot, along the slide"
    )
    inner_dead_centre: _limits(PositiveLength) | None = Field(
        None, description="position of the slider's pin nearest to the crank pivot, along the slide"
    )
    outer_dead_centre_angle: _limits(Angle) | None = Field(
        None, description="crank angle at the outer dead centre; 0 without offset"
    )
    inner_dead_centre_angle: _limits(Angle) | None = Field(
        None, description="crank angle at the inner dead centre; 180 deg without offset"
    )
    length_along: PositiveLength | None = Field(
        None, description="largest length along the slide of the space that the centres of the joints sweep"
    )
    length_across: PositiveLength | None = Field(None, description="largest length across the slide of that space")
    largest_pin_force: quantity("N", gt=0) | None = Field(
        None, description="largest force in either pin over the settled revolution, simulated with clearance"
    )

    @property
    def decide_crank(self) -> bool:
        """Whether they are about the crank's length, so that it is not to be kept besides."""
        dead_centres = self.outer_dead_centre, self.inner_dead_centre
        return self.crank_length is not None or self.stroke is not None or None not in dead_centres

    @model_validator(mode="after")
    def _ranges_are_ordered(self):
        for key, value in self:
            if isinstance(value, tuple) and value[0] > value[1]:
                raise ValueError(f"{key} [{value[0]:g}, {value[1]:g}] is upside down; write the lower bound first")
        return self


class Optimise(Section):
    """The search for the link lengths."""

    window: tuple[Angle, Angle] = Field(
        (0.0, 2 * math.pi), description="crank angles after the start that the error counts"
    )
    boxes: dict[Word, Box] = Field(
        {},
        description="bounds by name; the first box is the main one; none: the crank keeps its length, and the rod is "
        "searched within 5 % of its own",
    )
    ratio_limit: OpenFraction | None = Field(
        None, description="crank length minus ratio_limit times rod length must not be positive; null: no such limit"
    )
    constraints: Constraints = Field(Constraints(), description="what lengths have to meet besides their bounds")
    rod_tolerance: PositiveLength | None = Field(
        None, description="width of the tolerance of the rod's length as made; null: IT7 of ISO 286 for that length"
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
        _check_order("window", *self.window)
        if self.window[0] < 0 or self.window[1] > 2 * math.pi * (1 + 1e-12):
            raise ValueError(
                f"window [{self.window[0]:g}, {self.window[1]:g}] rad leaves the first revolution, 0 to 360 deg"
            )
        return self


class Figures(Section):
    """What the figures show."""

    animation_frames: whole_number(ge=1, le=600) = Field(
        120, description="frames of the animation of the first revolution"
    )
    magnification: PositiveNumber | None = Field(
        None, description="how much the animation magnifies the clearances; null: the largest to a quarter of the crank"
    )


_SPAN = {"from", "to", "number"}
_SPAN_SCHEMA = {
    "type": "object",
    "additionalProperties": False,
    "required": sorted(_SPAN),
    "properties": {
        "from": {"type": ["number", "string"]},
        "to": {"type": ["number", "string"]},
        "number": {"type": "integer", "minimum": 2},
    },
}


def spread(values: Any) -> Any:
    """A list of values as it is; ``{from: 200 rpm, to: 1200 rpm, number: 6}`` as a list of values evenly apart."""
    if isinstance(values, list | tuple) and values:
        return values
    if not isinstance(values, dict) or set(values) != _SPAN:
        raise ValueError("must be a list of values, or {from: ..., to: ..., number: ...} for values evenly apart")
    number = values["number"]
    if not isinstance(number, int) or not 2 <= number <= MOST_VALUES:
        raise ValueError(
            f"number = {number!r} must be a whole number from 2 to {MOST_VALUES}: each value is simulated by itself"
        )
    (low, unit), (high, other) = (_end(key, values[key]) for key in ("from", "to"))
    if unit != other:
        raise ValueError(f"from has the unit '{unit}' and to the unit '{other}'; give both in one unit")
    between = [float(f"{value:.12g}") for value in np.linspace(float(low), float(high), number)]
    return [f"{value!r} {unit}" for value in between] if unit else between


def _end(key: str, value: Any) -> tuple[str, str]:
    """The number and the unit at one end of a span."""
    try:
        number, unit = split_quantity(str(value))
    except ValueError as error:
        raise ValueError(f"{key} = {value!r} {error}") from error
    if not math.isfinite(float(number)):
        raise ValueError(f"{key} = {value!r} must be finite")
    return number, unit


def _list_of(kind: Any) -> Any:
    """Type of some values of one kind, listed or spread evenly."""
    items = {"type": "array", "minItems": 1}
    return Annotated[
        tuple[kind, ...], BeforeValidator(spread), WithJsonSchema({"anyOf": [items, _SPAN_SCHEMA]}), Field(min_length=1)
    ]


def _check_combinations(lists: Mapping[str, Sequence]) -> None:
    """ValueError where there are more combinations of one value of each of `lists` than can be simulated."""
    combinations = math.prod(len(values) for values in lists.values())
    if combinations > MOST_COMBINATIONS:
        factors = " x ".join(f"{len(values)} of {name}" for name, values in lists.items())
        raise ValueError(
            f"{factors} are {combinations} combinations, more than {MOST_COMBINATIONS}, each of which is simulated and "
            "held in memory; give fewer values"
        )


class Runs(Section):
    """What the runs of an ensemble differ in: every combination of values, each from several starts."""

    vary: dict[str, _list_of(Any)] = Field(
        {},
        description="lists of values (or from, to, number) by what they set: speed, clearance, friction, restitution, "
        "stiffness, or the path of a key such as mechanism.slider.mass",
    )
    members: whole_number(ge=1, le=10_000) = Field(
        10, description="starts of each combination; the first is not perturbed"
    )
    perturbation: PositiveLength = Field(1e-7, description="standard deviation of the perturbed starting positions")
    seed: Seed = Field(0, description="seed of the perturbations")

    @model_validator(mode="after")
    def _combinations_can_be_held(self):
        _check_combinations(self.vary)
        return self


class DrivenMechanism(Section):
    """A mechanism and how it is driven and sampled: all that a simulation needs."""

    mechanism: Mechanism
    simulate: Simulate = Simulate()

    @model_validator(mode="after")
    def _can_be_simulated(self):
        _check_simulation(self)
        return self


class Scenario(Section):
    """A mechanism and what is done with it: the input of every stage."""

    removed: ClassVar = {
        "study": "use sweep with design: grid, as in config/map.yaml",
        **dict.fromkeys(
            ("design_networks", "compare_searches"),
            "use sweep.best_lengths: the frozen motion is as good (docs/how_to/sweep.md)",
        ),
    }

    description: str = Field("", max_length=1000, description="one sentence for the report: what this scenario is for")
    mechanism: Mechanism
    simulate: Simulate = Simulate()
    networks: bool = Field(False, description="train networks on the motion in the joints, as the paper does")
    paper: bool = Field(False, description="compare everything with what the paper prints; needs networks")
    surrogate: Surrogate = Surrogate()
    optimise: Optimise = Optimise()
    figures: Figures = Figures()
    ensemble: Runs = Runs()
    sweep: Sweep = Sweep()
    sensitivity: Sensitivity | None = None
    infer_settings: InferSettings | None = None
    optimise_robust: OptimiseRobust = OptimiseRobust()

    @model_validator(mode="after")
    def _paper_has_networks(self):
        if self.paper and "networks" in self.model_fields_set and not self.networks:
            raise ValueError("paper = true needs networks: true, for most of what the paper prints is about them")
        return self

    @model_validator(mode="after")
    def _lengths_are_searched_around_the_mechanism_s_own(self):
        if not self.optimise.boxes:
            applied = self.mechanism.applied()
            crank, rod = (
                tuple(round(length * (1 + side * _OWN_SHARE), _OWN_DIGITS) for side in (-1, 1))
                for length in (applied.crank.length, applied.rod.length)
            )
            found = {"boxes": {_OWN_BOX: Box(crank_length=crank, rod_length=rod)}}
            if not self.optimise.constraints.decide_crank:
                kept = {"crank_length": (applied.crank.length,) * 2}
                found["constraints"] = self.optimise.constraints.model_copy(update=kept)
            object.__setattr__(self, "optimise", self.optimise.model_copy(update=found))
        return self

    @model_validator(mode="after")
    def _sections_go_together(self):
        """A stage that reads some sections alone is given those alone: those that are there are checked."""
        checks = (
            ({"mechanism", "simulate"}, _check_simulation),
            ({"simulate", "surrogate"}, _check_samples),
            ({"mechanism"}, _check_rod_tolerance),
            ({"mechanism", "optimise"}, _check_boxes),
            ({"sweep", "sensitivity"}, _check_measures),
            ({"simulate", "optimise"}, _check_settled_revolution),
        )
        for sections, check in checks:
            if sections <= self.model_fields_set:
                check(self)
        return self


def _check_simulation(scenario: DrivenMechanism | Scenario) -> None:
    applied = scenario.mechanism.applied()
    check_drive(scenario.mechanism, scenario.simulate)
    check_tolerance(applied, scenario.simulate)
    applied.check_contacts(scenario.simulate.highest_speed)


def _check_samples(scenario: Scenario) -> None:
    """Training points are samples, and what the second surrogate chooses from can be held."""
    samples, intervals = scenario.simulate.samples_per_revolution, scenario.surrogate.training_points - 1
    if samples % intervals or samples < 5 * intervals:
        raise ValueError(
            f"simulate.samples_per_revolution {samples} must be a multiple of surrogate.training_points - 1 = "
            f"{intervals}, five times it at least, so that the held-out grid is finer than the training points and "
            "shares none of them"
        )
    multiple = scenario.surrogate.clearance_sampling
    if samples * multiple > MOST_SAMPLES:
        raise ValueError(
            f"surrogate.clearance_sampling {multiple} times simulate.samples_per_revolution {samples} is more than "
            f"{MOST_SAMPLES:g} samples, which memory does not hold; lower one of them"
        )


def _check_rod_tolerance(scenario: Scenario) -> None:
    width, rod = scenario.optimise.rod_tolerance, scenario.mechanism.applied().rod.length
    if width is not None and width > 0.1 * rod:
        raise ValueError(
            f"optimise.rod_tolerance {1e3 * width:g} mm is more than a tenth of the rod, {1e3 * rod:g} mm; give it "
            "with its unit, such as 35 um"
        )


def _check_boxes(scenario: Scenario) -> None:
    """One of the boxes holds the mechanism's own lengths, and the crank can turn in all of them."""
    applied, boxes = scenario.mechanism.applied(), scenario.optimise.boxes
    own, offset = (applied.crank.length, applied.rod.length), abs(applied.slider.offset)
    if not any(_holds(box.crank_length, own[0]) and _holds(box.rod_length, own[1]) for box in boxes.values()):
        raise ValueError(
            f"optimise.boxes ({', '.join(boxes)}): none holds the mechanism's own lengths, crank {1e3 * own[0]:g} mm "
            f"and rod {1e3 * own[1]:g} mm; give bounds around them, and set boxes that are of no use to null"
        )
    for name, box in boxes.items():
        crank, rod = box.crank_length[1], box.rod_length[0]
        if crank + offset >= rod:
            raise ValueError(
                f"optimise.boxes.{name}: a crank of {1e3 * crank:g} mm with the slide {1e3 * offset:g} mm off cannot "
                f"turn on a rod of {1e3 * rod:g} mm; keep rods longer than crank and offset together"
            )


def _holds(bounds: tuple[float, float], length: float) -> bool:
    return bounds[0] - _LENGTH_ROUNDING <= length <= bounds[1] + _LENGTH_ROUNDING


def _check_measures(scenario: Scenario) -> None:
    known = {column.name for column in measured(scenario.sweep.best_lengths, scenario.sweep.printed_numbers)}
    for name in scenario.sensitivity.measures if scenario.sensitivity else ():
        if name not in known:
            key = "printed_numbers" if name in PRINTED_OPTIMA.names else "best_lengths"
            raise ValueError(f"sensitivity.measures: {name} is not measured; set sweep.{key} to true")


def _check_settled_revolution(scenario: Scenario) -> None:
    settled, revolutions = scenario.optimise.ensemble.settled_revolution, scenario.simulate.revolutions
    if settled > revolutions:
        raise ValueError(
            f"optimise.ensemble.settled_revolution {settled} is more than the {revolutions} revolutions of "
            "simulate.revolutions"
        )
