"""Stage decide: what is fitted once more, and what is handed on."""

import json
from pathlib import Path

import pytest
from jsonschema import validate

from jointgap.campaign import verdict_json
from jointgap.campaign.fits_on_disk import outcome_of
from jointgap.identification.baseline import recalibrate
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.model_selection import select_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.thresholds import screen_candidates
from tests.campaign.conftest import TRUTH
from tests.identification.linear import stairs
from tests.identification.toy import stated_noise, toy


def test_the_other_one_of_two_effects_is_fitted_alone_where_it_never_was():
    model = toy({"coulomb": {"force_N": TRUTH}, "spring": {"stiffness_N_m": 40.0}})
    base = recalibrate(model, stated_noise(model))
    signatures, limits = screen_candidates(base, 0.01)
    by_label = {candidate.label: candidate for candidate in model.candidates}
    pair = fit_hypothesis(base.problem, (by_label["coulomb"], by_label["spring"]))
    coulomb = fit_hypothesis(base.problem, (by_label["coulomb"],))
    spring = fit_hypothesis(base.problem, (by_label["spring"],))
    outcome = outcome_of(select_hypothesis(base, signatures, [pair, coulomb], limits), {})
    assert outcome.chosen.label == "coulomb + spring"
    gains = dict(zip(outcome.ranking["explanation"], outcome.ranking["bic"], strict=True)) | {"base": base.base.bic}
    costs = {one["name"]: one["delta_bic"] for one in verdict_json.effects(outcome.chosen, gains)}
    assert costs["coulomb"] == pytest.approx(spring.bic - pair.bic, rel=1e-3)
    assert costs["spring"] == pytest.approx(coulomb.bic - pair.bic, rel=1e-3)


def test_a_verdict_tells_which_choices_the_runs_have():
    model = stairs({"a": 2, "b": 3})
    found = fit_hypothesis(Problem(model, model.noise), model.candidates, {"rise.rise": 1.0})
    (told,) = verdict_json.effects(found, {})
    assert told["choices"] == {"start@a": 2, "start@b": 3}
    schema = json.loads(Path("workflow/schemas/verdict.schema.json").read_text(encoding="utf-8"))
    validate(verdict_json._finite([told]), {"$ref": "#/$defs/explanation", "$defs": schema["$defs"]})


def test_an_effect_without_choices_tells_of_none():
    model = toy({"coulomb": {"force_N": TRUTH}})
    (coulomb,) = (candidate for candidate in model.candidates if candidate.label == "coulomb")
    (told,) = verdict_json.effects(fit_hypothesis(Problem(model, stated_noise(model)), (coulomb,)), {})
    assert "choices" not in told
