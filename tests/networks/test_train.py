"""Training of one output: points, gaps, errors, tables."""

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Surrogate
from jointgap.core.errors import InputError
from jointgap.networks.errors import Grid, error_rows
from jointgap.networks.train import train
from jointgap.paper.printed import TRAINING_MSE

STATED = {"model": "network", "seed": 0, "weights": 19, "iterations": 5, "stop": "why"}
SMALL = Surrogate(
    hidden=(6,), training_points=73, iterations=60, seeds=(4, 1, 2), seed_iterations=25
)


def trajectory(revolutions=2, samples=720, start=0.4, gap=()):
    """Two revolutions of a wave with a bump, undefined at the rows in `gap`."""
    angle = start + np.linspace(0, 2 * np.pi * revolutions, samples * revolutions + 1)
    gamma = 3.0 + 2.0 * np.sin(2 * angle) + np.exp(-((angle - 2.0) ** 2) / 0.1)
    gamma[list(gap)] = np.nan
    return pd.DataFrame({"crank_angle": angle, "gamma2": gamma})


def test_undefined_points_are_left_out_and_counted():
    fit = train(trajectory(gap=(0, 3, 40)), "gamma2", SMALL)[0]
    assert (fit.grid.training.undefined, fit.grid.held_out.undefined) == (2, 1)
    assert len(fit.grid.training.values) == 71
    whole, late = fit.errors().iloc[:2].itertuples()
    assert (whole.undefined_points, late.undefined_points) == (3, 0)
    assert (whole.training_points, whole.held_out_points) == (71, 647)
    assert np.isfinite(fit.weights()["weight"]).all()


@pytest.mark.parametrize("points", [72, 721])
def test_training_points_that_are_no_samples_or_leave_nothing_to_hold_out_are_refused(points):
    with pytest.raises(InputError, match="samples_per_revolution"):
        Grid.of(trajectory(), "gamma2", points)


def test_errors_are_what_their_names_say():
    grid = Grid.of(trajectory(), "gamma2", 73)
    rows = error_rows(grid, lambda angle: 3.0 + 2.0 * np.sin(2 * angle), grid.training, STATED)
    for row, first in zip(rows, (0.0, np.pi / 3), strict=True):
        for name, points in (("training", grid.training), ("held_out", grid.held_out)):
            inside = points.crank_angle - 0.4 >= first
            missed = np.exp(-((points.crank_angle[inside] - 2.0) ** 2) / 0.1)
            scale = (
                grid.training.values.max() - grid.training.values.min()
            )  # always over all training points
            assert row["range"] == pytest.approx(scale)
            assert row[f"{name}_points"] == inside.sum()
            assert row[f"{name}_mse"] == pytest.approx(np.mean((missed / scale) ** 2))
            assert row[f"{name}_rms"] == pytest.approx(np.mean(missed**2) ** 0.5)
            assert row[f"{name}_mse_over_variance"] == pytest.approx(
                np.mean(missed**2) / np.var(points.values[inside])
            )
        assert row["held_out_peak"] == pytest.approx(missed.max() / scale)
        assert row["paper_mse"] == TRAINING_MSE["gamma2"]
        assert row["unit"] == "rad"


def test_the_default_seed_comes_first_with_its_own_budget_and_the_others_share_theirs():
    fits = train(trajectory(), "gamma2", SMALL)
    assert [fit.seed for fit in fits] == [4, 1, 2]
    assert [fit.history()["iteration"].max() for fit in fits] == [60, 25, 25]
    fit, training = fits[0], fits[0].grid.training
    last = fit.history()["mse"].iloc[-1]
    error = (fit.network.values(training.crank_angle) - training.values) / fit.network.output.range
    assert last == pytest.approx(np.mean(error**2), rel=1e-9)
    assert fit.errors()["training_mse"].iloc[0] == pytest.approx(last, rel=1e-9)


def test_training_is_the_same_to_the_last_bit_every_time():
    for one, other in zip(*(train(trajectory(), "gamma2", SMALL) for _ in range(2)), strict=True):
        pd.testing.assert_frame_equal(one.weights(), other.weights(), check_exact=True)


def test_later_stages_need_neither_torch_nor_mlflow():
    modules = "networks.network", "scenario.kinematics", "lengths.optimise"
    code = "import sys, " + ", ".join(f"jointgap.{name}" for name in modules)
    code += "; sys.exit(bool({'torch', 'mlflow'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
