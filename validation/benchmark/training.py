"""Simulated campaigns on which the network is trained."""

import json
import math
import signal
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from jointgap.core.errors import InputError, SimulationError
from jointgap.core.files import write_text
from validation.benchmark.features import Features, features
from validation.benchmark.pool import in_parallel
from validation.data_faults import damage
from validation.kinds import Trial, plan_trials
from validation.rig import RECIPE, Hidden, Readings, Rig, Run, draw_effect, draw_rig, read
from validation.score import LEAST_GAP, effect_label
from validation.trial import campaign_of, noisy, write_campaign

SEED = 65_002  # of the training campaigns; their random streams differ from those of all sets
_STREAM = 101  # `validation.trial.make_trial` has 100
_SETS = 10  # planned training campaigns, in numbers of the set
# Of motion that never repeats every third planned campaign is drawn: it takes ten times as long
_CHAOTIC_EVERY = 3
_LARGEST_GAP = 20.0  # of an effect
_TOLERANCE = 1e-9  # local error of a step [m]: less accurate than a trial, far below the noise
_ARRAYS = ("channels", "tokens", "rig", "gap")
_SECONDS = 60.0  # processor time of a training campaign, after which it is given up


def simulate(folder: Path, count: int, trial_set: Any, cores: int = 1) -> None:
    """Draw training campaigns like those of a set until `folder` has `count` usable ones; each is
    a file ``{number}.npz``, a refused one ``{number}.json``.

    Sizes of effects are scaled in one step to a random gap without recalibration; campaigns are
    refused if the effect is not visible after a linear recalibration.
    """
    folder.mkdir(parents=True, exist_ok=True)
    plans = [plan for plan in _training_plans(trial_set) if not list(_files(folder, plan))]
    usable = len(list(folder.glob("*.npz")))
    if usable >= count:
        return
    for outcome in in_parallel(partial(_simulated, folder), plans, cores):
        usable += outcome == ""
        note = f", one refused: {outcome}" if outcome else ""
        print(f"{usable} of {count} training campaigns{note}", flush=True)
        if usable >= count:
            return
    raise InputError(f"{folder}: no more than {usable} training campaigns; give a lower number")


def _training_plans(trial_set: Any) -> list[Trial]:
    larger = {kind: min(_SETS * getattr(trial_set, kind), 10_000) for kind in RECIPE["kinds"]}
    plans = plan_trials(trial_set.model_copy(update={"seed": SEED, **larger}))
    return [p for p in plans if p.base != "chaotic" or p.number % _CHAOTIC_EVERY == 0]


def _files(folder: Path, plan: Trial) -> Iterator[Path]:
    return folder.glob(f"{plan.number:05d}.*")


def _simulated(folder: Path, plan: Trial) -> str:
    """Write the file of a training campaign; why it is refused, or ""."""
    usual = signal.signal(signal.SIGPROF, _give_up)
    signal.setitimer(signal.ITIMER_PROF, _SECONDS)
    begin = time.process_time()
    try:
        with tempfile.TemporaryDirectory() as place:
            outcome = _drawn(Path(place), plan)
    except (InputError, SimulationError, RuntimeError, TimeoutError) as error:
        outcome = f"{type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, usual)
    seconds = round(time.process_time() - begin, 2)
    path = folder / f"{plan.number:05d}"
    if isinstance(outcome, str):
        record = {"kind": plan.kind, "base": plan.base, "refused": outcome, "seconds": seconds}
        write_text(path.with_suffix(".json"), json.dumps(record) + "\n")
        return outcome
    temporary = folder / f".{path.name}.npz"
    np.savez_compressed(temporary, **outcome, seconds=seconds)
    temporary.replace(path.with_suffix(".npz"))
    return ""


def _give_up(*_: object) -> None:
    raise TimeoutError(f"{_SECONDS:g} s of processor time")


