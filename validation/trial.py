"""One trial: a rig whose hidden effects are as large as was asked for, its campaign, and the truth
to be sealed."""

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, cached_property
from math import tau
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from scipy.optimize import brentq, lsq_linear
from scipy.signal import lfilter

from jointgap.config import EFFECTS
from jointgap.config.campaign import CHANNELS, UNITS
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.formula import compile_formula
from jointgap.core.units import unit_factor
from jointgap.dynamics.equations import evaluate
from jointgap.identification.problem import Noise, whiten
from jointgap.rig.model import STEADY_CONTACT_DAMPING_FACTOR
from jointgap.rig.sensors import FAULTS
from jointgap.rig.simulate_run import with_nuisances
from validation.kinds import CLEARANCES, Trial
from validation.rig import (
    Effects,
    Hidden,
    Numerics,
    Readings,
    Rig,
    draw_effect,
    draw_rig,
    read,
    read_truth,
    visited,
)
from validation.wiring import damage

# Relative deviation from the target up to which a gap is what was asked for
GAP_TOLERANCE = 0.16

# Bins of the crank angle, and motions as long as the measured one over which statistics are taken
BINS, MOTIONS = 36, 4

# Rigs drawn for one effect; where none can show it, the last is kept, and the trial counts as
# undetectable
_MOST_RIGS = 6

# Rigs drawn for an effect whose size is drawn too, and sizes for each
_MOST_RIGS_FOR_SIZES, _SIZES = 60, 4

# Gap from which on a joint that becomes loose whirls: friction of 0.25 and more drives the journal
# around in some ten micrometres, with forces of hundreds of times the noise. Nobody runs such a rig
_WHIRLS = 50.0

_FILE_TIME = (
    1_577_836_800  # [s] 2020-01-01 for every file, so that times of files give nothing away
)


