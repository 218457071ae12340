"""A campaign file from the measured files alone: which column is which channel, its unit, and the speeds of the runs.

Headings and units decide where they say enough, otherwise the shape of the values. Every guess has its reason as a
comment, and what cannot be guessed has the value `FILL_IN`.
"""

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import degrees, isclose, log, tau
from pathlib import Path

import numpy as np
import yaml

from jointgap.config.campaign import CHANNELS, RESERVED_IDS, UNITS
from jointgap.config.yaml_files import FILL_IN
from jointgap.core.csv_files import Columns, Csv, find_headings, read_columns
from jointgap.core.errors import InputError
from jointgap.core.files import write_text
from jointgap.core.section import word
from jointgap.core.units import respelled, unit_factor
from jointgap.core.words import number
from jointgap.rig import checks
from jointgap.rig.sampling import speed_from_periodicity

WORDS = {
    "time": "t time zeit clock stamp elapsed temps n nr no sample samples index",
    "crank_angle": "crank angle theta th phi alpha θ φ encoder enc count counts pulses winkel rotation position",
    "crank_speed": "crank speed omega ω w n drehzahl angular velocity rotational",
    "slider_position": "slider piston position pos x s weg stroke hub displacement travel lvdt",
    "slider_velocity": "slider piston velocity vel v speed geschwindigkeit",
    "slider_acceleration": "slider piston acceleration accel acc a g beschleunigung",
    "crank_torque": "crank torque trq tq moment m drehmoment current curr i strom",
    "rod_angle": "angle",
    "rod_angular_velocity": "angular velocity rate gyro",
    "rod_acceleration_x": "acceleration acc x",
    "rod_acceleration_y": "acceleration acc y",
    "guide_force": "force f guide",
    "frame_force_x": "force f frame x",
    "frame_force_y": "force f frame y",
}
"""Words of headings, by channel; words of four letters or more also as parts of a word."""

REQUIRED = {"rod": "rod conrod pleuel", "guide": "guide normal side", "frame": "frame foundation base bearing"}
"""Words of which the heading of a channel needs one, by the beginning of the channel's name."""

OTHER_WORDS = set("pressure druck temperature temp power leistung state status flag event".split())
OTHER_UNITS = ("Pa", "W", "K")
"""Words and units of quantities that are no channel."""

SAMPLE_NUMBERS = {"n", "nr", "no", "sample", "samples", "index"}
COUNTED = {"count", "counts", "pulses", "enc", "encoder"}
SIGNALS = {"A": "a ma current curr i strom", "V": "v mv u volt volts voltage spannung"}
"""Units of a sensor's signal that needs a factor, with words that stand for them."""

COUNTS = sorted({lines * edges for edges in (1, 2, 4) for lines in (
    100, 128, 180, 200, 250, 256, 300, 360, 400, 500, 512, 600, 720, 900, 1000, 1024, 1080, 1200, 1250, 1440, 1500,
    1800, 2000, 2048, 2500, 3600, 4096, 5000, 8192, 10000, 16384)})  # fmt: skip
"""Usual counts of encoders per turn."""

PERIODS = {"deg": (360.0, 720.0), "rad": (tau, 2 * tau), "turn": (1.0, 2.0)}
"""Period of an angle by its unit, of a crank and of a four-stroke cycle."""

LENGTHS = (4e-3, 0.7)  # [m] Of usual cranks
SPEEDS = (8.0, 20000.0)  # [rpm] Usual
KINEMATIC = ("slider_position", "slider_velocity", "slider_acceleration")  # In order of their derivatives

MECHANISM = f"""\
# Written by `jointgap new`. Replace every {FILL_IN} by a value with its unit; all keys: config/README.md
crank:
  length: {FILL_IN}   # between its joints, such as 40 mm%(length)s
  mass: {FILL_IN}   # such as 0.8 kg
  inertia: {FILL_IN}   # about its mass centre, such as 5e-4 kg*m^2
  mass_centre: {FILL_IN}   # from the pivot towards the crank pin, such as 12 mm; negative: beyond the pivot
rod:
  length: {FILL_IN}   # between its joints, such as 150 mm
  mass: {FILL_IN}
  inertia: {FILL_IN}   # about its mass centre
  mass_centre: {FILL_IN}   # from the crank pin towards the piston pin
slider:
  mass: {FILL_IN}
  offset: 0 mm   # assumed: the slide points at the crank pivot; otherwise its distance from there
joints: {{crank_pivot: ideal, crank_pin: ideal, piston_pin: ideal}}   # assumed: no clearance is known
gravity_direction: {FILL_IN}   # from the slide's direction (pivot to slider): -90 deg if it is horizontal, 180 deg if the
                             # slider moves above the crank. If the mechanism lies flat, remove this and the next line
effects: [{{name: gravity}}]   # with all other loads that you know (`jointgap effects`)
"""


