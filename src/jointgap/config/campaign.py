"""The campaign file: a mechanism, the runs measured on its rig, their columns, and what is known within bounds."""

import math
from collections.abc import Mapping
from datetime import date as Date
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, ValidationInfo, WithJsonSchema, field_serializer, field_validator, model_validator

from jointgap.config.mechanism import Mechanism
from jointgap.config.scenario import MotorDrive
from jointgap.core.csv_files import Csv
from jointgap.core.errors import did_you_mean
from jointgap.core.joints import PINS
from jointgap.core.section import Name, Section, Word, text_of
from jointgap.core.units import (
    Angle,
    PositiveAngle,
    PositiveAngularSpeed,
    PositiveTime,
    quantity,
    scaled_unit_factor,
    split_quantity,
    split_share,
    to_si,
    unit_factor,
)
from jointgap.effects.clearance import LEAST_CLEARANCE

CHANNELS = {
    "time": "s",
    "crank_angle": "rad",
    "crank_speed": "rad/s",
    "slider_position": "m",
    "slider_velocity": "m/s",
    "slider_acceleration": "m/s^2",
    "rod_angle": "rad",
    "rod_angular_velocity": "rad/s",
    "rod_acceleration_x": "m/s^2",
    "rod_acceleration_y": "m/s^2",
    "crank_torque": "N*m",
    "guide_force": "N",
    "frame_force_x": "N",
    "frame_force_y": "N",
}
"""SI unit of every channel that a rig can have."""

UNITS = {
    "s": ("s", "ms", "us"),
    "m": ("m", "mm", "cm", "um", "inch"),
    "m/s": ("m/s", "mm/s", "km/h"),
    "m/s^2": ("m/s^2", "g_n", "mm/s^2"),
    "rad": ("rad", "deg", "turn"),
    "rad/s": ("rad/s", "deg/s", "rpm", "turn/s"),
    "N*m": ("N*m", "N*cm", "N*mm", "kN*m", "lbf*ft"),
    "N": ("N", "kN", "lbf", "mN"),
}
"""Units, by the SI unit, that are proposed where none is stated or the stated one does not fit."""


FILTER_ORDER = 4
"""Of the Butterworth low-pass by which a campaign file describes a sensor's bandwidth."""

_UNIT_HINTS = {
    "g": "g is the gram; the standard acceleration of gravity is g_n",
    "nm": "nm is the nanometre; a torque is N*m",
    "Hz": "Hz may or may not mean turns; write rpm, turn/s or rad/s",
    **dict.fromkeys(
        ("count", "counts"),
        "give the factor of the counts: counts_per_turn of an angle, rate of time, scale of other channels",
    ),
}

_COUNTED = {"counts_per_turn": ("turn", ""), "rate": ("s", "Hz")}
"""Keys that make a column of whole numbers one of parts of a unit: that unit, and the unit of the key."""


_AMOUNT = [{"type": "number", "exclusiveMinimum": 0}, {"type": "string"}, {"type": "null"}]
_AMOUNTS = [*_AMOUNT, {"type": "object", "additionalProperties": {"anyOf": _AMOUNT[:2]}}]