class Calibrator:
    """Measures gaps of a rig: noise-free differences between a truth and the recalibrated base,
    over the noise.

    Where the motion never repeats, they are those of mean and log variance in bins of the crank
    angle, over their standard errors in one run; what the scatter of the simulated motions adds is
    taken off.
    """

    def __init__(self, rig: Rig):
        self.rig, self.chaotic = rig, rig.base == "chaotic"
        # truth and base alike, so that no difference between numerics counts as the effect's;
        # motions that never repeat part within revolutions whatever the tolerance, but their
        # statistics agree
        self.numerics = Numerics(1e-8 if self.chaotic else 1e-10)
        self.base = {name: self._read(rig.runs[name]) for name in rig.fitted}
        fastest = max(rig.fitted, key=lambda name: rig.runs[name].speed)
        self.spread = {channel: float(self.base[fastest][channel].std()) for channel in rig.sensors}

    def gap(self, effects: Effects) -> float:
        """Root of 1 plus the mean square of what recalibration within the nuisances' bounds leaves
        of `effects`."""
        left, *_ = self._recalibrated(effects)
        return self._gap(left)

    def where(self, effects: Effects) -> dict[str, list[float]]:
        """Root mean square of what recalibration leaves of `effects`, over the noise, in bins of
        the crank angle; by run and channel."""
        _, readings, base, steps = self._recalibrated(effects)
        found = {}
        for name, own in readings.items():
            place = np.floor(own["crank_angle"] / tau % 1.0 * BINS)
            for channel, sensor in self.rig.sensors.items():
                moved = sum(
                    step * (other[name][channel] - self.base[name][channel])
                    for step, other in steps
                )
                rest = own[channel] - base[name][channel] - moved
                squares = pd.Series(
                    (rest / (sensor.noise_share * self.base[name][channel].std())) ** 2
                )
                means = squares.groupby(place).mean().reindex(range(BINS), fill_value=0.0)
                found[f"{name} {channel}"] = [round(float(mean) ** 0.5, 3) for mean in means]
        return found

    def _recalibrated(self, effects: Effects) -> tuple[np.ndarray, dict, dict, list]:
        """What recalibration leaves of `effects`, as `_seen`; their readings, those of the base,
        and the steps that nuisances go, each with the readings after one step."""
        readings, base = {}, dict(self.base)
        for name in base:
            run = self.rig.runs[name]
            readings[name] = self._read(run, effects)
            seen = readings[name]["crank_angle"]
            if (
                self.rig.angle_noise
                and not self.chaotic
                and not np.allclose(seen, base[name]["crank_angle"])
            ):
                # the analyst's base turns as the encoder says: on the line through its readings
                if run.drift:
                    shift = float(np.mean(seen - base[name]["crank_angle"]))
                    base[name] = self._read(replace(run, phase=run.phase + shift))
                    continue
                speed, phase = map(float, np.polyfit(run.times, seen, 1))
                base[name] = self._read(replace(run, speed=speed, phase=phase))
        left, (moved, slopes, low, high) = self._seen(readings) - self._seen(base), self._slopes
        steps = lsq_linear(slopes, left, (low, high)).x if moved else np.zeros(0)
        return left - slopes @ steps, readings, base, list(zip(steps, moved, strict=True))

    def numerics_gap(self, effects: Effects, readings: Mapping[str, Readings]) -> float:
        """Gap of a truth by these numerics from its `readings` by others."""
        own = {name: self._read(self.rig.runs[name], effects) for name in self.base}
        return self._gap(self._seen(own) - self._seen({name: readings[name] for name in own}))

    def _read(self, run: Any, effects: Effects = (), values: Mapping[str, float] = {}) -> Readings:
        if self.chaotic:  # whole revolutions later again
            turns = math.ceil(run.times[-1] * run.speed / tau) + 1
            later = turns * tau / run.speed * np.arange(MOTIONS)[:, None]
            run = replace(run, times=(run.times + later).ravel())
        if late := (
            values.get("encoder_lag", 0.0) - self.rig.values.get("encoder_lag", 0.0)
            if values
            else 0.0
        ):
            run = replace(
                run, phase=run.phase + late * run.speed
            )  # the crank was ahead of what the encoder reads
        mechanism = with_nuisances(self.rig.nominal, {**self.rig.values, **values})
        return read(mechanism, run, self.numerics, effects)

    def _seen(self, readings: Mapping[str, Readings]) -> np.ndarray:
        """Readings over their noise (n,), scaled so that each channel of each run counts alike."""
        parts = []
        for name, own in readings.items():
            for channel, sensor in self.rig.sensors.items():
                usual = self.base[name][channel]
                sd = sensor.noise_share * usual.std()
                if self.chaotic:
                    errors = self._statistics(name, usual, sd)[1]
                    parts.append(self._statistics(name, own[channel], sd)[0] / errors)
                else:
                    noise = Noise(
                        np.full(usual.size, sd), (sensor.correlation,) if sensor.correlation else ()
                    )
                    parts.append(whiten(own[channel], noise))
        return np.concatenate([part / math.sqrt(part.size * len(parts)) for part in parts])

    def _statistics(self, name: str, series: np.ndarray, sd: float) -> np.ndarray:
        """Mean and log variance in bins of the crank angle, and their standard errors in one run:
        (2, n)."""
        run, values, turned = (
            self.rig.runs[name],
            pd.Series(series),
            self.base[name]["crank_angle"] / tau,
        )
        cycle, place = np.floor(turned), np.floor(turned % 1.0 * BINS)
        squares = (values - values.groupby(place).transform("mean")) ** 2 + sd**2
        means, variances = (
            one.groupby([cycle, place]).mean().groupby(level=1) for one in (values, squares)
        )
        cycles = run.times[-1] * run.speed / tau
        count, variance = run.times.size / cycles / BINS, variances.mean()
        errors = (
            (means.var() + sd**2 / count) / cycles,
            (variances.var() / variance**2 + 2 / count) / cycles,
        )
        return np.array([[*means.mean(), *np.log(variance)], np.sqrt([*errors[0], *errors[1]])])

    @cached_property
    def _slopes(self) -> tuple[list, np.ndarray, np.ndarray, np.ndarray]:
        """Readings after a step of each nuisance away from its nearer bound, what that changes (n,
        k), and the bounds in steps."""
        share = (
            0.3 if self.chaotic else 0.1
        )  # of the range: beyond the scatter, small enough to be linear
        moved, ends = [], []
        for key, (value, low, high) in self._nuisances().items():
            step = share * (high - low) * (1 if value < 0.5 * (low + high) else -1)
            name, _, only = key.partition("@")
            readings = dict(self.base)
            for run in [only] if only else self.base:
                changed = replace(self.rig.runs[run], **({name: value + step} if only else {}))
                readings[run] = self._read(changed, (), {} if only else {key: value + step})
            moved.append(readings)
            ends.append(sorted(((low - value) / step, (high - value) / step)))
        base = self._seen(self.base)
        slopes = np.array([self._seen(one) - base for one in moved]).reshape(len(moved), base.size)
        return moved, slopes.T, *np.array(ends).reshape(-1, 2).T

    def _nuisances(self) -> dict[str, tuple[float, float, float]]:
        """True value and bounds of all that a recalibration may move; ``key@run`` of one run
        alone."""
        rig, reach = self.rig, math.log(STEADY_CONTACT_DAMPING_FACTOR)
        free = {key: (rig.values[key], p.low, p.high) for key, p in rig.nuisances.items()}
        free |= {
            key: (own, -reach, reach)
            for key, own in rig.values.items()
            if key.startswith("lasting_damping")
        }
        for name in () if self.chaotic else rig.fitted:
            run = rig.runs[name]
            if "speed" in rig.bounds:
                free[f"speed@{name}"] = (
                    run.speed,
                    0.997 * run.nominal_speed,
                    1.003 * run.nominal_speed,
                )
            if not rig.angle_noise:
                free[f"phase@{name}"] = run.phase, run.phase - 0.05, run.phase + 0.05
        return free

    def _gap(self, left: np.ndarray) -> float:
        excess = float(left @ left) - (2 / MOTIONS if self.chaotic else 0.0)
        return math.sqrt(1 + max(excess, 0.0))