@dataclass
class _File:
    path: Path
    columns: Columns


@dataclass
class _Column:
    """A column of all runs."""

    heading: str
    words: frozenset[str]
    unit: str  # As written, '' if none is
    values: list[np.ndarray]  # By run

    def named(self, channel: str) -> float:
        """Number of words that fit a channel; a single letter counts half."""
        required = REQUIRED.get(channel.partition("_")[0], "")
        found = _common(self.words, required)
        if required and not found:
            return 0.0
        return found + _common(self.words, WORDS[channel])

    def unit_for(self, channel: str) -> str | None:
        """The written unit in the spelling of pint, '' where none is written; None where it does not fit."""
        return (fitting_unit(self.unit, CHANNELS[channel]) or None) if self.unit else ""

    @cached_property
    def _names(self) -> dict[str, float]:
        return {channel: self.named(channel) for channel in CHANNELS}

    def may_be(self, channel: str) -> bool:
        """Whether no other channel fits the heading better, by more than a letter."""
        return max(self._names.values()) < max(self._names[channel], 0.5) + 0.1

    @property
    def signal(self) -> str:
        """The unit of a sensor's signal, '' for a quantity."""
        for unit, words in SIGNALS.items():
            if self.unit and _converts(self.unit, unit):
                return self.unit
            if not self.unit and self.words & set(words.split()) and not self.words & {"v", "a"}:
                return unit
        return ""


def _common(words: frozenset[str], table: str) -> float:
    known = table.split()
    found = [word for word in words if any(one == word or (len(one) > 3 and one in word) for one in known)]
    return sum(0.5 if len(word) == 1 else 1.0 for word in found)


@lru_cache(1000)
def fitting_unit(written: str, base: str) -> str:
    """`written` in a spelling that pint knows, where it converts to the SI unit `base`; '' otherwise."""
    return written if _converts(written, base) else respelled(written, base)


def _converts(unit: str, base: str) -> bool:
    try:
        return unit_factor(unit, base) > 0
    except Exception:  # pint raises a dozen kinds
        return False


_KNOWN = {word for words in WORDS.values() for word in words.split()}
_IN_BRACKETS = re.compile(r"^(.*?)\s*(?:[\[({<]\s*([^\])}>]*?)\s*[\])}>]|(?:\s/\s*|\s+in\s+|,\s*)(\S+))\s*$")


def words_and_unit(heading: str) -> tuple[frozenset[str], str]:
    """Words of a heading in lower case, and the unit in it, '' if none: ``Torque [Nm]``, ``M / Nm``, ``torque_Nm``."""
    rest, unit = heading, ""
    if (found := _IN_BRACKETS.match(heading)) and _is_unit(found[2] or found[3] or ""):
        rest, unit = found[1], found[2] or found[3]
    elif len(heading) > 1 and heading.lower() not in _KNOWN and _is_quantity(heading):
        rest, unit = heading, heading
    else:
        parts = heading.split("_")
        for begin in range(1, len(parts)):
            joined = (sign.join(parts[begin:]).replace("/per/", "/") for sign in ("/", "*"))
            if unit := next((text for text in joined if _is_quantity(text)), ""):
                rest = " ".join(parts[:begin])
                break
    spaced = re.sub(r"(?<=[^\W\d_A-Z])(?=[A-Z][a-z])", " ", rest)
    return frozenset(re.findall(r"[^\W\d_]+", spaced.lower())), unit


def _is_quantity(text: str) -> bool:
    return any(fitting_unit(text, base) for base in (*CHANNELS.values(), *SIGNALS, *OTHER_UNITS))


def _is_unit(text: str) -> bool:
    return bool(text) and (_is_quantity(text) or _converts(text, text))


# Files


def _read(path: Path) -> _File:
    """All columns of numbers of a file."""
    headings = find_headings(path)
    once = [heading for heading in headings if headings.count(heading) == 1]
    try:
        return _File(path, read_columns(path, once, Csv()))
    except InputError as error:  # dates, or texts in a column
        values, units, why = {}, {}, error
    for heading in once:
        try:
            own = read_columns(path, [heading], Csv(), heading)
        except InputError as error:
            why = error
            continue
        values |= own.values
        units |= own.units or ({heading: "s"} if own.is_dated else {})
    if not values:
        raise why
    rows = min(map(len, values.values()))
    return _File(path, Columns({name: own[-rows:] for name, own in values.items()}, np.arange(rows), units))


