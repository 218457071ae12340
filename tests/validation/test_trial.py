"""A trial from the draw to the score."""

import json

import pytest

from validation.analyse import analyse_trial
from validation.kinds import Trial
from validation.score import score_trial
from validation.trial import make_trial

pytestmark = pytest.mark.integration


def outcome_of(trial, seed, folder):
    """The outcome of an analysis without error; truth and record pass through JSON."""
    truth, record = make_trial(trial, seed, folder), analyse_trial(folder)
    assert "error" not in record
    return score_trial(
        *(json.loads(json.dumps(each, allow_nan=False)) for each in (truth, record))
    )["outcome"]


LOOSE = pytest.param("single", "loose", ("crank_coulomb_friction",), marks=pytest.mark.slow)
CLEARANCE = pytest.param("single", "ideal", ("crank_pin_clearance",), marks=pytest.mark.slow)
IDEAL = ("single", "ideal", ("crank_coulomb_friction",))


@pytest.mark.parametrize(
    ("kind", "base", "effects"), [IDEAL, LOOSE, ("nothing", "ideal", ()), CLEARANCE]
)
def test_the_hidden_effect_alone_is_named(tmp_path, kind, base, effects):
    trial = Trial(kind, base, 5.0 if effects else 0.0, effects, number=8, id="0123456789ab")
    assert outcome_of(trial, 11, tmp_path / trial.id) == "right"


@pytest.mark.slow
@pytest.mark.parametrize("number", range(4))
def test_nothing_is_named_for_a_drifting_crank_without_effects(tmp_path, number):
    plan = {"measured_angle": True, "drift": True, "number": number}
    trial = Trial("nothing", "ideal", **plan, id=f"00000000000{number}")
    assert outcome_of(trial, 61, tmp_path / trial.id) == "right"