class Channel(Section):
    """A column of the runs' files, and what is known of its sensor."""

    column: Name = Field(description="heading of the column in every run's file")
    unit: str = Field(
        description="unit of the column, by its pint name, such as deg, g_n, N*m or rpm; not needed with "
        "counts_per_turn or rate"
    )
    scale: Annotated[str | None, WithJsonSchema({"anyOf": _AMOUNT})] = Field(
        None, description="factor of a sensor's signal, such as 0.35 N*m/A for a column in A; null: none"
    )
    counts_per_turn: quantity("", gt=0) | None = Field(
        None, description="of an angle whose column has an encoder's counts: how many are a turn"
    )
    rate: quantity("Hz", gt=0) | None = Field(
        None, description="of time whose column has sample numbers: how many are a second, such as 2 kHz"
    )
    noise: Annotated[float | dict[str, float] | None, WithJsonSchema({"anyOf": _AMOUNTS})] = Field(
        None, description="standard deviation of the noise in the column's unit, one or by run; null: estimated"
    )
    resolution: Annotated[float | None, WithJsonSchema({"anyOf": _AMOUNT})] = Field(
        None, description="step of an encoder in the column's unit; null: not known"
    )
    bandwidth: quantity("Hz", gt=0) | None = Field(
        None, description="corner of the fourth-order low-pass that the samples went through; null: instantaneous"
    )
    filter: Literal["zero_phase", "causal"] = Field("zero_phase", description="whether that low-pass delays")
    sign: Literal[1, -1] = Field(1, description="-1: the sensor reads the opposite of what the axes say")
    jitter: quantity("s", gt=0) | None = Field(
        None, description="of time: standard deviation of its stamps; null: estimated where samples tell"
    )
    repeated: Literal["first", "last"] | None = Field(
        None,
        description="of time: which of several rows of one time is kept, such as a solver writes at its events; null: "
        "rows that are the same are kept once, others refused",
    )
    reads_gravity: bool = Field(False, description="whether an accelerometer's reading has gravity in it")

    @model_validator(mode="before")
    @classmethod
    def _counts_are_parts_of_a_unit(cls, given: Any) -> Any:
        for key, (whole, own) in _COUNTED.items():
            if not isinstance(given, dict) or given.get(key) is None:
                continue
            try:
                parts = to_si(given[key], own)
            except ValueError:
                parts = 0.0
            if not parts > 0:
                return {"unit": whole} | given  # its own check says what is wrong
            unit = f"{whole}/{parts:.17g}"
            if given.get("unit", "count") not in ("count", "counts", unit):
                raise ValueError(f"unit = {given['unit']!r} and {key} are both given; remove one of them")
            given = ({"resolution": 1} if key == "counts_per_turn" else {}) | given | {"unit": unit}
        return given

    @field_validator("scale", mode="before")
    @classmethod
    def _is_text(cls, scale: Any) -> Any:
        if scale is not None and not to_si(split_quantity(str(scale))[0], "") > 0:
            raise ValueError("must be greater than 0; write 'sign: -1' for a sensor that reads the opposite")
        return scale if scale is None else str(scale)

    @field_validator("unit")
    @classmethod
    def _is_a_unit(cls, unit: str) -> str:
        try:
            whole, _ = split_share(unit)
            unit_factor(whole, whole)
        except Exception as error:  # what pint makes of text that is no unit is of a dozen kinds
            raise ValueError(
                _UNIT_HINTS.get(unit, "is not a unit; write one such as s, deg, mm, g_n, N*m or rpm")
            ) from error
        return unit

    @field_validator("noise", "resolution", mode="before")
    @classmethod
    def _is_in_the_columns_unit(cls, value: Any, info: ValidationInfo) -> Any:
        unit = info.data.get("unit")
        if value is None or unit is None:  # the unit is refused itself
            return None
        if info.field_name == "noise" and isinstance(value, dict):
            return {text_of(run): _amount(own, unit, f"{run}: ") for run, own in value.items()}
        return _amount(value, unit)

    def noise_of(self, run: str) -> float | None:
        """Stated standard deviation of the noise in a run, in the column's unit; None where it is to be estimated."""
        return self.noise.get(run) if isinstance(self.noise, dict) else self.noise


def _amount(value: Any, unit: str, where: str = "") -> float:
    """A number > 0 in the column's unit, of a number in it or a text with a unit of its own."""
    whole, parts = split_share(unit)
    try:
        amount = to_si(value, whole)
        if isinstance(value, str) and split_quantity(value)[1]:
            amount *= parts
    except ValueError as error:
        raise ValueError(f"{where}{error}") from error
    if not amount > 0:
        raise ValueError(f"{where}{amount:g} must be greater than 0; leave the key out where it is not known")
    return amount


def channel_factor(name: str, unit: str, scale: str | None = None) -> float:
    """How much of the SI unit of the channel `name` one `unit` of its column is."""
    base = CHANNELS[name]
    factor = f"such as scale: 1 {base}/{unit}"
    try:
        return unit_factor(unit, base) if scale is None else scaled_unit_factor(scale, unit, base)
    except ValueError as error:
        if scale is not None:
            raise ValueError(f"{name}.scale = '{scale}' of a column in {unit} {error}; give it {factor}") from error
        hint = _UNIT_HINTS.get(unit, f"of a sensor's signal give the factor, {factor}")
        raise ValueError(f"{name}.unit = '{unit}' {error}; {hint}") from error


class _Range(NamedTuple):
    """Unit of a nuisance, and what it can be in a simulation: the least, the most, and both in words."""

    unit: str
    least: float
    most: float
    words: str


