"""One trial: an effect hidden in the data of a rig, and the truth sealed elsewhere."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jointgap.formula import compile_formula
from jointgap.trials.draw_rigs import Design, design
from jointgap.trials.injected_effects import LISTED, OFF_LIST, Hidden
from jointgap.trials.rig_files import written
from jointgap.trials.sensor_readings import Turn, moved, read, with_effects
from jointgap.trials.size_calibration import NEAR, Gauge, sized
from jointgap.trials.statistics_size import StatisticGauge
from jointgap.trials.trial_plan import Plan

_DRAWS = 4
"""Rigs that are drawn for one effect; where none can show it, the last is kept, and the trial counts as undetectable."""

PIECES = 72
"""Pieces of the crank angle for which the truth tells how far the base is off."""


def conceal(plan: Plan, seed: int, folder: Path) -> dict:
    """Write a campaign into `folder`, and return the truth that is to be sealed.

    Parameters
    ----------
    plan : Plan
    seed : int
        The set's.
    folder : Path
        For the campaign.
    """
    rng = np.random.default_rng([seed, 1, plan.number])
    if plan.kind == "exudyn":
        from jointgap.trials.exudyn_trial import conceal_in_peer

        return {"id": plan.id, **conceal_in_peer(plan, rng, folder)}
    return {"id": plan.id, **_concealed(plan, rng, folder)}


def drawn(plan: Plan, rng: np.random.Generator) -> tuple[Design, object, list[tuple[Hidden, float]], list[float]]:
    """A rig, its gauge, effects with their sizes, and the gap that each causes alone."""
    catalogue = OFF_LIST if plan.kind == "off_list" else LISTED
    film = [name.partition(":")[2] for name in plan.effects if name.startswith("lubricated_joint")]
    for draw in range(_DRAWS):
        made = design(rng, plan.base, film[0] if film else "", "encoder_offset" in plan.effects)
        identify = [run for run in made.runs if run != made.confirm]
        gauge = (StatisticGauge if plan.base == "chaotic" else Gauge)(made, identify)
        rig = made.rig(gauge.spread())
        effects = [catalogue[name](rig, rng) for name in plan.effects]
        found = [sized(gauge, one, plan.size) for one in effects]
        gaps = [gap for _, gap in found]
        if draw == _DRAWS - 1 or all(
            _fits(plan, one, size, gap) for one, (size, gap) in zip(effects, found, strict=True)
        ):
            return made, gauge, [(one, size) for one, (size, _) in zip(effects, found, strict=True)], gaps
    raise AssertionError("the last draw returns")


def _fits(plan: Plan, one: Hidden, size: float, gap: float) -> bool:
    """Whether the gap is what was asked for, or more where the effect cannot be smaller."""
    return abs(gap / plan.size - 1) < 2 * NEAR or (size <= one.least and gap > plan.size)


def _concealed(plan: Plan, rng: np.random.Generator, folder: Path) -> dict:
    made, gauge, hidden, gaps = drawn(plan, rng)
    clean = {run: read(made.true, turn, made.numerics, tuple(made.sensors), hidden) for run, turn in made.runs.items()}
    written(rng, made, noisy(rng, made, clean), folder, plan.id)
    return {
        **told(plan, made, gaps),
        "numerics": vars(made.numerics),
        "numerics_gap": round(gauge.numerics_gap(hidden, made.numerics), 3) if isinstance(gauge, Gauge) else None,
        "difference": difference(made, gauge, hidden) if isinstance(gauge, Gauge) else None,
        "effects": [_effect(made, one, size) for one, size in hidden],
    }


_BEYOND = {
    "added_slider_mass": {"mass_kg": ("slider", "mass")},
    "link_length_error": {"crank_m": ("crank", "length"), "rod_m": ("rod", "length")},
}


def beyond_nominal(made: Design, one: Hidden, size: float) -> dict[str, float]:
    """An effect's parameters as an analyst can know them, the drawn one first.

    A mass that is added to one that is not exactly known, and likewise a length, is known by their sum alone: it counts from what
    the mechanism file says.
    """
    found = dict(one.parameters(size))
    for key, (body, what) in _BEYOND.get(one.name, {}).items():
        found[key] = found.get(key, 0.0) + made.true[body][what] - made.nominal[body][what]
    return found


def told(plan: Plan, made: Design, gaps: Sequence[float]) -> dict:
    """What the sealed truth of every trial holds."""
    return {
        "kind": plan.kind,
        "base": plan.base,
        "size": plan.size,
        "gaps": [round(gap, 4) for gap in gaps],
        "confirm": made.confirm,
        "channels": list(made.sensors),
        "encoder": made.angle_noise > 0,
        "stated": made.stated,
        "nuisances": made.values,
    }


def noisy(rng, made: Design, clean: dict[str, dict[str, np.ndarray]]) -> dict[str, dict[str, np.ndarray]]:
    """Readings with noise and gaps, with the noise's standard deviation as ``{channel} sd``."""
    found = {}
    for run, turn in made.runs.items():
        reading = {"time": turn.times - turn.times[0]}
        for channel, sensor in made.sensors.items():
            series = clean[run][channel]
            sd = sensor.share * float(series.std())
            values = series + sd * autoregressive(rng, series.size, sensor.memory)
            if sensor.gaps:
                for _ in range(int(rng.integers(1, 4))):
                    length = int(rng.uniform(0.01, 0.05) * values.size)
                    begin = int(rng.integers(0, values.size - length))
                    values[begin : begin + length] = np.nan
            reading |= {channel: values, f"{channel} sd": sd}
        if made.angle_noise:
            reading["crank_angle"] = clean[run]["crank_angle"] + rng.normal(0.0, made.angle_noise, turn.times.size)
        found[run] = reading
    return found


