"""A campaign file from the measured files alone: which column is which channel, its unit, and the
speeds of the runs.

Headings and units decide; time, crank angle and crank speed are also recognised by their values.
Every guess has its reason as a comment, and what the files do not contain has the value `FILL_IN`.
"""

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import isclose, tau
from pathlib import Path

import numpy as np
import yaml

from jointgap.config.campaign import RESERVED_IDS, UNITS
from jointgap.config.channels import CHANNELS, PRESSURES, ChannelKind, channel_kinds
from jointgap.config.load import load_mechanism
from jointgap.config.yaml_files import FILL_IN
from jointgap.core.csv_files import Csv, find_headings, read_columns
from jointgap.core.errors import InputError
from jointgap.core.files import write_text
from jointgap.core.section import word
from jointgap.core.sites import SLIDER_CRANK, Sites
from jointgap.core.units import counts_near, respelled, unit_factor
from jointgap.core.words import number
from jointgap.rig import checks

SAMPLE_NUMBERS = {"n", "nr", "no", "sample", "samples", "index"}
COUNTED = {"count", "counts", "pulses", "enc", "encoder"}
NO_CHANNEL = {"temperature", "temp", "power", "leistung", "state", "status", "flag", "event"}
"""Words of sample numbers, of an encoder's counts, and of quantities that are no channel."""

SIGNALS = {
    "A": {"current", "curr", "i", "strom"},
    "V": {"u", "volt", "volts", "voltage", "spannung"},
}
"""Units of a sensor's signal, and words that stand for them."""

USUAL_UNITS = (*CHANNELS.values(), *SIGNALS, "W", "K")
PERIODS = {"deg": (360.0, 720.0), "rad": (tau, 2 * tau), "turn": (1.0, 2.0)}
"""Values of an angle's unit in a turn, and in a four-stroke cycle."""

STROKES, SPEEDS = (8e-3, 1.4), (8.0, 20000.0)  # [m], [rpm] of usual cranks

# Headings

_fitting = lru_cache(respelled)
_KNOWN_WORDS = frozenset(
    word for kind in channel_kinds(SLIDER_CRANK).values() for word in kind.words.split()
)
_WITH_UNIT = re.compile(
    r"(.*?)\s*(?:[\[({<]\s*([^\])}>]*?)\s*[\])}>]|(?:\s/\s*|\s+in\s+|,\s*)(\S+))\s*"
)


def words_and_unit(heading: str) -> tuple[frozenset[str], str]:
    """Words of a heading in lower case, and its unit or '': ``Torque [Nm]``, ``M / Nm``,
    ``torque_Nm``, ``rpm``."""
    text = heading
    unit = ""
    parts = heading.split("_")
    match = _WITH_UNIT.fullmatch(heading)
    if match and respelled(match[2] or match[3] or ""):
        text = match[1]
        unit = match[2] or match[3]
    elif len(heading) > 1 and heading.lower() not in _KNOWN_WORDS:
        unit = heading if _is_usual_unit(heading) else ""
    for begin in () if unit else range(1, len(parts)):
        joined = (sign.join(parts[begin:]).replace("/per/", "/") for sign in ("/", "*"))
        if unit := next(filter(_is_usual_unit, joined), ""):
            text = " ".join(parts[:begin])
            break
    spaced = re.sub(r"(?<=[^\W\d_A-Z])(?=[A-Z][a-z])", " ", text)  # CrankAngle
    return frozenset(re.findall(r"[^\W\d_]+", spaced.lower())), unit


def _is_usual_unit(text: str) -> bool:
    return any(_fitting(text, unit) for unit in USUAL_UNITS)


def _matches(words: frozenset[str], table: frozenset[str]) -> float:
    """Number of `words` in the `table`, also as a part of a word; a single letter counts half."""
    matching = [
        text
        for text in words
        if any(entry == text or (len(entry) > 3 and entry in text) for entry in table)
    ]
    return sum(0.5 if len(text) == 1 else 1.0 for text in matching)


