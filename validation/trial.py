"""One trial: a rig with hidden effects of the requested size, its campaign and the ground truth."""

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

from jointgap.config.campaign import UNITS
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.formula import compile_formula
from jointgap.core.units import unit_factor
from jointgap.effects import effects_of
from jointgap.identification.problem import Noise, whiten
from jointgap.linkage.laws import evaluate
from jointgap.rig.model import STEADY_CONTACT_DAMPING_FACTOR
from jointgap.rig.sensors import ENCODER_ECCENTRICITY, FAULTS
from jointgap.rig.simulate_run import with_nuisances
from validation.data_faults import damage
from validation.kinds import Trial
from validation.linkages import draw_linkage
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
    visited_states,
)

# Accepted relative deviation from the requested gap
GAP_TOLERANCE = 0.16

# Bins of the crank angle, and simulated motions (of the measured length) for statistics
BINS, MOTIONS = 36, 4

# Rigs drawn until an effect is detectable; the last one is kept, and the trial is undetectable
_MOST_RIGS = 6

# The same if the size is drawn too, and sizes per rig
_MOST_RIGS_FOR_SIZES, _SIZES = 60, 4

# Gap above which a newly loose joint whirls: with a friction of 0.25 or more the journal is driven
# around in a few tens of micrometres, with forces of hundreds of times the noise
_WHIRLS = 50.0

_FILE_TIME = 1_577_836_800  # [s] 2020-01-01, so that file times reveal nothing