def sized(calibrator: Calibrator, effect: Hidden, target: float) -> tuple[float, float]:
    """Size of an effect at which its gap is about `target`, and that gap; the nearest possible
    where none is."""
    gaps: dict[float, float] = {}

    @cache
    def excess(log_size: float) -> float:
        """Logarithm of the excess over the target's; sizes that cannot be simulated are too
        large."""
        size = math.exp(log_size)
        try:
            gaps[size] = calibrator.gap([(effect, size)])
        except (InputError, SimulationError):
            return 10.0
        return math.log(max(gaps[size] ** 2 - 1, 1e-9) / (target**2 - 1))

    least, most = math.log(max(effect.least, 1e-4 * effect.first)), math.log(effect.most)
    low = high = math.log(effect.first)
    while excess(high) < 0 and high < most:
        low, high = high, min(high + 1.2, most)
    while excess(low) > 0 and low > least:
        low, high = max(low - 1.2, least), low
    if excess(low) < 0 < excess(high):
        brentq(excess, low, high, xtol=0.03)
    return min(
        gaps.items(), key=lambda one: abs(math.log(one[1] / target)), default=(effect.first, 1.0)
    )


def draw(
    trial: Trial, rng: np.random.Generator
) -> tuple[Rig, Calibrator, list[tuple[Hidden, float]], list[float], int]:
    """Draw rigs until one shows the effects of a trial as large as planned: rig, its calibrator,
    effects with their sizes, the gap that each causes alone, and how many sizes were drawn in
    vain."""
    most, discarded = _MOST_RIGS_FOR_SIZES if trial.shown else _MOST_RIGS, 0
    for number in range(1, most + 1):
        rig = draw_rig(rng, trial)
        calibrator = Calibrator(rig)
        drawn = [draw_effect(name, rig, calibrator.spread, rng) for name in trial.effects]
        if None in drawn:
            continue
        if trial.shown:
            for effect, size in ((drawn[0], _any_size(drawn[0], rng)) for _ in range(_SIZES)):
                gap = _gap_if_possible(calibrator, effect, size)
                if trial.shown[0] <= gap <= trial.shown[1]:
                    return rig, calibrator, [(effect, size)], [gap], discarded
                discarded += 1
            continue
        found = [sized(calibrator, effect, trial.size) for effect in drawn]
        effects = [(effect, size) for effect, (size, _) in zip(drawn, found, strict=True)]
        gaps = [gap for _, gap in found]
        shown = all(
            abs(gap / trial.size - 1) < GAP_TOLERANCE
            or (size <= 1.01 * effect.least and gap > trial.size)
            for (effect, size), gap in zip(effects, gaps, strict=True)
        )
        if number == most or (shown and not _whirls(calibrator, effects)):
            return rig, calibrator, effects, gaps, discarded
    raise RuntimeError(f"none of {most} rigs can have {' and '.join(trial.effects)}")


def _any_size(effect: Hidden, rng: np.random.Generator) -> float:
    """A size drawn evenly in the logarithm, of all that an effect is searched at."""
    return math.exp(
        rng.uniform(math.log(effect.least or 0.01 * effect.most), math.log(effect.most))
    )


def _gap_if_possible(calibrator: Calibrator, effect: Hidden, size: float) -> float:
    """The gap that an effect causes; infinite where the motion cannot be simulated."""
    try:
        return calibrator.gap([(effect, size)])
    except (InputError, SimulationError):
        return math.inf


def _whirls(calibrator: Calibrator, effects: Effects) -> bool:
    """Whether a joint that becomes loose whirls, at the size with which its search began or with
    the other effect."""
    loose = [effect for effect, _ in effects if effect.name in CLEARANCES]
    tried = [[(effect, effect.first)] for effect in loose] + ([list(effects)] if loose else [])
    try:
        return any(calibrator.gap(one) >= _WHIRLS for one in tried)
    except SimulationError:
        return True