@dataclass(frozen=True, eq=False)
class Column:
    """A column of all runs."""

    heading: str
    words: frozenset[str]
    unit: str  # As written; '' without one
    values: tuple[np.ndarray, ...]  # By run
    kinds: Mapping[str, ChannelKind]  # Of the mechanism's channels

    def named(self, channel: str) -> float:
        """Number of words that fit a channel."""
        required = frozenset(self.kinds[channel].required_words.split())
        required_count = _matches(self.words, required)
        if required and not required_count:
            return 0.0
        return required_count + _matches(self.words, frozenset(self.kinds[channel].words.split()))

    def may_be(self, channel: str) -> bool:
        """Whether the unit fits, or no other channel fits the heading better by more than a
        letter."""
        best = max(map(self.named, self.kinds))
        return bool(self.unit_for(channel)) or (
            not self.unit and best <= max(self.named(channel), 0.5)
        )

    def unit_for(self, channel: str) -> str:
        """The written unit in a spelling that pint knows; '' if it does not fit the channel."""
        return _fitting(self.unit, self.kinds[channel].unit)

    @property
    def is_zero(self) -> bool:
        """Whether all values are 0, such as the torque of a motor that is off."""
        return not any(values.any() for values in self.values)

    @property
    def is_constant(self) -> bool:
        return any(
            np.isfinite(values).sum() < checks.MIN_SAMPLES or np.nanstd(values) == 0.0
            for values in self.values
        )

    @property
    def signal(self) -> str:
        """The unit of a sensor's signal; '' for a quantity."""
        units = (
            _fitting(self.unit, unit) or (not self.unit and self.words & words and unit)
            for unit, words in SIGNALS.items()
        )
        return next(filter(None, units), "")


# Files


@dataclass
class _Run:
    """Columns of numbers of a run, from its file or from those of several loggers."""

    files: list[Path]
    unread: list[str]  # Headings of columns of text, and of several columns
    values: dict[str, np.ndarray] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)  # From a row of units

    def add(self, second: "_Run") -> None:
        """Add the columns of a further logger, at the times of the first."""
        clock = next(name for name in second.values if name in self.values)
        self.files += second.files
        for name, values in second.values.items():
            if name not in self.values:
                times = self.values[clock], second.values[clock]
                self.values[name] = np.interp(*times, values)
        self.units |= second.units


def _read(path: Path) -> _Run:
    """The columns of a file without those that contain text."""
    headings = find_headings(path)
    unique = [heading for heading in headings if headings.count(heading) == 1]
    run = _Run([path], sorted({*headings} - {*unique}))
    try:
        columns = read_columns(path, unique, Csv())
        run.values, run.units = columns.values, columns.units
        return run
    except InputError as error:
        reason = error
    for heading in unique:
        try:
            column = read_columns(path, [heading], Csv(), clock=heading)
        except InputError:
            run.unread.append(heading)
            continue
        run.values |= column.values
        run.units |= {heading: "s"} if column.began is not None else column.units
    if not run.values:
        raise reason
    rows = min(map(len, run.values.values()))  # without a row of units, which some columns may lack
    run.values = {name: values[-rows:] for name, values in run.values.items()}
    return run


def read_runs(files: Sequence[Path]) -> list[_Run]:
    """The runs in `files`. A file with other headings than the first is joined to the run of the
    most similar name."""
    parts = [_read(path) for path in files]
    headings = {*parts[0].values}
    runs = [part for part in parts if part.values.keys() == headings]
    for part in [part for part in parts if part.values.keys() != headings]:
        stems = [[part.files[0].stem, run.files[0].stem] for run in runs]
        alike = [len(os.path.commonprefix(pair)) for pair in stems]  # noqa: RUF071
        if alike.count(max(alike)) > 1 or not part.values.keys() & headings:
            raise InputError(
                f"{part.files[0]}: has other headings than {files[0]}; give all runs the same"
                " headings, and the files of several loggers a common heading of the time and"
                " names that begin alike, such as slow.csv and slow_2.csv"
            )
        runs[np.argmax(alike)].add(part)
    if lacking := [run for run in runs if run.values.keys() != runs[0].values.keys()]:
        raise InputError(
            f"{lacking[0].files[0]}: its run lacks columns of others; give all files of each run"
        )
    return runs


# Values