class Calibrator:
    """Gaps of a rig: noise-free difference of the true motion and the recalibrated base, over the
    noise.

    Non-periodic motion is compared by mean and log variance in bins of the crank angle, over their
    standard errors in one run; the scatter of the simulated motions is subtracted.
    """

    def __init__(self, rig: Rig):
        self.rig, self.chaotic = rig, rig.base == "chaotic"
        # the same numerics with and without the effect; statistics need less accuracy
        self.numerics = Numerics(1e-8 if self.chaotic else 1e-10)
        self.base = {name: self._read(rig.runs[name]) for name in rig.fitted}
        fastest = max(rig.fitted, key=lambda name: rig.runs[name].speed)
        self.spread = {channel: float(self.base[fastest][channel].std()) for channel in rig.sensors}

    def gap(self, effects: Effects) -> float:
        """Root of 1 plus the mean square residual of `effects` after recalibration."""
        residual, *_ = self._recalibrated(effects)
        return self._gap(residual)

    def where(self, effects: Effects) -> dict[str, list[float]]:
        """RMS residual of `effects` over the noise, in bins of the crank angle; by run and
        channel."""
        _, readings, base, steps = self._recalibrated(effects)
        table = {}
        for name, signals in readings.items():
            bins = np.floor(signals["crank_angle"] / tau % 1.0 * BINS)
            for channel, sensor in self.rig.sensors.items():
                adjustment = sum(
                    step * (moved[name][channel] - self.base[name][channel])
                    for step, moved in steps
                )
                residual = signals[channel] - base[name][channel] - adjustment
                sd = sensor.noise_share * self.base[name][channel].std()
                means = pd.Series((residual / sd) ** 2).groupby(bins).mean()
                means = means.reindex(range(BINS), fill_value=0.0)
                table[f"{name} {channel}"] = [round(float(mean) ** 0.5, 3) for mean in means]
        return table

    def _recalibrated(self, effects: Effects) -> tuple[np.ndarray, dict, dict, list]:
        """Scaled residual of `effects` after recalibration; readings with the effects and of the
        base; steps of the nuisances, each with its readings."""
        readings, base = {}, dict(self.base)
        for name in base:
            run = self.rig.runs[name]
            readings[name] = self._read(run, effects)
            angle, base_angle = (signals[name]["crank_angle"] for signals in (readings, base))
            if not self.rig.angle_noise or self.chaotic or np.allclose(angle, base_angle):
                continue
            # the base of the analyst turns as the encoder reads: on a line through its angles
            if self.rig.drive == "measured_angle" and effects[0][0].name == ENCODER_ECCENTRICITY:
                ((eccentricity, size),) = effects
                read_run = run.as_read(*eccentricity.parameters(size).values())
            elif run.drift:
                read_run = replace(run, phase=run.phase + float(np.mean(angle - base_angle)))
            else:
                speed, phase = map(float, np.polyfit(run.times, angle, 1))
                read_run = replace(run, speed=speed, phase=phase)
            base[name] = self._read(read_run)
        residual, (moved, slopes, low, high) = (
            self._scaled(readings) - self._scaled(base),
            self._slopes,
        )
        steps = lsq_linear(slopes, residual, (low, high)).x if moved else np.zeros(0)
        return residual - slopes @ steps, readings, base, list(zip(steps, moved, strict=True))

    def numerics_gap(self, effects: Effects, readings: Mapping[str, Readings]) -> float:
        """Gap between the effects with these numerics and `readings` with others."""
        own = {name: self._read(self.rig.runs[name], effects) for name in self.base}
        return self._gap(self._scaled(own) - self._scaled({name: readings[name] for name in own}))

    def _read(self, run: Any, effects: Effects = (), values: Mapping[str, float] = {}) -> Readings:
        if self.chaotic:  # repeated after whole revolutions
            turns = math.ceil(run.times[-1] * run.speed / tau) + 1
            later = turns * tau / run.speed * np.arange(MOTIONS)[:, None]
            run = replace(run, times=(run.times + later).ravel())
        lag = self.rig.values.get("encoder_lag", 0.0)
        late = values.get("encoder_lag", 0.0) - lag if values else 0.0
        if late:  # the crank is ahead of the reading
            run = replace(run, phase=run.phase + late * run.speed)
        mechanism = with_nuisances(self.rig.nominal, {**self.rig.values, **values})
        readings = read(mechanism, run, self.numerics, effects)
        return readings | {"crank_angle": readings["crank_angle"] - late * run.speed}

    def _scaled(self, readings: Mapping[str, Readings]) -> np.ndarray:
        """Readings over their noise (n,), each channel of each run with the same weight."""
        parts = []
        for name, signals in readings.items():
            for channel, sensor in self.rig.sensors.items():
                usual = self.base[name][channel]
                sd = sensor.noise_share * usual.std()
                if self.chaotic:
                    errors = self._statistics(name, usual, sd)[1]
                    parts.append(self._statistics(name, signals[channel], sd)[0] / errors)
                else:
                    correlation = (sensor.correlation,) if sensor.correlation else ()
                    parts.append(
                        whiten(signals[channel], Noise(np.full(usual.size, sd), correlation))
                    )
            if self.rig.compares_angle:
                sd = math.hypot(self.rig.angle_noise, self.rig.angle_step / math.sqrt(12.0))
                parts.append(signals["crank_angle"] / sd)
        return np.concatenate([part / math.sqrt(part.size * len(parts)) for part in parts])

    def _statistics(self, name: str, series: np.ndarray, sd: float) -> np.ndarray:
        """Mean and log variance in bins of the crank angle, and their errors in one run, (2, n)."""
        run, values = self.rig.runs[name], pd.Series(series)
        turns = self.base[name]["crank_angle"] / tau
        cycle, angle_bin = np.floor(turns), np.floor(turns % 1.0 * BINS)
        squares = (values - values.groupby(angle_bin).transform("mean")) ** 2 + sd**2
        means = values.groupby([cycle, angle_bin]).mean().groupby(level=1)
        variances = squares.groupby([cycle, angle_bin]).mean().groupby(level=1)
        cycles = run.times[-1] * run.speed / tau
        count, variance = run.times.size / cycles / BINS, variances.mean()
        mean_errors = (means.var() + sd**2 / count) / cycles
        variance_errors = (variances.var() / variance**2 + 2 / count) / cycles
        statistics = [*means.mean(), *np.log(variance)]
        return np.array([statistics, np.sqrt([*mean_errors, *variance_errors])])

    @cached_property
    def _slopes(self) -> tuple[list, np.ndarray, np.ndarray, np.ndarray]:
        """Readings after a step of each nuisance away from its nearer bound, their change (n, k),
        and the bounds in steps."""

        share = 0.3 if self.chaotic else 0.1  # of the range: above scatter, nearly linear
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
        base = self._scaled(self.base)
        slopes = np.array([self._scaled(readings) - base for readings in moved])
        return moved, slopes.reshape(len(moved), base.size).T, *np.array(ends).reshape(-1, 2).T

    def _nuisances(self) -> dict[str, tuple[float, float, float]]:
        """True value and bounds of each recalibrated parameter; ``key@run`` for one run."""
        rig, log_factor = self.rig, math.log(STEADY_CONTACT_DAMPING_FACTOR)
        free = {key: (rig.values[key], p.low, p.high) for key, p in rig.nuisances.items()}
        for key, value in rig.values.items():
            if key.startswith("lasting_damping"):
                free[key] = value, -log_factor, log_factor
        for name in () if self.chaotic else rig.fitted:
            run = rig.runs[name]
            if "speed" in rig.bounds:
                low, high = 0.997 * run.nominal_speed, 1.003 * run.nominal_speed
                free[f"speed@{name}"] = run.speed, low, high
            if not rig.angle_noise:
                free[f"phase@{name}"] = run.phase, run.phase - 0.05, run.phase + 0.05
        return free

    def _gap(self, residual: np.ndarray) -> float:
        excess = float(residual @ residual) - (2 / MOTIONS if self.chaotic else 0.0)
        return math.sqrt(1 + max(excess, 0.0))


