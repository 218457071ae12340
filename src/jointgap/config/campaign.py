"""The campaign file: a mechanism, the measured runs, their columns, and bounds of uncertain
quantities."""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from datetime import date as Date
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import yaml
from pydantic import (
    BeforeValidator,
    Field,
    TypeAdapter,
    ValidationInfo,
    WithJsonSchema,
    field_serializer,
    field_validator,
    model_validator,
)

from jointgap.config.channels import (
    PRESSURES,
    ChannelKind,
    channel_kinds,
    groups_of,
    joints_of,
)
from jointgap.config.linkage_file import AnyMechanism, LinkageFile
from jointgap.config.mechanism import Mechanism
from jointgap.config.scenario import MotorDrive, OptimiseLinkage
from jointgap.core.csv_files import Csv
from jointgap.core.errors import did_you_mean
from jointgap.core.section import ConfigModel, Name, Word, checked, text_of
from jointgap.core.sites import SLIDER_CRANK, Sites
from jointgap.core.units import (
    Angle,
    PositiveLength,
    quantity,
    respelled,
    scaled_unit_factor,
    split_quantity,
    split_share,
    to_si,
    unit_factor,
)
from jointgap.core.words import joined
from jointgap.effects import EFFECTS, AnyEffect, effects_of
from jointgap.effects.clearance import LEAST_CLEARANCE
from jointgap.effects.force_table import ForceTableParameters
from jointgap.effects.own_law import OwnLaw

_TABLES = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))

UNITS: dict[str, list[str]] = _TABLES["units"]
"""Units, by SI unit, suggested where none is given or the given one does not convert."""

FILTER_ORDER = 4
"""Order of the Butterworth low-pass that describes a sensor's bandwidth."""

_UNIT_HINTS: dict[str, str] = _TABLES["unit_hints"]

_COUNTED = {"counts_per_turn": ("turn", ""), "rate": ("s", "Hz")}
"""Keys that define the unit of a column of integers as a part of a unit: that unit, and the unit of
the key."""

_AMOUNT = [{"type": "number", "exclusiveMinimum": 0}, {"type": "string"}]
_BY_RUN = {"type": "object", "additionalProperties": {"anyOf": _AMOUNT}}
_AMOUNTS = WithJsonSchema({"anyOf": [*_AMOUNT, {"type": "null"}]})
Scale = Annotated[str | None, _AMOUNTS]
Step = Annotated[float | None, _AMOUNTS]
Noise = Annotated[
    float | dict[str, float] | None,
    WithJsonSchema({"anyOf": [*_AMOUNT, {"type": "null"}, _BY_RUN]}),
]


