"""A scenario: a mechanism, and the options of each stage."""

import math
from collections.abc import Iterator, Mapping
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, field_validator

from jointgap.config.designs import (
    InferSettings,
    OptimiseRobust,
    Sensitivity,
    Sweep,
    Window,
    in_order,
    measured,
)
from jointgap.config.linkage_file import AnyMechanism, LinkageFile
from jointgap.config.mechanism import Mechanism
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.schema import BEST_LENGTHS, PRINTED_OPTIMA
from jointgap.core.section import ConfigModel, Seed, Word, checked, distinct, whole_number
from jointgap.core.units import (
    Angle,
    Length,
    OpenFraction,
    PositiveLength,
    quantity,
    unit_factor,
)

MOST_SAMPLES = 20_000_000  # per run: 10 GB with all columns
MOST_WEIGHTS = 5000  # per network: 200 MB per matrix of its training

TOLERANCE_SHARE = 1e-4
"""Largest tolerance over the clearance; larger steps would miss contacts."""

SampleCount = whole_number(ge=1, le=MOST_SAMPLES)
Iterations = whole_number(ge=1, le=10_000_000)

_BOX_SHARE, _BOX_DIGITS = 0.05, 6  # default box: half width over the lengths, and digits [m]
_LENGTH_ROUNDING = 1e-9  # [m] 564 mm and 0.564 m are equal
_CLEARANCE_ROUNDING = 1e-9  # relative: a clearance is the difference of two radii


class ConstantDrive(ConfigModel):
    """The crank turns at simulate.speed, whatever the torque."""

    FREES_CRANK: ClassVar = False
    kind: Literal["constant"] = "constant"


class MeasuredDrive(ConfigModel):
    """The crank follows a measured angle over time, smoothed."""

    FREES_CRANK: ClassVar = False
    kind: Literal["measured"]
    file: str = Field(
        description=(
            "table of samples, CSV or Parquet; from the working folder or the configuration's"
        )
    )
    time: str = Field("time", description="column of the times in seconds")
    angle: str = Field("crank_angle", description="column of the crank angles")
    angle_unit: str = Field("rad", description="unit of the column of angles, e.g. deg or turn")
    resolution: quantity("rad", gt=0) | None = Field(
        None, description="step of the encoder; null: unknown"
    )

    @property
    def content(self) -> str:
        """Digest of the file's content; empty where the file does not exist."""
        path = Path(self.file)
        return sha256(path.read_bytes()).hexdigest()[:12] if path.is_file() else ""

    @field_validator("angle_unit")
    @classmethod
    def _is_a_unit_of_angles(cls, unit: str) -> str:
        unit_factor(unit, "rad")
        return unit


class MotorDrive(ConfigModel):
    """A motor on the crank with a falling torque-speed line: M = stall_torque (1 - w /
    no_load_speed)."""

    FREES_CRANK: ClassVar = True
    kind: Literal["motor"] = "motor"
    stall_torque: quantity("N*m", ge=0) = Field(
        description=(
            "torque at standstill; 0: a flywheel without motor, as of an engine that a gas table"
            " drives"
        )
    )
    no_load_speed: quantity("rad/s", gt=0) = Field(
        description="speed at which the torque is zero; without motor the highest expected speed"
    )
    inertia: quantity("kg*m^2", ge=0) = Field(
        0.0, description="of rotor and flywheel, on the crank's axis"
    )


class FreeDrive(ConfigModel):
    """No drive: the crank starts with the stated speed, without torque."""

    FREES_CRANK: ClassVar = True
    kind: Literal["free"] = "free"
    inertia: quantity("kg*m^2", ge=0) = Field(0.0, description="of a flywheel, on the crank's axis")


Drive = Annotated[
    ConstantDrive | MeasuredDrive | MotorDrive | FreeDrive, Field(discriminator="kind")
]