def _runs_of(files: Sequence[_File]) -> list[list[_File]]:
    """The files of each run: one, or where headings differ (several loggers) those with the most similar names."""
    first = files[0].columns.values.keys()
    runs = [[file] for file in files if file.columns.values.keys() == first]
    for file in (file for file in files if file.columns.values.keys() != first):
        alike = [len(os.path.commonprefix([file.path.stem, run[0].path.stem])) for run in runs]
        if alike.count(max(alike)) > 1:
            raise InputError(
                f"{file.path}: has other headings than {files[0].path}, and its name does not tell its run; give all "
                "files the same headings, or the files of a run names that begin alike, such as slow.csv and slow_2.csv"
            )
        runs[int(np.argmax(alike))].append(file)
    return runs


def _in_run(run: Sequence[_File], heading: str) -> _File | None:
    return next((file for file in run if heading in file.columns.values), None)


# Shapes


def unwrapped(values: np.ndarray) -> tuple[np.ndarray, float]:
    """An angle continued over its jumps back, and the size of the jumps; 0 where it runs on."""
    finite = np.isfinite(values)
    steps = np.diff(values[finite])
    jumps = np.abs(steps) > 0.5 * np.ptp(values[finite])
    period = 0.0
    if jumps.any() and steps.size > 2:
        usual = float(np.median(steps[~jumps])) if (~jumps).any() else 0.0
        period = float(np.median(np.abs(steps[jumps] - usual)))
        values = values.copy()
        values[finite] = np.unwrap(values[finite], period=period)
    return values, period


def _progress(values: np.ndarray) -> float:
    """Change over the record, relative to the sum of all steps: 1 for values that rise or fall throughout."""
    finite = values[np.isfinite(values)]
    return float(finite[-1] - finite[0]) / max(float(np.abs(np.diff(finite)).sum()), 1e-300) if finite.size > 2 else 0.0


def _evenness(values: np.ndarray) -> float:
    """1 for equal positive steps, 0 for steps that scatter by their mean or do not all rise."""
    steps = np.diff(values[np.isfinite(values)])
    return max(0.0, 1.0 - float(np.std(steps) / np.mean(steps))) if steps.size and steps.min() > 0 else 0.0


