"""The regularised network: what it is trained at, what is held out, and that its errors hold
between its points."""

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Surrogate
from jointgap.networks.errors import Points, smoothing_spline
from jointgap.networks.train import train, train_regularised

OPTIONS = Surrogate(
    hidden=(10, 10),
    training_points=91,
    iterations=300,
    seeds=(4,),
    regularised_neurons=40,
    regularised_iterations=40,
)


def ringing(samples):
    """A slow wave with a contact that rings as fast as the paper's training points are spaced, and
    an impact."""
    angle = np.linspace(0, 2 * np.pi, samples + 1)
    since = np.clip(angle - 2.0, 0.0, None)
    values = (
        np.sin(2 * angle)
        + 0.3 * np.exp(-3.0 * since) * np.sin(60 * since)
        + 0.5 * np.tanh((angle - 4.0) / 0.003)
    )
    values[0] = np.nan
    return pd.DataFrame({"crank_angle": angle, "gamma2": values})


@pytest.fixture(scope="module")
def fit():
    return train_regularised(ringing(720), ringing(7200), "gamma2", OPTIONS)


def test_its_errors_hold_between_its_points_where_those_of_the_papers_recipe_do_not(fit):
    papers, regularised = (
        one.errors().iloc[0] for one in (*train(ringing(720), "gamma2", OPTIONS), fit)
    )
    assert papers["held_out_mse"] > 10 * papers["training_mse"]
    assert regularised["held_out_mse"] < 2 * regularised["training_mse"]
    assert regularised["held_out_mse"] < 0.1 * papers["held_out_mse"]


def test_a_third_of_the_samples_is_held_out_and_takes_no_part(fit):
    training, held_out = fit.training.crank_angle, fit.grid.held_out.crank_angle
    assert not np.intersect1d(training, held_out).size
    assert len(held_out) / (len(training) + len(held_out)) == pytest.approx(1 / 3, abs=0.01)
    spoilt = ringing(7200)
    changed = np.isin(spoilt["crank_angle"], held_out)
    # Small enough to leave the choice of samples as it is, large beside rounding.
    spoilt.loc[changed, "gamma2"] += 1e-10
    again = train_regularised(ringing(720), spoilt, "gamma2", OPTIONS)
    np.testing.assert_array_equal(again.grid.held_out.crank_angle, held_out)
    np.testing.assert_array_equal(again.network.parameters, fit.network.parameters)


def test_the_smoothing_spline_follows_exact_points_and_smooths_noise():
    x = np.linspace(0.0, 6.0, 300)
    noise = 0.1 * np.random.default_rng(0).normal(size=300)
    between = (x[1:] + x[:-1]) / 2
    exact = smoothing_spline(Points(x, np.sin(3 * x), 0))(between) - np.sin(3 * between)
    noisy = smoothing_spline(Points(x, np.sin(3 * x) + noise, 0))(between) - np.sin(3 * between)
    assert np.max(np.abs(exact[20:-20])) < 1e-5  # its second derivative is 0 at the ends
    assert np.std(noisy) < 0.05
    assert smoothing_spline(Points(x[:14], x[:14], 0)) is None
