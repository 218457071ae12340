"""Sentences of the verdict, and the limits at which they change, from both sides."""

import re

import pytest

from jointgap.campaign.labels import estimates, format_effect, format_label, names_to_labels
from jointgap.campaign.page import page
from jointgap.campaign.sentences import (
    answer,
    best_known_summary,
    format_gain,
    held_out_summary,
    left_out_summary,
    title,
)
from jointgap.core.page import to_markdown
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.campaign.verdicts import BIAS, COULOMB, NAMED, VERDICTS, WEIGHT

NOISE_GAP = DEFAULT_SETTINGS.decision.noise_gap
MISFIT = "The model does not fit the held-out data"
FRICTION = "The model lacks Coulomb friction of the slider"
FAULT = "The measurement has a fault: a bias of the sensor of crank torque (0.5000 N m)."
REMAINING = {"identify": {"before": 9.0, "after": 2.2}, "confirm": {"before": 8.0, "after": 1.0}}
RIVAL = {"explanation": "gravity + slider_spring", "behind": 432.4, "explained_share": 0.31}
BEST_KNOWN = {"effects": [COULOMB], "explained_share": 0.56, "rival": RIVAL}
INCONSISTENT = {"doubted_channels": ["crank_torque", "slider_acceleration"]}
SHAPE = {"law": "slider_power_drag", "shape": "exponent", "value": 0.4}
SHAPE |= {"interval_99": [0.0, 1.3], "named": True}


def held_out(kind, before, after):
    """A verdict with other gaps on held-out data."""
    gap = {"identify": {"before": 9.0, "after": 1.0}, "confirm": {"before": before, "after": after}}
    return VERDICTS[kind] | {"gap": gap}


def candidate(test="falls", fitted=(3.0, 2.0), confirm=(3.0, 2.1), **changes):
    """A verdict with a best candidate that is not confirmed, with gaps before and after."""
    gaps = {"identify": fitted, "confirm": confirm}
    gap = {role: dict(zip(("before", "after"), ends, strict=True)) for role, ends in gaps.items()}
    best = BEST_KNOWN | changes
    return VERDICTS["unexplained"] | {"best_known": best, "held_out_test": test, "gap": gap}


SEVERAL = {"equivalent": [[COULOMB, BIAS], [COULOMB, WEIGHT]], "certain": [COULOMB]}
PARTLY = VERDICTS["named_with_remaining_misfit"] | {"gap": REMAINING}
REFUTED = VERDICTS["unexplained"] | INCONSISTENT | {"best_known": BEST_KNOWN}
FAMILY = NAMED | {"effects": [COULOMB | {"families": [SHAPE]}]}
CERTAIN = "Coulomb friction of the slider (21.30 N)"
ANSWERS = [
    (VERDICTS["no_disagreement"], ["No missing effect", "consistent with noise"]),
    (VERDICTS["parameters_only"], ["No missing effect", "re-fitting", "consistent with noise"]),
    (NAMED, [f"{FRICTION}.", "consistent with noise"]),
    (PARTLY, [f"{FRICTION}. The gap falls from 9.00 to 2.20"]),
    (VERDICTS["ambiguous"], ["An effect is missing: 2 explanations", "None was added"]),
    (VERDICTS["ambiguous"] | SEVERAL, [f"All contain {CERTAIN}; the rest is a bias of the sensor"]),
    (VERDICTS["unexplained"], ["An effect is missing", "no tested effect", "No effect was added"]),
    (REFUTED, ["Channels are inconsistent", "crank torque and slider acceleration"]),
    (NAMED | {"effects": [BIAS]}, [f"The mechanism model lacks no effect. {FAULT}"]),
    (NAMED | {"effects": [COULOMB, BIAS]}, [f"{FRICTION}. {FAULT}"]),
    (NAMED | {"effects": [COULOMB, WEIGHT]}, [f"{FRICTION} and the weight of the bodies."]),
    (FAMILY, ["drag of the slider (exponent 0 to 1.3, 99 % interval; Coulomb"]),
]


@pytest.mark.parametrize("verdict, parts", ANSWERS)
def test_the_answer_tells_effects_faults_and_families(verdict, parts):
    text = answer(verdict)
    assert [part for part in parts if part not in text] == []
    assert verdict["gap"] != REMAINING or "consistent with noise" not in text


@pytest.mark.parametrize("gap, fits", [(1.2, True), (1.2001, False)])
def test_a_held_out_gap_up_to_1_2_counts_as_noise(gap, fits):
    for kind, before in (("named", 9.0), ("no_disagreement", gap), ("parameters_only", gap)):
        assert (MISFIT not in answer(held_out(kind, before, gap))) == fits