def _above_0(unit: str) -> _Range:
    return _Range(unit, math.nextafter(0.0, 1.0), math.inf, f"more than 0 {unit}")


_CLEARANCE = _Range("m", LEAST_CLEARANCE, math.inf, f"{LEAST_CLEARANCE:g} m or more")

SHARED = {
    "joint_friction": _Range("", 0.0, 0.6, "0 to 0.6"),
    "restitution": _Range("", 1e-3, math.nextafter(1.0, 0.0), "0.001 to below 1"),
}
"""Quantities that both pins share unless they are listed for each."""

MOTOR_LINE = ("stall_torque", "no_load_speed")
"""The torque-speed line of a motor: supply and winding are not alike in all runs."""

RUN_NUISANCES = ("speed", "encoder_zero", "slider_position_zero", *MOTOR_LINE)
"""Quantities that every run has for itself."""

NEEDED_CHANNELS = {
    "encoder_zero": ("crank_angle",),
    "slider_position_zero": ("slider_position",),
    "encoder_lag": ("time", "crank_angle"),
}
"""Channels without which a nuisance of a sensor has nothing to act on."""

_RANGES = {
    "slider_mass": _above_0("kg"),
    "rod_mass": _above_0("kg"),
    "rod_inertia": _above_0("kg*m^2"),
    "crank_length": _above_0("m"),
    "rod_length": _above_0("m"),
    "crank_pin_clearance": _CLEARANCE,
    "piston_pin_clearance": _CLEARANCE,
    **SHARED,
    **{f"{key}_{pin}": own for key, own in SHARED.items() for pin in PINS},
    "speed": _above_0("rad/s"),
    "stall_torque": _above_0("N*m"),
    "no_load_speed": _above_0("rad/s"),
    "slider_offset": _Range("m", -math.inf, math.inf, "any length"),
    "encoder_zero": _Range("rad", -math.tau, math.tau, "a turn either way"),
    "encoder_lag": _Range("s", -math.inf, math.inf, "any time"),
    "slider_position_zero": _Range("m", -math.inf, math.inf, "any length"),
}

NUISANCES = {key: limits.unit for key, limits in _RANGES.items()}
"""SI unit of every quantity that may be listed under ``nuisance``; ``''`` for pure numbers."""


NOMINALLY_0 = ("encoder_zero", "encoder_lag", "slider_position_zero")
"""Of sensors: 0 where the bounds do not say otherwise."""

_AMOUNT_EXAMPLES = {"m": "'1 mm'", "rad": "'5 deg'", "s": "'5 ms'"}
"""By which a quantity of the unit may differ from nominal either way, for example."""


def share_or_bounds(key: str, value: Any, nominals: tuple[float, ...] = ()) -> float | tuple[float, float]:
    """The `value` of the nuisance `key` in a campaign file: a share of its nominal value, or its bounds [SI]."""
    unit = NUISANCES[key]
    if isinstance(value, str) and (amount := _amount_around(value, unit)) is not None:
        if len(set(nominals)) != 1 or not amount > 0:
            raise ValueError(
                f"{key} = '{value}' must be more than 0 {unit} either way of one nominal value; write bounds such as "
                "[low, high]"
            )
        low, high = nominals[0] - amount, nominals[0] + amount
        check_possible(key, low, high, f"{key} = '{value}'")
        return low, high
    if isinstance(value, str):
        share = _percent(key, value)
        if not 0 < share < 1:
            raise ValueError(f"{key} = '{value}' must be more than 0 % and less than 100 %")
        return share
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise ValueError(f"{key} = {value!r} must be a percentage such as '5 %' or bounds such as [low, high]")
    try:
        low, high = (to_si(bound, unit) for bound in value)
    except ValueError as error:
        raise ValueError(f"{key} = {list(value)!r} {error}") from error
    if low >= high:
        raise ValueError(f"{key} = {list(value)!r} is upside down or empty; write the lower bound first")
    check_possible(key, low, high, f"{key} = {list(value)!r}")
    return low, high


def check_possible(key: str, low: float, high: float, source: str) -> None:
    """ValueError, beginning with the `source`, where `low` or `high` [SI] of the nuisance `key` cannot be simulated."""
    _, least, most, words = _RANGES[key]
    if low < least or high > most:
        raise ValueError(f"{source} reaches from {low:g} to {high:g} and leaves what is possible, {words}; narrow it")


