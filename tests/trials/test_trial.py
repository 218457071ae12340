"""A trial from the seal to the score."""

import json

import pytest

from jointgap.trials.analyse_trial import analysed
from jointgap.trials.make_trial import conceal
from jointgap.trials.score import scored
from jointgap.trials.trial_plan import Plan


@pytest.mark.parametrize(
    ("kind", "base", "size", "effects"),
    [
        ("single", "ideal", 5.0, ("crank_coulomb_friction",)),
        ("single", "loose", 5.0, ("crank_coulomb_friction",)),
        ("nothing", "ideal", 0.0, ()),
    ],
    ids=["one", "one-with-loose-joints", "none"],
)
def test_what_was_hidden_is_named_and_nothing_else(tmp_path, kind, base, size, effects):
    plan = Plan("0123456789ab", 8, kind, base, size, effects)
    truth = conceal(plan, 11, tmp_path / plan.id)
    told = analysed(tmp_path / plan.id, tmp_path / "verdicts")
    assert "error" not in told
    row = scored(json.loads(json.dumps(truth)), json.loads(json.dumps(told, allow_nan=False)))
    assert row["outcome"] == "right"
    assert (tmp_path / "verdicts" / "verdict.json").is_file()
