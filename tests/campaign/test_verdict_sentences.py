"""Sentences of a verdict, whole as a user reads them, and the gaps at which they turn: each is met from both sides."""

import pytest

from jointgap.campaign.page import title
from jointgap.campaign.sentences import answer, best_known_in_words, held_out_in_words
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.campaign.verdicts import BIAS, COULOMB, NAMED, VERDICTS, WEIGHT

FRICTION = "Missing in the model is Coulomb friction of the slider."
TOLERATED = DEFAULT_SETTINGS.decision.tolerated_reduced_chi2


def held_out(verdict, before, after):
    """A verdict of a kind with other gaps on held-out data; what was not added changes nothing."""
    return VERDICTS[verdict] | {
        "gap": {"identify": {"before": 9.0, "after": 1.0}, "confirm": {"before": before, "after": after}}
    }


def test_the_answer_names_a_family_where_the_law_of_the_list_is_not_the_only_one():
    found = {"law": "slider_power_drag", "shape": "exponent", "value": 0.4, "interval_99": [0.0, 1.3], "named": True}
    assert answer(NAMED | {"effects": [COULOMB | {"families": [found]}]}) == (
        "Missing in the model is drag of the slider (exponent 0 to 1.3; Coulomb friction of the slider fits). With "
        "this added the model meets the measurement within the noise."
    )


@pytest.mark.parametrize(
    ("verdict", "sentence"),
    [
        (
            "no_disagreement",
            "Nothing is missing that these data could show: the model as it stands meets the measurement within "
            "the noise.",
        ),
        (
            "parameters_only",
            "No effect is missing that these data could show: with other parameters within their stated ranges the "
            "model meets the measurement within the noise.",
        ),
        ("named", f"{FRICTION} With this added the model meets the measurement within the noise."),
        (
            "named_with_remaining_misfit",
            f"{FRICTION} This closes most of the gap, but not all: a small rest is left that none of the effects tried "
            "explains.",
        ),
        (
            "ambiguous",
            "Something is missing, but these data cannot tell what: 2 explanations fit equally well. None of them was "
            "added to the model.",
        ),
        (
            "unexplained",
            "Something is missing, and it is none of the effects tried: the model and the measurement disagree by more "
            "than the noise, and no explanation holds. No effect was added to the model.",
        ),
    ],
)
def test_the_whole_answer_of_every_verdict(verdict, sentence):
    assert answer(VERDICTS[verdict]) == sentence


@pytest.mark.parametrize(
    ("verdict", "sentence"),
    [
        (
            "no_disagreement",
            "Nothing is missing that the data used for fitting could show: the model as it stands meets them "
            "within the "
            "noise. It does not meet the held-out data: the gap there is 3.00, so something may be missing.",
        ),
        (
            "parameters_only",
            "No effect is missing that the data used for fitting could show: with other parameters within their stated "
            "ranges the model meets them within the noise. It does not meet the held-out data: the gap there is 3.00, "
            "so something may be missing.",
        ),
        (
            "named",
            f"{FRICTION} With this added the model meets the data used for fitting within the noise. It does not meet "
            "the held-out data: the gap there is 2.50, so more may be missing.",
        ),
        (
            "named_with_remaining_misfit",
            f"{FRICTION} With it the model meets the data used for fitting within the noise. It does not meet the "
            "held-out data: the gap there is 2.50, so more may be missing.",
        ),
    ],
)
def test_the_whole_answer_where_held_out_data_are_not_met(verdict, sentence):
    assert answer(held_out(verdict, 3.0, 2.5)) == sentence


def test_an_effect_and_a_fault_of_a_sensor_are_both_taken_into_account():
    assert answer(NAMED | {"effects": [COULOMB, BIAS]}) == (
        "Missing in the model is Coulomb friction of the slider, and the measurement has a fault: a bias of "
        "the sensor of "
        "crank torque (0.5000 N m). With this taken into account the model meets the measurement within the noise."
    )


@pytest.mark.parametrize(("gap", "met"), [(1.2, True), (1.2001, False)])
def test_up_to_a_gap_of_1_2_held_out_data_count_as_met(gap, met):
    for verdict, before, after in (("named", 9.0, gap), ("no_disagreement", gap, 9.0), ("parameters_only", gap, None)):
        assert ("It does not meet the held-out data" not in answer(held_out(verdict, before, after))) == met
    assert ("More than noise is left there" not in held_out_in_words(held_out("named", 9.0, gap))) == met
    assert ("That is more than noise" not in held_out_in_words(held_out("no_disagreement", gap, gap))) == met


