"""Stage decide: what is fitted once more, and what is handed on."""

import pytest

from jointgap.campaign import verdict_json
from jointgap.campaign.fits_on_disk import outcome_of
from jointgap.identification.baseline import recalibrate
from jointgap.identification.fit import fit_hypothesis
from jointgap.identification.model_selection import select_hypothesis
from jointgap.identification.thresholds import screen_candidates
from tests.campaign.conftest import TRUTH
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