def continued(values: np.ndarray) -> tuple[np.ndarray, float]:
    """An angle without gaps and without jumps back, and the size of these jumps or 0."""
    places = np.flatnonzero(np.isfinite(values))
    angle = values[places]
    jump = 0.0
    steps = np.diff(angle)
    back = np.abs(steps) > 0.5 * np.ptp(angle)
    if back.any() and not back.all():
        jump = np.median(np.abs(steps[back] - np.median(steps[~back])))
        angle = np.unwrap(angle, period=jump)
    return np.interp(np.arange(values.size), places, angle), jump


def progress(values: np.ndarray) -> float:
    """Change over the record as a share of all steps: 1 or -1 if values rise or fall throughout."""
    return (values[-1] - values[0]) / max(np.abs(np.diff(values)).sum(), 1e-300)


def evenness(values: np.ndarray) -> float:
    """1 for equal positive steps, 0 for uneven ones."""
    steps = np.diff(values[np.isfinite(values)])
    if not steps.size or steps.min() <= 0:
        return 0.0
    return max(0.0, 1.0 - np.std(steps) / np.mean(steps))


class Guesses:
    """What the columns of runs of a mechanism with such `kinds` of channels are."""

    def __init__(self, runs: Sequence[_Run], kinds: Mapping[str, ChannelKind]):
        self.runs, self.kinds = runs, kinds
        self.columns: dict[str, Column] = {}  # Not yet assigned
        self.unused = dict.fromkeys(runs[0].unread, "contains text, or is there twice")
        self.channels: dict[str, dict[str, object]] = {}  # Entries of the campaign file
        self.why: dict[str, str] = {}
        self.turned: list[np.ndarray] = []  # [turns] by run
        self.rates: list[float] = [0.0] * len(runs)  # [turns/s] signed; 0 if not known
        for heading in runs[0].values:
            words, unit = words_and_unit(heading)
            unit = unit or runs[0].units.get(heading, "").strip("- ")
            values = tuple(run.values[heading] for run in runs)
            column = Column(heading, words, unit, values, kinds)
            if column.is_constant and not (column.named("crank_torque") and column.is_zero):
                self.unused[heading] = "has one value or too few"
            else:
                self.columns[heading] = column
        if not self.columns:
            files = " and ".join(str(file) for run in runs for file in run.files)
            raise InputError(
                f"{files}: no column with {checks.MIN_SAMPLES} different numbers; give the record"
                " of a measurement"
            )
        self.time, self.angle = self._take("time"), self._take("crank_angle")
        if self.angle:
            self._assign_angle()
        if self.time:
            self._assign_time()
        self._assign_sensors()

    def _take(self, channel: str) -> Column | None:
        """The column that fits best, if any does."""
        best = max(
            self.columns.values(), key=lambda column: self._score(column, channel), default=None
        )
        if best is None or not self._score(best, channel):
            return None
        return self.columns.pop(best.heading)

    def _score(self, column: Column, channel: str) -> float:
        """How well heading, unit and values of a column fit a channel; 0 if they do not."""
        shape = self._shape(column, channel)
        are_numbers = bool(column.words & SAMPLE_NUMBERS)
        if channel == "time":
            if are_numbers and not column.unit and shape:
                return 0.1 * column.may_be(channel)  # where there are no times
            is_possible = shape and column.may_be(channel)
        elif channel == "crank_angle":
            is_counted = column.unit.lower() in COUNTED
            is_possible = column.may_be(channel) or is_counted
            is_possible = is_possible and shape > 0.5 and not are_numbers
        else:
            is_possible = column.unit_for(channel) or column.signal or not column.unit
            is_possible = is_possible and not column.words & NO_CHANNEL
        named = column.named(channel)
        score = 2.0 * named + shape
        if not is_possible or not score:
            return 0.0
        return score + 2.0 * bool(column.unit)

    def _shape(self, column: Column, channel: str) -> float:
        """How well the values fit time, crank angle or crank speed, or the unit another channel."""
        if channel == "time":
            return round(min(map(evenness, column.values)), 2)
        if channel == "crank_angle":
            return min(abs(progress(continued(values)[0])) for values in column.values)
        if channel == "crank_speed" and self._speed_unit(column):
            return 3.0
        return float(bool(column.unit_for(channel)) and not self.kinds[channel].required_words)

    def _assign(self, channel: str, column: Column, reasons: Sequence[str], **keys: object) -> None:
        self.channels[channel] = {"column": column.heading, **keys}
        reason = "; ".join(filter(None, reasons))
        self.why[channel] = f"guess: {reason}" if reason else "from the heading"

    # Angle, time, speed

    def _assign_angle(self) -> None:
        """The unit of the angle, from its jumps back, and `turned`."""
        column = self.angle
        unit = self.angle.unit_for("crank_angle")
        angles, jumps = zip(*map(continued, column.values), strict=True)
        size = float(np.median(jumps))
        is_whole = all((values[np.isfinite(values)] % 1 == 0).all() for values in column.values)
        bits = [bits for bits in (16, 24, 32) if isclose(size, 2**bits, rel_tol=1e-3)]
        if is_whole and bits:  # an overflow of the counter
            size = 0.0
        reasons = ["" if column.named("crank_angle") else "rises throughout"]
        reasons += ["" if unit or not size else f"starts again after {number(size)}"]
        fitting = [
            name
            for name, periods in PERIODS.items()
            if any(isclose(size, period, rel_tol=0.03) for period in periods)
        ]
        is_counted = is_whole and not unit and (not fitting or bool(column.words & COUNTED))
        if is_counted and (size or column.words & COUNTED):
            period = (counts_near(size) or round(size)) if size else 0.0
            reasons = [*reasons, "whole numbers"] if size else ["whole numbers"]
            self._assign("crank_angle", column, reasons, counts_per_turn=period or FILL_IN)
        else:
            if not unit and not fitting:
                reasons[1] = "no unit"
                fitting = [name for name in PERIODS if _samples_well(PERIODS[name][0], angles)]
            unit = unit or (fitting or [FILL_IN])[0]
            period = 0.0 if unit == FILL_IN else tau / unit_factor(unit, "rad")
            self._assign("crank_angle", column, reasons, unit=unit)
        self.turned = [angle / period for angle in angles] if period else []

    def _assign_time(self) -> None:
        """The unit of the time, and `rates`."""
        column = self.time
        unit = self.time.unit_for("time")
        if not unit and column.words & SAMPLE_NUMBERS:
            self._assign("time", column, ["sample numbers"], rate=FILL_IN)
            return
        times = [continued(values)[0] for values in column.values]
        rates = [
            (turns[-1] - turns[0]) / np.ptp(time)
            for turns, time in zip(self.turned, times, strict=False)
        ]
        reasons = ["" if column.named("time") or unit else "rises evenly"]
        if not unit:
            rpm = 60 * np.median(np.abs(rates or [0.0]))
            usual = [
                name
                for name in ("s", "ms", "us")
                if SPEEDS[0] < rpm / unit_factor(name, "s") < SPEEDS[1]
            ]
            unit = (usual or ["s"])[0]
            reasons += ["no unit", f"{unit} gives usual speeds" if usual else ""]
        self.rates = [rate / unit_factor(unit, "s") for rate in rates] or self.rates
        self._assign("time", column, reasons, unit=unit)

    @property
    def unsteady(self) -> str:
        """How the speed of a run varies, from its angle and time; '' if it does not, or they are
        not known."""
        if not (self.angle and any(self.rates)):
            return ""
        second = unit_factor(self.channels["time"]["unit"], "s")
        variations = (
            checks.unsteady(continued(time)[0] * second, np.sign(rate) * tau * turns)
            for turns, rate, time in zip(self.turned, self.rates, self.time.values, strict=True)
        )
        return next(filter(None, variations), "")

    # Other channels

    def _assign_sensors(self) -> None:
        """Assign the columns left to channels, those that fit best first."""
        scores = [
            (self._score(column, channel), channel, column)
            for column in self.columns.values()
            for channel in self.kinds.keys() - {"time", "crank_angle"}
        ]
        assigned: dict[str, Column] = {}
        for score, channel, column in sorted(scores, key=lambda entry: -entry[0]):
            if score >= 1.0 and channel not in assigned and column not in assigned.values():
                assigned[channel] = column
        # written units first, as they give the length of the crank
        for channel, column in sorted(assigned.items(), key=lambda entry: not entry[1].unit):
            self._assign_sensor(channel, column)
        for column in self.columns.values():
            if column not in assigned.values():
                self.unused[column.heading] = (
                    "is none of the channels, or it is not clear which one"
                )

    def _speed_unit(self, column: Column) -> str:
        """The unit in which a column is the speed of the crank; '' if there is none."""
        means = np.abs([np.nanmean(values) for values in column.values])
        spreads = np.array([np.nanstd(values) for values in column.values])
        if not all(self.rates) or np.any(means < 2 * spreads):
            return ""
        units = [column.unit_for("crank_speed")] if column.unit else UNITS["rad/s"]
        for unit in filter(None, units):
            turns = means * unit_factor(unit, "rad/s") / tau
            if np.allclose(turns, np.abs(self.rates), rtol=0.03):
                return unit
        return ""

    def _assign_sensor(self, channel: str, column: Column) -> None:
        base = self.kinds[channel].unit
        unit = column.unit_for(channel)
        keys = {}
        by = "its mean is the speed of the crank" if channel == "crank_speed" else "by its unit"
        reasons = ["" if column.named(channel) else by]
        if column.signal and not unit:
            reasons.append(f"the scale of the sensor, in {base}/{column.signal}")
            unit = column.signal
            keys = {"scale": FILL_IN}
        elif column.is_zero:
            reasons.append(
                "all values are 0, as of a motor that is off; the noise of the torque, such as"
                " 0.01 N*m"
            )
            unit = unit or base
            keys = {"noise": FILL_IN}
        elif channel in PRESSURES:
            reasons.append(
                "load on a piston of diameter bore; ambient_pressure: 0 bar if gauge, 1.013 bar if"
                " absolute"
            )
            unit = unit or FILL_IN
            keys = {"bore": FILL_IN, "ambient_pressure": FILL_IN}
        else:
            if column.unit.lower() == "g":
                reasons.append("g is the acceleration of gravity")
            if not unit:
                unit, reason = self._likely_unit(channel, column)
                reasons.append(reason)
        self._assign(channel, column, reasons, unit=unit, **keys)

    def _likely_unit(self, channel: str, column: Column) -> tuple[str, str]:
        """The unit with which a column gives the speed or a usual stroke, and the reason."""
        base = self.kinds[channel].unit
        if channel == "crank_speed" and (unit := self._speed_unit(column)):
            return unit, f"no unit; {unit} gives the speed by angle and time"
        if base == "m":
            ranges = [np.nanmax(values) - np.nanmin(values) for values in column.values]
            for unit in (base, *UNITS[base]):
                stroke = np.median(ranges) * unit_factor(unit, base)
                if STROKES[0] < stroke < STROKES[1]:
                    return unit, f"no unit; {unit} gives a stroke of {number(1e3 * stroke, 2)} mm"
        return base, f"no unit; {base} assumed"


