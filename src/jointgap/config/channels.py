"""Channels of a campaign: what can be measured, and how a column of a file becomes one."""

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, WithJsonSchema, field_validator, model_validator

from jointgap.config.names import Name, text_of
from jointgap.core.units import quantity, scaled_unit_factor, split_quantity, split_share, to_si, unit_factor
from jointgap.section import Section

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
