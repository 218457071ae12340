"""Many simulations at once."""

import itertools

import numpy as np
import pytest

from jointgap.core.errors import SimulationError
from jointgap.motion.parallel import Run, simulate_ensemble, simulate_runs
from tests.motion.cases import MOTOR, effect, mechanism, options

COARSE = options(samples_per_revolution=90, tolerance=1e-9)


def test_only_a_few_of_many_runs_are_in_memory():
    made, count = mechanism(friction=0.1), itertools.count()
    outcomes = simulate_runs((Run(made, COARSE) for _ in count), workers=2)
    for _ in range(5):
        next(outcomes)
    outcomes.close()
    assert next(count) < 40


def test_a_failed_run_has_its_error_and_an_ensemble_raises_it():
    braked = mechanism(effect("slider_constant_force", force_N=5000.0), friction=0.1)
    stalling = options(drive=MOTOR, samples_per_revolution=90, tolerance=1e-9)
    made = mechanism(friction=0.1)
    runs = [Run(made, COARSE), Run(made, COARSE, [0.1, 0, 0, 0]), Run(braked, stalling)]
    fine, outside, stalled = simulate_runs(runs)
    assert fine.error is None and len(fine.result.times) == 91
    assert "not less than its clearance" in str(outside.error)
    assert "stalls" in str(stalled.error)
    with pytest.raises(SimulationError, match="stalls"):
        simulate_ensemble(braked, stalling, np.zeros((1, 4)))