def autoregressive(rng, count: int, memory: float) -> np.ndarray:
    """Noise of variance 1 whose neighbouring samples have the correlation `memory`."""
    steps = rng.normal(size=count)
    if not memory:
        return steps
    found = np.empty(count)
    found[0] = steps[0]
    for place in range(1, count):
        found[place] = memory * found[place - 1] + math.sqrt(1 - memory**2) * steps[place]
    return found


def difference(made: Design, gauge: Gauge, hidden: Sequence) -> dict[str, dict[str, list[float | None]]]:
    """RMS noise-free difference of the recalibrated base over the noise, by run, channel and piece of the crank angle."""
    off = gauge.unwhitened(hidden)
    found: dict[str, dict[str, list[float | None]]] = {}
    for one in gauge.yardsticks:
        turn: Turn = made.runs[one.run]
        piece = ((turn.phase + turn.speed * turn.times) / (2 * math.pi) % 1 * PIECES).astype(int) % PIECES
        square = np.bincount(piece, off[one.place] ** 2, PIECES)
        count = np.bincount(piece, minlength=PIECES)
        values = [round(math.sqrt(s / n), 4) if n else None for s, n in zip(square, count, strict=True)]
        found.setdefault(one.run, {})[one.channel] = values
    return found


def _effect(made: Design, one: Hidden, size: float) -> dict:
    entry = {"name": one.name, "site": one.site, "listed": one.listed, "parameters": beyond_nominal(made, one, size)}
    if one.formula:
        entry["force"] = _visited(made, one, size)
    return entry


def _visited(made: Design, one: Hidden, size: float) -> dict:
    """A law on nobody's list over the states that the motion visits, for a formula to be compared with."""
    kind, text = one.formula
    program = compile_formula(text, {"s": size})
    found = {key: [] for key in ("x", "v", "w", "theta", "t", "value")}
    for turn in made.runs.values():
        times = np.arange(100) / 100 * 2 * math.pi / turn.speed
        seen = moved(with_effects(made.true, [(one, size)]), Turn(turn.speed, 0.0, times), made.numerics)
        states = seen["slider_velocity"], seen["slider_position"], seen["crank_speed"], seen["crank_angle"], times
        found["value"] += values_of(program, *states)
        for key, values in zip(("v", "x", "w", "theta", "t"), states, strict=True):
            found[key] += np.round(values, 9).tolist()
    return {"kind": kind, "formula": text, "coefficients": {"s": size}, **found}


def values_of(program, *states: np.ndarray) -> list[float]:
    """Values of a formula over states: slider's velocity and position, crank's speed and angle, time."""
    from jointgap.dynamics.model.formula_evaluator import evaluate

    return [float(evaluate(program.codes, program.numbers, *map(float, state))) for state in zip(*states, strict=True)]