@pytest.mark.parametrize(("after", "met"), [(5.0**0.5 - 1e-6, True), (5.0**0.5 + 1e-6, False)])
def test_where_a_rest_is_admitted_half_of_the_squared_excess_may_be_left_on_held_out_data(after, met):
    said = answer(held_out("named_with_remaining_misfit", 3.0, after))  # 3^2 - 1 = 8, of which 5 - 1 = 4 is half
    assert ("It does not meet the held-out data" not in said) == met


def test_the_gap_on_held_out_data_where_nothing_was_added():
    assert held_out_in_words(VERDICTS["parameters_only"]) == "On data that took no part in fitting it is 1.02"
    assert held_out_in_words(VERDICTS["unexplained"]) == "On data that took no part in fitting it is 8.70"
    assert held_out_in_words(held_out("no_disagreement", 3.0, 3.0)) == (
        "On data that took no part in fitting it is 3.00. That is more than noise: what the held-out data "
        "hold is not all "
        "in the model"
    )


@pytest.mark.parametrize(
    ("test", "before", "after", "sentence"),
    [
        ("falls", 3.0, 1.0, "falls from 3.00 to 1.00: 100.0 % of what exceeds the noise is gone"),
        ("falls", 3.0, 0.9, "falls from 3.00 to 0.90: 100.0 % of what exceeds the noise is gone"),
        (
            "falls",
            3.0,
            5.0**0.5,
            "falls from 3.00 to 2.24: 50.0 % of what exceeds the noise is gone. More than noise is left there: "
            "the effect, "
            "or what else the held-out data hold, is not all known",
        ),
        (
            "rises",
            3.0,
            4.0,
            "rises from 3.00 to 4.00, so what was added does not hold there. More than noise is left "
            "there: the effect, or what else the held-out data hold, is not all known",
        ),
        ("falls", 1.184, 1.181, "falls from 1.184 to 1.181: 1.8 % of what exceeds the noise is gone"),
        ("stays", 1.18, 1.18, "stays at 1.18, though it should fall"),
        (
            "cannot_tell",
            1.03,
            1.01,
            "stays within what noise leaves open, 1.03 before and 1.01 after: these data cannot tell, the effect would "
            "hardly show there",
        ),
    ],
)
def test_how_the_gap_on_held_out_data_goes_once_something_is_added(test, before, after, sentence):
    assert held_out_in_words(held_out("named", before, after) | {"held_out_test": test}) == (
        f"On data that took no part in fitting or choosing it {sentence}"
    )


def test_it_is_told_that_features_of_the_cycle_confirm_what_samples_cannot():
    verdict = held_out("named", 3.0, 4.0) | {"held_out_features": {"before": 210.4, "after": 80.6}}
    assert held_out_in_words(verdict) == (
        "On data that took no part in fitting or choosing it the gap goes from 3.00 to 4.00, for impacts ring in "
        "another phase; where in the cycle they come and how hard they are is met, its misfit falls from 210 to 81"
    )


def test_a_name_by_features_is_told_as_that_and_samples_as_not_met():
    features = {"basis": "statistics", "held_out_features": {"before": 210.4, "after": 80.6}}
    told = answer(held_out("named", 3.0, 4.0) | features | {"effects": [COULOMB | {"delta_bic": None}]})
    assert "where in the cycle impacts come and how hard they are" in told
    assert "Single samples it does not meet" in told
    assert "within the noise" not in told
    assert "Single samples" not in answer(held_out("named", 3.0, 4.0))


@pytest.mark.parametrize(("before", "told"), [(TOLERATED**0.5 - 1e-6, False), (TOLERATED**0.5 + 1e-6, True)])
def test_of_a_gap_that_counts_as_a_slight_misfit_no_share_is_told(before, told):
    assert ("of what exceeds the noise is gone" in held_out_in_words(held_out("named", before, 0.99))) == told


