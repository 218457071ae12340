"""A campaign file from the measured files alone: which column is which channel, its unit, and the
speeds of the runs.

Headings and units decide where they say enough, otherwise the values do. Every guess has its reason
as a comment, and what the files do not contain has the value `FILL_IN`.
"""

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import degrees, isclose, log, tau
from pathlib import Path

import numpy as np
import yaml

from jointgap.config.campaign import CHANNELS, PRESSURES, RESERVED_IDS, UNITS
from jointgap.config.yaml_files import FILL_IN
from jointgap.core.csv_files import Csv, find_headings, read_columns
from jointgap.core.errors import InputError
from jointgap.core.files import write_text
from jointgap.core.section import word
from jointgap.core.units import counts_near, respelled, unit_factor
from jointgap.core.words import number
from jointgap.rig import checks
from jointgap.rig.sampling import speed_from_periodicity

WORDS = {
    "time": "t time zeit clock stamp elapsed temps n nr no sample samples index",
    "crank_angle": (
        "crank angle theta th phi alpha θ φ encoder enc count counts pulses winkel rotation"
        " position"
    ),
    "crank_speed": "crank speed omega ω w n drehzahl angular velocity rotational",
    "slider_position": "slider piston position pos x s weg stroke hub displacement travel lvdt",
    "slider_velocity": "slider piston velocity vel v speed geschwindigkeit",
    "slider_acceleration": "slider piston acceleration accel acc a g beschleunigung",
    "crank_torque": "crank torque trq tq moment m drehmoment current curr i strom",
    "rod_angle": "angle",
    "rod_angular_velocity": "angular velocity rate gyro",
    "rod_acceleration_x": "acceleration acc x",
    "rod_acceleration_y": "acceleration acc y",
    "guide_force": "force f",
    "frame_force_x": "force f x",
    "frame_force_y": "force f y",
    "cylinder_pressure": "cylinder pressure druck indicator",
    "crank_side_pressure": "pressure druck",
}
"""Words of headings, by channel; words of four letters or more also as a part of a word."""

REQUIRED = {
    "rod": "rod conrod pleuel",
    "guide": "guide normal side",
    "frame": "frame foundation base bearing",
}
REQUIRED["crank_side"] = "crankside rear rod"
"""Words of which the heading of a channel needs one, by the beginning of the channel's name."""

SAMPLE_NUMBERS = {"n", "nr", "no", "sample", "samples", "index"}
COUNTED = {"count", "counts", "pulses", "enc", "encoder"}
OTHER = {"temperature", "temp", "power", "leistung", "state", "status", "flag", "event"}
"""Words of sample numbers, of an encoder's counts, and of quantities that are no channel."""

SIGNALS = {
    "A": {"current", "curr", "i", "strom"},
    "V": {"u", "volt", "volts", "voltage", "spannung"},
}
"""Units of a sensor's signal, and words that stand for them."""

OTHER_UNITS = ("W", "K")
PERIODS = {"deg": (360.0, 720.0), "rad": (tau, 2 * tau), "turn": (1.0, 2.0)}
"""Values of an angle's unit in a turn, and in a four-stroke cycle."""

LENGTHS, SPEEDS = (4e-3, 0.7), (8.0, 20000.0)  # [m], [rpm] of usual cranks
KINEMATIC = (
    "slider_position",
    "slider_velocity",
    "slider_acceleration",
)  # In the order of the derivatives
SHAPES = {
    "crank_speed": "its mean is the speed of the crank",
    "slider_position": "once a turn, of one size at all speeds",
    "slider_velocity": "once a turn, grows with the speed",
    "slider_acceleration": "once a turn, grows with the square of the speed",
    "crank_torque": "repeats every turn",
}
"""What the values of a channel are like."""

# Headings


