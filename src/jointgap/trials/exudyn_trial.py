"""Trials whose motion and effects come from independent code: Exudyn's bodies, constraints, loads and springs."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from jointgap.trials.draw_rigs import Design
from jointgap.trials.exudyn_model import FRICTION_ZONE, STEPS, simulate
from jointgap.trials.injected_effects import Hidden
from jointgap.trials.make_trial import beyond_nominal, difference, drawn, noisy, told
from jointgap.trials.rig_files import written
from jointgap.trials.sensor_readings import SETTLING, Turn, with_effects
from jointgap.trials.trial_plan import Plan


def conceal_in_peer(plan: Plan, rng: np.random.Generator, folder: Path) -> dict:
    """As `jointgap.trials.make_trial.conceal`; the size is set by the package's own numerics, the data are Exudyn's.

    Raises
    ------
    ImportError
        Exudyn is not installed.
    """
    made, gauge, hidden, gaps = drawn(plan, rng)
    made = replace(made, runs={run: _evenly(turn) for run, turn in made.runs.items()})
    written(rng, made, noisy(rng, made, _readings(made, hidden)), folder, plan.id)
    return {
        **told(plan, made, gaps),
        "numerics": {"code": "exudyn", "steps_per_revolution": STEPS, "friction_zone": FRICTION_ZONE},
        "numerics_gap": None,
        "difference": difference(replace(made, runs=gauge.design.runs), gauge, hidden),
        "effects": [
            {"name": one.name, "site": one.site, "listed": True, "parameters": beyond_nominal(made, one, size)}
            for one, size in hidden
        ],
    }


def _evenly(turn: Turn) -> Turn:
    """The run with samples in equal steps, which Exudyn's integrator takes."""
    return replace(turn, times=np.linspace(0.0, turn.times[-1], turn.times.size))


def _readings(made: Design, hidden: Sequence[tuple[Hidden, float]]) -> Mapping[str, Mapping[str, np.ndarray]]:
    content = with_effects(made.true, hidden)
    return {run: simulate(content, turn.speed, turn.phase, turn.times, SETTLING) for run, turn in made.runs.items()}