def _samples_well(period: float, angles: Sequence[np.ndarray]) -> bool:
    """Whether the runs have at least a turn of this period, and six samples in it."""
    return all(
        abs(angle[-1] - angle[0]) > period > 6 * abs(np.median(np.diff(angle))) for angle in angles
    )


# Files to write


def new_rig(files: Sequence[Path], name: str = "rig", mechanism: str = "") -> str:
    """Write the campaign file ``NAME.yaml`` for measured files and, unless a `mechanism` is given
    by its path or name, the file ``NAME_mechanism.yaml`` of a slider-crank.

    Returns a summary. InputError if one of both exists, or a file cannot be read.
    """
    own = [] if mechanism else [f"{name}_mechanism"]
    campaign, *written = _new_files(name, *own)
    sites = load_mechanism(mechanism).sites if mechanism else SLIDER_CRANK
    guesses = Guesses(read_runs(files), channel_kinds(sites))
    lines = campaign_lines(guesses, name, mechanism or written[0].name, sites)
    text = "\n".join(lines) + "\n"
    write_text(campaign, text)
    for path in written:
        write_text(path, mechanism_text())
    gaps = f"; fill in what is marked {FILL_IN}" if FILL_IN in text else ""
    to_fill_in = "".join(f"\n{path}: fill in what is marked {FILL_IN}" for path in written)
    return (
        f"{campaign}: {len(guesses.runs)} runs, {len(guesses.channels)} channels; check the guesses"
        f" in the comments{gaps}{to_fill_in}\nthen: jointgap measure {campaign}; jointgap analyse"
        f" {campaign}"
    )


