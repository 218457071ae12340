"""The file of a model of your own, ``model.yaml``, and the class in ``model.py`` beside it."""

import importlib.util
import sys
from collections.abc import Iterator
from math import inf
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator

from jointgap.axis.axis import MOTION, Axis
from jointgap.config.campaign import Channel, Day
from jointgap.config.load import validate
from jointgap.config.yaml_files import read_yaml
from jointgap.core.csv_files import Csv
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.section import ConfigModel, Word
from jointgap.core.units import (
    coherent,
    format_dimension,
    quantity,
    scaled_unit_factor,
    split_share,
    unit_factor,
)
from jointgap.core.words import joined

NAME = "model.yaml"
DRIVE, POSITION = "drive", "position"

_BASES = {
    "time": ("s",),
    POSITION: ("m", "rad"),
    "velocity": ("m/s", "rad/s"),
    "acceleration": ("m/s^2", "rad/s^2"),
    DRIVE: ("N", "N*m"),
}
"""SI units of the channels of every axis: of a body that slides, or turns."""

_OF_CAMPAIGNS = ("filter", "high_pass", "average", "jitter", "repeated", "reads_gravity", "bore")
_OF_CAMPAIGNS += ("ambient_pressure",)
_METHODS = ("mass", "force", "load")


class ModelRun(ConfigModel, use_attribute_docstrings=True):
    """The samples of one measurement."""

    id: Word
    """name of the run"""
    file: str
    """table of samples, CSV or Parquet, from `folder`"""
    role: Literal["identify", "confirm", "split"]
    """split: the last third is held out for confirm"""
    start: Literal["moving", "at_rest"] = "moving"
    """at_rest: starts without velocity at the first position; only with given: drive"""
    period: quantity("s", gt=0) | None = None
    """of a motion that repeats; null: it does not"""
    begin: quantity("s") | None = Field(
        None, alias="from", description="time of the first sample used; null: all"
    )
    end: quantity("s") | None = Field(
        None, alias="to", description="time of the last sample used; null: all"
    )

    @property
    def span(self) -> tuple[float, float]:
        """Times [s] of the first and last sample used."""
        return (-inf if self.begin is None else self.begin, inf if self.end is None else self.end)

    @property
    def files(self) -> tuple[str, ...]:
        return (self.file,)


class ModelFile(ConfigModel, use_attribute_docstrings=True):
    """A model of your own with one degree of freedom, and its measurements."""

    name: Word
    """name of the model, and of its folder of results"""
    date: Day | None = None
    """day of the measurement: 2026-03-01"""
    model: str = "model.py"
    """Python file with one class derived from jointgap.axis.Axis"""
    given: Literal[DRIVE, POSITION]
    """drive: the measured force or torque (or what the method force makes of other channels) acts,
    and the motion is simulated; position: the motion is given, and the others are computed"""
    channels: dict[Word, Channel] = Field(min_length=3)
    """time, drive, position, velocity, acceleration, and channels of your own"""
    mean_of: Annotated[int, Field(ge=1)] | None = None
    """samples whose mean is compared; null: one, or two per period of a given position's
    bandwidth"""
    runs: tuple[ModelRun, ...] = Field(min_length=1)
    """the runs, one file each"""
    candidates: tuple[str, ...] | None = None
    """effects that may be missing; null: all that can act"""
    csv: Csv = Csv()
    """format of text files"""
    folder: Path = Path()
    """folder of the files, relative to the model file's"""

    @field_validator("channels")
    @classmethod
    def _have_units(cls, channels: dict[str, Channel]) -> dict[str, Channel]:
        for name, channel in channels.items():
            if name in _METHODS:
                raise ValueError(f"{name} is the name of a method; rename the channel")
            for key in _OF_CAMPAIGNS:
                if getattr(channel, key) != Channel.model_fields[key].default:
                    raise ValueError(f"{name}.{key} does not apply to a model; remove it")
            if channel.bandwidth is not None and name != POSITION:
                raise ValueError(
                    f"{name}.bandwidth: state it for {POSITION} only; all compared channels are"
                    " filtered alike"
                )
            unit_of_channel(name, channel)
        return channels

    def errors(self) -> Iterator[str]:
        required = ("time",) if self.given == DRIVE else ("time", self.given)
        for name in required:
            if name not in self.channels:
                yield f"channels: {name} is missing; add its column"
        if not self.compared:
            yield f"channels: only {joined(list(self.channels))}; add a channel to compare"
        if self.channels[POSITION].bandwidth is not None if POSITION in self.channels else False:
            if self.given == DRIVE:
                yield f"channels: {POSITION}.bandwidth requires given: {POSITION}; remove it"
        kinds = {
            _BASES[name].index(unit_of_channel(name, self.channels[name])[0])
            for name in self.channels
            if name in _BASES and name != "time"
        }
        if len(kinds) > 1:
            yield (
                "channels: some units are of a body that slides and some of one that turns; give"
                " m, m/s and N, or rad, rad/s and N*m"
            )
        ids = [run.id for run in self.runs]
        for repeated in sorted({run for run in ids if ids.count(run) > 1}):
            yield f"runs: several have the id '{repeated}'; give each its own"
        roles = {run.role for run in self.runs}
        if not roles & {"identify", "split"}:
            yield "runs: none has the role identify; nothing could be fitted"
        if not roles & {"confirm", "split"}:
            yield "runs: none has the role confirm; hold out one, or the last third (role: split)"
        for name, channel in self.channels.items():
            for run in channel.noise if isinstance(channel.noise, dict) else ():
                if run not in ids:
                    hint = did_you_mean(run, ids)
                    yield f"channels: {name}.noise: there is no run '{run}'; {hint}"
        for run in self.runs:
            if not run.span[0] < run.span[1]:
                yield f"runs: '{run.id}': 'from' must be before 'to'"
            if run.start == "at_rest" and self.given == POSITION:
                yield f"runs: '{run.id}': start requires given: {DRIVE}; remove it"

    @property
    def turns(self) -> bool:
        """Whether the body turns: its position is an angle."""
        return any(
            name in self.channels and unit_of_channel(name, self.channels[name])[0] == units[1]
            for name, units in _BASES.items()
            if name != "time"
        )

    @property
    def compared(self) -> tuple[str, ...]:
        """Channels that a simulation predicts, as far as the class knows no input of this name."""
        given = ("time", DRIVE) if self.given == DRIVE else ("time", *MOTION[:3])
        return tuple(name for name in self.channels if name not in given)

    def shown_unit(self, channel: str) -> tuple[str, float]:
        """Display unit of a channel, and its SI value."""
        if (
            self.channels[channel].scale is None
            and split_share(self.channels[channel].unit)[1] == 1
        ):
            return self.channels[channel].unit, self.factor(channel)
        return unit_of_channel(channel, self.channels[channel])[0], 1.0

    def factor(self, channel: str) -> float:
        """SI value of one unit of the channel's column, without its sign."""
        return unit_of_channel(channel, self.channels[channel])[1]

    # Tables and pages read these of a campaign
    own_loads: ClassVar[tuple] = ()
    nuisance: ClassVar[dict] = {}