def period_of(x: np.ndarray, values: Sequence[np.ndarray]) -> float:
    """The period, in rising `x`, at which all `values` repeat; 0 if there is none."""
    grid = np.linspace(x[0], x[-1], min(4 * x.size, 8192))
    total, count = np.zeros(grid.size), 0
    for own in values:
        finite = np.isfinite(own)
        y = np.interp(grid, x[finite], own[finite])
        y = y - y.mean()
        if y.any():
            power = np.abs(np.fft.rfft(y / y.std(), 2 * y.size)) ** 2
            total, count = total + np.fft.irfft(power)[: y.size] / np.arange(y.size, 0, -1), count + 1
    alike = total[: 2 * grid.size // 3] / max(count, 1)
    falls = np.flatnonzero(alike < 0.4)
    if not falls.size:
        return 0.0
    inside = np.arange(max(int(falls[0]), 1), alike.size - 1)
    peaks = inside[(alike[inside] >= alike[inside - 1]) & (alike[inside] > alike[inside + 1])]
    best = alike[peaks].max(initial=0.0)
    if best < 0.5:
        return 0.0
    rough = float(grid[peaks[alike[peaks] > best - 0.1][0]] - grid[0])
    part = x - x[0] < 20 * rough
    speed = speed_from_periodicity(
        x[part] - x[0], [own[part] for own in values], 0.97 * tau / rough, 1.03 * tau / rough
    )
    return tau / speed


def orders_of(turns: np.ndarray, values: np.ndarray, count: int = 4) -> np.ndarray | None:
    """Mean and complex orders of `values` over `turns`: Re sum c_k exp(2 pi i k turns); None if they do not repeat."""
    used = np.isfinite(turns) & np.isfinite(values)
    turning = np.exp(1j * tau * np.outer(turns[used], np.arange(1, count + 1)))
    columns = np.column_stack([np.ones(used.sum()), turning.real, turning.imag])
    if columns.shape[0] < 2 * columns.shape[1]:
        return None
    weights = np.linalg.lstsq(columns, values[used], rcond=None)[0]
    residual = values[used] - columns @ weights
    if not np.var(residual) < 0.6 * np.var(values[used]):
        return None
    return np.append(weights[0], weights[1 : count + 1] - 1j * weights[count + 1 :])


class _Guesses:
    """What the columns of the runs are."""

    def __init__(self, runs: Sequence[Sequence[_File]]):
        self.runs = runs
        headings = dict.fromkeys(name for run in runs for file in run for name in file.columns.values)
        self.columns, self.unused = {}, {}
        for heading in headings:
            if any(_in_run(run, heading) is None for run in runs):
                self.unused[heading] = "is not in every run"
                continue
            values = [_in_run(run, heading).columns.values[heading] for run in runs]
            words, unit = words_and_unit(heading)
            unit = unit or _in_run(runs[0], heading).columns.units.get(heading, "").strip(" -")
            if all(np.isfinite(own).sum() < checks.MIN_SAMPLES or np.nanstd(own) == 0.0 for own in values):
                self.unused[heading] = "does not vary"
            else:
                self.columns[heading] = _Column(heading, words, unit, values)
        self.channels: dict[str, dict[str, object]] = {}  # Keys of the channels' entries
        self.why: dict[str, str] = {}
        self.radius: dict[str, float] = {}  # [m] of the crank, by channel
        self.zero = None  # [deg] read at the outer dead centre
        self.time = self._choose("time", self._as_time)
        self.angle = self._choose("crank_angle", self._as_angle)
        self._angles()
        self._speeds()
        self._others()

    def _choose(self, channel: str, merit) -> _Column | None:
        free = [column for column in self.columns.values() if column.unit_for(channel) is not None or (
            channel == "crank_angle" and column.unit.lower() in ("count", "counts"))]  # fmt: skip
        best = max(free, key=merit, default=None)
        if best is None or merit(best) <= 0.0:
            return None
        del self.columns[best.heading]
        return best

    def _as_time(self, column: _Column) -> float:
        even = min(map(_evenness, column.values))
        dated = bool(column.unit)
        if not even or not (dated or column.may_be("time")):
            return 0.0
        return 2 * column.named("time") + 2 * dated + round(even, 2) - 0.5 * bool(column.words & SAMPLE_NUMBERS)

    def _as_angle(self, column: _Column) -> float:
        turning = min(abs(_progress(unwrapped(own)[0])) for own in column.values)
        if turning < 0.5 or not (column.unit or column.may_be("crank_angle")) or column.words & SAMPLE_NUMBERS:
            return 0.0
        return 2 * column.named("crank_angle") + 2 * bool(column.unit) + turning

    # Angle and speed

    def _at(self, column: _Column, run: int, values: Sequence[np.ndarray] | None = None) -> np.ndarray:
        """The `values` of the angle (or of time, without an angle) of a run at the samples of a column."""
        reference = self.angle or self.time
        values = reference.values if values is None else values
        file, own = (_in_run(self.runs[run], one.heading) for one in (reference, column))
        if file is own or self.time is None:
            return values[run]
        clock, at = (one.columns.values[self.time.heading] for one in (own, file))
        finite = np.isfinite(values[run]) & np.isfinite(at)
        return np.interp(clock, at[finite], values[run][finite], left=np.nan, right=np.nan)

    def _angles(self) -> None:
        """`turned`: the angle of each run in turns, and what unit follows."""
        reference = self.angle or self.time
        self.turned: list[np.ndarray] = []
        self.period = 0.0
        if reference is None:
            return
        continued, jump = list(reference.values), 0.0
        if self.angle:
            pairs = [unwrapped(own) for own in reference.values]
            continued, jump = [pair[0] for pair in pairs], float(np.median([pair[1] for pair in pairs]))
        whole = self.angle is not None and all((own[np.isfinite(own)] % 1 == 0).all() for own in reference.values)
        overflow = whole and any(isclose(jump, 2**bits, rel_tol=1e-3) for bits in (16, 24, 32))
        found = []
        for run in range(len(self.runs)):
            others = [(self._at(own, run, continued), own.values[run]) for own in self.columns.values()]
            others = [(x, y) for x, y in others if x.size == others[0][0].size]
            x = others[0][0] if others else np.empty(0)
            sign = -1.0 if x.size and _progress(x) < 0 else 1.0
            rising = np.isfinite(x)
            if rising.sum() > 20:
                x = np.maximum.accumulate(sign * x[rising]) + 1e-12 * np.arange(rising.sum())
                found.append(period_of(x, [y[rising] for _, y in others if not _constant(y)]))
        if self.angle is None:
            self.periods = found
            self.turned = [own / period if period else np.full(own.size, np.nan)
                           for own, period in zip(continued, found, strict=False)]  # fmt: skip
            self._entry("time", self.time)
            return
        repeats = float(np.median([one for one in found if one])) if any(found) else 0.0
        wraps = jump if jump and not overflow else 0.0
        self._angle_unit(wraps, repeats, whole)
        self.turned = [own / self.period if self.period else np.full(own.size, np.nan) for own in continued]

    def _angle_unit(self, wraps: float, repeats: float, whole: bool) -> None:
        """The unit of the angle from its jumps back, or from the period of the other columns."""
        column, entry = self.angle, {"column": self.angle.heading}
        unit = column.unit_for("crank_angle")
        size, by = (wraps, f"it returns to its start after {number(wraps)}") if wraps else (
            repeats, f"the other columns repeat every {number(repeats)}")  # fmt: skip
        known = {each: period for each, periods in PERIODS.items() for period in periods}
        fits = next((each for each, periods in PERIODS.items() for period in periods
                     if size and isclose(size, period, rel_tol=0.03)), "")  # fmt: skip
        reasons = [] if column.named("crank_angle") else ["rises throughout"]
        if unit:
            self.period = tau / unit_factor(unit, "rad")
            entry["unit"] = unit
        elif fits and not (whole and column.words & COUNTED):
            self.period, entry["unit"] = PERIODS[fits][0], fits
            reasons.append(by)
        elif whole and size:
            counts = min(COUNTS, key=lambda usual: abs(log(usual / size)))
            if not isclose(counts, size, rel_tol=6e-3):
                counts = round(size)
            self.period, entry["counts_per_turn"] = float(counts), counts
            reasons.append(f"whole numbers; {by}")
        elif whole and column.words & COUNTED:
            entry["counts_per_turn"] = FILL_IN
            reasons.append("whole numbers, such as counts of an encoder")
        else:
            entry["unit"] = next((each for each in known if self._is_sampled(known[each])), FILL_IN)
            self.period = PERIODS[entry["unit"]][0] if entry["unit"] != FILL_IN else 0.0
            reasons.append("no unit given")
        self.channels["crank_angle"] = entry
        self.why["crank_angle"] = _because(reasons)

    def _is_sampled(self, period: float) -> bool:
        """Whether the record has at least one turn of this period, and at least six samples in it."""
        steps = [np.diff(own[np.isfinite(own)]) for own in self.angle.values]
        return all(abs(own.sum()) > period > 6 * abs(np.median(own)) for own in steps)

    def _speeds(self) -> None:
        """Mean speed of each run [turns/s], signed, and the unit of time."""
        self.rates: list[float | None] = [None] * len(self.runs)
        if self.time is None:
            return
        unit = self.time.unit_for("time")
        if not unit and self.time.words & SAMPLE_NUMBERS:
            self._entry("time", self.time, rate=FILL_IN)
            self.why["time"] = _because(["sample numbers"])
            return
        per_unit = []
        for run, turned in enumerate(self.turned):
            clock = _in_run(self.runs[run], (self.angle or self.time).heading).columns.values[self.time.heading]
            ends = np.flatnonzero(np.isfinite(turned) & np.isfinite(clock))
            ends = ends[[0, -1]] if ends.size > 1 else None
            per_unit.append(None if ends is None else np.diff(turned[ends])[0] / np.diff(clock[ends])[0])
        known = [abs(one) for one in per_unit if one]
        reasons = [] if self.time.named("time") or unit else ["rises evenly"]
        if not unit:
            usual = [each for each in ("s", "ms", "us") if known
                     and SPEEDS[0] < 60 * np.median(known) / unit_factor(each, "s") < SPEEDS[1]]  # fmt: skip
            unit = usual[0] if usual else "s"
            speed = f"; in {unit}, the speeds are usual" if usual else ""
            reasons.append(f"no unit given{speed}")
        self._entry("time", self.time, unit=unit)
        self.why["time"] = _because(reasons)
        self.rates = [one and float(one) / unit_factor(unit, "s") for one in per_unit]

    def _entry(self, channel: str, column: _Column, **keys: object) -> None:
        self.channels[channel] = {"column": column.heading, **keys}

    # Other channels

    def _others(self) -> None:
        found = {name: self._scores(column) for name, column in self.columns.items()}
        listed = sorted(((score, channel, name) for name, own in found.items() for channel, score in own.items()),
                        key=lambda one: -one[0])  # fmt: skip
        taken = {}
        for _, channel, name in listed:
            if channel not in taken and name not in taken.values():
                taken[channel] = name
        for channel in sorted(taken, key=lambda one: (not self.columns[taken[one]].unit, list(CHANNELS).index(one))):
            self._add(channel, self.columns[taken[channel]])
        for name, column in self.columns.items():
            if name not in taken.values():
                unit = f" [{column.unit}]" if column.unit else ""
                self.unused[name] = f"{unit[1:]} is none of the channels, or which one is not clear".strip()
        self._zero()

    def _orders(self, column: _Column) -> list[np.ndarray | None]:
        return [orders_of(self._at(column, run, self.turned), own) if self.turned else None
                for run, own in enumerate(column.values)]  # fmt: skip

    def _scores(self, column: _Column) -> dict[str, float]:
        """How well a column fits each channel."""
        if column.words & OTHER_WORDS:
            return {}
        shapes, scores = self._shapes(column), {}
        for channel in CHANNELS.keys() - {"time", "crank_angle"}:
            unit, named = column.unit_for(channel), column.named(channel)
            if unit is None and not column.signal:
                continue
            score = 2 * named + shapes.get(channel, 0.0) + (1.0 if unit else 0.0)
            if score >= 1.0 and (named or channel in shapes) and shapes.get(channel, 0.0) > -1.0:
                scores[channel] = score
        return scores

    def _shapes(self, column: _Column) -> dict[str, float]:
        """Channels whose values vary like a column's: over a turn, and with the speed."""
        if any(rate is not None for rate in self.rates) and self._speed_unit(column):
            return {"crank_speed": 3.0}
        orders = [own for own in self._orders(column) if own is not None]
        if len(orders) < len(column.values):
            return {}
        sizes = np.abs(np.array(orders))
        first = bool(np.median(sizes[:, 2] / sizes[:, 1]) < 0.6)
        power = _power(self.rates, sizes[:, 1:].sum(axis=1))
        if not first:
            return {"crank_torque": 1.5}
        mean = float(np.median(sizes[:, 0] / sizes[:, 1]))
        order = int(np.clip(round(power), 0, 2)) if power is not None else 2 * (mean < 0.5)
        return {KINEMATIC[order]: 1.5 - (mean if order else 0.0), "crank_torque": 1.0}

    def _speed_unit(self, column: _Column) -> str:
        """The unit in which a column is the crank speed; '' if there is none."""
        means = [float(np.nanmean(own)) for own in column.values]
        if any(abs(mean) < 2 * np.nanstd(own) for mean, own in zip(means, column.values, strict=True)):
            return ""
        for unit in (column.unit_for("crank_speed") and [column.unit_for("crank_speed")]) or UNITS["rad/s"]:
            factor = unit_factor(unit, "rad/s") / tau
            if all(rate and abs(abs(mean) * factor / abs(rate) - 1) < 0.03
                   for mean, rate in zip(means, self.rates, strict=True)):  # fmt: skip
                return unit
        return ""

    def _add(self, channel: str, column: _Column) -> None:
        base, unit, reasons = CHANNELS[channel], column.unit_for(channel), []
        if not column.named(channel):
            reasons.append({
                "crank_speed": "its mean is the speed", "slider_position": "once a turn, of equal size at all speeds",
                "slider_velocity": "once a turn, rises with the speed", "crank_torque": "repeats every turn",
                "slider_acceleration": "once a turn, rises with the square of the speed"}.get(channel, ""))  # fmt: skip
        if column.signal and not unit:
            self._entry(channel, column, unit=column.signal, scale=FILL_IN)
            reasons.append(f"a signal; the factor of the sensor, in {base}/{column.signal}")
            self.why[channel] = _because(reasons)
            return
        if not unit:
            unit, reason = self._unit(channel, column)
            reasons.append(reason)
        elif column.unit.strip().lower() == "g":
            reasons.append("g is the acceleration of gravity, g_n")
        self._entry(channel, column, unit=unit)
        self.why[channel] = _because(reasons)
        if (radius := self._radius(channel, column, unit)) is not None:
            self.radius[channel] = radius

    def _unit(self, channel: str, column: _Column) -> tuple[str, str]:
        """The likeliest unit of a column without one, and why."""
        base = CHANNELS[channel]
        if channel == "crank_speed" and (unit := self._speed_unit(column)):
            return unit, "no unit given; its mean is the speed"
        if self._radius(channel, column, base) is None:
            return base, "no unit given"
        sizes = {unit: self._radius(channel, column, unit) for unit in UNITS[base]}
        if known := [radius for name, radius in self.radius.items() if name != channel]:
            unit = min(sizes, key=lambda one: abs(log(sizes[one] / known[0])))
        else:
            unit = next((one for one in sizes if LENGTHS[0] < sizes[one] < LENGTHS[1]), base)
        return unit, f"no unit given; for a crank of about {number(1e3 * sizes[unit], 2)} mm"

    def _radius(self, channel: str, column: _Column, unit: str) -> float | None:
        """The crank's length [m] by the once-per-turn part of a column in this unit."""
        if channel not in KINEMATIC:
            return None
        order, factor = KINEMATIC.index(channel), unit_factor(unit, CHANNELS[channel])
        found = [abs(own[1]) * factor / (tau * abs(rate or 1.0)) ** order
                 for own, rate in zip(self._orders(column), self.rates, strict=True)
                 if own is not None and (rate or not order)]  # fmt: skip
        return float(np.median(found)) if found and np.median(found) > 0 else None

    def _zero(self) -> None:
        """The angle read at the outer dead centre, by the first channel of the slider's motion."""
        for channel in (one for one in KINEMATIC if one in self.channels):
            column = self.columns[self.channels[channel]["column"]]
            turning = {"slider_position": 1, "slider_velocity": -1j, "slider_acceleration": -1}[channel]
            orders = [own for own in self._orders(column) if own is not None]
            if self.angle and orders and all(rate is None or rate > 0 for rate in self.rates):
                self.zero = channel, degrees(-np.angle(np.sum([own[1] for own in orders]) * turning))
                return

    @property
    def varies(self) -> str:
        """How the speed of the runs varies; '' if it does not, or is not known."""
        if not self.angle or not self.time or not self.period or not self.channels["time"].get("unit"):
            return ""
        factor = unit_factor(self.channels["time"]["unit"], "s")
        for run, turned in enumerate(self.turned):
            clock = _in_run(self.runs[run], self.angle.heading).columns.values[self.time.heading] * factor
            used = np.isfinite(clock)
            sign = -1.0 if (self.rates[run] or 0.0) < 0 else 1.0
            if text := checks.unsteady(clock[used], sign * tau * turned[used]):
                return text
        return ""


def _constant(values: np.ndarray) -> bool:
    finite = values[np.isfinite(values)]
    return finite.size < checks.MIN_SAMPLES or float(np.std(finite)) == 0.0


def _power(rates: Sequence[float | None], sizes: np.ndarray) -> float | None:
    """The power of the speed with which `sizes` grow; None for speeds that are unknown or alike."""
    if any(not rate for rate in rates) or max(map(abs, rates)) < 1.15 * min(map(abs, rates)):
        return None
    return float(np.polyfit(np.log(np.abs(rates)), np.log(sizes), 1)[0])


def _because(reasons: Sequence[str]) -> str:
    given = [reason for reason in reasons if reason]
    return f"guess: {'; '.join(given)}" if given else "from the heading"


# Text


def new_rig(files: Sequence[Path], name: str = "rig") -> str:
    """Write the campaign file ``NAME.yaml`` and the mechanism file ``NAME_mechanism.yaml`` for measured files.

    Returns a summary. InputError where one of both exists, or a file cannot be read.
    """
    campaign, mechanism = _new_files(name, f"{name}_mechanism")
    guesses = _Guesses(_runs_of([_read(path) for path in files]))
    text = "\n".join(_lines(guesses, name, files, mechanism)) + "\n"
    write_text(campaign, text)
    write_text(mechanism, _mechanism(guesses.radius))
    blanks = text.count(FILL_IN)
    also = f"{blanks} values to fill in, and " if blanks else ""
    return (
        f"{campaign}: {len(guesses.runs)} runs, {len(guesses.channels)} channels; {also}the guesses in the comments to "
        f"check\n{mechanism}: the values marked {FILL_IN} to fill in\nthen: jointgap measure {campaign}; jointgap "
        f"analyse {campaign}"
    )


def new_mechanism(name: str = "mechanism") -> str:
    """Write the mechanism file ``NAME.yaml`` to fill in; returns a summary. InputError where it exists."""
    (path,) = _new_files(name)
    write_text(path, _mechanism({}))
    return f"{path}: the values marked {FILL_IN} to fill in"


def _new_files(*names: str) -> list[Path]:
    try:
        files = [Path(f"{word(name)}.yaml") for name in names]
    except ValueError as error:
        raise InputError(f"--name {names[0]}: {error}") from error
    if there := [str(path) for path in files if path.exists()]:
        raise InputError(f"{' and '.join(there)}: already there, and not replaced; move it, or give another --name")
    return files


def _mechanism(radius: Mapping[str, float]) -> str:
    """The content of a mechanism file to fill in; `radius` are lengths of the crank that channels suggest."""
    suggested = next((f"; {channel} suggests {number(1e3 * own, 3)} mm" for channel, own in radius.items()), "")
    return MECHANISM.replace("%(length)s", suggested)


def _lines(guesses: _Guesses, name: str, files: Sequence[Path], mechanism: Path) -> Iterator[str]:
    yield f"# Written by `jointgap new rig {' '.join(path.name for path in files)}`. Check every line with a guess."
    yield f"name: {name}"
    yield f"mechanism: {mechanism.name}   # fill in lengths and masses there"
    varies = guesses.varies
    if varies:
        yield f"drive: measured_angle   # guess: the speed varies {varies}"
    else:
        yield "drive: constant_speed   # guess: or measured_angle, if the speed varies"
    yield "runs:"
    yield from _run_lines(guesses)
    yield "channels:"
    for channel in CHANNELS:
        if channel in guesses.channels:
            keys = ", ".join(f"{key}: {_quoted(value)}" for key, value in guesses.channels[channel].items())
            yield f"  {channel}: {{{keys}}}   # {guesses.why[channel]}"
    if not guesses.channels.keys() & {"time", "crank_angle"}:
        yield f"  time: {{column: {FILL_IN}, unit: {FILL_IN}}}   # no column rises evenly"
    for heading, why in guesses.unused.items():
        yield f"  # not used: column {json.dumps(heading, ensure_ascii=False)} {why}"
    yield "nuisance:   # how well quantities are known; fitted within these bounds"
    yield "  slider_mass: 5 %   # assumed"
    yield "  rod_mass: 5 %   # assumed"
    if guesses.angle:
        yield _zero_line(guesses)
    if "slider_position" in guesses.channels:
        yield "  slider_position_zero: 1 m   # assumed: the zero of the position is not known"


def _zero_line(guesses: _Guesses) -> str:
    if guesses.zero is None:
        return "  encoder_zero: 180 deg   # assumed: not known; give less, such as 5 deg, if crank_angle is 0 at the outer dead centre"
    channel, zero = guesses.zero
    if abs(zero) < 3.0:
        return f"  # encoder_zero: 5 deg   # not needed: by {channel}, crank_angle is 0 at the outer dead centre"
    return f"  encoder_zero: 180 deg   # guess: by {channel}, crank_angle is {zero:.0f} deg at the outer dead centre"


def _run_lines(guesses: _Guesses) -> Iterator[str]:
    rates = guesses.rates
    order = sorted(range(len(rates)), key=lambda run: (abs(rates[run] or 0.0), run))
    ids = _ids([run[0].path.stem for run in guesses.runs])
    for run in order:
        role = "split" if len(order) == 1 else "confirm" if run == order[-1] else "identify"
        paths = [_quoted(os.path.relpath(file.path)) for file in guesses.runs[run]]
        file = paths[0] if len(paths) == 1 else f"[{', '.join(paths)}]"
        rate, why = rates[run], "of the crank, such as 300 rpm"
        if rate:
            by = "by the angle and the time" if guesses.angle else "the columns repeat this often, once a turn"
            why = f"guess: {by}"
        way = ", direction: clockwise" if rate and rate < 0 and guesses.angle else ""
        why += "; the angle falls" if way else ""
        speed = f"{number(60 * abs(rate))} rpm" if rate else FILL_IN
        yield f"  - {{id: {_quoted(ids[run])}, file: {file}, speed: {speed}, role: {role}{way}}}   # {why}"


def _ids(stems: Sequence[str]) -> list[str]:
    ids: list[str] = []
    for stem in stems:
        own = re.sub(r"[^\w-]+", "_", stem)[:40]
        ids.append(f"run_{len(ids) + 1}_{own}"[:50] if own in RESERVED_IDS or own in ids else own)
    return ids


def _quoted(value: object) -> str:
    """`value` in YAML, in quotation marks where it needs them."""
    text = str(value)
    if not isinstance(value, str):
        return text
    plain = re.fullmatch(r"[^\W\d]([\w./^*°² -]*[\w²])?", text) and text.lower() not in ("yes", "no", "on", "off")
    return text if plain and yaml.safe_load(text) == text else json.dumps(text, ensure_ascii=False)