class Channel(ConfigModel, use_attribute_docstrings=True):
    """A column of the runs' files and its sensor."""

    column: Name
    """heading of the column in every run's file"""
    unit: str
    """pint name such as deg, g_n, N*m or rpm; not needed with counts_per_turn or rate"""
    scale: Scale = None
    """factor of a sensor's signal, such as 0.35 N*m/A for a column in A"""
    counts_per_turn: quantity("", gt=0) | None = None
    """of an angle in an encoder's counts"""
    rate: quantity("Hz", gt=0) | None = None
    """sampling rate, for time in sample numbers: 2 kHz"""
    noise: Noise = None
    """standard deviation in the column's unit, one or by run; null: estimated"""
    resolution: Step = None
    """step of an encoder in the column's unit; null: unknown"""
    bandwidth: quantity("Hz", gt=0) | None = None
    """corner of the samples' fourth-order low-pass"""
    filter: Literal["zero_phase", "causal"] = "zero_phase"
    """phase of that low-pass"""
    high_pass: quantity("Hz", gt=0) | None = None
    """corner of an AC-coupled sensor: 0.5 Hz"""
    average: quantity("s", gt=0) | None = None
    """gate time of a counter that reads means: 50 ms"""
    sign: Literal[1, -1] = 1
    """-1: the sensor's axis is opposite to the definition of the channel"""
    jitter: quantity("s", gt=0) | None = None
    """of time: standard deviation of its stamps; null: estimated"""
    repeated: Literal["first", "last"] | None = None
    """of time: row to keep of rows with equal times"""
    reads_gravity: bool = False
    """whether an accelerometer's reading includes gravity"""
    bore: PositiveLength | None = None
    """of a pressure: diameter on which it acts"""
    ambient_pressure: quantity("Pa", ge=0) | None = None
    """of a pressure: on the slider's other side, 0 for gauge pressures; null: 101325 Pa"""

    @model_validator(mode="before")
    @classmethod
    def _counts_are_parts_of_a_unit(cls, content: Any) -> Any:
        for key, (counted_unit, key_unit) in _COUNTED.items():
            if not isinstance(content, dict) or content.get(key) is None:
                continue
            try:
                unit = f"{counted_unit}/{checked(quantity(key_unit, gt=0), content[key]):.17g}"
            except ValueError:
                return {"unit": counted_unit} | content  # rejected by the key's own check
            if content.get("unit", "count") not in ("count", "counts", unit):
                raise ValueError(
                    f"unit = {content['unit']!r} and {key} are both given; remove one of them"
                )
            step = {"resolution": 1} if key == "counts_per_turn" else {}
            content = step | content | {"unit": unit}
        return content

    @field_validator("scale", mode="before")
    @classmethod
    def _is_text(cls, scale: Any) -> Any:
        if scale is not None and not to_si(split_quantity(str(scale))[0], "") > 0:
            raise ValueError(
                "must be greater than 0; write 'sign: -1' for a sensor with the opposite axis"
            )
        return scale if scale is None else str(scale)

    @field_validator("unit")
    @classmethod
    def _is_a_unit(cls, unit: str) -> str:
        try:
            base, _ = split_share(unit)
            unit_factor(base, base)
        except Exception as error:  # pint raises a dozen kinds
            hint = "write one such as s, deg, mm, g_n, N*m or rpm"
            if spelling := respelled(unit):
                hint = f"did you mean '{spelling}'?"
            raise ValueError(_UNIT_HINTS.get(unit, f"is not a unit; {hint}")) from error
        return unit

    @field_validator("noise", "resolution", mode="before")
    @classmethod
    def _is_in_the_columns_unit(cls, value: Any, info: ValidationInfo) -> Any:
        unit = info.data.get("unit")
        if value is None or unit is None:  # an invalid unit has its own error
            return None
        if info.field_name == "noise" and isinstance(value, dict):
            return {text_of(run): _amount(sd, unit, f"{run}: ") for run, sd in value.items()}
        return _amount(value, unit)

    @property
    def pressure_behind(self) -> float:
        """Pressure [Pa] on the slider's other side; 0 for gauge pressures."""
        default = ForceTableParameters.model_fields["ambient_pressure"].default
        return default if self.ambient_pressure is None else self.ambient_pressure

    @property
    def remembers(self) -> bool:
        """Whether the sensor's reading depends on the past (without a low-pass, which may also use
        the future)."""
        return self.high_pass is not None or self.average is not None

    def noise_of(self, run: str) -> float | None:
        """Standard deviation of the noise in a run, in the column's unit; None if it is to be
        estimated."""
        return self.noise.get(run) if isinstance(self.noise, dict) else self.noise


def _amount(value: Any, unit: str, where: str = "") -> float:
    """A number > 0 in the column's unit, from a number or a text with a unit."""
    base, parts = split_share(unit)
    try:
        amount = to_si(value, base)
        if isinstance(value, str) and split_quantity(value)[1]:
            amount *= parts
    except ValueError as error:
        raise ValueError(f"{where}{error}") from error
    if not amount > 0:
        raise ValueError(
            f"{where}{amount:g} must be greater than 0; remove the key if it is unknown"
        )
    return amount


def channel_factor(name: str, base: str, unit: str, scale: str | None = None) -> float:
    """Value in the unit `base` of one `unit` of the column of the channel `name`."""
    try:
        return unit_factor(unit, base) if scale is None else scaled_unit_factor(scale, unit, base)
    except ValueError as error:
        key = f"unit = '{unit}'" if scale is None else f"scale = '{scale}' of a column in {unit}"
        factor = f"for a sensor's signal give the factor, such as scale: 1 {base}/{unit}"
        hint = _UNIT_HINTS.get(unit, "" if str(error).endswith("?") else factor)
        raise ValueError(f"{name}.{key} {error}{hint and f'; {hint}'}") from error


def _groups(kinds: Mapping[str, ChannelKind]) -> dict[str, set[str]]:
    """The channels of each group in the rules of their keys."""
    return {
        "time": {"time"},
        "crank_angle": {"crank_angle"},
        "angles": {name for name, kind in kinds.items() if kind.unit == "rad"},
        "accelerations": {name for name, kind in kinds.items() if kind.axis},
        "pressures": {*PRESSURES},
    }