class Simulate(ConfigModel):
    """Drive, duration and sampling of the simulation."""

    speed: quantity("rad/s") = Field(
        20 * math.pi, description="of the crank, negative clockwise; a motor starts with it"
    )
    drive: Drive = Field(
        ConstantDrive(),
        description="drive of the crank: constant speed, measured angle, motor, or free (none)",
    )
    start_angle: quantity("rad", ge=-1e4, le=1e4) = Field(
        0.0, description="first crank angle; 0: crank along +x"
    )
    revolutions: SampleCount = Field(
        4, description="number; the first starts with coincident joint centres"
    )
    samples_per_revolution: SampleCount = Field(3600, description="samples, uniform in crank angle")
    tolerance: quantity("m", gt=0, le=1e-7) = Field(
        1e-12, description="local error of positions in a step"
    )

    @property
    def highest_speed(self) -> float:
        """Largest speed [rad/s] of the crank; 0 for a measured angle."""
        if self.drive.kind == "measured":
            return 0.0
        no_load_speed = self.drive.no_load_speed if self.drive.kind == "motor" else 0.0
        return max(abs(self.speed), no_load_speed)

    def errors(self) -> Iterator[str]:
        if self.speed == 0 and self.drive.kind in ("constant", "free"):
            yield (
                "speed 0: the crank does not turn; give a speed, or a motor, which starts from rest"
            )
        if self.speed < 0 and self.drive.kind == "measured":
            yield (
                "speed is negative, but a measured drive takes its direction from the angles;"
                " remove speed"
            )
        if self.revolutions * self.samples_per_revolution > MOST_SAMPLES:
            yield (
                f"revolutions {self.revolutions} times samples_per_revolution"
                f" {self.samples_per_revolution} is more than {MOST_SAMPLES:g} samples; lower one"
                " of them"
            )


def check_tolerance(mechanism: Mechanism | LinkageFile, options: Simulate) -> None:
    """InputError where the tolerance is too large for the clearances."""
    check_clearance_tolerance(
        {name: mechanism.clearance(name) for name in mechanism.loose}, options
    )


def check_clearance_tolerance(clearances: Mapping[str, float], options: Simulate) -> None:
    """InputError where the tolerance is too large for the clearances [m] of the loose joints."""
    if not clearances:
        return
    name = min(clearances, key=clearances.get)
    clearance = clearances[name]
    largest = TOLERANCE_SHARE * clearance
    if options.tolerance > largest * (1 + _CLEARANCE_ROUNDING):
        raise InputError(
            f"simulate.tolerance {options.tolerance:g} m is more than {TOLERANCE_SHARE:g} of the"
            f" clearance {clearance:g} m of {name}, the smallest of the loose joints; steps would"
            f" miss contacts: give at most {largest:.3g} m, or make the joint ideal"
        )


def check_drive(mechanism: Mechanism | LinkageFile, options: Simulate) -> None:
    """InputError where an effect of the `mechanism` is incompatible with the drive."""
    for effect in mechanism.effects:
        if effect.DRIVE not in ("", options.drive.kind):
            raise InputError(
                f"mechanism.effects: {effect.name} requires simulate.drive.kind {effect.DRIVE}, not"
                f" {options.drive.kind}; change one of them"
            )


class Surrogate(ConfigModel):
    """The paper's networks and regularised networks, four of each per loose joint."""

    removed: ClassVar = {
        "clearance_sampling": "delete it: regularised networks choose their samples themselves"
    }

    hidden: tuple[whole_number(ge=1, le=MOST_WEIGHTS), ...] = Field((10, 10, 10, 10), min_length=1)
    training_points: whole_number(ge=3, le=10_001) = Field(
        361, description="in the first revolution, ends included"
    )
    iterations: Iterations = Field(
        300, description="largest number of Levenberg-Marquardt iterations, default seed"
    )
    seeds: Annotated[tuple[Seed, ...], AfterValidator(distinct)] = Field(
        (0,), min_length=1, max_length=100
    )
    seed_iterations: Iterations = Field(
        300, description="largest number of iterations of the other seeds"
    )
    regularised_neurons: whole_number(ge=4, le=500) = Field(
        100, description="neurons of a regularised network"
    )
    regularised_iterations: Iterations = Field(
        100, description="largest number of iterations of regularised networks"
    )

    def errors(self) -> Iterator[str]:
        layers = pairwise((1, *self.hidden, 1))
        weights = sum((inputs + 1) * neurons for inputs, neurons in layers)
        if weights > MOST_WEIGHTS:
            yield (
                f"hidden {list(self.hidden)[:10]} has {weights} weights, more than {MOST_WEIGHTS};"
                " use fewer neurons"
            )