def _amount_around(text: str, unit: str) -> float | None:
    """A length, angle or time with a unit of its own as a number in `unit`; None of any other text."""
    try:
        return to_si(text, unit) if unit in _AMOUNT_EXAMPLES and split_quantity(text)[1] else None
    except ValueError:
        return None


def _percent(key: str, text: str) -> float:
    try:
        number, own = split_quantity(text.strip().removeprefix("+-"))
    except ValueError as error:
        own, mistake = "", f" {error};"
    else:
        mistake = ""
    if own in ("%", "percent"):
        return float(Decimal(number) / 100)
    unit = NUISANCES[key]
    # of what is nominally 0 a percentage is no range
    instead = [] if key in NOMINALLY_0 else ["a percentage such as '5 %'"]
    instead += [f"an amount such as {_AMOUNT_EXAMPLES[unit]}"] if unit in _AMOUNT_EXAMPLES else []
    raise ValueError(f"{key} = '{text}'{mistake} must be {' or '.join(instead)}, or bounds such as [low, high]")


def as_written(value: float | tuple[float, float]) -> str | list[float]:
    """What `share_or_bounds` reads as `value`, to the last digit."""
    return list(value) if isinstance(value, tuple) else f"{Decimal(repr(value)) * 100} %"


def check_keys(given: Mapping[str, Any]) -> None:
    """ValueError on unknown keys, and on a quantity given for both pins and for one."""
    for key in given:
        if key not in _RANGES:
            raise ValueError(f"unknown key 'nuisance.{key}'; {did_you_mean(key, _RANGES)}")
    for shared in SHARED:
        own = [f"{shared}_{pin}" for pin in PINS if f"{shared}_{pin}" in given]
        if shared in given and own:
            raise ValueError(f"{shared} of both pins and {own[0]} are listed; give one of them")


def nominal_values(mechanism: Mechanism, key: str) -> tuple[float, ...]:
    """Values [SI] of the nuisance `key` in a `mechanism`, one or one per pin; () where it has nothing to act on.

    Not of the speed, which the runs have, and not of a motor. Zeros and lags of sensors are nominally 0.
    """
    plain = dict.fromkeys(NEEDED_CHANNELS, 0.0) | {
        "slider_offset": mechanism.slider.offset,
        "slider_mass": mechanism.slider.mass,
        "rod_mass": mechanism.rod.mass,
        "rod_inertia": mechanism.rod.inertia,
        "crank_length": mechanism.crank.length,
        "rod_length": mechanism.rod.length,
    }
    if key in plain:
        return (plain[key],)
    pins = [pin for pin in PINS if pin in key] or PINS
    if key.endswith("clearance"):
        return tuple(mechanism.clearance(pin) for pin in pins if pin in mechanism.loose)
    contacts = [mechanism.joint(pin).contact for pin in pins if pin in mechanism.loose]
    if key.startswith("joint_friction"):
        return tuple(contact.friction for contact in contacts)
    return tuple(contact.restitution for contact in contacts if contact.restitution is not None)


_STARTS = ("settled", "at_rest", "dead_centre", "unknown")

RESERVED_IDS = ("all", "look", "measured", "remarks", "contradictions", "config_snapshot")
"""No run may be called so: a sum over runs is, and the tables that stand beside the pictures of the runs are."""


class Start(Section):
    """Where the motion began before the first sample: at an angle of the crank, or so far or so long before.

    It began as in the paper, with coincident joint centres and the velocities of the ideal mechanism.
    """

    angle: Angle | None = Field(
        None,
        description="crank angle at which the motion began: where it was passed nearest to turned or ran, or last",
    )
    turned: PositiveAngle | None = Field(None, description="how far the crank had turned by the first sample: 3 turn")
    ran: PositiveTime | None = Field(None, description="how long it had run by the first sample: 0.5 s")

    @model_validator(mode="after")
    def _says_one_thing(self):
        if self.turned is not None and self.ran is not None:
            raise ValueError("how far it had turned and how long it ran are both given; remove turned or ran")
        if self.angle is None and self.turned is None and self.ran is None:
            raise ValueError("says nothing; give angle, turned or ran, such as {angle: 40 deg, turned: 3 turn}")
        return self