def test_held_out_runs_that_cannot_be_simulated_are_all_told_with_their_reasons():
    lost = [
        {"run": "fast", "gap": {"before": 8.0, "after": None}, "not_simulated": "it flies off"},
        {"run": "mid", "gap": {"before": 8.0, "after": 1.0}},
        {"run": "slow", "gap": {"before": 8.0, "after": None}, "not_simulated": "it jams"},
    ]
    reason = (
        "What was added cannot be simulated in run fast (it flies off) and run slow (it jams), so "
        "it is not confirmed there"
    )
    verdict = held_out("named", 8.7, None) | {"held_out": lost}
    assert held_out_in_words(verdict) == (
        f"On data that took no part in fitting or choosing it is 8.70 before anything is added. {reason}"
    )
    assert answer(verdict) == (
        f"{FRICTION} With this added the model meets the data used for fitting within the noise. {reason}."
    )


def test_a_fault_alone_lies_in_the_measurement_and_two_effects_are_in_the_plural():
    assert answer(NAMED | {"effects": [BIAS]}) == (
        "The fault lies in the measurement, not in the mechanism: a bias of the sensor of crank torque (0.5000 N m). "
        "With this taken into account the model meets the measurement within the noise."
    )
    assert answer(NAMED | {"effects": [COULOMB, WEIGHT]}) == (
        "Missing in the model are Coulomb friction of the slider and the weight of the bodies. With this added the "
        "model meets the measurement within the noise."
    )


def test_beside_a_run_that_cannot_be_simulated_the_largest_gap_of_the_others_is_told():
    lost = {"run": "fast", "gap": {"before": 8.0, "after": None}, "not_simulated": "it flies off"}
    others = [{"run": run, "gap": {"before": 6.0, "after": after}} for run, after in (("mid", 5.0), ("low", 5.5))]
    assert answer(held_out("named", 8.7, None) | {"held_out": [lost, *others]}).endswith(
        "so it is not confirmed there. It does not meet the held-out data: the gap in another run is 5.50, so more may "
        "be missing."
    )


BEST_KNOWN = {
    "effects": [COULOMB],
    "explained_share": 0.56,
    "gap": {"identify": {"before": 3.0, "after": 2.0}, "confirm": {"before": 3.0, "after": 2.1}},
    "rival": {"explanation": "gravity + slider_spring", "behind": 432.4, "explained_share": 0.31},
}


def unproven(test="falls", **changed):
    """A verdict that shows what is best but not proven."""
    return VERDICTS["unexplained"] | {"best_known": BEST_KNOWN | changed, "held_out_test": test}


def test_where_an_explanation_is_best_but_not_proven_the_headline_does_not_say_that_there_is_none():
    assert answer(unproven()) == (
        "Something is missing, and it is not proven what. 56 % of what exceeds the noise is explained by Coulomb "
        "friction of the slider (21.30 N). No effect was added to the model."
    )


@pytest.mark.parametrize(
    ("share", "part"), [(0.994, "99 % of what exceeds the noise"), (0.996, "A part"), (1.01, "A part")]
)
def test_what_explains_all_on_the_data_used_for_fitting_is_not_called_a_part_of_a_hundred_percent(share, part):
    assert f"not proven what. {part} is explained by" in answer(unproven(explained_share=share))
    assert ("explained in part (99 %): " in title(unproven(explained_share=share))) == (share < 0.995)


def test_a_held_out_gap_whose_interval_begins_above_noise_is_told_with_the_name():
    gap = {"identify": {"before": 9.0, "after": 1.0}, "confirm": {"before": 8.0, "after": 1.12}}
    said = answer(NAMED | {"verdict": "named_with_remaining_misfit", "gap": gap})
    assert said.endswith("on the held-out data a gap of 1.12 is left, which is more.")


def test_what_is_best_but_not_proven_is_told_with_its_rest_its_test_its_rival_and_what_would_prove_it():
    assert best_known_in_words(unproven()) == (
        "With it the gap on the data used for fitting goes from 3.00 to 2.00: 56.0 % of the misfit is explained.",
        "On data that took no part in fitting or choosing it falls from 3.00 to 2.10.",
        "The next best that is another one, the weight of the bodies and a linear spring on the slider, is 432 of BIC "
        "behind, and explains 31.0 %.",
        "What would prove it: that what it leaves is explained too, by another effect or by parameters with wider "
        "bounds; the map of disagreement and the residuals show where it is.",
    )
    assert best_known_in_words(VERDICTS["unexplained"]) == ()