def test_held_out_runs_that_cannot_be_simulated_are_listed_with_their_reasons():
    runs = [
        {"run": "fast", "gap": {"before": 8.0, "after": None}, "not_simulated": "it flies off"},
        {"run": "mid", "gap": {"before": 8.0, "after": 1.0}},
        {"run": "slow", "gap": {"before": 8.0, "after": None}, "not_simulated": "it jams"},
    ]
    verdict = held_out("named", 8.7, None) | {"held_out": runs}
    for text in (answer(verdict), held_out_summary(verdict)):
        assert "cannot be simulated in run fast (it flies off) and run slow (it jams)" in text
    assert MISFIT not in answer(verdict)
    runs[1]["gap"]["after"] = 5.5
    assert f"{MISFIT}: their gap is 5.50" in answer(verdict)


@pytest.mark.parametrize("verdict", [*VERDICTS.values(), candidate(rival=None)])
def test_the_page_says_if_no_held_out_sample_can_be_used(verdict):
    gap = verdict["gap"] | {"confirm": {"before": None, "after": None}}
    test = "nothing_held_out" if verdict["held_out_test"] else None
    verdict = verdict | {"gap": gap, "held_out_test": test}
    for text in (to_markdown(page(verdict, {})), f"{answer(verdict)} {held_out_summary(verdict)}"):
        assert "No held-out data confirm it" in text
        assert "None" not in text.replace("None was added", "")


@pytest.mark.parametrize(
    "test, before, after, change",
    [
        ("falls", 3.0, 0.9, "falls from 3.00 to 0.90: 100.0 %"),
        ("falls", 3.0, 5.0**0.5, "falls from 3.00 to 2.24: 50.0 %"),
        ("falls", 300.0, 2.0, "99.9 % of the excess"),  # not all while a gap remains
        ("falls", NOISE_GAP - 1e-6, 0.99, "falls from"),  # of a small misfit there is no share
        ("falls", NOISE_GAP + 1e-6, 0.99, "falls from"),
        ("rises", 3.0, 4.0, "rises from 3.00 to 4.00"),
        ("stays", 1.18, 1.18, "stays at 1.18"),
    ],
)
def test_the_change_of_the_held_out_gap(test, before, after, change):
    text = held_out_summary(held_out("named", before, after) | {"held_out_test": test})
    assert change in text
    assert ("of the excess over noise" in text) == (test == "falls" and before > NOISE_GAP)


@pytest.mark.parametrize(
    "share, text", [(0.56, "56.0 %"), (0.9994, "99.9 %"), (0.9996, ""), (1.01, "")]
)
def test_the_best_candidate_is_not_confirmed_and_has_its_share_once(share, text):
    verdict = candidate(explained_share=share, confirm=(3.0, 2.1 if share < 0.9 else 1.1))
    assert "Coulomb friction of the slider (21.30 N)" in answer(verdict)
    assert "not confirmed" in answer(verdict)
    assert (f"{text} of the misfit" in answer(verdict)) == bool(text)
    assert (f"({text})" in title(verdict)) == bool(text)
    texts = (answer(verdict), title(verdict), *best_known_summary(verdict))
    shares = {part for line in texts for part in re.findall(r"[\d.]+ %", line)} - {"90 %"}
    assert shares == ({text} if text else set())


def test_the_best_candidate_has_its_gaps_and_its_rival():
    fitted, confirm, rival, _ = best_known_summary(candidate())
    assert "from 3.00 to 2.00" in fitted and "from 3.00 to 2.10" in confirm
    assert "the weight of the bodies and a linear spring on the slider" in rival and "432" in rival
    assert len(best_known_summary(candidate(rival=None))) == 3
    assert best_known_summary(VERDICTS["unexplained"]) == ()


@pytest.mark.parametrize("after, share", [(4.3, 0.997), (4.3, 0.9999), (1.02, 1.0)])
def test_a_best_candidate_with_a_large_held_out_gap_does_not_explain_the_misfit(after, share):
    verdict = candidate(fitted=(82.5, after), confirm=(35.75, 15.29), explained_share=share)
    text = answer(verdict)
    assert "explain" not in f"{title(verdict)} {text}"
    assert f"reduces the gap of the fitted data from 82.50 to {after:.2f}" in text
    assert "a gap of 15.29 remains" in text


def test_a_best_candidate_explains_the_misfit_or_does_not_reduce_it():
    complete = candidate(fitted=(3.0, 1.01), confirm=(3.0, 1.1), explained_share=1.0)
    assert "explains the misfit of the fitted data" in answer(complete)
    worse = answer(candidate(fitted=(3.0, 3.1), explained_share=0.3))
    assert "does not reduce the gap of the fitted data, which rises from 3.00 to 3.10" in worse