class CampaignRun(Section):
    """One file of samples, measured at one speed."""

    id: Word = Field(description="name of the run: letters, digits, '_' and '-'")
    file: str = Field(min_length=1, description="table of samples, CSV or Parquet, from the campaign file's folder")
    speed: PositiveAngularSpeed = Field(description="nominal speed of the crank")
    role: Literal["identify", "confirm", "split"] = Field(
        description="identify: for fitting and choosing; confirm: takes no part in either; split: its last third "
        "does not"
    )
    start: Literal["settled", "at_rest", "dead_centre", "unknown"] | Start = Field(
        "settled", description="how the motion began before the first sample, or where and how long before"
    )
    first_angle: Angle | None = Field(
        None, description="crank angle at the first sample, where no channel has it; null: found with the nuisances"
    )
    direction: Literal["counter_clockwise", "clockwise"] = Field(
        "counter_clockwise", description="how the crank turns; a clockwise crank's falling angle is mirrored"
    )

    @field_validator("speed", mode="before")
    @classmethod
    def _has_no_sign(cls, given: Any) -> Any:
        if str(given).lstrip().startswith("-"):
            raise ValueError(
                "must be greater than 0; of a crank that turns clockwise give 'direction: clockwise' beside it"
            )
        return given

    @field_validator("start", mode="before")
    @classmethod
    def _is_a_start(cls, given: Any) -> Any:
        if isinstance(given, dict | Start):
            return Start.model_validate(given)
        if given not in _STARTS:
            known = ", ".join(_STARTS)
            raise ValueError(f"is {given!r}; give {known}, or a mapping such as {{angle: 40 deg, turned: 3 turn}}")
        return given

    @field_validator("id")
    @classmethod
    def _is_free(cls, name: str) -> str:
        if name in RESERVED_IDS:
            raise ValueError("would be taken for another result of that name; choose another id")
        return name