_END = {"type": ["number", "string"]}
_RANGE = {"type": "array", "items": _END, "minItems": 2, "maxItems": 2}


def _range(kind: Any) -> Any:
    """Type of a range [lower, upper], which is not empty."""
    return Annotated[tuple[kind, kind], AfterValidator(lambda ends: in_order(ends, True))]


def _value_or_range(kind: Any) -> Any:
    """Type of a range [lower, upper]; a single value gives two equal bounds."""

    def with_two_ends(value: Any) -> Any:
        return value if isinstance(value, list | tuple) else (checked(kind, value),) * 2

    return Annotated[
        tuple[kind, kind],
        BeforeValidator(with_two_ends),
        AfterValidator(in_order),
        WithJsonSchema({"anyOf": [_END, _RANGE]}),
    ]


Bounds = _range(Length)
Lengths = _value_or_range(PositiveLength)
Angles = _value_or_range(Angle)


class Box(ConfigModel):
    """Bounds of the link lengths."""

    crank_length: _range(PositiveLength) = Field(description="bounds of the crank's length")
    rod_length: _range(PositiveLength) = Field(description="bounds of the rod's length")

    def errors(self) -> Iterator[str]:
        if self.crank_length[1] >= self.rod_length[0]:
            yield (
                f"crank_length is up to {self.crank_length[1]:g} m and rod_length from"
                f" {self.rod_length[0]:g} m: the crank could not turn; keep all rods longer than"
                " all cranks"
            )


class Genetic(ConfigModel):
    """Genetic algorithm with the paper's settings: 2 elites, 80 % crossover."""

    removed: ClassVar = dict.fromkeys(
        ("elites", "crossover_fraction"), "delete it: the paper's 2 elites and 0.8 are used"
    )

    population: whole_number(ge=4, le=10_000) = Field(20, description="individuals")
    generations: whole_number(ge=1, le=10_000) = Field(50, description="generations")
    seed: Seed = Field(0, description="seed")


class Ensemble(ConfigModel):
    """Perturbed starts for the re-simulation of an optimum."""

    members: whole_number(ge=2, le=10_000) = Field(
        15, description="simulations for each pair of lengths"
    )
    perturbation: PositiveLength = Field(
        1e-7, description="standard deviation of the perturbed starting positions"
    )
    settled_revolution: SampleCount = Field(
        4, description="revolution taken as settled (1 = the first)"
    )
    seed: Seed = Field(0, description="seed")


class Constraints(ConfigModel):
    """Constraints besides the bounds of the lengths: a value for equality, or a range [lower,
    upper]."""

    crank_length: Lengths | None = Field(None, description="length of the crank")
    stroke: Lengths | None = Field(
        None, description="distance of the dead centres, without clearance"
    )
    outer_dead_centre: Lengths | None = Field(
        None, description="slider position farthest from the crank pivot"
    )
    inner_dead_centre: Lengths | None = Field(
        None, description="slider position nearest to the crank pivot"
    )
    outer_dead_centre_angle: Angles | None = Field(
        None, description="crank angle there; 0 without offset"
    )
    inner_dead_centre_angle: Angles | None = Field(
        None, description="crank angle there; 180 deg without offset"
    )
    length_along: PositiveLength | None = Field(
        None, description="of the joints' space along the slide, at most"
    )
    length_across: PositiveLength | None = Field(
        None, description="of the joints' space across the slide, at most"
    )
    largest_pin_force: quantity("N", gt=0) | None = Field(
        None, description="in either pin, settled, with clearance"
    )

    @property
    def decide_crank(self) -> bool:
        """Whether they determine the crank length, which is otherwise fixed by default."""
        dead_centres = self.outer_dead_centre, self.inner_dead_centre
        return self.crank_length is not None or self.stroke is not None or None not in dead_centres