@pytest.mark.parametrize("test", ["rises", "cannot_tell", "stays"])
def test_an_explanation_with_a_rising_held_out_gap_is_no_best_candidate(test):
    verdict = candidate(test, confirm=(5.5, 12.3))
    text = answer(verdict)
    assert "no tested effect explains" in text and "from 5.50 to 12.30" in text
    assert "best candidate" not in text
    assert title(verdict).endswith("no tested effect explains the residual")
    assert not any("To confirm" in line for line in best_known_summary(verdict))


def test_huge_or_negative_differences_in_bic_are_no_numbers():
    def rival(behind):
        return best_known_summary(candidate(rival=RIVAL | {"behind": behind}))[2]

    assert "larger by 432" in rival(432.4) and "the same" in rival(0.2)
    assert "smaller by more than 1000" in rival(-3155.0)
    gains = [format_gain(gain) for gain in (11436382.0, 812.4, -3.0)]
    assert gains == ["more than 1000", "812", "none"]


@pytest.mark.parametrize("after, is_little", [(1.18, True), (1.04, False)])
def test_equivalent_explanations_that_explain_little_say_so(after, is_little):
    gap = {"identify": {"before": 1.3, "after": 1.2}, "confirm": {"before": 1.23, "after": after}}
    text = answer(VERDICTS["ambiguous"] | {"held_out_test": "stays", "gap": gap})
    assert ("leaves a gap of 1.18 where it was 1.23" in text) == is_little


def test_certain_effects_are_listed_with_the_alternatives():
    rival = RIVAL | {"explanation": "slider_coulomb_friction + gravity"}
    verdict = candidate(effects=[COULOMB, BIAS], rival=rival) | {"certain": [COULOMB]}
    text = "Certain is Coulomb friction of the slider (21.30 N); the rest is a bias of the sensor"
    assert f"{text} of crank torque or the weight of the bodies, of those" in answer(verdict)
    begin = "An effect is missing; certain is Coulomb friction of the slider, 21.30 N"
    assert title(verdict).startswith(begin)
    rising = {"identify": {"before": 9.0, "after": 1.5}, "confirm": {"before": 5.5, "after": 12.3}}
    for refuting in (INCONSISTENT, {"held_out_test": "rises", "gap": rising}):
        assert "ertain is" not in f"{title(verdict | refuting)} {answer(verdict | refuting)}"


@pytest.mark.parametrize("kind", ["no_disagreement", "parameters_only", "ambiguous"])
def test_inconsistent_channels_do_not_change_the_title_of_other_verdicts(kind):
    assert title(VERDICTS[kind] | INCONSISTENT) == title(VERDICTS[kind])


def test_steps_that_were_not_searched_are_listed():
    steps = ["pairs of effects", "slider_spring alone"]
    (text,) = left_out_summary(VERDICTS["unexplained"] | {"not_searched": steps})
    assert text.endswith("pairs of effects and a linear spring on the slider alone.")
    assert left_out_summary(VERDICTS["unexplained"]) == ()


def test_a_term_of_a_force_law_is_never_shown_as_a_label():
    law = "a slider force with a formula found by regression"
    text = "the best sum, discovered_slider_force[1] + discovered_slider_force[v*|v|], explains 3%"
    assert names_to_labels(text) == f"the best sum, {law} (terms 1 and v*|v|), explains 3%"
    label = format_label("gravity + discovered_slider_force[v^3]")
    assert label == f"the weight of the bodies and {law} (term v^3)"


def test_the_interval_of_a_shape_is_that_of_the_table_of_parameters():
    shape = {"value": 2.0, "sd": 0.1, "interval_90": [1.8, 2.2], "interval_99": [1.6, 2.4]}
    drag = {"name": "slider_power_drag", "site": "slider", "parameters": {"exponent": shape}}
    drag["families"] = [SHAPE | {"interval_99": [1.6, 2.4]}]
    assert "exponent 1.80 to 2.20, 90 % interval" in format_effect(drag)
    assert estimates([drag])[0].interval == "1.80 to 2.20"


@pytest.mark.parametrize(
    "test, behind, after, ending",
    [
        ("rises", 432.0, 4.0, "its BIC is larger"),  # the data contradict it: no advice
        ("stays", 432.0, 3.0, "its BIC is larger"),
        ("stays", 432.0, 2.6, "explain the remaining"),
        ("falls", 9.9, 2.1, "A further run separates them."),
        ("falls", 10.1, 2.1, "explain the remaining"),
        ("cannot_tell", 432.0, 2.1, "a longer held-out run"),
    ],
)
def test_the_step_that_confirms_the_best_candidate(test, behind, after, ending):
    verdict = candidate(test, confirm=(3.0, after), rival=RIVAL | {"behind": behind})
    advice = {"separated_by": "A further run separates them."}
    assert ending in best_known_summary(verdict | advice)[-1]
