"""Why a trial is not right: the first cause that seal, preflight and fits show."""

import pytest

from jointgap.trials.causes import cause

DRAG, SPRING = frozenset({"slider_quadratic_drag"}), frozenset({"slider_spring"})


def truth(listed=True, idle=False, numerics_gap=1.0, **further) -> dict:
    return {"effects": [{"listed": listed, "idle": idle}], "numerics_gap": numerics_gap} | further


def analysis(merged=(), **chi2) -> dict:
    verdict = {"preflight": {"merged": [list(group) for group in merged]}}
    return {"verdict": verdict, "fits": {"samples": 1000, "chi2": {"base": 2000.0, **chi2}}}


BOTH = {"slider_quadratic_drag": 1010.0, "slider_spring": 1020.0}


@pytest.mark.parametrize(
    ("sealed", "found", "words"),
    [
        (truth(), {"error": "MemoryError"}, "the analysis failed"),
        (truth(damage={"what": "sign"}), analysis(), "data damaged: sign"),
        (truth(listed=False), analysis(**BOTH), "the truth is no candidate"),
        (truth(idle=True), analysis(**BOTH), "an effect that is none: within a stated range"),
        (truth(numerics_gap=1.4), analysis([DRAG | SPRING], **BOTH), "look-alikes, as preflight says"),
        (truth(numerics_gap=1.4), analysis(**BOTH), "the truth itself leaves a gap of 1.4"),
        (truth(), analysis(slider_spring=1020.0), "the truth was not fitted"),
        (truth(), analysis(**BOTH | {"slider_quadratic_drag": 1200.0}), "did not reach it: chi2 1.2 per sample, the"),
        (truth(), analysis(**BOTH), "the truth fits better, chi2 less by 10"),
        (truth(numerics_gap=None), analysis(**BOTH | {"slider_spring": 1003.0}), "fits worse, chi2 more by 7"),
    ],
)
def test_a_wrong_name_has_the_first_cause_that_holds(sealed, found, words):
    assert words in cause(sealed, found, DRAG, SPRING)


def test_a_truth_that_is_left_open_or_that_nothing_need_explain_is_told_so():
    open_ = "the truth is one of several that are equally good"
    assert cause(truth(numerics_gap=1.4), analysis(**BOTH), DRAG, frozenset(), [SPRING, DRAG]) == open_
    assert cause(truth(), analysis(**BOTH), DRAG, frozenset(), [SPRING]) != open_
    found = analysis(slider_spring=1020.0)
    found["verdict"]["verdict"] = "parameters_only"
    assert cause(truth(), found, DRAG, frozenset()) == "the model without it leaves noise alone"


def test_what_nothing_hidden_leaves_is_compared_with_the_base():
    nothing = {"effects": [], "numerics_gap": 1.0}
    assert "did not reach it: chi2 2 per sample" in cause(nothing, analysis(**BOTH), frozenset(), SPRING)
    found = analysis(**BOTH | {"base": 1030.0})
    assert cause(nothing, found, frozenset(), SPRING) == "the truth was reached and fits worse, chi2 more by 10"


def test_where_nothing_is_named_what_counts_is_whether_the_truth_was_reached():
    found = analysis(**{"slider_spring": 1300.0, "slider_quadratic_drag + slider_spring": 1010.0})
    assert "did not reach it" in cause(truth(), found, SPRING, frozenset())
    assert cause(truth(), found, DRAG | SPRING, DRAG | SPRING) == "the fit of the truth reached it"
    assert cause(truth(), analysis() | {"fits": None}, DRAG, frozenset()) == ""