class Optimise(ConfigModel):
    """The optimisation of the link lengths."""

    removed: ClassVar = {
        "rod_tolerance": "delete it: summary.html gives the deviation of the rod that is allowed"
    }

    objective: Literal["transmission_angle", "largest_pin_force", "torque_ripple"] = Field(
        "transmission_angle", description="quantity to minimise"
    )
    window: Window = Field(
        (0.0, 2 * math.pi), description="crank angles after the start over which the error counts"
    )
    boxes: dict[Word, Box] = Field(
        {}, description="bounds by name, the main ones first; none: the rod within 5 %"
    )
    ratio_limit: OpenFraction | None = Field(
        None, description="of crank length to rod length; null: no limit"
    )
    constraints: Constraints = Field(
        Constraints(), description="constraints besides the bounds of the lengths"
    )
    local_tolerance: quantity("", gt=0) = Field(
        1e-8, description="stopping tolerance of the local optimiser"
    )
    further_tolerances: Annotated[tuple[quantity("", gt=0), ...], AfterValidator(distinct)] = Field(
        (), description="at which the local search is repeated, to compare where it ends"
    )
    genetic: Genetic = Genetic()
    ensemble: Ensemble = Ensemble()

    @field_validator("boxes", mode="before")
    @classmethod
    def _boxes_set_to_null_are_left_out(cls, boxes: Any) -> Any:
        """An overriding configuration removes a box with null."""
        if not isinstance(boxes, dict):
            return boxes
        return {name: box for name, box in boxes.items() if box is not None}

    def errors(self) -> Iterator[str]:
        default = type(self).model_fields["window"].default
        if self.objective != "transmission_angle" and self.window != default:
            yield (
                f"window belongs to the transmission angle; remove it: {self.objective} is of a"
                " settled revolution"
            )


class OptimiseLinkage(ConfigModel):
    """The optimisation of the lengths of a general linkage."""

    objective: Word = Field(
        "transmission_angle",
        description="to minimise the angle's error; least_transmission_angle: to maximise the least"
        " angle; or a force or torque to minimise: largest_pin_force, JOINT_peak_force,"
        " JOINT_rms_force, torque_ripple, peak_torque, rms_torque",
    )
    lengths: dict[str, Bounds] = Field(
        min_length=1, description="bounds of BODY.length, frame.POINT.x or frame.POINT.y, by name"
    )
    transmission: Word | None = Field(
        None,
        description="inner joint of the two bodies whose transmission angle counts; null: the"
        " last ones",
    )
    least_angle: quantity("rad", ge=0, lt=math.pi / 2) | None = Field(
        None, description="the transmission angle is at least this, and at most 180 deg minus this"
    )
    dead_point_margin: quantity("rad", gt=math.radians(1.0), lt=math.pi / 2) = Field(
        math.radians(5.0), description="of all bodies from their dead points"
    )
    stroke: dict[Word, Lengths] = Field({}, description="of bodies on slides of the frame, by name")
    swing: dict[Word, Angles] = Field({}, description="of bodies that turn to and fro, by name")
    largest_force: dict[Word, quantity("N", gt=0)] = Field(
        {}, description="in joints, by name, at most; settled, with clearance"
    )
    local_tolerance: quantity("", gt=0) = Field(
        1e-8, description="stopping tolerance of the local optimiser"
    )
    genetic: Genetic = Genetic()
    ensemble: Ensemble = Ensemble()

    def errors(self) -> Iterator[str]:
        for name, (low, _) in self.lengths.items():
            if name.endswith(".length") and low <= 0.0:
                yield f"lengths.{name}: starts at {low:g} m; a length is above 0"


class Figures(ConfigModel):
    """Options of the figures."""

    removed: ClassVar = {"magnification": "delete it: it is chosen automatically"}

    animation_frames: whole_number(ge=1, le=600) = Field(
        120, description="frames of the first revolution"
    )