@dataclass(frozen=True, eq=False)
class Column:
    """A column of all runs."""

    heading: str
    words: frozenset[str]
    unit: str  # As written; '' if none is
    values: tuple[np.ndarray, ...]  # By run

    def named(self, channel: str) -> float:
        """Number of words that fit a channel; a single letter counts half."""
        required = next(
            (words for start, words in REQUIRED.items() if channel.startswith(start)), ""
        )
        needed = _matches(self.words, required)
        return needed + _matches(self.words, WORDS[channel]) if needed or not required else 0.0

    def may_be(self, channel: str) -> bool:
        """Whether no other channel fits the heading better by more than a letter, and the unit
        fits."""
        others = max(self.named(other) for other in CHANNELS)
        return bool(self.unit_for(channel)) or (
            not self.unit and others <= max(self.named(channel), 0.5)
        )

    def unit_for(self, channel: str) -> str:
        """The written unit in a spelling that pint knows; '' where it does not fit the channel, or
        is missing."""
        return _fitting(self.unit, CHANNELS[channel])

    @property
    def is_zero(self) -> bool:
        """Whether all values are 0, such as the torque of a motor that is off."""
        return not any(own.any() for own in self.values)

    @property
    def signal(self) -> str:
        """The unit of a sensor's signal; '' for a quantity."""
        for unit, words in SIGNALS.items():
            if found := _fitting(self.unit, unit) or (
                not self.unit and self.words & words and unit
            ):
                return found
        return ""


def _matches(words: frozenset[str], table: str) -> float:
    known = table.split()
    found = [
        own for own in words if any(one == own or (len(one) > 3 and one in own) for one in known)
    ]
    return sum(0.5 if len(own) == 1 else 1.0 for own in found)


_fitting = lru_cache(respelled)
_KNOWN = {own for words in WORDS.values() for own in words.split()}
_WITH_UNIT = re.compile(
    r"(.*?)\s*(?:[\[({<]\s*([^\])}>]*?)\s*[\])}>]|(?:\s/\s*|\s+in\s+|,\s*)(\S+))\s*"
)


def words_and_unit(heading: str) -> tuple[frozenset[str], str]:
    """Words of a heading in lower case, and its unit or '': ``Torque [Nm]``, ``M / Nm``,
    ``torque_Nm``, ``rpm``."""
    rest, unit, parts = heading, "", heading.split("_")
    if (found := _WITH_UNIT.fullmatch(heading)) and (respelled(found[2] or found[3] or "")):
        rest, unit = found[1], found[2] or found[3]
    elif len(heading) > 1 and heading.lower() not in _KNOWN and _is_usual_unit(heading):
        unit = heading
    for begin in () if unit else range(1, len(parts)):
        joined = (sign.join(parts[begin:]).replace("/per/", "/") for sign in ("/", "*"))
        if unit := next(filter(_is_usual_unit, joined), ""):
            rest = " ".join(parts[:begin])
            break
    spaced = re.sub(r"(?<=[^\W\d_A-Z])(?=[A-Z][a-z])", " ", rest)  # CrankAngle
    return frozenset(re.findall(r"[^\W\d_]+", spaced.lower())), unit


def _is_usual_unit(text: str) -> bool:
    return any(_fitting(text, base) for base in (*CHANNELS.values(), *SIGNALS, *OTHER_UNITS))


# Files


@dataclass
class _Run:
    """Columns of numbers of a run, from its file or from those of several loggers."""

    files: list[Path]
    values: dict[str, np.ndarray]
    units: dict[str, str]  # From a row of units
    unread: list[str]  # Headings of columns of text, and of several columns

    def add(self, other: "_Run") -> None:
        """Add the columns of a further logger, at the times of the first."""
        clock = next(name for name in other.values if name in self.values)
        self.files += other.files
        for name in [name for name in other.values if name not in self.values]:
            self.values[name] = np.interp(
                self.values[clock], other.values[clock], other.values[name]
            )
        self.units |= other.units


def _read(path: Path) -> _Run:
    """The columns of a file; those with text are left out."""
    headings = find_headings(path)
    once = [heading for heading in headings if headings.count(heading) == 1]
    try:
        columns = read_columns(path, once, Csv())
        return _Run([path], columns.values, columns.units, sorted({*headings} - {*once}))
    except InputError as error:
        why = error
    run = _Run([path], {}, {}, sorted({*headings} - {*once}))
    for heading in once:
        try:
            own = read_columns(path, [heading], Csv(), clock=heading)
        except InputError:
            run.unread.append(heading)
            continue
        run.values |= own.values
        run.units |= {heading: "s"} if own.began is not None else own.units
    if not run.values:
        raise why
    rows = min(map(len, run.values.values()))  # without a row of units, which some columns may lack
    run.values = {name: own[-rows:] for name, own in run.values.items()}
    return run