def make_trial(
    trial: Trial, seed: int, folder: Path, endings=("csv", "csv", "parquet")
) -> dict[str, Any]:
    """Write a campaign, its runs in files with one of three `endings`, and return the ground truth
    that is to be sealed."""
    rng = np.random.default_rng([seed, 100, trial.number])
    rig, calibrator, effects, gaps, discarded = draw(trial, rng)
    clean = {
        name: read_truth(rig, run, effects, trial.kind == "exudyn")
        for name, run in rig.runs.items()
    }
    campaign, frames = campaign_of(rng, rig, noisy(rng, rig, clean), trial.id, endings)
    damaged = damage(rng, trial.damage, campaign, frames) if trial.damage else None
    write_campaign(rng, folder, rig, campaign, frames)
    comparable = not calibrator.chaotic and {name: clean[name] for name in rig.fitted}
    truth = {
        "id": trial.id,
        "kind": trial.kind,
        "base": trial.base,
        "drive": rig.drive,
        "size": trial.size,
        "gaps": [round(gap, 4) for gap in gaps],
        "discarded": discarded,
        "nuisances": {
            **rig.values,
            **{f"speed@{name}": run.speed for name, run in rig.runs.items()},
        },
        "where": None if calibrator.chaotic else calibrator.where(effects),
        "numerics": "exudyn" if trial.kind == "exudyn" else vars(rig.numerics),
        "numerics_gap": (
            round(calibrator.numerics_gap(effects, comparable), 3) if comparable else None
        ),
        "effects": [_record(rig, effect, size) for effect, size in effects],
    }
    return truth | ({"damage": damaged} if damaged else {})


def noisy(rng: np.random.Generator, rig: Rig, clean: Mapping[str, Readings]) -> dict[str, Readings]:
    """Readings with noise and gaps, and the noise's standard deviation as ``{channel} sd``."""
    noisy = {}
    for name, run in rig.runs.items():
        readings: dict[str, Any] = {"time": run.times - run.times[0]}
        for channel, sensor in rig.sensors.items():
            series = clean[name][channel]
            sd = sensor.noise_share * float(series.std())
            values = series + sd * ar1_noise(rng, series.size, sensor.correlation)
            for _ in range(int(rng.integers(1, 4)) if sensor.gaps else 0):
                begin, length = rng.uniform(0, 0.95), rng.uniform(0.01, 0.05)
                values[int(begin * values.size) : int((begin + length) * values.size)] = np.nan
            if sensor.every > 1:
                values[np.arange(values.size) % sensor.every != 0] = np.nan
            readings |= {channel: values, f"{channel} sd": sd}
        if rig.angle_noise:
            true = clean[name]["crank_angle"]
            true = true - rig.values.get("encoder_lag", 0.0) * np.gradient(true, run.times)
            angle = true + rng.normal(0.0, rig.angle_noise, run.times.size)
            readings["crank_angle"] = (
                np.round(angle / rig.angle_step) * rig.angle_step if rig.angle_step else angle
            )
        noisy[name] = readings
    return noisy


def ar1_noise(rng: np.random.Generator, count: int, correlation: float) -> np.ndarray:
    """First-order autoregressive noise of variance 1, (count,); neighbours have the
    `correlation`."""
    steps = rng.normal(size=count)
    steps[1:] *= math.sqrt(1 - correlation**2)
    return lfilter([1.0], [1.0, -correlation], steps)


def _record(rig: Rig, effect: Hidden, size: float) -> dict[str, Any]:
    """An effect as the truth states it, the drawn parameter first; of a law off the list its values
    where it was."""
    record = {
        "name": effect.name,
        "site": effect.site,
        "listed": effect.name in EFFECTS or effect.name in FAULTS,
    }
    record["parameters"] = parameters_beyond_nominal(rig, effect, size)
    if effect.law:
        states = visited(rig, [(effect, size)])[STATES]
        (entry,) = effect.in_file(size)
        values = formula_values(**entry["parameters"], states=states)
        record["force"] = {"kind": entry["name"], "value": values, "states": states.to_dict("list")}
    return record


# What a formula is a function of
STATES = ["slider_velocity", "slider_position", "crank_speed", "crank_angle", "time"]


def formula_values(
    formula: str, coefficients: Mapping[str, float], states: pd.DataFrame
) -> list[float]:
    """Values [N or N m] of a law over the `STATES` that a motion visits [SI]."""
    program = compile_formula(formula, coefficients)
    return [
        float(evaluate(program.codes, program.numbers, *state))
        for state in states[STATES].to_numpy()
    ]


