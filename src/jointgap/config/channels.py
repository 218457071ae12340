"""Channels of a campaign: what can be measured, and how a column of a file becomes one."""

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, WithJsonSchema, field_validator

from jointgap.config.names import Name, text_of
from jointgap.quantities import quantity, to_si, unit_factor
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
    "Nm": "write N*m",
    "nm": "nm is the nanometre; a torque is N*m",
    "Hz": "Hz may or may not mean turns; write rpm, turn/s or rad/s",
}


_AMOUNT = [{"type": "number", "exclusiveMinimum": 0}, {"type": "string"}, {"type": "null"}]
_AMOUNTS = [*_AMOUNT, {"type": "object", "additionalProperties": {"anyOf": _AMOUNT[:2]}}]


class Channel(Section):
    """A column of the runs' files, and what is known of its sensor."""

    column: Name = Field(description="heading of the column in every run's file")
    unit: str = Field(description="unit of the column, by its pint name, such as deg, g_n, N*m or rpm")
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
    reads_gravity: bool = Field(False, description="whether an accelerometer's reading has gravity in it")

    @field_validator("unit")
    @classmethod
    def _is_a_unit(cls, unit: str) -> str:
        try:
            unit_factor(unit, unit)
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
    try:
        amount = to_si(value, unit)
    except ValueError as error:
        raise ValueError(f"{where}{error}") from error
    if not amount > 0:
        raise ValueError(f"{where}{amount:g} must be greater than 0; leave the key out where it is not known")
    return amount


def channel_factor(name: str, unit: str) -> float:
    """How much of the SI unit of the channel `name` one `unit` is.

    Raises
    ------
    ValueError
        A unit of another dimension, or a rate or an angle that may or may not mean turns.
    """
    base = CHANNELS[name]
    try:
        return unit_factor(unit, base)
    except ValueError as error:
        hint = _UNIT_HINTS.get(unit)
        raise ValueError(f"{name}.unit = '{unit}' {error}{f'; {hint}' if hint else ''}") from error