def read_runs(files: Sequence[Path]) -> list[_Run]:
    """The runs in `files`. A file with other headings than the first is joined to the run of the
    most similar name."""
    found = [_read(path) for path in files]
    headings = {*found[0].values}
    runs = [run for run in found if run.values.keys() == headings]
    for other in [run for run in found if run.values.keys() != headings]:
        alike = [_alike(other.files[0].stem, run.files[0].stem) for run in runs]
        if alike.count(max(alike)) > 1 or not other.values.keys() & headings:
            raise InputError(
                f"{other.files[0]}: has other headings than {files[0]}; give all runs the same"
                " headings, and the files of several loggers a common heading of the time and"
                " names that begin alike, such as slow.csv and slow_2.csv"
            )
        runs[int(np.argmax(alike))].add(other)
    if lacking := [run for run in runs if run.values.keys() != runs[0].values.keys()]:
        raise InputError(
            f"{lacking[0].files[0]}: its run lacks columns of others; give all files of each run"
        )
    return runs


def _alike(one: str, other: str) -> int:
    """Number of equal letters at the beginning."""
    return next(
        (n for n, (a, b) in enumerate(zip(one, other, strict=False)) if a != b),
        min(len(one), len(other)),
    )


# Values


def continued(values: np.ndarray) -> tuple[np.ndarray, float]:
    """An angle without gaps and without jumps back, and the size of these jumps; 0 if there are
    none."""
    finite = np.flatnonzero(np.isfinite(values))
    steps, jump = np.diff(values[finite]), 0.0
    back = np.abs(steps) > 0.5 * np.ptp(values[finite])
    whole = values[finite]
    if back.any() and not back.all():
        jump = float(np.median(np.abs(steps[back] - np.median(steps[~back]))))
        whole = np.unwrap(whole, period=jump)
    return np.interp(np.arange(values.size), finite, whole), jump


def progress(values: np.ndarray) -> float:
    """Change over the record as a share of all steps: 1 or -1 if values rise or fall throughout."""
    return float(values[-1] - values[0]) / max(float(np.abs(np.diff(values)).sum()), 1e-300)


def evenness(values: np.ndarray) -> float:
    """1 for equal positive steps, 0 for uneven ones."""
    steps = np.diff(values[np.isfinite(values)])
    return (
        max(0.0, 1.0 - float(np.std(steps) / np.mean(steps)))
        if steps.size and steps.min() > 0
        else 0.0
    )


