"""Comparison methods without simulations of effects: sparse regression, the smallest BIC."""

import math

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("pysindy", reason="needs pysindy: scripts/set-up peers")

from jointgap.config.load import load_campaign
from jointgap.rig.read_files import read_measurements
from validation.benchmark import sparse
from validation.benchmark.greedy import greedy_names
from validation.kinds import Trial
from validation.trial import make_trial


def residuals(folder, missing) -> pd.DataFrame:
    """Residuals of the crank torque if a force `missing` of the slider velocity is not in the
    model."""
    campaign = load_campaign(folder / "campaign.yaml")
    parts = []
    for run, recording in read_measurements(campaign).runs.items():
        speed = next(one.speed for one in campaign.runs if one.id == run)
        angle = speed * recording.time
        made = campaign.mechanism
        links = made.crank.length, made.rod.length, made.slider.offset
        sine = (links[2] - links[0] * np.sin(angle)) / links[1]
        v = speed * links[0] * (-np.sin(angle) + np.cos(angle) * sine / np.sqrt(1 - sine**2))
        torque = -missing(v) * v / speed + np.random.default_rng(0).normal(0.0, 1e-3, v.size)
        columns = {"run": run, "channel": "crank_torque", "crank_angle": angle}
        columns["sample"] = np.arange(v.size)
        columns |= {"held_out": recording.held_out, "measured": torque, "base": 0.0}
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("campaign")
    make_trial(Trial("nothing", "ideal", id="0123456789ab"), 5, place)
    return place


def test_sparse_regression_names_one_force_and_nothing_in_noise(folder):
    campaign = load_campaign(folder / "campaign.yaml")
    cases = [
        (["slider_coulomb_friction"], lambda v: -5.0 * np.sign(v)),
        (["slider_viscous_friction"], lambda v: -3.0 * v),
        (["slider_quadratic_drag"], lambda v: -3.0 * v * np.abs(v)),
        (["slider_constant_force"], lambda v: np.full_like(v, 20.0)),
        ([], np.zeros_like),
    ]
    for names, force in cases:
        assert sparse.sparse_names(campaign, residuals(folder, force)) == names
    found = residuals(folder, np.zeros_like).assign(channel="guide_force", measured=math.pi)
    assert sparse.sparse_names(campaign, found) is None


def test_residuals_of_the_recalibrated_model_are_noise_where_nothing_is_hidden(folder):
    found = sparse.recalibrated_residuals(load_campaign(folder / "campaign.yaml"))
    scatter = found.dropna().assign(residual=lambda t: t["measured"] - t["base"])
    by_series = scatter.groupby(["run", "channel"])[["residual", "measured"]].std()
    assert (by_series["residual"] < 0.1 * by_series["measured"]).all()  # 1 to 5 % noise
    assert sorted(set(found["run"])) == ["run1", "run2", "run3"]
    assert found.groupby("run")["held_out"].all().sum() == 1


def test_greedy_selection_follows_the_smallest_bic():
    bic = {"base": 100.0, "a": 60.0, "b": 50.0, "a + b": 49.0, "b + c": 51.0, "a + c": 10.0}
    assert greedy_names(bic) == ["a", "b"]
    assert greedy_names({"base": 100.0}) == greedy_names({"a": 1.0}) == []