def parameters_beyond_nominal(rig: Rig, effect: Hidden, size: float) -> dict[str, float]:
    """An effect's parameters as an analyst can know them, the drawn one first.

    A mass that is added to one that is not exactly known, and likewise a length, is known by their
    sum alone: it counts from what the mechanism file says.
    """
    values = dict(effect.parameters(size))
    for key, (body, datum) in (
        EFFECTS[effect.name].ADDS_TO if effect.name in EFFECTS else {}
    ).items():
        values[key] += getattr(getattr(rig.true, body), datum) - getattr(
            getattr(rig.nominal, body), datum
        )
    return values


def campaign_of(
    rng: Any, rig: Rig, readings: Mapping[str, Readings], name: str, endings=("csv",)
) -> tuple[dict, dict]:
    """Content of the campaign file, and samples by run: as users have them, in various units."""
    measured = [*(["crank_angle"] if rig.angle_noise else []), *rig.sensors]
    prefix = str(rng.choice(["ch", "signal", "AI", "s"]))
    units = {channel: str(rng.choice(UNITS[CHANNELS[channel]])) for channel in measured} | {
        "time": "s"
    }
    if rng.random() < 0.3:
        units["time"] = "ms"
    scale = {channel: 1 / unit_factor(unit, CHANNELS[channel]) for channel, unit in units.items()}
    channels: dict[str, Any] = {"time": {"column": "t", "unit": units["time"]}}
    for number, channel in zip(rng.permutation(len(measured)), measured, strict=True):
        entry = channels[channel] = {"column": f"{prefix}{number + 1}", "unit": units[channel]}
        if channel == "crank_angle":
            key, value = (
                ("resolution", rig.angle_step) if rig.angle_step else ("noise", rig.angle_noise)
            )
            entry[key] = _rounded(value * scale[channel])
        elif rig.noise_is_stated:
            sds = {run: own[f"{channel} sd"] for run, own in readings.items()}
            entry["noise"] = {run: _rounded(sd * scale[channel]) for run, sd in sds.items()}
    wrapped, ending = rng.choice(["none", "up", "both"]), str(rng.choice(endings))
    frames, runs = {}, []
    for run, own in readings.items():
        own = {**own, "time": own["time"] + rng.uniform(0, 5)}
        if rig.angle_noise and wrapped != "none":
            back = math.pi if wrapped == "both" else 0.0
            own["crank_angle"] = (own["crank_angle"] + back) % tau - back
        columns = sorted(
            channels, key=lambda channel: (channel != "time", channels[channel]["column"])
        )
        frames[run] = pd.DataFrame(
            {channels[one]["column"]: own[one] * scale[one] for one in columns}
        )
        role = "confirm" if run == rig.confirm else "identify"
        speed = f"{rig.runs[run].nominal_speed * 60 / tau:g} rpm"
        runs.append(
            {"id": run, "file": f"{run}.{ending}", "speed": speed, "role": role, "start": "settled"}
        )
    bounds = {key: [_rounded(low), _rounded(high)] for key, (low, high) in rig.bounds.items()}
    if "speed" in bounds:
        bounds["speed"] = f"{100 * rig.bounds['speed'][1]:g}%"
    campaign = {"name": name, "mechanism": "mechanism.yaml", "drive": rig.drive}
    return campaign | {"runs": runs, "channels": channels, "nuisance": bounds}, frames


def write_campaign(
    rng: np.random.Generator, folder: Path, rig: Rig, campaign: dict, frames: Mapping
) -> None:
    """Write the files of a campaign, all of one date."""
    folder.mkdir(parents=True, exist_ok=True)
    marks = [{"sep": ","}, {"sep": ";", "decimal": ","}, {"sep": "\t"}][int(rng.integers(3))]
    for run in campaign["runs"]:
        path = folder / run["file"]
        if path.suffix == ".parquet":
            frames[run["id"]].to_parquet(path, index=False)
        else:
            frames[run["id"]].to_csv(path, index=False, float_format="%.9g", **marks)
    known = {**rig.content, "effects": []}  # how the crank swings is measured, not stated
    for file, content in (("mechanism.yaml", known), ("campaign.yaml", campaign)):
        (folder / file).write_text(yaml.safe_dump(dict(content), sort_keys=False), encoding="utf-8")
    for path in folder.iterdir():
        os.utime(path, (_FILE_TIME, _FILE_TIME))


def _rounded(number: float) -> float:
    return float(f"{number:.8g}")