def _errors_of_channels(
    channels: dict[str, Channel], kinds: Mapping[str, ChannelKind]
) -> Iterator[str]:
    columns: dict[str, str] = {}
    groups = _groups(kinds)
    angles = joined(name for name in kinds if name in groups["angles"])
    for name, channel in channels.items():
        for rule in _TABLES["keys_of_channels"]:
            named = set().union(*(groups[group] for group in rule.get("only", rule.get("except"))))
            applies = (name in named) == ("only" in rule)
            for key in () if applies else rule["keys"]:
                if getattr(channel, key) != Channel.model_fields[key].default:
                    why = rule["why"].format(angles=angles)
                    yield f"{name}.{key} does not apply: {why}; remove it"
        if name in PRESSURES and channel.bore is None:
            yield (
                f"{name} requires bore, the diameter on which it acts; add it, such as 'bore:"
                " 60 mm'"
            )
        if channel.average is not None and "time" not in channels:
            yield f"{name}.average requires the channel time; add it"
        if channel.filter != "zero_phase" and channel.bandwidth is None:
            yield f"{name}.filter requires bandwidth; add bandwidth, or remove filter"
        try:
            channel_factor(name, kinds[name].unit, channel.unit, channel.scale)
        except ValueError as error:
            yield str(error)
        if channel.column in columns:
            yield (
                f"{columns[channel.column]} and {name} both read column '{channel.column}'; give"
                " two columns"
            )
        columns.setdefault(channel.column, name)


SHARED = ("joint_friction", "restitution")
"""Quantities that the joints share unless they are listed per joint."""

MOTOR_LINE = ("stall_torque", "no_load_speed")
"""The torque-speed line of a motor: supply and winding may differ between runs."""

PRESSURE_ZERO = "pressure_zero"
PRESSURE_SENSOR = (PRESSURE_ZERO, "pressure_gain")
"""Zero and gain of the sensor of all pressures on the slider."""

POSITION_ZERO = "_position_zero"
"""End of the name of the zero of a position."""


class Nuisance(NamedTuple):
    """A quantity that may be uncertain."""

    unit: str  # SI; '' for a pure number
    limits: str  # By their name in `_LIMITS`
    part: str  # The body or joint that it is of; '' for others
    what: str  # Its name there, such as mass
    needs: tuple[str, ...]  # Channels that it acts on, of a sensor; it is then nominally 0


def nuisances_of(sites: Sites, loose: Collection[str] = ()) -> dict[str, Nuisance]:
    """Every nuisance of a mechanism with the `sites` and `loose` joints, by name."""
    groups = groups_of(sites, loose)
    return {
        name.format(part=part): Nuisance(
            unit,
            limits,
            part,
            name.replace("{part}", "").strip("_"),
            tuple(channel.format(part=part) for channel in needs),
        )
        for group, names in _TABLES["nuisances"].items()
        for part in groups[group]
        for name, (unit, limits, *needs) in names.items()
    }


_LIMITS: dict[str, dict[str, float]] = {
    "positive": {"gt": 0},
    "clearance": {"ge": LEAST_CLEARANCE},
    "friction": {"ge": 0, "le": 0.6},
    "restitution": {"ge": 1e-3, "lt": 1},
    "turn": {"ge": -math.tau, "le": math.tau},
    "any": {},
}
"""Physical limits of nuisances, by their name in `campaign.yaml`."""

NUISANCE_RULES = [
    name for names in _TABLES["nuisances"].values() for name in names if "{part}" in name
]
"""Names of the nuisances of the parts of a mechanism, with {part} for a body or joint."""

NUISANCES = {key: kind.unit for key, kind in nuisances_of(SLIDER_CRANK).items()}
"""SI unit of every quantity accepted under ``nuisance`` of a slider-crank; ``''`` for pure
numbers."""

_AMOUNT_EXAMPLES: dict[str, str] = _TABLES["amount_examples"]
"""Example of a deviation from nominal, by unit."""


def _share_or_bounds(
    key: str, value: Any, kind: Nuisance, nominals: tuple[float, ...]
) -> float | tuple[float, float]:
    """The `value` of a nuisance in a campaign file: a share of its nominal value, or bounds
    [SI]."""
    unit = kind.unit
    error_text = " is not a range"
    try:
        if isinstance(value, list | tuple) and len(value) == 2:
            low, high = (_possible(kind, bound) for bound in value)
            if low >= high:
                raise ValueError("is in the wrong order or empty; write the lower bound first")
            return low, high
        if isinstance(value, str):
            number, value_unit = split_quantity(value.strip().removeprefix("+-"))
            if value_unit in ("%", "percent"):
                share = Decimal(number) / 100
                if not 0 < share < 1:
                    raise ValueError("must be more than 0 % and less than 100 %")
                return float(share)
            if value_unit and unit in _AMOUNT_EXAMPLES:
                amount = checked(quantity(unit, gt=0), value)
                if len(set(nominals)) != 1:
                    raise ValueError("requires exactly one nominal value")
                return _possible(kind, nominals[0] - amount), _possible(kind, nominals[0] + amount)
    except ValueError as error:
        error_text = f": {error}"
    # a percentage of a nominal 0 is not a range
    instead = [] if kind.needs else ["a percentage such as '5 %'"]
    instead += [f"an amount such as {_AMOUNT_EXAMPLES[unit]}"] if unit in _AMOUNT_EXAMPLES else []
    raise ValueError(
        f"{key} = {value!r}{error_text}; give {' or '.join(instead)} or bounds such as [low, high]"
    )