def period_of(x: np.ndarray, values: Sequence[np.ndarray]) -> float:
    """The period in `x`, which rises or falls, at which all `values` repeat; 0 if there is none."""
    x, values = (
        np.maximum.accumulate(np.copysign(1.0, progress(x)) * x),
        [own for own in values if np.nanstd(own) > 0],
    )
    grid = np.linspace(x[0], x[-1], min(4 * x.size, 8192))
    alike = np.zeros(grid.size)
    for own in values:
        finite = np.isfinite(own)
        y = np.interp(grid, x[finite], own[finite])
        power = np.abs(np.fft.rfft((y - y.mean()) / max(y.std(), 1e-300), 2 * y.size)) ** 2
        alike += np.fft.irfft(power)[: y.size] / np.arange(y.size, 0, -1) / len(values)
    apart = np.flatnonzero(alike < 0.4)
    lags = np.arange(apart[0] + 1 if apart.size else grid.size, 2 * grid.size // 3)
    peaks = lags[(alike[lags] >= alike[lags - 1]) & (alike[lags] > alike[lags + 1])]
    best = alike[peaks].max(initial=0.0)
    if best < 0.5:
        return 0.0
    rough = float(grid[peaks[alike[peaks] > best - 0.1][0]] - grid[0])
    part, speed = x - x[0] < 20 * rough, tau / rough
    return tau / speed_from_periodicity(
        x[part] - x[0], [own[part] for own in values], 0.97 * speed, 1.03 * speed
    )


def orders_of(turns: np.ndarray, values: np.ndarray) -> np.ndarray | None:
    """Mean and four complex orders of `values`: Re sum c_k exp(2 pi i k turns); None if most of it
    does not repeat."""
    used = np.isfinite(values)
    turning = np.exp(1j * tau * np.outer(turns[used], np.arange(1, 5)))
    columns = np.column_stack([np.ones(used.sum()), turning.real, turning.imag])
    weights = np.linalg.lstsq(columns, values[used], rcond=None)[0]
    if columns.shape[0] < 20 or not np.var(values[used] - columns @ weights) < 0.6 * np.var(
        values[used]
    ):
        return None
    return np.append(weights[0], weights[1:5] - 1j * weights[5:])


class Guesses:
    """What the columns of runs are."""

    def __init__(self, runs: Sequence[_Run]):
        self.runs = runs
        self.columns: dict[str, Column] = {}  # Not yet assigned
        self.unused = dict.fromkeys(
            runs[0].unread, "contains text, or is there twice"
        )  # Why, by heading
        self.channels: dict[str, dict[str, object]] = {}  # Entries of the campaign file
        self.why: dict[str, str] = {}
        self.lengths: dict[str, float] = {}  # [m] of the crank, by channel
        self.zero: tuple[str, float] | None = (
            None  # Channel, and by it the angle [deg] read at the outer dead centre
        )
        self.turned: list[np.ndarray] = []  # [turns] by run
        self.rates: list[float] = [0.0] * len(runs)  # [turns/s] signed; 0 if not known
        for heading in runs[0].values:
            values = tuple(run.values[heading] for run in runs)
            words, unit = words_and_unit(heading)
            column = Column(
                heading, words, unit or runs[0].units.get(heading, "").strip("- "), values
            )
            constant = any(
                np.isfinite(own).sum() < checks.MIN_SAMPLES or np.nanstd(own) == 0.0
                for own in values
            )
            if constant and not (column.named("crank_torque") and column.is_zero):
                self.unused[heading] = "has one value or too few"
            else:
                self.columns[heading] = column
        if not self.columns:
            files = " and ".join(str(file) for run in runs for file in run.files)
            text = (
                f"no column with {checks.MIN_SAMPLES} different numbers; give the record of a"
                " measurement"
            )
            raise InputError(f"{files}: {text}")
        self.time, self.angle = self._take(self._as_time), self._take(self._as_angle)
        if self.angle:
            self._turn()
        elif self.time:
            self._repeat()
        if self.time:
            self._clock()
        self._others()

    def _take(self, merit) -> Column | None:
        best = max(self.columns.values(), key=merit, default=None)
        return self.columns.pop(best.heading) if best and merit(best) > 0.0 else None

    def _as_time(self, column: Column) -> float:
        even = round(min(map(evenness, column.values)), 2)
        merit = 2 * column.named("time") + 2 * bool(column.unit) + even
        if column.words & SAMPLE_NUMBERS and not column.unit:
            merit = 0.1  # where there are no times
        return merit if even and column.may_be("time") else 0.0

    def _as_angle(self, column: Column) -> float:
        turning = min(abs(progress(continued(own)[0])) for own in column.values)
        counted = column.unit.lower() in COUNTED
        possible = (column.may_be("crank_angle") or counted) and not column.words & SAMPLE_NUMBERS
        merit = 2 * column.named("crank_angle") + 2 * bool(column.unit)
        return merit + turning if turning > 0.5 and possible else 0.0

    def _state(self, channel: str, column: Column, reasons: Sequence[str], **keys: object) -> None:
        """Assign a column to a channel."""
        self.channels[channel] = {"column": column.heading, **keys}
        self.why[channel] = (
            f"guess: {'; '.join(filter(None, reasons))}" if any(reasons) else "from the heading"
        )

    # Angle, time, speed

    def _turn(self) -> None:
        """The unit of the angle, from its jumps back or from the period of the other columns, and
        `turned`."""
        column, unit = self.angle, self.angle.unit_for("crank_angle")
        angles, jumps = zip(*map(continued, column.values), strict=True)
        size, by = float(np.median(jumps)), "starts again after {}"
        counted = all((own[np.isfinite(own)] % 1 == 0).all() for own in column.values)
        overflows = counted and any(isclose(size, 2**bits, rel_tol=1e-3) for bits in (16, 24, 32))
        if not size or overflows:
            others = [
                [other.values[run] for other in self.columns.values()] for run in range(len(angles))
            ]
            found = [period_of(own, others[run]) for run, own in enumerate(angles) if others[run]]
            size, by = (
                float(np.median([one for one in found if one] or [0.0])),
                "the other columns repeat every {}",
            )
        reasons = [
            "" if column.named("crank_angle") else "rises throughout",
            "" if unit else by.format(number(size)),
        ]
        fits = [
            each
            for each, periods in PERIODS.items()
            if any(isclose(size, one, rel_tol=0.03) for one in periods)
        ]
        counted = counted and not unit and (not fits or bool(column.words & COUNTED))
        if counted and size:
            period = counts_near(size) or round(size)
            self._state("crank_angle", column, [*reasons, "whole numbers"], counts_per_turn=period)
        elif counted and column.words & COUNTED:
            period = 0.0
            self._state("crank_angle", column, ["whole numbers"], counts_per_turn=FILL_IN)
        else:
            if not unit and not fits:
                fits, reasons[1] = (
                    [each for each in PERIODS if self._samples_well(PERIODS[each][0], angles)],
                    "no unit",
                )
            unit = unit or (fits or [FILL_IN])[0]
            period = 0.0 if unit == FILL_IN else tau / unit_factor(unit, "rad")
            self._state("crank_angle", column, reasons, unit=unit)
        self.turned = [own / period for own in angles] if period else []

    def _samples_well(self, period: float, angles: Sequence[np.ndarray]) -> bool:
        """Whether the runs have at least a turn of this period, and six samples in it."""
        return all(
            abs(own[-1] - own[0]) > period > 6 * abs(np.median(np.diff(own))) for own in angles
        )

    def _repeat(self) -> None:
        """`turned` without an angle, from the period of the columns in time."""
        times = [continued(own)[0] for own in self.time.values]
        others = [
            [other.values[run] for other in self.columns.values()] for run in range(len(times))
        ]
        periods = [
            period_of(time, others[run]) if others[run] else 0.0 for run, time in enumerate(times)
        ]
        self.turned = (
            [time / one for time, one in zip(times, periods, strict=True)] if all(periods) else []
        )

    def _clock(self) -> None:
        """The unit of the time, and `rates`."""
        column, unit = self.time, self.time.unit_for("time")
        if not unit and column.words & SAMPLE_NUMBERS:
            return self._state("time", column, ["sample numbers"], rate=FILL_IN)
        times = [continued(own)[0] for own in column.values]
        rates = [
            float(np.ptp(own[[0, -1]]) / np.ptp(time)) * (1 if own[-1] > own[0] else -1)
            for own, time in zip(self.turned, times, strict=False)
        ]
        reasons = [
            "" if column.named("time") or unit else "rises evenly",
            "" if unit else "no unit",
        ]
        if not unit:
            rpm = 60 * float(np.median(np.abs(rates or [0.0])))
            usual = [
                one
                for one in ("s", "ms", "us")
                if SPEEDS[0] < rpm / unit_factor(one, "s") < SPEEDS[1]
            ]
            unit = (usual or ["s"])[0]
            reasons.append(f"{unit} gives usual speeds" if usual else "")
        self.rates = [rate / unit_factor(unit, "s") for rate in rates] or self.rates
        return self._state("time", column, reasons, unit=unit)

    @property
    def unsteady(self) -> str:
        """How the speed of a run varies, from its angle and time; '' if it does not, or they are
        not known."""
        if not (self.angle and any(self.rates)):
            return ""
        second = unit_factor(self.channels["time"]["unit"], "s")
        pairs = zip(self.turned, self.rates, self.time.values, strict=True)
        found = (
            checks.unsteady(continued(time)[0] * second, np.sign(rate) * tau * own)
            for own, rate, time in pairs
        )
        return next(filter(None, found), "")

    # Other channels

    def _others(self) -> None:
        """Assign the columns left to channels, those that fit best first."""
        scores = [
            (score, channel, column)
            for column in self.columns.values()
            for channel, score in self._scores(column).items()
        ]
        taken: dict[str, Column] = {}
        for _, channel, column in sorted(scores, key=lambda one: -one[0]):
            if channel not in taken and column not in taken.values():
                taken[channel] = column
        for channel, column in sorted(
            taken.items(), key=lambda one: not one[1].unit
        ):  # written units first
            self._add(channel, column)
        for column in self.columns.values():
            if column not in taken.values():
                self.unused[column.heading] = (
                    "is none of the channels, or it is not clear which one"
                )

    def _scores(self, column: Column) -> dict[str, float]:
        """How well a column fits each possible channel."""
        if column.words & OTHER:
            return {}
        shapes, scores = self._shapes(column), {}
        for channel in CHANNELS.keys() - {"time", "crank_angle"}:
            unit, named = column.unit_for(channel), column.named(channel)
            if (unit or column.signal or not column.unit) and (named or channel in shapes):
                scores[channel] = 2 * named + shapes.get(channel, 0.0) + bool(unit)
        return {channel: score for channel, score in scores.items() if score >= 1.0}

    def _orders(self, column: Column) -> list[np.ndarray]:
        """Orders of a column by run; [] where it does not repeat every turn in all runs."""
        found = [orders_of(*pair) for pair in zip(self.turned, column.values, strict=False)]
        return [] if any(own is None for own in found) else found

    def _shapes(self, column: Column) -> dict[str, float]:
        """Channels whose values are like those of a column: over a turn, and by the speed."""
        if column.unit_for("cylinder_pressure"):
            return {"cylinder_pressure": 1.0}
        if self._speed_unit(column):
            return {"crank_speed": 3.0}
        sizes = np.abs(np.array(self._orders(column)))
        if not sizes.size:
            return {}
        if np.median(sizes[:, 2] / sizes[:, 1]) > 0.6:
            return {"crank_torque": 1.5}
        mean, rates = float(np.median(sizes[:, 0] / sizes[:, 1])), np.abs(self.rates)
        power = 2.0 * (mean < 0.5)  # at one speed: only a position is far from 0
        if rates.max() > 1.15 * rates.min() > 0.0:
            power = float(np.polyfit(np.log(rates), np.log(sizes[:, 1:].sum(axis=1)), 1)[0])
        order = int(np.clip(round(power), 0, 2))
        return {KINEMATIC[order]: 1.5 - (mean if order else 0.0), "crank_torque": 1.0}

    def _speed_unit(self, column: Column) -> str:
        """The unit in which a column is the speed of the crank; '' if there is none."""
        means = np.array([np.nanmean(own) for own in column.values])
        if not all(self.rates) or np.any(
            np.abs(means) < 2 * np.array([np.nanstd(own) for own in column.values])
        ):
            return ""
        units = [column.unit_for("crank_speed")] if column.unit else UNITS["rad/s"]
        turns = {unit: np.abs(means) * unit_factor(unit, "rad/s") / tau for unit in units if unit}
        return next(
            (
                unit
                for unit, own in turns.items()
                if np.allclose(own, np.abs(self.rates), rtol=0.03)
            ),
            "",
        )

    def _add(self, channel: str, column: Column) -> None:
        base, unit = CHANNELS[channel], column.unit_for(channel)
        reasons = ["" if column.named(channel) else SHAPES.get(channel, "")]
        if column.signal and not unit:
            reasons.append(f"the scale of the sensor, in {base}/{column.signal}")
            self._dead_centre(channel, column)
            return self._state(channel, column, reasons, unit=column.signal, scale=FILL_IN)
        if column.is_zero:
            reasons.append(
                "all values are 0, as of a motor that is off; the noise of the torque, such as"
                " 0.01 N*m"
            )
            return self._state(channel, column, reasons, unit=unit or base, noise=FILL_IN)
        if channel in PRESSURES:
            reasons.append(
                "load on a piston of diameter bore; ambient_pressure: 0 bar if gauge, 1.013 bar if"
                " absolute"
            )
            return self._state(
                channel,
                column,
                reasons,
                unit=unit or FILL_IN,
                bore=FILL_IN,
                ambient_pressure=FILL_IN,
            )
        if column.unit.lower() == "g":
            reasons.append("g is the acceleration of gravity")
        if not unit:
            unit = self._speed_unit(column) if channel == "crank_speed" else ""
            lengths = {one: self._length(channel, column, one) for one in (base, *UNITS[base])}
            known = next(iter(self.lengths.values()), 0.0)
            if not unit and lengths[base]:
                usual = (one for one, length in lengths.items() if LENGTHS[0] < length < LENGTHS[1])
                unit = (
                    min(lengths, key=lambda one: abs(log(lengths[one] / known)))
                    if known
                    else next(usual, base)
                )
            unit = unit or base
            reasons.append(
                f"no unit; {unit} gives a crank of about {number(1e3 * lengths[unit], 2)} mm"
                if lengths[unit]
                else f"no unit; {unit} assumed"
            )
        self._state(channel, column, reasons, unit=unit)
        if length := self._length(channel, column, unit):
            self.lengths[channel] = length
            self._dead_centre(channel, column)
        return None

    def _length(self, channel: str, column: Column, unit: str) -> float:
        """The length [m] of a crank that moves the slider as a column in this `unit` says; 0 if it
        does not."""
        order = KINEMATIC.index(channel) if channel in KINEMATIC else None
        if order is None or (order and not all(self.rates)):
            return 0.0
        pairs = zip(self._orders(column), self.rates, strict=False)
        sizes = [abs(own[1]) / abs(tau * rate) ** order for own, rate in pairs]
        return float(np.median(sizes or [0.0])) * unit_factor(unit, CHANNELS[channel])

    def _dead_centre(self, channel: str, column: Column) -> None:
        """`zero` by a channel of the slider's motion."""
        if channel in KINEMATIC and self.angle and self.zero is None and min(self.rates) >= 0.0:
            phase = {"slider_position": 1, "slider_velocity": -1j, "slider_acceleration": -1}[
                channel
            ]
            self.zero = (
                channel,
                degrees(-np.angle(sum(own[1] for own in self._orders(column)) * phase)),
            )


# Files to write


def new_rig(files: Sequence[Path], name: str = "rig") -> str:
    """Write the campaign file ``NAME.yaml`` and the mechanism file ``NAME_mechanism.yaml`` for
    measured files.

    Returns a summary. InputError where one of both exists, or a file cannot be read.
    """
    campaign, mechanism = _absent(name, f"{name}_mechanism")
    guesses = Guesses(read_runs(files))
    text = "\n".join(campaign_lines(guesses, name, mechanism.name)) + "\n"
    write_text(campaign, text)
    write_text(mechanism, mechanism_text(guesses.lengths))
    also = f"; fill in what is marked {FILL_IN}" if FILL_IN in text else ""
    return (
        f"{campaign}: {len(guesses.runs)} runs, {len(guesses.channels)} channels; check the guesses"
        f" in the comments{also}\n{mechanism}: fill in what is marked {FILL_IN}\nthen: jointgap"
        f" measure {campaign}; jointgap analyse {campaign}"
    )


def new_mechanism(name: str = "mechanism") -> str:
    """Write the mechanism file ``NAME.yaml`` to fill in; returns a summary. InputError where it
    exists."""
    (path,) = _absent(name)
    write_text(path, mechanism_text())
    return f"{path}: fill in what is marked {FILL_IN}"


def _absent(*names: str) -> list[Path]:
    """The files with these names; InputError where one exists."""
    try:
        files = [Path(f"{word(name)}.yaml") for name in names]
    except ValueError as error:
        raise InputError(f"--name {names[0]}: {error}") from error
    if there := [str(path) for path in files if path.exists()]:
        raise InputError(
            f"{' and '.join(there)}: already there, and not replaced; move it, or give another"
            " --name"
        )
    return files


def mechanism_text(lengths: Mapping[str, float] | None = None) -> str:
    """A mechanism file to fill in; `lengths` are those of the crank by channel."""
    text = (Path(__file__).parents[1] / "data/new_mechanism.yaml").read_text(encoding="utf-8")
    for channel, length in list((lengths or {}).items())[:1]:
        text = text.replace("such as 40 mm", f"about {number(1e3 * length, 2)} mm by {channel}")
    return text


def campaign_lines(guesses: Guesses, name: str, mechanism: str) -> Iterator[str]:
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
    for channel in (one for one in CHANNELS if one in guesses.channels):
        keys = ", ".join(
            f"{key}: {_yaml(value)}" for key, value in guesses.channels[channel].items()
        )
        yield f"  {channel}: {{{keys}}}   # {guesses.why[channel]}"
    if not guesses.channels.keys() & {"time", "crank_angle"}:
        yield f"  time: {{column: {FILL_IN}, unit: {FILL_IN}}}   # no column rises evenly"
    for heading, why in guesses.unused.items():
        yield f"  # column {json.dumps(heading, ensure_ascii=False)} {why}"
    yield "nuisance:   # uncertain quantities, fitted within these bounds"
    yield "  slider_mass: 5 %   # assumed"
    yield "  rod_mass: 5 %   # assumed"
    if guesses.angle and guesses.zero and abs(guesses.zero[1]) < 3.0:
        yield (
            f"  # encoder_zero: 5 deg   # by {guesses.zero[0]}, crank_angle is 0 at the outer dead"
            " centre"
        )
    elif guesses.angle and guesses.zero:
        reads = (
            f"by {guesses.zero[0]}, crank_angle is {guesses.zero[1]:.0f} deg at the outer dead"
            " centre"
        )
        yield f"  encoder_zero: 180 deg   # guess: {reads}"
    elif guesses.angle and len(guesses.runs[0].files) > 1:
        yield (
            "  # encoder_zero: 180 deg   # the fitted offset of the clocks includes it, so it"
            " cannot be fitted too"
        )
    elif guesses.angle:
        yield (
            "  encoder_zero: 180 deg   # assumed; reduce it if crank_angle is known to be 0 at the"
            " outer dead centre"
        )
    if "slider_position" in guesses.channels:
        yield (
            "  slider_position_zero: 1 m   # assumed; reduce it if it is the distance from the"
            " crank pivot"
        )


def _run_lines(guesses: Guesses) -> Iterator[str]:
    """The runs by speed; the fastest one is held out."""
    order, ids = np.argsort(np.abs(guesses.rates), kind="stable"), []
    for place, run in enumerate(order):
        files, rate = guesses.runs[run].files, guesses.rates[run]
        own = re.sub(r"[^\w-]+", "_", files[0].stem)[:40]
        ids.append(f"{own}_{place + 1}" if own in (*ids, *RESERVED_IDS) else own)
        paths = [_yaml(os.path.relpath(file)) for file in files]
        keys = {
            "id": _yaml(ids[-1]),
            "file": paths[0] if len(paths) == 1 else f"[{', '.join(paths)}]",
        }
        keys["speed"] = f"{number(60 * abs(rate))} rpm" if rate else FILL_IN
        keys["role"] = "split" if len(order) == 1 else "confirm" if run == order[-1] else "identify"
        why = "speed: of the crank, such as 300 rpm"
        if rate:
            why = (
                "guess: speed by angle and time"
                if guesses.angle
                else "guess: speed by the period of the columns"
            )
        if rate < 0.0:
            keys["direction"], why = "clockwise", f"{why}; the angle falls"
        yield f"  - {{{', '.join(f'{key}: {value}' for key, value in keys.items())}}}   # {why}"


def _yaml(value: object) -> str:
    """`value` in YAML, with quotation marks where it needs them."""
    text = str(value)
    plain = re.fullmatch(r"[^\W\d]([\w./^*°² -]*[\w²])?", text) and text.lower() not in (
        "yes",
        "no",
        "on",
        "off",
    )
    if not isinstance(value, str) or (plain and yaml.safe_load(text) == text):
        return text
    return json.dumps(text, ensure_ascii=False)