def sized(calibrator: Calibrator, effect: Hidden, target: float) -> tuple[float, float]:
    """The size at which the gap of an effect is closest to `target`, and that gap."""
    gaps: dict[float, float] = {}

    @cache
    def excess(log_size: float) -> float:
        """Logarithm of the excess over that of the target; failed simulations are too large."""
        size = math.exp(log_size)
        try:
            gaps[size] = calibrator.gap([(effect, size)])
        except (InputError, SimulationError):
            return 10.0
        return math.log(max(gaps[size] ** 2 - 1, 1e-9) / (target**2 - 1))

    lowest, most = math.log(max(effect.lowest, 1e-4 * effect.first)), math.log(effect.most)
    low = high = math.log(effect.first)
    while excess(high) < 0 and high < most:
        low, high = high, min(high + 1.2, most)
    while excess(low) > 0 and low > lowest:
        low, high = max(low - 1.2, lowest), low
    if excess(low) < 0 < excess(high):
        brentq(excess, low, high, xtol=0.03)
    if not gaps:
        return effect.first, 1.0
    return min(gaps.items(), key=lambda pair: abs(math.log(pair[1] / target)))


def draw(
    trial: Trial, rng: np.random.Generator
) -> tuple[Rig, Calibrator, list[tuple[Hidden, float]], list[float], int]:
    """Draw rigs until one shows the effects with the planned size: rig, calibrator, effects with
    sizes, the gap of each alone, and the number of discarded sizes."""
    most, discarded = _MOST_RIGS_FOR_SIZES if trial.shown else _MOST_RIGS, 0
    for number in range(1, most + 1):
        rig = draw_linkage(rng, trial) if trial.mechanism else draw_rig(rng, trial)
        calibrator = Calibrator(rig)
        drawn = [draw_effect(name, rig, calibrator.spread, rng) for name in trial.effects]
        if None in drawn:
            continue
        if trial.shown:
            effect = drawn[0]
            low, high = (
                math.log(end) for end in (effect.lowest or 0.01 * effect.most, effect.most)
            )
            for _ in range(_SIZES):
                size = math.exp(rng.uniform(low, high))
                gap = _gap_or_infinity(calibrator, effect, size)
                if trial.shown[0] <= gap <= trial.shown[1]:
                    return rig, calibrator, [(effect, size)], [gap], discarded
                discarded += 1
            continue
        effects, gaps, shown = [], [], True
        for effect in drawn:
            size, gap = sized(calibrator, effect, trial.size)
            effects.append((effect, size))
            gaps.append(gap)
            smallest_is_larger = size <= 1.01 * effect.lowest and gap > trial.size
            shown &= abs(gap / trial.size - 1) < GAP_TOLERANCE or smallest_is_larger
        if number == most or (shown and not _whirls(calibrator, effects)):
            return rig, calibrator, effects, gaps, discarded
    raise RuntimeError(f"none of {most} rigs can have {' and '.join(trial.effects)}")