def new_mechanism(name: str = "mechanism") -> str:
    """Write the mechanism file ``NAME.yaml`` to fill in; returns a summary. InputError if it
    exists."""
    (path,) = _new_files(name)
    write_text(path, mechanism_text())
    return f"{path}: fill in what is marked {FILL_IN}"


def _new_files(*names: str) -> list[Path]:
    try:
        files = [Path(f"{word(name)}.yaml") for name in names]
    except ValueError as error:
        raise InputError(f"--name {names[0]}: {error}") from error
    if existing := [str(path) for path in files if path.exists()]:
        raise InputError(
            f"{' and '.join(existing)}: already there, and not replaced; move it, or give another"
            " --name"
        )
    return files


def mechanism_text() -> str:
    """A mechanism file to fill in."""
    return (Path(__file__).parents[1] / "data/new_mechanism.yaml").read_text(encoding="utf-8")


def campaign_lines(guesses: Guesses, name: str, mechanism: str, sites: Sites) -> Iterator[str]:
    """The lines of the campaign file."""
    yield "# Written by `jointgap new rig`. Check every guess. All keys: config/README.md"
    yield f"name: {name}"
    yield f"mechanism: {mechanism}"
    if varies := guesses.unsteady:
        yield f"drive: measured_angle   # guess: the speed varies {varies}"
    else:
        yield "drive: constant_speed   # guess: or measured_angle, if the speed varies"
    yield "runs:"
    yield from _run_lines(guesses)
    yield "channels:"
    for channel in guesses.kinds:
        if channel in guesses.channels:
            yield f"  {channel}: {_flow(guesses.channels[channel])}   # {guesses.why[channel]}"
    if not guesses.channels.keys() & {"time", "crank_angle"}:
        yield f"  time: {{column: {FILL_IN}, unit: {FILL_IN}}}   # no column rises evenly"
    for heading, why in guesses.unused.items():
        yield f"  # column {json.dumps(heading, ensure_ascii=False)} {why}"
    yield "nuisance:   # uncertain quantities, fitted within these bounds"
    for body in reversed(sites.bodies):
        if body != sites.crank:
            yield f"  {body}_mass: 5 %   # assumed"
    is_short = sites is SLIDER_CRANK
    if guesses.angle:
        place = "at the outer dead centre" if is_short else "where the crank's x axis is along +x"
        yield f"  # encoder_zero: 5 deg   # unless crank_angle is exactly 0 {place}"
    for body in sites.slides:
        if f"{body}_position" in guesses.channels:
            origin = "the crank pivot" if is_short else "the origin of its slide"
            known = f"from {origin}; give 1 mm if it is known so well"
            yield f"  {body}_position_zero: 1 m   # where the sensor reads 0, {known}"


