"""The second surrogate: local basis, consistency of its outputs, training on motions known in
closed form."""

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Surrogate
from jointgap.core import parquet, schema
from jointgap.core.joints import PINS
from jointgap.networks.clearance import ClearanceNetwork, Samples, crank_speed, train_clearance
from jointgap.paper.printed import TRAINING_MSE

SPEED = 30.0


def motion(samples, revolutions=1, start=0.2, swing=0.0):
    """Clearance vectors that start at zero with zero velocity, swing and ring; all derivatives by
    hand.

    The crank's speed swings by a share of `swing`.
    """
    angle = start + np.linspace(0, 2 * np.pi * revolutions, samples * revolutions + 1)
    x = angle - start
    w, w1 = SPEED * (1 + swing * np.cos(x)), -SPEED * swing * np.sin(x)
    frame = {"crank_angle": angle, "crank_speed": w, "crank_acceleration": w * w1}
    for joint, (turn, ring) in {2: (1.0, 40.0), 3: (-2.0, 55.0)}.items():
        gamma = [
            turn * x + 0.1 * np.sin(ring * x),
            turn + 0.1 * ring * np.cos(ring * x),
            -0.1 * ring**2 * np.sin(ring * x),
        ]
        f = np.exp(-(x**2))
        r = [1e-3 * (1 - f), 2e-3 * x * f, 2e-3 * f * (1 - 2 * x**2)]
        for quantity, by_angle in (
            ("r", r),
            ("gamma", [np.where(x > 0, part, np.nan) for part in gamma]),
        ):
            frame[f"{quantity}{joint}"] = by_angle[0]
            frame[f"{quantity}{joint}_dot"] = by_angle[1] * w
            frame[f"{quantity}{joint}_ddot"] = by_angle[2] * w**2 + by_angle[1] * w * w1
    return pd.DataFrame(frame)


FIT = Surrogate(training_points=121)


@pytest.fixture(scope="module")
def fit():
    return train_clearance(motion(720, 2), motion(14400), FIT, PINS)


def test_every_output_is_the_derivative_of_the_one_before(fit):
    network = fit.joints[3].network
    angle, step = np.linspace(0.3, 6.3, 40), 1e-5

    def quotient(name):
        samples = [network.output(name, angle + k * step)[0] for k in (-2, -1, 1, 2)]
        return (samples[0] - 8 * samples[1] + 8 * samples[2] - samples[3]) / (12 * step)

    for name in ("r3", "gamma3", "gamma3_dot", "gamma3_ddot"):
        slope = network.output(name, angle)[1]
        np.testing.assert_allclose(slope, quotient(name), atol=1e-6 * np.abs(slope).max())
    for rate, name in (("gamma3_dot", "gamma3"), ("gamma3_ddot", "gamma3_dot")):
        by_time = SPEED * network.output(name, angle)[1]
        np.testing.assert_allclose(network.output(rate, angle)[0], by_time, rtol=1e-14)


def test_a_motion_in_closed_form_is_learned_to_a_tenth_of_what_is_asked_and_between_its_points(fit):
    errors = fit.errors()
    assert set(errors["output"]) == set(TRAINING_MSE)
    assert (errors["held_out_mse"] <= 0.2 * errors["paper_mse"]).all()
    assert errors["stop"].str.startswith("training errors").all()


def test_a_speed_that_swings_enters_the_rates_and_nothing_else(tmp_path):
    coarse, fine = motion(720, 2, swing=0.3), motion(14400, swing=0.3)
    fit = train_clearance(coarse, fine, FIT, ("piston_pin",))
    errors = fit.errors()
    assert list(errors["output"].unique()) == ["r3", "gamma3", "gamma3_dot", "gamma3_ddot"]
    assert (errors["held_out_mse"] <= 0.2 * errors["paper_mse"]).all()
    network, angle, step = fit.joints[3].network, np.linspace(0.3, 6.3, 40), 1e-5
    slopes = network.output("gamma3_ddot", angle)[1]
    around = [network.output("gamma3_ddot", angle + k * step)[0] for k in (-1, 1)]
    np.testing.assert_allclose(
        slopes, (around[1] - around[0]) / (2 * step), atol=1e-3 * np.abs(slopes).max()
    )
    parquet.write(schema.CLEARANCE_FIT, fit.weights(), tmp_path / "fit.parquet")
    stored = parquet.read(schema.CLEARANCE_FIT, tmp_path / "fit.parquet")
    assert stored["speed"].isna().all()
    back = ClearanceNetwork.from_frame(stored, 3, crank_speed(coarse))
    np.testing.assert_array_equal(
        back.output("gamma3_dot", angle), network.output("gamma3_dot", angle)
    )


def test_no_sample_that_is_held_out_is_trained_at():
    coarse, fine = motion(720), motion(14400)
    samples = Samples.of(coarse, fine, 2, 121)
    nearest = np.abs(samples.crank_angle[:, None] - coarse["crank_angle"].to_numpy()).min(axis=1)
    assert nearest.min() > 0.9 * 2 * np.pi / 14400
    assert samples.shares.sum() == pytest.approx(1.0)