def _possible(kind: Nuisance, value: Any) -> float:
    """The `value` [SI] of a nuisance; ValueError outside of its limits."""
    return checked(quantity(kind.unit, **_LIMITS[kind.limits]), value)


def _as_written(value: float | tuple[float, float]) -> str | list[float]:
    """The inverse of `_share_or_bounds`, exactly."""
    return list(value) if isinstance(value, tuple) else f"{Decimal(repr(value)) * 100} %"


def _nominal_values(mechanism: Mechanism | LinkageFile, kind: Nuisance) -> tuple[float, ...]:
    """Values [SI] of a nuisance in a `mechanism`, one or one per joint; () where it has no
    effect."""
    if kind.needs:
        return (0.0,)
    joints = [kind.part] if kind.part else joints_of(mechanism.sites)
    loose = [mechanism.joint(name) for name in joints if name in mechanism.loose]
    if kind.what == "clearance":
        values = [joint.clearance for joint in loose]
    elif kind.what in SHARED:
        name = kind.what.removeprefix("joint_")
        values = [getattr(joint.contact, name) for joint in loose]
    elif kind.part:
        values = [getattr(mechanism.body(kind.part), kind.what)]
    else:  # not of the mechanism
        values = []
    return tuple(value for value in values if value is not None)


def _pressure_sensor(
    key: str, effects: Iterable[Any], channels: Iterable[str]
) -> tuple[float, ...]:
    """Nominal values of the nuisance `key` of a pressure sensor; () without a pressure."""
    tables = [effect.parameters for effect in effects]
    values = {getattr(table, key) for table in tables if getattr(table, "bore", None)}
    if PRESSURES.keys() & set(channels):
        values.add(ForceTableParameters.model_fields[key].default)
    return tuple(sorted(values))


RESERVED_IDS = ("all", "look", "measured", "remarks", "contradictions", "config_snapshot")
"""Reserved names of results: a sum over runs, and tables next to the figures of the runs."""


class Start(ConfigModel, use_attribute_docstrings=True):
    """Beginning of the motion before the first sample: a crank angle, and turns or time before it.

    The joint centres coincide and the velocities are those of the ideal mechanism, as in the paper.
    """

    angle: Angle | None = None
    """crank angle; the passage nearest to turned or ran, else the last"""
    turned: quantity("rad", gt=0) | None = None
    """rotation of the crank before the first sample: 3 turn"""
    ran: quantity("s", gt=0) | None = None
    """time before the first sample: 0.5 s"""

    def errors(self) -> Iterator[str]:
        if self.turned is not None and self.ran is not None:
            yield "turned and ran are both given; remove one of them"
        if self.angle is None and self.turned is None and self.ran is None:
            yield "is empty; give angle, turned or ran, such as {angle: 40 deg, turned: 3 turn}"


_OF_OTHERS = ("sensor_", "encoder_", "discovered_")
"""Beginnings of the names of sensor faults and of terms of formulas."""

_STARTS = ("settled", "at_rest", "dead_centre", "unknown")


LOADS_OF_A_RUN = ("slider_force_table", "crank_brake")
"""Effects that may be listed for a single run."""


def _one_or_two(files: Any) -> Any:
    if files and isinstance(files, str):
        return files
    if isinstance(files, list | tuple) and all(isinstance(name, str) and name for name in files):
        if len(files) == len({*files}) == 2:
            return tuple(files)
    raise ValueError("must be the name of a file, or a list of two: [a.csv, b.csv] of two loggers")


_FILE = {"type": "string", "minLength": 1}
_PAIR = {"type": "array", "items": _FILE, "minItems": 2, "maxItems": 2}
Files = Annotated[
    str | tuple[str, str], BeforeValidator(_one_or_two), WithJsonSchema({"anyOf": [_FILE, _PAIR]})
]


def _kinds_of(mechanism: Mechanism | LinkageFile) -> dict[str, ChannelKind]:
    return channel_kinds(mechanism.sites, mechanism.loose)


def _all_of(joints: Collection[str]) -> str:
    return "both pins" if len(joints) == 2 else "all pins"