def _gap_or_infinity(calibrator: Calibrator, effect: Hidden, size: float) -> float:
    """The gap of an effect; infinite if the motion cannot be simulated."""
    try:
        return calibrator.gap([(effect, size)])
    except (InputError, SimulationError):
        return math.inf


def _whirls(calibrator: Calibrator, effects: Effects) -> bool:
    """Whether a newly loose joint whirls, at the first size or together with the other effect."""
    loose = [effect for effect, _ in effects if effect.name.endswith("_clearance")]
    attempts = [[(effect, effect.first)] for effect in loose] + ([list(effects)] if loose else [])
    try:
        return any(calibrator.gap(attempt) >= _WHIRLS for attempt in attempts)
    except SimulationError:
        return True


def make_trial(
    trial: Trial, seed: int, folder: Path, endings=("csv", "csv", "parquet")
) -> dict[str, Any]:
    """Write a campaign with data files of one of the `endings`; its ground truth."""
    rng = np.random.default_rng([seed, 100, trial.number])
    rig, calibrator, effects, gaps, discarded = draw(trial, rng)
    clean = {name: read_truth(rig, run, effects, trial.by_exudyn) for name, run in rig.runs.items()}
    campaign, frames = campaign_of(rng, rig, noisy(rng, rig, clean), trial.id, endings)
    damaged = damage(rng, trial.damage, campaign, frames) if trial.damage else None
    write_campaign(rng, folder, rig, campaign, frames)
    where = numerics_gap = None
    if not calibrator.chaotic:
        where = calibrator.where(effects)
        fitted = {name: clean[name] for name in rig.fitted}
        numerics_gap = round(calibrator.numerics_gap(effects, fitted), 3)
    speeds = {f"speed@{name}": run.speed for name, run in rig.runs.items()}
    truth = {
        "id": trial.id,
        "kind": trial.kind,
        "base": trial.base,
        "mechanism": trial.mechanism or "slider_crank",
        "drive": rig.drive,
        "size": trial.size,
        "gaps": [round(gap, 4) for gap in gaps],
        "discarded": discarded,
        "nuisances": {**rig.values, **speeds},
        "where": where,
        "numerics": "exudyn" if trial.by_exudyn else vars(rig.numerics),
        "numerics_gap": numerics_gap,
        "effects": [effect_record(rig, effect, size) for effect, size in effects],
    }
    return truth | ({"damage": damaged} if damaged else {})