class Campaign(Section):
    """Everything that the naming of effects knows of a rig but the samples."""

    name: Word = Field(description="name of the campaign, and of its folder of results")
    date: Date | None = Field(None, description="day of the measurement, for trends: 2026-03-01")
    mechanism: Mechanism = Field(description="the mechanism as it is simulated so far")
    drive: Literal["constant_speed", "measured_angle", "motor"] = Field(
        "constant_speed", description="what turns the crank: a constant speed, the measured angle, or a motor"
    )
    motor: MotorDrive | None = Field(None, description="torque-speed line of the motor")
    runs: Annotated[tuple[CampaignRun, ...], Field(min_length=1)] = Field(description="the runs, a file each")
    channels: dict[str, Channel] = Field(description="what was measured, by the channel's name")
    nuisance: dict[str, float | tuple[float, float]] = Field(
        {}, description="what is known within bounds only: a percentage of nominal, an amount, or [low, high]"
    )
    csv: Csv = Field(Csv(), description="how text files are written")
    folder: Path = Field(Path(), description="folder of the runs' files, from the campaign file's own")

    @field_validator("date", mode="before")
    @classmethod
    def _is_a_day(cls, given: Any) -> Any:
        if given is None or type(given) is Date:
            return given
        try:
            return Date.fromisoformat(given)
        except (TypeError, ValueError):
            raise ValueError("is no day; write year, month and day, such as 2026-03-01") from None

    @field_validator("motor", mode="before")
    @classmethod
    def _is_a_motor(cls, value: Any) -> Any:
        if value is not None and not isinstance(value, dict | MotorDrive):
            raise ValueError("must be a mapping with the keys stall_torque and no_load_speed")
        return {"kind": "motor"} | value if isinstance(value, dict) else value

    @field_validator("channels", mode="before")
    @classmethod
    def _are_known(cls, given: Any) -> Any:
        if not isinstance(given, dict) or not given:
            raise ValueError("must map channels to their columns, e.g. 'crank_angle: {column: theta, unit: deg}'")
        for name in given:
            if name not in CHANNELS:
                raise ValueError(f"unknown channel '{name}'; {did_you_mean(name, CHANNELS)}")
            unit = given[name].get("unit") if isinstance(given[name], dict) else None
            if isinstance(unit, str) and not unit.strip():
                raise ValueError(f"{name}.unit is empty; write that of the column: {', '.join(UNITS[CHANNELS[name]])}")
        return given

    @field_validator("channels")
    @classmethod
    def _fit_their_columns(cls, channels: dict[str, Channel]) -> dict[str, Channel]:
        wrong, columns = [], {}
        for name, channel in channels.items():
            try:
                _check_sensor(name, channel)
                channel_factor(name, channel.unit, channel.scale)
            except ValueError as error:
                wrong.append(str(error))
            if channel.column in columns:
                wrong.append(
                    f"{columns[channel.column]} and {name} both read column '{channel.column}'; give two columns"
                )
            columns.setdefault(channel.column, name)
        if wrong:
            raise ValueError("; ".join(wrong))
        return channels

    @field_validator("nuisance", mode="before")
    @classmethod
    def _are_shares_or_bounds(cls, given: Any, info: ValidationInfo) -> Any:
        if not isinstance(given, dict):
            raise ValueError("must map quantities to bounds, e.g. 'slider_mass: 5 %'")
        check_keys(given)
        mechanism = info.data.get("mechanism")  # absent where it is refused itself
        if mechanism is None:
            return {}
        nominals = {key: () if key in ("speed", *MOTOR_LINE) else nominal_values(mechanism, key) for key in given}
        return {key: share_or_bounds(key, value, nominals[key]) for key, value in given.items()}

    @field_serializer("nuisance")
    def _bounds_as_written(self, nuisance: dict) -> dict:
        return {key: as_written(value) for key, value in nuisance.items()}

    @model_validator(mode="after")
    def _runs_can_be_told_apart(self):
        for index, run in enumerate(self.runs):
            for other in self.runs[:index]:
                if other.id == run.id:
                    raise ValueError(f"runs: two have the id '{run.id}'; give each its own")
                if other.file == run.file:
                    raise ValueError(
                        f"runs: '{other.id}' and '{run.id}' both read {run.file}; give two files, or one run with "
                        "role split"
                    )
        roles = {run.role for run in self.runs}
        for needed, purpose in (("identify", "fitting"), ("confirm", "confirming what is found")):
            if not roles & {needed, "split"}:
                raise ValueError(f"runs: none is for {purpose}; give one the role {needed} (or split, for both)")
        return self

    @model_validator(mode="after")
    def _contacts_are_firm_at_the_speeds_of_the_runs(self):
        self.mechanism.applied().check_contacts(max(run.speed for run in self.runs))
        return self

    @model_validator(mode="after")
    def _drive_has_what_it_needs(self):
        has = self.channels.keys()
        if (self.drive == "motor") != (self.motor is not None):
            raise ValueError(
                "drive motor needs the key 'motor'; add 'motor: {stall_torque: 12 N*m, no_load_speed: 700 rpm}'"
                if self.motor is None
                else f"motor is given, but drive is {self.drive}; set 'drive: motor' or remove it"
            )
        if not has & {"time", "crank_angle"}:
            raise ValueError("channels: neither time nor crank_angle is given; add one of them")
        needed = {"constant_speed": set(), "measured_angle": {"time", "crank_angle"}, "motor": {"time"}}[self.drive]
        if missing := sorted(needed - has):
            raise ValueError(f"channels: drive {self.drive} needs the channel {' and '.join(missing)}; add it")
        for run in self.runs:
            if self.drive == "measured_angle" and isinstance(run.start, Start):
                raise ValueError(
                    f"runs: '{run.id}' has a start before its record, through which no measured angle leads; give "
                    "settled or dead_centre, or drive constant_speed"
                )
        inputs = {"time"} if self.drive != "measured_angle" and "time" in has else {"time", "crank_angle"}
        if not has - inputs:
            raise ValueError("channels: there is nothing to compare; add a channel such as crank_torque")
        for run in self.runs:
            if run.first_angle is not None and "crank_angle" in has:
                raise ValueError(f"runs: '{run.id}' has a first_angle, which the channel crank_angle gives; remove it")
        return self

    @model_validator(mode="after")
    def _noise_is_of_runs(self):
        ids = [run.id for run in self.runs]
        for name, channel in self.channels.items():
            for run in channel.noise if isinstance(channel.noise, dict) else ():
                if run not in ids:
                    raise ValueError(f"channels.{name}.noise: there is no run '{run}'; {did_you_mean(run, ids)}")
        return self

    @model_validator(mode="after")
    def _nominal_is_within_bounds(self):
        for key in self.nuisance:
            nominals = self.nominals(key)
            if key in SHARED and len(set(nominals)) > 1:
                raise ValueError(
                    f"nuisance: {key} of both pins would be one number, but is {nominals[0]:g} in {PINS[0]} and "
                    f"{nominals[1]:g} in "
                    f"{PINS[1]}; list {key}_{PINS[0]} and {key}_{PINS[1]}"
                )
            for nominal in nominals:
                low, high = self.bounds(key, nominal)
                if low == high:
                    raise ValueError(
                        f"nuisance: {key} is {nominal:g}, of which a percentage is no range; give [low, high]"
                    )
                if not low <= nominal <= high:
                    raise ValueError(
                        f"nuisance: {key} is {nominal:g}, outside of [{low:g}, {high:g}]; widen them or correct the "
                        "value"
                    )
                source = f"nuisance: {key} = {as_written(self.nuisance[key])} of {nominal:g}"
                check_possible(key, low, high, source)
        return self

    def nominals(self, key: str) -> tuple[float, ...]:
        """Nominal values [SI] of the nuisance `key`, one or one for each pin or run; () where it is of nothing here."""
        if key == "speed":
            return tuple(run.speed for run in self.runs)
        if key in MOTOR_LINE:
            return () if self.motor is None else (getattr(self.motor, key),)
        given = self.nuisance.get(key)
        if key in NOMINALLY_0 and isinstance(given, tuple) and not given[0] <= 0.0 <= given[1]:
            return (0.5 * (given[0] + given[1]),)  # [170 deg, 190 deg]: an encoder mounted the other way round
        return nominal_values(self.mechanism, key)

    def bounds(self, key: str, nominal: float) -> tuple[float, float]:
        """Lowest and highest value of the nuisance `key` [SI] around its `nominal` value [SI]."""
        given = self.nuisance[key]
        return given if isinstance(given, tuple) else (nominal * (1 - given), nominal * (1 + given))

    def factor(self, channel: str) -> float:
        """How many SI units one unit of the channel's column is, whatever its sign."""
        return channel_factor(channel, self.channels[channel].unit, self.channels[channel].scale)

    def shown_unit(self, channel: str) -> tuple[str, float]:
        """Unit in which pages show a channel, and how many SI units it is: the column's, unless that has counts or a
        sensor's signal.
        """
        stated = self.channels[channel]
        if stated.scale is None and split_share(stated.unit)[1] == 1.0:
            return stated.unit, self.factor(channel)
        unit = {"rad": "deg"}.get(CHANNELS[channel], CHANNELS[channel])
        return unit, channel_factor(channel, unit)

    @property
    def idle_nuisances(self) -> tuple[str, ...]:
        """Nuisances that are left out: those that have nothing to act on, and a speed that the records contain."""
        recorded = {"time", "crank_angle"} <= self.channels.keys()

        def is_idle(key: str) -> bool:
            if key == "speed":
                return recorded
            return not (self.nominals(key) and self.channels.keys() >= set(NEEDED_CHANNELS.get(key, ())))

        return tuple(key for key in self.nuisance if is_idle(key))

    @property
    def jitter(self) -> float | None:
        """Standard deviation of the time stamps [s] as stated; None where it is not."""
        return self.channels["time"].jitter if "time" in self.channels else None