def _run_lines(guesses: Guesses) -> Iterator[str]:
    """The runs by speed; the fastest one is held out."""
    order = np.argsort(np.abs(guesses.rates), kind="stable")
    ids = [*RESERVED_IDS]
    for place, run in enumerate(order):
        files = guesses.runs[run].files
        rate = guesses.rates[run]
        stem = re.sub(r"[^\w-]+", "_", files[0].stem)[:40]
        ids.append(f"{stem}_{place + 1}" if stem in ids else stem)
        paths = [os.path.relpath(file) for file in files]
        keys = {"id": ids[-1], "file": paths[0] if len(paths) == 1 else paths, "speed": FILL_IN}
        why = "speed: of the crank, such as 300 rpm"
        if rate:
            keys["speed"] = f"{number(60 * abs(rate))} rpm"
            why = "guess: speed by angle and time"
        keys["role"] = "split" if len(order) == 1 else "confirm" if run == order[-1] else "identify"
        if rate < 0.0:
            keys["direction"] = "clockwise"
            why = f"{why}; the angle falls"
        yield f"  - {_flow(keys)}   # {why}"


def _flow(keys: Mapping[str, object]) -> str:
    """A mapping in one line of YAML."""
    text = yaml.safe_dump(
        dict(keys), default_flow_style=True, sort_keys=False, width=10**6, allow_unicode=True
    )
    return text.strip()