def noisy(rng: np.random.Generator, rig: Rig, clean: Mapping[str, Readings]) -> dict[str, Readings]:
    """Readings with noise and gaps, and the standard deviation as ``{channel} sd``."""
    noisy = {}
    for name, run in rig.runs.items():
        readings: dict[str, Any] = {"time": run.times - run.times[0]}
        for channel, sensor in rig.sensors.items():
            signal = clean[name][channel]
            sd = sensor.noise_share * float(signal.std())
            values = signal + sd * ar1_noise(rng, signal.size, sensor.correlation)
            for _ in range(int(rng.integers(1, 4)) if sensor.gaps else 0):
                begin, length = rng.uniform(0, 0.95), rng.uniform(0.01, 0.05)
                values[int(begin * values.size) : int((begin + length) * values.size)] = np.nan
            if sensor.every > 1:
                values[np.arange(values.size) % sensor.every != 0] = np.nan
            readings |= {channel: values, f"{channel} sd": sd}
        if rig.angle_noise:
            true = clean[name]["crank_angle"]
            true = true - rig.values.get("encoder_lag", 0.0) * np.gradient(true, run.times)
            angle, step = true + rng.normal(0.0, rig.angle_noise, run.times.size), rig.angle_step
            if step:
                angle = (np.floor if rig.truncates else np.round)(angle / step) * step
            readings["crank_angle"] = angle
        noisy[name] = readings
    return noisy


def ar1_noise(rng: np.random.Generator, count: int, correlation: float) -> np.ndarray:
    """First-order autoregressive noise (count,) of variance 1."""
    steps = rng.normal(size=count)
    steps[1:] *= math.sqrt(1 - correlation**2)
    return lfilter([1.0], [1.0, -correlation], steps)


# Variables of a formula
STATES = ["velocity", "position", "crank_speed", "crank_angle", "time"]


def effect_record(rig: Rig, effect: Hidden, size: float) -> dict[str, Any]:
    """An effect in the ground truth; of an unlisted law also its values in visited states."""
    listed = effect.name in effects_of(rig.nominal.sites) or effect.name in FAULTS
    record = {"name": effect.name, "site": effect.site, "listed": listed}
    record["parameters"] = parameters_beyond_nominal(rig, effect, size)
    if effect.law:
        states = visited_states(rig, [(effect, size)])
        at_site = {name: states[key] for name, key in _variables_at(rig, effect.site).items()}
        states = states.assign(**at_site)[STATES]
        (entry,) = effect.in_file(size)
        values = formula_values(**entry["parameters"], states=states)
        record["force"] = {"kind": entry["name"], "value": values, "states": states.to_dict("list")}
    return record


def _variables_at(rig: Rig, site: str) -> dict[str, str]:
    """Channels of the velocity and position in a formula at a body; at the crank of a slider-crank
    those of the slider."""
    sites = rig.nominal.sites
    if not rig.is_linkage:
        site = "slider"
    elif site == sites.crank:
        return {"velocity": "crank_speed", "position": "crank_angle"}
    ends = ("velocity", "position") if site in sites.slides else ("angular_velocity", "angle")
    return {"velocity": f"{site}_{ends[0]}", "position": f"{site}_{ends[1]}"}


def formula_values(
    formula: str, coefficients: Mapping[str, float], states: pd.DataFrame
) -> list[float]:
    """Values [N or N m] of a law in the `STATES` of a motion [SI]."""
    program = compile_formula(formula, coefficients)
    rows = states[STATES].to_numpy()
    return [float(evaluate(program.codes, program.numbers, *row)) for row in rows]


def parameters_beyond_nominal(rig: Rig, effect: Hidden, size: float) -> dict[str, float]:
    """Parameters of an effect, the drawn one first.

    Only the sum of an added mass and an uncertain mass is identifiable, likewise of lengths: they
    count from the mechanism file.
    """
    values = dict(effect.parameters(size))
    known = effects_of(rig.nominal.sites)
    adds_to = known[effect.name].ADDS_TO if effect.name in known else {}
    for key, (body, datum) in adds_to.items():
        true, nominal = (made.body(body) for made in (rig.true, rig.nominal))
        values[key] += getattr(true, datum) - getattr(nominal, datum)
    return values


