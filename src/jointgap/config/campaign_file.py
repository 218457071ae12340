"""The campaign file: a mechanism, the runs measured on its rig, and how their columns map to channels."""

from datetime import date as Date
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_serializer, field_validator, model_validator

from jointgap.config.channels import CHANNELS, UNITS, Channel, channel_factor
from jointgap.config.mechanism_config import Mechanism
from jointgap.config.names import Word
from jointgap.config.nuisance_bounds import (
    MOTOR_LINE,
    NEEDED_CHANNELS,
    NOMINALLY_0,
    SHARED,
    as_written,
    check_keys,
    check_possible,
    nominal_values,
    share_or_bounds,
)
from jointgap.config.scenario import MotorDrive
from jointgap.core.csv_files import Csv
from jointgap.core.errors import did_you_mean
from jointgap.core.joints import PINS
from jointgap.core.units import Angle, PositiveAngle, PositiveAngularSpeed, PositiveTime, split_share
from jointgap.section import Section

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
