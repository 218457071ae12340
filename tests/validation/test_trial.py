"""A trial from the draw to the score."""

import json

import pytest

from validation.analyse import analyse_trial
from validation.kinds import Trial
from validation.score import score_trial
from validation.trial import make_trial

pytestmark = pytest.mark.integration


@pytest.mark.parametrize(
    ("kind", "base", "effects"),
    [
        ("single", "ideal", ("crank_coulomb_friction",)),
        pytest.param("single", "loose", ("crank_coulomb_friction",), marks=pytest.mark.slow),
        ("nothing", "ideal", ()),
        pytest.param("single", "ideal", ("crank_pin_clearance",), marks=pytest.mark.slow),
    ],
    ids=["one", "one-with-loose-joints", "none", "a-joint-that-became-loose"],
)
def test_the_hidden_effect_alone_is_named(tmp_path, kind, base, effects):
    trial = Trial(kind, base, 5.0 if effects else 0.0, effects, number=8, id="0123456789ab")
    truth = make_trial(trial, 11, tmp_path / trial.id)
    record = analyse_trial(tmp_path / trial.id)
    assert "error" not in record
    row = score_trial(
        json.loads(json.dumps(truth)), json.loads(json.dumps(record, allow_nan=False))
    )
    assert row["outcome"] == "right"


@pytest.mark.slow
@pytest.mark.parametrize("number", range(4))
def test_nothing_is_named_for_a_drifting_crank_without_effects(tmp_path, number):
    plan = {"measured_angle": True, "drift": True, "number": number}
    trial = Trial("nothing", "ideal", **plan, id=f"00000000000{number}")
    truth = make_trial(trial, 61, tmp_path / trial.id)
    record = analyse_trial(tmp_path / trial.id)
    row = score_trial(
        json.loads(json.dumps(truth)), json.loads(json.dumps(record, allow_nan=False))
    )
    assert row["outcome"] == "right"