def unit_of_channel(name: str, channel: Channel) -> tuple[str, float]:
    """SI unit of a channel, and the value of one unit of its column; ValueError if the unit is not
    one of this channel."""
    unit, scale = channel.unit, channel.scale
    bases = _BASES.get(name)
    if bases is None:
        if scale is not None:
            raise ValueError(f"{name}.scale: give the unit of the column instead")
        base, parts = split_share(unit)
        factor, dimension = coherent(1.0, base)
        si = format_dimension(dimension)
        is_angle = si in ("", "1") and base not in ("", "1", "%")
        return ("rad" if is_angle else si or "1"), factor * parts
    for base in bases:
        try:
            if scale is not None:
                return base, scaled_unit_factor(scale, unit, base)
            return base, unit_factor(unit, base)
        except ValueError as error:
            problem = error
    raise ValueError(f"{name}.unit = '{unit}': {problem}; give a unit of {' or '.join(bases)}")


def load_model(folder: Path) -> tuple[ModelFile, type[Axis]]:
    """The model file in a `folder`, and its class.

    Raises
    ------
    InputError
        A file is missing or invalid; the message gives key and value.
    """
    file = folder / NAME if folder.is_dir() else folder
    if not file.is_file():
        raise InputError(f"{folder}: has no {NAME}; docs/how_to/own_model.md shows one")
    model = validate(ModelFile, read_yaml(file), str(file))
    model = model.model_copy(update={"folder": file.parent / model.folder})
    return model, load_class(file.parent / model.model)


def load_class(path: Path) -> type[Axis]:
    """The only class derived from `Axis` in a Python file."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; write the class of the model, or correct `model`")
    spec = importlib.util.spec_from_file_location(f"jointgap_model_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        line = getattr(error, "lineno", None)
        traceback = error.__traceback__
        while traceback is not None:
            if traceback.tb_frame.f_code.co_filename == str(path):
                line = traceback.tb_lineno
            traceback = traceback.tb_next
        where = f", line {line}" if line else ""
        raise InputError(f"{path}{where}: {type(error).__name__}: {error}") from error
    classes = [
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Axis) and value.__module__ == spec.name
    ]
    if len(classes) != 1:
        raise InputError(
            f"{path}: has {len(classes)} classes derived from jointgap.axis.Axis; write one"
        )
    return classes[0]