def campaign_of(
    rng: Any, rig: Rig, readings: Mapping[str, Readings], name: str, endings=("csv",)
) -> tuple[dict, dict]:
    """Content of the campaign file and samples by run, in random units."""
    measured = [*(["crank_angle"] if rig.angle_noise else []), *rig.sensors]
    prefix = str(rng.choice(["ch", "signal", "AI", "s"]))
    si = {name: kind.unit for name, kind in rig.channel_kinds.items()}
    units = {channel: str(rng.choice(UNITS[si[channel]])) for channel in measured}
    units["time"] = "ms" if rng.random() < 0.3 else "s"
    scale = {channel: 1 / unit_factor(unit, si[channel]) for channel, unit in units.items()}
    channels: dict[str, Any] = {"time": {"column": "t", "unit": units["time"]}}
    for number, channel in zip(rng.permutation(len(measured)), measured, strict=True):
        entry = channels[channel] = {"column": f"{prefix}{number + 1}", "unit": units[channel]}
        if channel == "crank_angle" and rig.truncates:
            scale[channel] = 1 / rig.angle_step
            channels[channel] = {
                "column": entry["column"],
                "counts_per_turn": round(tau / rig.angle_step),
            }
        elif channel == "crank_angle":
            key = "resolution" if rig.angle_step else "noise"
            entry[key] = _rounded((rig.angle_step or rig.angle_noise) * scale[channel])
        elif rig.noise_is_stated:
            sds = {run: signals[f"{channel} sd"] for run, signals in readings.items()}
            entry["noise"] = {run: _rounded(sd * scale[channel]) for run, sd in sds.items()}
    wrapped, ending = rng.choice(["none", "up", "both"]), str(rng.choice(endings))
    columns = ["time", *sorted(measured, key=lambda channel: channels[channel]["column"])]
    frames, runs = {}, []
    for run, signals in readings.items():
        signals = {**signals, "time": signals["time"] + rng.uniform(0, 5)}
        if rig.angle_noise and wrapped != "none":
            back = math.pi if wrapped == "both" else 0.0
            signals["crank_angle"] = (signals["crank_angle"] + back) % tau - back
        frames[run] = pd.DataFrame(
            {channels[channel]["column"]: signals[channel] * scale[channel] for channel in columns}
        )
        if rig.truncates:
            counts = channels["crank_angle"]["column"]
            frames[run][counts] = frames[run][counts].round()
        role = "confirm" if run == rig.confirm else "identify"
        speed = f"{rig.runs[run].nominal_speed * 60 / tau:g} rpm"
        runs.append({"id": run, "file": f"{run}.{ending}", "speed": speed, "role": role})
        runs[-1]["start"] = "settled"
    bounds = {key: [_rounded(low), _rounded(high)] for key, (low, high) in rig.bounds.items()}
    if "speed" in bounds:
        bounds["speed"] = f"{100 * rig.bounds['speed'][1]:g}%"
    campaign = {"name": name, "mechanism": "mechanism.yaml", "drive": rig.drive}
    return campaign | {"runs": runs, "channels": channels, "nuisance": bounds}, frames


def write_campaign(
    rng: np.random.Generator, folder: Path, rig: Rig, campaign: dict, frames: Mapping
) -> None:
    """Write the files of a campaign, all with one date."""
    folder.mkdir(parents=True, exist_ok=True)
    csv_format = [{"sep": ","}, {"sep": ";", "decimal": ","}, {"sep": "\t"}][int(rng.integers(3))]
    for run in campaign["runs"]:
        path, frame = folder / run["file"], frames[run["id"]]
        if path.suffix == ".parquet":
            frame.to_parquet(path, index=False)
        else:
            frame.to_csv(path, index=False, float_format="%.9g", **csv_format)
    known = {**rig.content, "effects": []}  # a swing of the crank is measured, not stated
    for file, content in (("mechanism.yaml", known), ("campaign.yaml", campaign)):
        (folder / file).write_text(yaml.safe_dump(dict(content), sort_keys=False), encoding="utf-8")
    for path in folder.iterdir():
        os.utime(path, (_FILE_TIME, _FILE_TIME))


def _rounded(number: float) -> float:
    return float(f"{number:.8g}")