def _drawn(place: Path, plan: Trial) -> dict[str, Any] | str:
    """Arrays of a training campaign, or why there are none."""
    rng = np.random.default_rng([SEED, _STREAM, plan.number])
    rig = draw_rig(rng, plan)
    rig = replace(rig, numerics=replace(rig.numerics, tolerance=_TOLERANCE))
    effects = _with_sizes(plan, rig, rng)
    if effects is None:
        return "the rig cannot have the effect"
    clean = {name: read(rig.true, run, rig.numerics, effects) for name, run in rig.runs.items()}
    campaign, frames = campaign_of(rng, rig, noisy(rng, rig, clean), plan.id, ("parquet",))
    if plan.damage:
        damage(rng, plan.damage, campaign, frames)
    write_campaign(rng, place, rig, campaign, frames)
    campaign_features = features(place / "campaign.yaml")
    if effects and not LEAST_GAP <= campaign_features.gap <= _LARGEST_GAP:
        return f"gap {campaign_features.gap:.3g}"
    named = [effect_label(vars(effect)) for effect, _ in effects]
    return {
        **{name: getattr(campaign_features, name) for name in _ARRAYS},
        **{"labels": np.array(named, dtype=str), "nothing": not (effects or plan.damage)},
        **{"kind": plan.kind, "base": plan.base},
    }


def _with_sizes(
    plan: Trial, rig: Rig, rng: np.random.Generator
) -> list[tuple[Hidden, float]] | None:
    """The effects of a plan with random sizes; None if the rig cannot have one."""
    fastest = max((rig.runs[name] for name in rig.fitted), key=lambda run: run.speed)
    base = read(rig.true, fastest, rig.numerics)
    spread = {channel: float(base[channel].std()) for channel in rig.sensors}
    sizes = []
    for label in plan.effects:
        effect = draw_effect(label, rig, spread, rng)
        if effect is None:
            return None
        if plan.shown:
            size = _log_uniform(rng, effect.lowest or 0.01 * effect.most, effect.most)
        elif rig.base == "chaotic":
            size = _log_uniform(rng, effect.first, effect.most)  # one motion has no gap
        else:
            gap = _log_uniform(rng, min(RECIPE["gaps"]), max(RECIPE["gaps"]))
            changed = read(rig.true, fastest, rig.numerics, [(effect, effect.first)])
            size = effect.first * _factor(rig, fastest, base, changed, gap)
        sizes.append((effect, min(max(size, effect.lowest), effect.most)))
    return sizes


def _factor(rig: Rig, run: Run, base: Readings, changed: Readings, gap: float) -> float:
    """Factor of the size of an effect for a gap, if the readings respond in proportion.

    The analyst's crank follows the encoder: its readings at constant speed on a line.
    """
    shift, squares = np.zeros(run.times.size), []
    if rig.angle_noise:
        shift = changed["crank_angle"] - base["crank_angle"]
        if rig.drive == "constant_speed":
            line = np.polyval(np.polyfit(run.times, shift, 1), run.times)
            sd = math.hypot(rig.angle_noise, rig.angle_step / math.sqrt(12.0))
            squares.append(np.mean(((shift - line) / sd) ** 2))
            shift = line
    for name, sensor in rig.sensors.items():
        followed = base[name] + shift * np.gradient(base[name], base["crank_angle"])
        sd = sensor.noise_share * base[name].std()
        squares.append(np.mean(((changed[name] - followed) / sd) ** 2))
    return math.sqrt((gap**2 - 1.0) / max(float(np.mean(squares)), 1e-12))


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def load_training(folder: Path) -> tuple[list[Features], list[set[str]]]:
    """The usable campaigns of a folder, and their labels; ``nothing`` if nothing is hidden and the
    data are intact."""
    campaigns, labels = [], []
    for path in sorted(folder.glob("[0-9]*.npz")):
        with np.load(path) as content:
            campaigns.append(Features(*(content[key] for key in _ARRAYS)))
            labels.append({*content["labels"].tolist(), *["nothing"] * bool(content["nothing"])})
    return campaigns, labels