class CampaignRun(ConfigModel, use_attribute_docstrings=True):
    """The samples measured at one speed, from one file or from two loggers."""

    id: Word
    """name of the run: letters, digits, '_' and '-'"""
    file: Files = Field(
        description=(
            "table of samples, CSV or Parquet, from the campaign file's folder; two loggers:"
            " [a.csv, b.csv]"
        )
    )
    speed: quantity("rad/s")
    """nominal speed of the crank"""
    role: Literal["identify", "confirm", "split"]
    """split: the last third is held out for confirm"""
    start: Literal[_STARTS] | Start = "settled"
    """beginning of the motion, or its angle, turns, time"""
    first_angle: Angle | None = None
    """crank angle at the first sample, without such a channel"""
    direction: Literal["counter_clockwise", "clockwise"] = "counter_clockwise"
    effects: tuple[AnyEffect, ...] = ()
    """known loads of this run: slider_force_table, crank_brake"""

    @property
    def files(self) -> tuple[str, ...]:
        """One file, or two of loggers with their own clocks."""
        return (self.file,) if isinstance(self.file, str) else self.file

    @property
    def side(self) -> float:
        """-1 for a clockwise crank, whose angles are mirrored when they are read; otherwise 1."""
        return -1.0 if self.direction == "clockwise" else 1.0

    def mirrored(self) -> "CampaignRun":
        """The run with angles and loads as seen from the side on which its crank turns
        counter-clockwise."""
        if self.side > 0.0:
            return self
        update = {"effects": tuple(effect.mirrored() for effect in self.effects)}
        if self.first_angle is not None:
            update["first_angle"] = -self.first_angle
        if isinstance(self.start, Start) and self.start.angle is not None:
            update["start"] = self.start.model_copy(update={"angle": -self.start.angle})
        return self.model_copy(update=update)

    @field_validator("start", mode="before")
    @classmethod
    def _is_a_start(cls, start: Any) -> Any:
        if isinstance(start, dict | Start):
            return Start.model_validate(start)
        if start not in _STARTS:
            raise ValueError(
                f"give {', '.join(_STARTS)}, or a mapping such as {{angle: 40 deg, turned: 3 turn}}"
            )
        return start

    def errors(self) -> Iterator[str]:
        if self.speed <= 0:
            yield (
                f"speed {self.speed:g} rad/s must be greater than 0; or give 'direction: clockwise'"
            )
        if self.id in RESERVED_IDS:
            yield f"id '{self.id}' is a reserved name of results; choose another id"
        for effect in self.effects:
            if effect.name not in LOADS_OF_A_RUN:
                yield (
                    f"effects: {effect.name} is no load of a single run"
                    f" ({' and '.join(LOADS_OF_A_RUN)} are); list it in the mechanism file"
                )


def _wrong_site(law: OwnLaw, sites: Sites) -> str:
    """Error message of a law whose site does not exist or needs the other key, or ''."""
    pivots = sites.crank, *sites.pivots
    if law.site not in (*sites.slides, *pivots):
        hint = did_you_mean(law.site, (*sites.slides, *pivots))
        return f"site = '{law.site}': there is no such body on a slide or pivot; {hint}"
    key, unit, other = ("force", "N", "torque")
    if law.site in pivots:
        key, unit, other = ("torque", "N*m", "force")
    if law.key == key:
        return ""
    return (
        f"site {law.site} requires the key {key} [{unit}], and not {other}, such as {key}: '-c*v'"
    )


def _day(date: Any) -> Any:
    try:
        return date if type(date) is Date else Date.fromisoformat(date)
    except (TypeError, ValueError):
        raise ValueError("is not a date; write year, month and day, such as 2026-03-01") from None


Day = Annotated[Date, BeforeValidator(_day)]