def test_of_a_gap_that_hardly_shows_no_share_is_told():
    slight = {"identify": {"before": 1.04, "after": 1.02}, "confirm": {"before": 1.03, "after": 1.01}}
    said = best_known_in_words(unproven(gap=slight, rival=None))
    assert said[0] == "With it the gap on the data used for fitting goes from 1.04 to 1.02."
    assert said[2] == "No other explanation was fitted that could be held against it."


@pytest.mark.parametrize(
    ("test", "behind", "words"),
    [
        ("rises", 432.0, "data that took no part, on which its gap falls"),
        ("falls", 9.9, "a speed, a load or a channel in which it differs from its rival"),
        ("falls", 10.1, "that what it leaves is explained too"),
        ("cannot_tell", 432.0, "a held-out run in which it shows"),
        ("not_simulated", 432.0, "a held-out run in which it shows"),
    ],
)
def test_what_would_prove_it_follows_from_what_it_lacks(test, behind, words):
    rival = BEST_KNOWN["rival"] | {"behind": behind}
    assert best_known_in_words(unproven(test, rival=rival))[-1].startswith(f"What would prove it: {words}")


@pytest.mark.parametrize(
    ("after", "words"),
    [
        (3.0, "data that took no part, on which its gap falls. On those held out it does not."),
        (2.6, "that what it leaves is explained too"),
    ],
)
def test_a_held_out_gap_that_falls_too_little_is_not_said_not_to_fall(after, words):
    gap = {"identify": {"before": 9.0, "after": 2.5}, "confirm": {"before": 3.0, "after": after}}
    said = best_known_in_words(unproven("stays", gap=gap))[-1]
    assert said.startswith(f"What would prove it: {words}")


def test_what_all_of_several_explanations_hold_is_certain():
    several = VERDICTS["ambiguous"] | {"equivalent": [[COULOMB, BIAS], [COULOMB, WEIGHT]], "certain": [COULOMB]}
    assert answer(several) == (
        "Certain is Coulomb friction of the slider: all explanations hold it. What acts beside it these data cannot "
        "tell: 2 explanations fit equally well. None of them was added to the model."
    )


@pytest.mark.parametrize(
    ("doubted", "words"),
    [
        (["crank_torque"], "crank torque reads what contradicts other channels"),
        (["crank_torque", "slider_acceleration"], "crank torque and slider acceleration read what contradicts"),
    ],
)
def test_channels_that_contradict_others_head_the_answer(doubted, words):
    said = answer(VERDICTS["unexplained"] | {"doubted_channels": doubted, "best_known": BEST_KNOWN})
    assert said.startswith(f"These data cannot tell what is missing: {words}")


@pytest.mark.parametrize(("after", "part"), [(2.2, "most"), (2.3, "part")])
def test_most_of_the_gap_is_closed_where_more_than_half_of_the_squared_excess_is_gone(after, part):
    verdict = VERDICTS["named_with_remaining_misfit"] | {
        "gap": {"identify": {"before": 3.0, "after": after}, "confirm": {"before": 3.0, "after": 1.0}}
    }
    assert f"This closes {part} of the gap, but not all" in answer(verdict)


def test_a_rest_on_the_held_out_data_alone_is_not_called_one_that_effects_were_tried_on():
    verdict = VERDICTS["named_with_remaining_misfit"] | {
        "held_out_test": "falls",
        "gap": {"identify": {"before": 9.0, "after": 1.0}, "confirm": {"before": 9.0, "after": 1.5}},
    }
    said = answer(verdict)
    assert "meets the data used for fitting within the noise; on the held-out data a gap of 1.50 is left" in said
    assert "tried" not in said


def test_a_name_that_the_held_out_data_hardly_bear_out_is_not_said_to_leave_a_rest_or_to_be_confirmed():
    verdict = VERDICTS["named_with_remaining_misfit"] | {
        "held_out_test": "stays",
        "gap": {"identify": {"before": 1.04, "after": 1.02}, "confirm": {"before": 1.024, "after": 1.022}},
    }
    said = answer(verdict)
    assert "within the noise; on the held-out data the gap falls by less than noise leaves open" in said
    assert "rest" not in said