def _check_sensor(name: str, channel: Channel) -> None:
    """ValueError where a key is given that means nothing for the channel `name`."""
    given = {key for key in Channel.model_fields if getattr(channel, key) != Channel.model_fields[key].default}
    if "counts_per_turn" in given and name not in ("crank_angle", "rod_angle"):
        spare, why = {"counts_per_turn"}, "only crank_angle and rod_angle are counted in parts of a turn"
    elif given & {"rate", "repeated"} and name != "time":
        spare, why = given & {"rate", "repeated"}, "it is of time alone"
    elif name == "time":
        allowed = {"column", "unit", "scale", "rate", "repeated", "jitter"}
        spare, why = given - allowed, "time is taken as exact but for its jitter"
    elif "jitter" in given:
        spare, why = {"jitter"}, "time alone has stamps; write it there"
    else:
        spare = set() if name in ("crank_angle", "rod_angle") else given & {"resolution"}
        why = "only crank_angle and rod_angle are read in steps"
    if not spare and "reads_gravity" in given and "acceleration" not in name:
        spare, why = {"reads_gravity"}, "only accelerations can have gravity in them"
    if not spare and "filter" in given and channel.bandwidth is None:
        spare, why = {"filter"}, "it needs the bandwidth that is filtered to"
    if spare:
        raise ValueError(f"{name}.{min(spare)} has no meaning, for {why}; remove it")
