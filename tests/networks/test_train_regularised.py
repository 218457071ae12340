"""The regularised network: its training data, its held-out data, and its errors between them."""

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Surrogate
from jointgap.networks.errors import Points, smoothing_spline
from jointgap.networks.train import train, train_regularised

REGULARISED = {"regularised_neurons": 40, "regularised_iterations": 40}
PAPERS = {"hidden": (10, 10), "training_points": 91, "iterations": 300, "seeds": (4,)}
OPTIONS = Surrogate(**PAPERS, **REGULARISED)


def ringing(samples):
    """A slow wave with an impact, and a contact that rings as fast as the paper's training points
    are spaced."""
    angle = np.linspace(0, 2 * np.pi, samples + 1)
    since = np.clip(angle - 2.0, 0.0, None)
    rings = 0.3 * np.exp(-3.0 * since) * np.sin(60 * since)
    values = np.sin(2 * angle) + rings + 0.5 * np.tanh((angle - 4.0) / 0.003)
    values[0] = np.nan
    return pd.DataFrame({"crank_angle": angle, "gamma2": values})


@pytest.fixture(scope="module")
def fit():
    return train_regularised(ringing(720), ringing(7200), "gamma2", OPTIONS)


def test_its_errors_hold_between_its_points_unlike_those_of_the_papers_network(fit):
    papers = train(ringing(720), "gamma2", OPTIONS)[0].errors().iloc[0]
    regularised = fit.errors().iloc[0]
    assert papers["held_out_mse"] > 10 * papers["training_mse"]
    assert regularised["held_out_mse"] < 2 * regularised["training_mse"]
    assert regularised["held_out_mse"] < 0.1 * papers["held_out_mse"]


def test_a_third_of_the_samples_is_held_out_and_does_not_affect_the_training(fit):
    training, held_out = fit.training.crank_angle, fit.held_out.crank_angle
    assert not np.intersect1d(training, held_out).size
    assert len(held_out) / (len(training) + len(held_out)) == pytest.approx(1 / 3, abs=0.01)
    changed = ringing(7200)
    # small enough to leave the choice of samples unchanged, large compared with rounding
    changed.loc[np.isin(changed["crank_angle"], held_out), "gamma2"] += 1e-10
    repeated = train_regularised(ringing(720), changed, "gamma2", OPTIONS)
    np.testing.assert_array_equal(repeated.held_out.crank_angle, held_out)
    np.testing.assert_array_equal(repeated.network.parameters, fit.network.parameters)


def test_the_smoothing_spline_follows_exact_points_and_smooths_noise():
    x = np.linspace(0.0, 6.0, 300)
    noise = 0.1 * np.random.default_rng(0).normal(size=300)
    between = (x[1:] + x[:-1]) / 2
    exact, noisy = (
        smoothing_spline(Points(x, values))(between) - np.sin(3 * between)
        for values in (np.sin(3 * x), np.sin(3 * x) + noise)
    )
    assert np.max(np.abs(exact[20:-20])) < 1e-5  # its second derivative is 0 at the ends
    assert np.std(noisy) < 0.05
    assert smoothing_spline(Points(x[:14], x[:14])) is None