class Campaign(ConfigModel, use_attribute_docstrings=True):
    """A rig and its measurements, without the samples."""

    name: Word
    """name of the campaign, and of its folder of results"""
    date: Day | None = None
    """day of the measurement, for trends: 2026-03-01"""
    mechanism: AnyMechanism
    """the current model of the mechanism"""
    drive: Literal["constant_speed", "measured_angle", "motor", "free"] = "constant_speed"
    """of the crank; free: a coast-down, without torque"""
    motor: MotorDrive | None = None
    """torque-speed line of the motor"""
    runs: tuple[CampaignRun, ...] = Field(min_length=1)
    """the runs, one file each"""
    channels: dict[str, Channel] = Field(min_length=1)
    """the measured quantities"""
    nuisance: dict[str, float | tuple[float, float]] = Field({})
    """bounds of uncertain quantities"""
    candidates: dict[Word, OwnLaw] = Field({})
    """laws of your own that may be missing, by name"""
    optimise_linkage: OptimiseLinkage | None = None
    """lengths of a general linkage that are optimised without and with the identified effects"""
    csv: Csv = Csv()
    """format of text files"""
    folder: Path = Path()
    """folder of the runs' files, relative to the campaign file's"""

    @field_validator("runs")
    @classmethod
    def _by_speed(cls, runs: tuple[CampaignRun, ...]) -> tuple[CampaignRun, ...]:
        """Every table, figure and page lists the runs in this order."""
        return tuple(sorted(runs, key=lambda run: run.speed))

    @field_validator("channels")
    @classmethod
    def _fit_their_columns(
        cls, channels: dict[str, Channel], info: ValidationInfo
    ) -> dict[str, Channel]:
        if (mechanism := info.data.get("mechanism")) is None:  # invalid itself
            return channels
        kinds = _kinds_of(mechanism)
        # raises with the place of each key
        TypeAdapter(dict[Literal[tuple(kinds)], Any]).validate_python(channels)
        if wrong := list(_errors_of_channels(channels, kinds)):
            raise ValueError("; ".join(wrong))
        return channels

    @field_validator("nuisance", mode="before")
    @classmethod
    def _are_shares_or_bounds(cls, nuisance: Any, info: ValidationInfo) -> Any:
        if not isinstance(nuisance, dict):
            raise ValueError("must map quantities to bounds, e.g. 'slider_mass: 5 %'")
        mechanism = info.data.get("mechanism")
        if mechanism is None:  # invalid itself
            return {}
        kinds = nuisances_of(mechanism.sites, mechanism.loose)
        for key in nuisance:
            if key not in kinds:
                raise ValueError(f"unknown key 'nuisance.{key}'; {did_you_mean(key, kinds)}")
            shared = next((shared for shared in SHARED if key.startswith(f"{shared}_")), None)
            if shared in nuisance:
                all_of_them = _all_of(joints_of(mechanism.sites))
                raise ValueError(f"{shared} ({all_of_them}) and {key} are listed; give one of them")
        runs = info.data.get("runs", ())
        channels = info.data.get("channels", {})
        loads = (*mechanism.effects, *(effect for run in runs for effect in run.effects))
        nominals = {
            key: _pressure_sensor(key, loads, channels)
            if key in PRESSURE_SENSOR
            else _nominal_values(mechanism, kinds[key])
            for key in nuisance
        }
        return {
            key: _share_or_bounds(key, value, kinds[key], nominals[key])
            for key, value in nuisance.items()
        }

    @field_validator("candidates")
    @classmethod
    def _have_free_names(
        cls, candidates: dict[str, OwnLaw], info: ValidationInfo
    ) -> dict[str, OwnLaw]:
        taken = {*EFFECTS}
        if mechanism := info.data.get("mechanism"):
            for name, law in candidates.items():
                if wrong := _wrong_site(law, mechanism.sites):
                    raise ValueError(f"{name}: {wrong}")
            taken |= {*effects_of(mechanism.sites)}
            taken |= {*nuisances_of(mechanism.sites, mechanism.loose), *_kinds_of(mechanism)}
        for name in candidates:
            if name in taken or name.startswith(_OF_OTHERS):
                raise ValueError(
                    f"{name} is, or begins like, the name of another effect or quantity; rename it"
                )
        return candidates

    @field_serializer("nuisance")
    def _bounds_as_written(self, nuisance: dict) -> dict:
        return {key: _as_written(value) for key, value in nuisance.items()}

    def errors(self) -> Iterator[str]:
        yield from self._errors_of_runs()
        if self.optimise_linkage and isinstance(self.mechanism, Mechanism):
            yield (
                "optimise_linkage is for general linkages; of a slider-crank crank and rod are"
                " optimised within 2 %: remove it"
            )
        self.mechanism.applied().check_contacts(max(run.speed for run in self.runs))
        for run in self.runs:
            if run.effects:
                together = self.mechanism.model_copy(
                    update={"effects": (*self.mechanism.effects, *run.effects)}
                )
                yield from (f"runs: '{run.id}': {error}" for error in together.errors())
        yield from self._errors_of_drive()
        ids = [run.id for run in self.runs]
        for name, channel in self.channels.items():
            for run in channel.noise if isinstance(channel.noise, dict) else ():
                if run not in ids:
                    yield (
                        f"channels.{name}.noise: there is no run '{run}'; {did_you_mean(run, ids)}"
                    )
        for key in self.nuisance:
            yield from self._errors_of_nuisance(key)

    def _errors_of_runs(self) -> Iterator[str]:
        for index, run in enumerate(self.runs):
            for earlier in self.runs[:index]:
                if earlier.id == run.id:
                    yield f"runs: two have the id '{run.id}'; give each its own"
                for file in {*earlier.files} & {*run.files}:
                    yield (
                        f"runs: '{earlier.id}' and '{run.id}' both read {file}; give two files, or"
                        " role split"
                    )
        roles = {run.role for run in self.runs}
        for role, purpose in (("identify", "fitting"), ("confirm", "validation")):
            if not roles & {role, "split"}:
                yield f"runs: none is for {purpose}; give one the role {role} (or split, for both)"

    def _errors_of_drive(self) -> Iterator[str]:
        has = self.channels.keys()
        if self.drive == "motor" and self.motor is None:
            yield (
                "drive motor needs the key 'motor'; add 'motor: {stall_torque: 12 N*m,"
                " no_load_speed: 700 rpm}'"
            )
        if self.drive != "motor" and self.motor is not None:
            yield f"motor is given, but drive is {self.drive}; set 'drive: motor' or remove it"
        if not has & {"time", "crank_angle"}:
            yield "channels: neither time nor crank_angle is given; add one of them"
        required = {
            "measured_angle": {"time", "crank_angle"},
            "motor": {"time"},
            "free": {"time"},
        }
        if missing := sorted(required.get(self.drive, set()) - has):
            yield (
                f"channels: drive {self.drive} requires the channel {' and '.join(missing)}; add it"
            )
        inputs = {"time", "crank_angle"}
        if self.drive != "measured_angle" and "time" in has:
            inputs = {"time"}
        if not has - inputs - PRESSURES.keys():
            yield "channels: no measured quantity to compare; add a channel such as crank_torque"
        for run in self.runs:
            if has & PRESSURES.keys() and "crank_angle" not in has and run.first_angle is None:
                yield (
                    f"runs: '{run.id}': a pressure requires the channel crank_angle, or first_angle"
                    " of runs; add it"
                )
            if self.drive == "measured_angle" and isinstance(run.start, Start):
                yield (
                    f"runs: '{run.id}' has a start angle, but none was measured; give start:"
                    " settled or dead_centre"
                )
            if self.drive == "free" and "crank_angle" not in has:
                if "crank_speed" not in has or run.first_angle is None:
                    yield (
                        f"runs: '{run.id}': drive free requires the channel crank_angle, or"
                        " crank_speed and first_angle of runs, for the motion at the first sample;"
                        " add it"
                    )
            if self.drive == "free" and isinstance(run.start, Start):
                yield (
                    f"runs: '{run.id}' has a start before the first sample, but with drive free"
                    " the motion starts at it; remove start"
                )
            if len(run.files) > 1 and "time" not in has:
                yield (
                    f"channels: the two files of run '{run.id}' require the channel time, of the"
                    " same heading; add it"
                )
            if run.first_angle is not None and "crank_angle" in has:
                yield (
                    f"runs: '{run.id}' has first_angle, but the channel crank_angle contains it;"
                    " remove first_angle"
                )

    def _errors_of_nuisance(self, key: str) -> Iterator[str]:
        nominals = self.nominals(key)
        if key in PRESSURE_SENSOR and len(nominals) > 1:
            values = " and ".join(f"{value:g}" for value in nominals)
            yield (
                f"nuisance: {key} is one value of all pressures, but the tables have {values}; give"
                " them the same"
            )
        if key in SHARED and len(set(nominals)) > 1:
            pins = [pin for pin in joints_of(self.mechanism.sites) if self.nominals(f"{key}_{pin}")]
            values = joined(
                f"{value:g} in {pin}" for value, pin in zip(nominals, pins, strict=True)
            )
            keys = joined(f"{key}_{pin}" for pin in pins)
            yield (
                f"nuisance: {key} requires equal values in {_all_of(pins)}, but they are {values};"
                f" list {keys}"
            )
        for nominal in nominals:
            low, high = self.bounds(key, nominal)
            where = f"nuisance: {key} is {nominal:g}"
            if low == high:
                yield f"{where}, so a percentage is not a range; give [low, high]"
            if not low <= nominal <= high:
                yield (
                    f"{where}, outside of its bounds [{low:g}, {high:g}]; widen them or correct the"
                    " value"
                )
            for bound in (low, high):
                try:
                    _possible(self.nuisance_kinds[key], bound)
                except ValueError as error:
                    yield (
                        f"{where}, and {bound:g} at {_as_written(self.nuisance[key])} {error};"
                        " narrow it"
                    )

    def nominals(self, key: str) -> tuple[float, ...]:
        """Nominal values [SI] of the nuisance `key`, one or one per pin or run; () where it has no
        effect."""
        if key == "speed":
            return tuple(run.speed for run in self.runs)
        if key in MOTOR_LINE:
            return () if self.motor is None else (getattr(self.motor, key),)
        if key in PRESSURE_SENSOR:
            return _pressure_sensor(key, (*self.mechanism.effects, *self._run_loads), self.channels)
        bounds, kind = self.nuisance.get(key), self.nuisance_kinds[key]
        if kind.needs and isinstance(bounds, tuple):
            if not bounds[0] <= 0.0 <= bounds[1]:  # an encoder mounted the other way round
                return (0.5 * (bounds[0] + bounds[1]),)
        return _nominal_values(self.mechanism, kind)

    @property
    def _run_loads(self) -> tuple[AnyEffect, ...]:
        return tuple(effect for run in self.runs for effect in run.effects)

    def bounds(self, key: str, nominal: float) -> tuple[float, float]:
        """Bounds of the nuisance `key` [SI] around its `nominal` value [SI]."""
        bounds = self.nuisance[key]
        if isinstance(bounds, tuple):
            return bounds
        return nominal * (1 - bounds), nominal * (1 + bounds)

    @cached_property
    def channel_kinds(self) -> dict[str, ChannelKind]:
        """The channels that its mechanism may have."""
        return _kinds_of(self.mechanism)

    @cached_property
    def nuisance_kinds(self) -> dict[str, Nuisance]:
        """The quantities of its mechanism and sensors that may be uncertain."""
        return nuisances_of(self.mechanism.sites, self.mechanism.loose)

    def unit(self, channel: str) -> str:
        """SI unit of a channel."""
        return self.channel_kinds[channel].unit

    def factor(self, channel: str) -> float:
        """SI value of one unit of the channel's column, without its sign."""
        given = self.channels[channel]
        return channel_factor(channel, self.unit(channel), given.unit, given.scale)

    def shown_unit(self, channel: str) -> tuple[str, float]:
        """Display unit of a channel, and its SI value: the column's unit, except for counts and
        sensor signals."""
        scale = self.channels[channel].scale
        unit = self.channels[channel].unit
        if scale is None and split_share(unit)[1] == 1.0:
            return unit, self.factor(channel)
        base = self.unit(channel)
        unit = {"rad": "deg"}.get(base, base)
        return unit, channel_factor(channel, base, unit)

    @property
    def data_files(self) -> tuple[Path, ...]:
        """The files of all runs."""
        return tuple(self.folder / file for run in self.runs for file in run.files)

    @property
    def idle_nuisances(self) -> tuple[str, ...]:
        """Listed nuisances without effect, including a speed that the records contain."""
        recorded = {"time", "crank_angle"} <= self.channels.keys()

        def is_idle(key: str) -> bool:
            if key == "speed":
                return recorded
            if key == f"{self.mechanism.sites.crank}_inertia" and self.drive == "constant_speed":
                return self.mechanism.effect("speed_fluctuation") is None
            needed = self.nuisance_kinds[key].needs
            return not (self.nominals(key) and self.channels.keys() >= {*needed})

        return tuple(key for key in self.nuisance if is_idle(key))

    @property
    def run_nuisances(self) -> tuple[str, ...]:
        """Nuisances with one value per run: with pressures of the single runs also the zero of
        their sensor."""
        zeros = [key for key in self.nuisance_kinds if key.endswith(POSITION_ZERO)]
        of_runs = ("speed", "encoder_zero", *zeros, *MOTOR_LINE)
        if _pressure_sensor(PRESSURE_ZERO, self._run_loads, self.channels):
            return (*of_runs, PRESSURE_ZERO)
        return of_runs

    @property
    def own_loads(self) -> tuple[str, ...]:
        """The known loads of single runs, one line each; the mechanism does not contain them."""
        lines = []
        for run in self.runs:
            for effect in run.effects:
                file = getattr(effect.parameters, "file", None)
                lines.append(f"run {run.id}: {effect.name}{f', {Path(file).name}' if file else ''}")
        pressures = [name for name in PRESSURES if name in self.channels]
        lines += [f"every run: {name}, averaged over its cycles" for name in pressures]
        return tuple(lines)

    @property
    def load_files(self) -> tuple[str, ...]:
        """Files of the loads in the mechanism and of single runs."""
        tables = [load.parameters for load in self._run_loads]
        files = (table.file for table in tables if hasattr(table, "file"))
        return (*self.mechanism.files, *files)

    @property
    def jitter(self) -> float | None:
        """Standard deviation of the time stamps [s] as stated, or None."""
        return self.channels["time"].jitter if "time" in self.channels else None