class DrivenMechanism(ConfigModel):
    """A mechanism with its drive and sampling."""

    mechanism: AnyMechanism = Field(
        description="a slider-crank; of make sweep also a general linkage"
    )
    simulate: Simulate = Simulate()

    def errors(self) -> Iterator[str]:
        applied = self.mechanism.applied()
        check_drive(self.mechanism, self.simulate)
        check_tolerance(applied, self.simulate)
        applied.check_contacts(self.simulate.highest_speed)
        if isinstance(applied, LinkageFile) and self.simulate.speed < 0.0:
            yield (
                f"simulate.speed {self.simulate.speed:g} rad/s is clockwise; mirror the linkage and"
                " give a positive speed"
            )


class Scenario(DrivenMechanism):
    """A mechanism and the options of all stages."""

    removed: ClassVar = {
        "study": "use sweep with design: grid, as in config/map.yaml",
        "ensemble": "use sweep with starts: 15, and design: grid for combinations of values",
        **dict.fromkeys(
            ("design_networks", "compare_searches"),
            "use sweep.best_lengths: the frozen motion is as good (docs/how_to/sweep.md)",
        ),
    }

    description: str = Field(
        "", max_length=1000, description="purpose of the scenario in one sentence, for the report"
    )
    networks: bool = Field(
        False, description="train networks on the motion in the joints, as in the paper"
    )
    paper: bool = Field(False, description="compare the results with the paper; requires networks")
    surrogate: Surrogate = Surrogate()
    optimise: Optimise = Optimise()
    optimise_linkage: OptimiseLinkage | None = Field(
        None, description="lengths of a general linkage and their constraints, for optimise_robust"
    )
    figures: Figures = Figures()
    sweep: Sweep = Sweep()
    sensitivity: Sensitivity | None = None
    infer_settings: InferSettings | None = None
    optimise_robust: OptimiseRobust = OptimiseRobust()

    def errors(self) -> Iterator[str]:
        """Checks only the sections that are present: a stage receives only those that it reads."""
        sections = set(self.model_fields_set)
        if isinstance(self.mechanism, LinkageFile):
            yield from self._errors_of_linkage()
            sections -= {"surrogate", "optimise"}
        else:
            self._set_default_box()
            if self.optimise_linkage:
                yield "optimise_linkage is for general linkages; a slider-crank has optimise.boxes"
        if self.paper and "networks" in self.model_fields_set and not self.networks:
            yield "paper = true requires networks: true; set it, or set paper to false"
        if "optimise" in sections:
            yield from self._errors_of_objective()
        if sections >= {"mechanism", "simulate"}:
            yield from super().errors()
        intervals = self.surrogate.training_points - 1
        samples = self.simulate.samples_per_revolution
        is_checked = sections >= {"simulate", "surrogate"}
        if is_checked and (samples % intervals or samples < 5 * intervals):
            yield (
                f"simulate.samples_per_revolution {samples} must be a multiple of"
                f" surrogate.training_points - 1 = {intervals}, at least five times it"
            )
        if sections >= {"mechanism", "optimise"}:
            yield from self._errors_of_lengths()
        names = [column.name for column in measured(self.mechanism.sites, self.sweep)]
        further = dict.fromkeys(BEST_LENGTHS.names, "best_lengths")
        further |= dict.fromkeys(PRINTED_OPTIMA.names, "printed_numbers")
        for name in self.sensitivity.measures if "sweep" in sections and self.sensitivity else ():
            if name in names:
                continue
            fix = f"is no measure here; {did_you_mean(name, names)}"
            if name in further and isinstance(self.mechanism, Mechanism):
                fix = f"is not computed; set sweep.{further[name]} to true"
            yield f"sensitivity.measures: {name} {fix}"
        settled, revolutions = self.optimise.ensemble.settled_revolution, self.simulate.revolutions
        if sections >= {"simulate", "optimise"} and settled > revolutions:
            yield (
                f"optimise.ensemble.settled_revolution {settled} is more than"
                f" simulate.revolutions, {revolutions}; reduce it"
            )

    def _errors_of_linkage(self) -> Iterator[str]:
        """Keys that only a slider-crank has."""
        optimise, sweep = self.optimise, self.sweep
        given = {
            "networks": self.networks,
            "paper": self.paper,
            "optimise.boxes": optimise.boxes,
            "optimise.constraints": optimise.constraints != Constraints(),
            "infer_settings": self.infer_settings,
            "sweep.best_lengths": sweep.best_lengths,
            "sweep.printed_numbers": sweep.printed_numbers,
        }
        for key, is_given in given.items():
            if is_given:
                yield f"{key} is for slider-cranks, and the mechanism is a linkage; remove it"
        if self.optimise_robust.uncertain and self.optimise_linkage is None:
            yield "optimise_robust of a linkage requires optimise_linkage.lengths, bounds by name"
        if self.optimise_linkage and self.optimise_linkage.objective != "transmission_angle":
            yield "optimise_linkage.objective must be transmission_angle for optimise_robust"
        if self.optimise_linkage and self.optimise_linkage.largest_force:
            yield "optimise_linkage.largest_force is not for optimise_robust; remove it"
        if len(self.mechanism.bodies) < 2:
            yield "mechanism: has a crank only; add the bodies that it moves"

    def check_slider_crank(self, source: str = "") -> None:
        """InputError, which begins with the `source`, where the mechanism is a general linkage."""
        if isinstance(self.mechanism, LinkageFile):
            raise InputError(
                f"{source}mechanism: is a general linkage (it has bodies), for `make sweep`,"
                " `jointgap look`, jointgap.simulate and campaigns; this needs a slider-crank:"
                " crank, rod, slider and joints"
            )

    def _set_default_box(self) -> None:
        """Without boxes, search around the mechanism's lengths; the crank length is constant
        unless the constraints determine it."""
        if self.optimise.boxes:
            return
        applied, shares = self.mechanism.applied(), (1 - _BOX_SHARE, 1 + _BOX_SHARE)
        crank, rod = applied.crank.length, applied.rod.length
        cranks, rods = (
            tuple(round(share * length, _BOX_DIGITS) for share in shares) for length in (crank, rod)
        )
        box = Box(crank_length=cranks, rod_length=rods)
        update: dict[str, Any] = {"boxes": {"own": box}}
        constraints = self.optimise.constraints
        if not constraints.decide_crank:
            constant = {"crank_length": (crank, crank)}
            update["constraints"] = constraints.model_copy(update=constant)
        object.__setattr__(self, "optimise", self.optimise.model_copy(update=update))

    def _errors_of_lengths(self) -> Iterator[str]:
        applied, boxes = self.mechanism.applied(), self.optimise.boxes
        crank, rod, offset = applied.crank.length, applied.rod.length, abs(applied.slider.offset)
        slack = _LENGTH_ROUNDING
        if not any(
            low - slack <= crank <= high + slack and low_rod - slack <= rod <= high_rod + slack
            for (low, high), (low_rod, high_rod) in (
                (box.crank_length, box.rod_length) for box in boxes.values()
            )
        ):
            yield (
                f"optimise.boxes ({', '.join(boxes)}): none contains the original crank"
                f" {1e3 * crank:g} mm and rod {1e3 * rod:g} mm; give bounds around them"
            )
        for name, box in boxes.items():
            crank, rod = box.crank_length[1], box.rod_length[0]
            if crank + offset >= rod:
                yield (
                    f"optimise.boxes.{name}: a crank of {1e3 * crank:g} mm with an offset of"
                    f" {1e3 * offset:g} mm cannot turn with a rod of {1e3 * rod:g} mm; lengthen the"
                    " rod"
                )

    def _errors_of_objective(self) -> Iterator[str]:
        """Sections that concern the transmission angle only."""
        if self.optimise.objective == "transmission_angle":
            return
        settings = {
            "networks: true": self.networks,
            "sweep.best_lengths": self.sweep.best_lengths,
            "optimise_robust.uncertain": self.optimise_robust.uncertain,
        }
        for key, is_set in settings.items():
            if is_set:
                yield (
                    f"optimise.objective {self.optimise.objective} cannot be combined with {key},"
                    " which is for transmission_angle; remove one"
                )
