"""Training of one output: points, gaps, errors, tables."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Surrogate
from jointgap.core.errors import InputError
from jointgap.networks.errors import split_samples
from jointgap.networks.network import Scaling
from jointgap.networks.train import TrainedNetwork, train
from jointgap.paper.printed import TRAINING_MSE

SMALL = Surrogate(
    hidden=(6,), training_points=73, iterations=60, seeds=(4, 1, 2), seed_iterations=25
)


def trajectory(gap=()):
    """Two revolutions of a wave with a bump, undefined at the rows in `gap`."""
    angle = 0.4 + np.linspace(0, 4 * np.pi, 1441)
    gamma = 3.0 + 2.0 * np.sin(2 * angle) + bump(angle)
    gamma[list(gap)] = np.nan
    return pd.DataFrame({"crank_angle": angle, "gamma2": gamma})


def bump(angle):
    return np.exp(-((angle - 2.0) ** 2) / 0.1)


@pytest.fixture(scope="module")
def fits():
    return train(trajectory(), "gamma2", SMALL)


def test_undefined_points_are_left_out_and_counted():
    options = SMALL.model_copy(update={"seeds": (4,), "iterations": 2})
    fit = train(trajectory(gap=(0, 3, 40)), "gamma2", options)[0]
    assert (fit.training.undefined, fit.held_out.undefined) == (2, 1)
    all_samples, past_60_deg = fit.errors().itertuples()
    assert (all_samples.undefined_points, past_60_deg.undefined_points) == (3, 0)
    assert (all_samples.training_points, all_samples.held_out_points) == (71, 647)
    assert np.isfinite(fit.weights()["weight"]).all()


@pytest.mark.parametrize("points", [72, 721])
def test_training_points_that_are_no_samples_or_leave_none_to_hold_out_are_errors(points):
    with pytest.raises(InputError, match="samples_per_revolution"):
        split_samples(trajectory(), "gamma2", points)


def test_errors_are_those_of_their_region_and_scaled_by_the_range_of_all_training_points():
    training, held_out = split_samples(trajectory(), "gamma2", 73)
    network = SimpleNamespace(
        values=lambda angle: 3.0 + 2.0 * np.sin(2 * angle),
        layout=SimpleNamespace(size=19),
        output=Scaling.of(training.values),
    )
    fit = TrainedNetwork(
        "network", 0, "gamma2", 0.4, network, training, held_out, np.ones(6), {}, "why"
    )
    scale = np.ptp(training.values)
    for row, begin in zip(fit.errors().to_dict("records"), (0.0, np.pi / 3), strict=True):
        for name, points in (("training", training), ("held_out", held_out)):
            inside = points.crank_angle - 0.4 >= begin
            errors = bump(points.crank_angle[inside])
            assert row[f"{name}_points"] == inside.sum()
            expected = {
                f"{name}_mse": np.mean((errors / scale) ** 2),
                f"{name}_rms": np.mean(errors**2) ** 0.5,
                f"{name}_mse_over_variance": np.mean(errors**2) / np.var(points.values[inside]),
            }
            assert {key: row[key] for key in expected} == pytest.approx(expected)
        assert row["range"] == pytest.approx(scale)
        assert row["held_out_peak"] == pytest.approx(errors.max() / scale)
        assert (row["paper_mse"], row["unit"]) == (TRAINING_MSE["gamma2"], "rad")


def test_the_default_seed_is_the_first_with_its_own_budget(fits):
    assert [fit.seed for fit in fits] == [4, 1, 2]
    assert [fit.history()["iteration"].max() for fit in fits] == [60, 25, 25]
    fit, training = fits[0], fits[0].training
    mse = fit.history()["mse"].iloc[-1]
    error = (fit.network.values(training.crank_angle) - training.values) / fit.network.output.range
    assert mse == pytest.approx(np.mean(error**2), rel=1e-9)
    assert fit.errors()["training_mse"].iloc[0] == pytest.approx(mse, rel=1e-9)


def test_training_is_bitwise_reproducible(fits):
    for fit, repeated in zip(fits, train(trajectory(), "gamma2", SMALL), strict=True):
        pd.testing.assert_frame_equal(fit.weights(), repeated.weights(), check_exact=True)
