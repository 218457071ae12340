"""A trial from the seal to the score."""

import json

import pytest

from validation.analyse import analyse_trial
from validation.hide import make_trial
from validation.plan import TrialPlan
from validation.score import score_trial

pytestmark = pytest.mark.integration


@pytest.mark.parametrize(
    ("kind", "base", "size", "effects"),
    [
        ("single", "ideal", 5.0, ("crank_coulomb_friction",)),
        ("single", "loose", 5.0, ("crank_coulomb_friction",)),
        ("nothing", "ideal", 0.0, ()),
        pytest.param("single", "ideal", 5.0, ("crank_pin_clearance",), marks=pytest.mark.slow),
    ],
    ids=["one", "one-with-loose-joints", "none", "a-joint-that-became-loose"],
)
def test_what_was_hidden_is_named_and_nothing_else(tmp_path, kind, base, size, effects):
    plan = TrialPlan("0123456789ab", 8, kind, base, size, effects)
    truth = make_trial(plan, 11, tmp_path / plan.id)
    record = analyse_trial(tmp_path / plan.id)
    assert "error" not in record
    row = score_trial(json.loads(json.dumps(truth)), json.loads(json.dumps(record, allow_nan=False)))
    assert row["outcome"] == "right"
