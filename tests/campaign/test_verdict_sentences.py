"""What a verdict says in words, and the numbers at which it turns: each is met from both sides."""

import re

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
from tests.catalogue import each

TOLERATED = DEFAULT_SETTINGS.decision.noise_gap
UNMET = "The model does not fit the held-out data"
FRICTION = "The model lacks Coulomb friction of the slider"
FAULT = "The measurement has a fault: a bias of the sensor of crank torque (0.5000 N m)."
SHAPE = {
    "law": "slider_power_drag",
    "shape": "exponent",
    "value": 0.4,
    "interval_99": [0.0, 1.3],
    "named": True,
}
LEFT = {"identify": {"before": 9.0, "after": 2.2}, "confirm": {"before": 8.0, "after": 1.0}}


def held_out(verdict, before, after):
    """A verdict of a kind with other gaps on held-out data; what was not added changes nothing."""
    gap = {"identify": {"before": 9.0, "after": 1.0}, "confirm": {"before": before, "after": after}}
    return VERDICTS[verdict] | {"gap": gap}


def test_every_verdict_says_what_is_missing_and_tells_effects_faults_and_families_apart():
    several = VERDICTS["ambiguous"] | {
        "equivalent": [[COULOMB, BIAS], [COULOMB, WEIGHT]],
        "certain": [COULOMB],
    }
    doubted = {
        "doubted_channels": ["crank_torque", "slider_acceleration"],
        "best_known": BEST_KNOWN,
    }
    cases = [
        (VERDICTS["no_disagreement"], "No missing effect", "consistent with noise"),
        (VERDICTS["parameters_only"], "No missing effect", "re-fitting", "consistent with noise"),
        (NAMED, f"{FRICTION}.", "consistent with noise"),
        (
            VERDICTS["named_with_remaining_misfit"] | {"gap": LEFT},
            f"{FRICTION}.",
            "gap falls from 9.00 to 2.20",
        ),
        (
            VERDICTS["ambiguous"],
            "An effect is missing",
            "2 explanations fit equally well",
            "None was added",
        ),
        (
            several,
            (
                "All contain Coulomb friction of the slider (21.30 N); the rest is a bias of the"
                " sensor of crank torque"
            ),
        ),
        (
            VERDICTS["unexplained"],
            "An effect is missing",
            "no tested effect",
            "No effect was added",
        ),
        (
            VERDICTS["unexplained"] | doubted,
            "Channels are inconsistent",
            "crank torque and slider acceleration",
        ),
        (NAMED | {"effects": [BIAS]}, f"The mechanism model lacks no effect. {FAULT}"),
        (NAMED | {"effects": [COULOMB, BIAS]}, f"{FRICTION}. {FAULT}"),
        (NAMED | {"effects": [COULOMB, WEIGHT]}, f"{FRICTION} and the weight of the bodies."),
        (
            NAMED | {"effects": [COULOMB | {"families": [SHAPE]}]},
            "drag of the slider (exponent 0 to 1.3, 99 % interval; Coulomb",
        ),
    ]

    def says(verdict, *parts):
        said = answer(verdict)
        assert [part for part in parts if part not in said] == []
        assert verdict["gap"] != LEFT or "consistent with noise" not in said

    each(says, cases)


def test_up_to_a_gap_of_1_2_held_out_data_count_as_met():
    for gap, met in ((1.2, True), (1.2001, False)):
        for verdict, before in (("named", 9.0), ("no_disagreement", gap), ("parameters_only", gap)):
            assert (UNMET not in answer(held_out(verdict, before, gap))) == met


def test_held_out_runs_that_cannot_be_simulated_are_all_named_with_their_reasons():
    lost = [
        {"run": "fast", "gap": {"before": 8.0, "after": None}, "not_simulated": "it flies off"},
        {"run": "mid", "gap": {"before": 8.0, "after": 1.0}},
        {"run": "slow", "gap": {"before": 8.0, "after": None}, "not_simulated": "it jams"},
    ]
    verdict = held_out("named", 8.7, None) | {"held_out": lost}
    for said in (answer(verdict), held_out_summary(verdict)):
        assert "cannot be simulated in run fast (it flies off) and run slow (it jams)" in said
    assert UNMET not in answer(verdict)
    lost[1]["gap"]["after"] = 5.5
    assert f"{UNMET}: their gap is 5.50" in answer(verdict)


def test_every_page_says_where_no_held_out_sample_can_be_used():
    unused = {"before": None, "after": None}
    best = {"effects": [COULOMB], "explained_share": 0.56, "rival": None}

    def says(verdict):
        gap = verdict["gap"] | {"confirm": unused}
        shown = verdict | {"gap": gap, "best_known": verdict["best_known"] and best | {"gap": gap}}
        shown["held_out_test"] = "nothing_held_out" if verdict["held_out_test"] else None
        for text in (to_markdown(page(shown, {})), f"{answer(shown)} {held_out_summary(shown)}"):
            assert "No held-out data confirm it" in text and "None" not in text.replace(
                "None was added", ""
            )

    each(
        says,
        [
            *VERDICTS.values(),
            VERDICTS["unexplained"] | {"best_known": best, "held_out_test": "falls"},
        ],
    )


def test_how_the_gap_on_held_out_data_goes_once_something_is_added():
    def goes(test, before, after, words):
        said = held_out_summary(held_out("named", before, after) | {"held_out_test": test})
        assert words in said
        assert ("of the excess over noise" in said) == (test == "falls" and before > TOLERATED)

    cases = [
        ("falls", 3.0, 0.9, "falls from 3.00 to 0.90: 100.0 %"),
        ("falls", 3.0, 5.0**0.5, "falls from 3.00 to 2.24: 50.0 %"),
        ("falls", TOLERATED - 1e-6, 0.99, "falls from"),  # of a slight misfit there is no share
        ("falls", TOLERATED + 1e-6, 0.99, "falls from"),
        ("rises", 3.0, 4.0, "rises from 3.00 to 4.00"),
        ("stays", 1.18, 1.18, "stays at 1.18"),
    ]
    each(goes, cases)
    assert (
        held_out_summary(VERDICTS["parameters_only"]) == "The gap on held-out data is 1.02"
    )  # nothing was added


BEST_KNOWN = {
    "effects": [COULOMB],
    "explained_share": 0.56,
    "rival": {"explanation": "gravity + slider_spring", "behind": 432.4, "explained_share": 0.31},
}


def unproven(test="falls", fitted=(3.0, 2.0), held_out=(3.0, 2.1), **changed):
    """A verdict that shows what is best but not proven, with gaps before and after."""
    gap = {"identify": fitted, "confirm": held_out}
    gap = {role: dict(zip(("before", "after"), own, strict=True)) for role, own in gap.items()}
    return VERDICTS["unexplained"] | {
        "best_known": BEST_KNOWN | changed,
        "held_out_test": test,
        "gap": gap,
    }


def test_the_best_candidate_is_shown_as_not_proven_with_its_share_its_rest_its_test_and_its_rival():
    for share, part in ((0.56, "56.0 %"), (0.9994, "99.9 %"), (0.9996, ""), (1.01, "")):
        verdict = unproven(explained_share=share, held_out=(3.0, 2.1 if share < 0.9 else 1.1))
        said, head = answer(verdict), title(verdict)
        assert "Coulomb friction of the slider (21.30 N)" in said and "not confirmed" in said
        assert (f"{part} of the misfit" in said) == bool(part) and (f"({part})" in head) == bool(
            part
        )
    rest, held, rival, _ = best_known_summary(unproven())
    assert "from 3.00 to 2.00" in rest and "from 3.00 to 2.10" in held
    assert "the weight of the bodies and a linear spring on the slider" in rival and "432" in rival
    assert len(best_known_summary(unproven(rival=None))) == 3
    assert best_known_summary(VERDICTS["unexplained"]) == ()


def test_a_best_candidate_that_leaves_a_large_gap_on_held_out_data_does_not_explain_the_misfit():
    for fitted, share in (((82.5, 4.3), 0.997), ((82.5, 4.3), 0.9999), ((82.5, 1.02), 1.0)):
        left = unproven(fitted=fitted, held_out=(35.75, 15.29), explained_share=share)
        said, reduces = (
            answer(left),
            f"reduces the gap of the fitted data from 82.50 to {fitted[1]:.2f}",
        )
        assert (
            "explain" not in f"{title(left)} {said}"
            and reduces in said
            and "a gap of 15.29 remains" in said
        )
    part = answer(unproven(fitted=(82.5, 60.0), held_out=(35.75, 28.0), explained_share=0.47))
    assert (
        "explains 47.0 % of the misfit of the fitted data" in part
        and "a gap of 28.00 remains" in part
    )
    whole = unproven(fitted=(3.0, 1.01), held_out=(3.0, 1.1), explained_share=1.0)
    assert "explains the misfit of the fitted data" in answer(whole)
    worse = answer(unproven(fitted=(3.0, 3.1), explained_share=0.3))
    assert (
        "explains" not in worse
        and "does not reduce the gap of the fitted data, which rises from 3.00 to 3.10" in worse
    )


def test_an_explanation_with_which_the_held_out_gap_rises_is_no_best_candidate():
    for test, after in (("rises", 12.3), ("cannot_tell", 12.3), ("stays", 12.3)):
        verdict = unproven(test, held_out=(5.5, after))
        said = answer(verdict)
        assert (
            "no tested effect explains" in said
            and "best candidate" not in said
            and "from 5.50 to 12.30" in said
        )
        assert title(verdict).startswith(
            "An effect is missing, but no tested effect explains the residual"
        )
        assert not any("To confirm" in line for line in best_known_summary(verdict))


def test_the_share_of_the_misfit_is_given_once_and_that_of_held_out_data_for_named_effects_only():
    verdict = unproven(fitted=(3.0, 1.4), held_out=(2.9, 1.0), explained_share=0.87)
    said = [
        answer(verdict),
        title(verdict),
        held_out_summary(verdict),
        *best_known_summary(verdict),
    ]
    assert {part for text in said for part in re.findall(r"[\d.]+ %", text) if part != "90 %"} == {
        "87.0 %"
    }
    assert "of the excess over noise" in held_out_summary(held_out("named", 2.9, 1.0))
    assert "99.9 % of the excess" in held_out_summary(
        held_out("named", 300.0, 2.0)
    )  # never all while a gap is left


def test_the_difference_to_the_next_best_explanation_is_never_negative_and_a_huge_gain_is_no_number():
    def said(behind):
        return best_known_summary(unproven(rival=BEST_KNOWN["rival"] | {"behind": behind}))[2]

    assert (
        "larger by 432" in said(432.4)
        and "smaller by more than 1000" in said(-3155.0)
        and "the same" in said(0.2)
    )
    assert [format_gain(gain) for gain in (11436382.0, 812.4, -3.0, None)] == [
        "more than 1000",
        "812",
        "none",
        "unknown",
    ]


def test_equivalent_explanations_that_explain_little_say_what_they_leave_on_held_out_data():
    equal = VERDICTS["ambiguous"] | {"held_out_test": "stays"}
    for after, little in ((1.18, True), (1.04, False)):
        verdict = equal | {
            "gap": {
                "identify": {"before": 1.3, "after": 1.2},
                "confirm": {"before": 1.23, "after": after},
            }
        }
        assert ("leaves a gap of 1.18 where it was 1.23" in answer(verdict)) == little


def test_what_is_certain_is_said_for_every_verdict_that_has_it_with_the_rest_that_was_tried():
    effects, rival = (
        [COULOMB, BIAS],
        BEST_KNOWN["rival"] | {"explanation": "slider_coulomb_friction + gravity"},
    )
    verdict = unproven(effects=effects, rival=rival) | {"certain": [COULOMB]}
    rest = (
        "the rest is a bias of the sensor of crank torque or the weight of the bodies, of those"
        " tried"
    )
    assert f"Certain is Coulomb friction of the slider (21.30 N); {rest}." in answer(verdict)
    assert title(verdict).startswith(
        "An effect is missing; certain is Coulomb friction of the slider, 21.30 N"
    )
    alone = unproven(rival=None) | {"certain": [COULOMB]}
    assert "Certain is Coulomb friction of the slider (21.30 N), of those tried." in answer(alone)


def test_nothing_is_certain_if_channels_are_inconsistent_or_the_held_out_data_refute_it():
    best = unproven(effects=[COULOMB, BIAS]) | {"certain": [COULOMB]}
    rising = {"identify": {"before": 9.0, "after": 1.5}, "confirm": {"before": 5.5, "after": 12.3}}
    for verdict in (
        best | {"doubted_channels": ["crank_torque"]},
        best | {"held_out_test": "rises", "gap": rising},
    ):
        assert "ertain is" not in f"{title(verdict)} {answer(verdict)}"


def test_inconsistent_channels_do_not_replace_the_title_of_a_verdict_that_they_do_not_change():
    doubted = {"doubted_channels": ["crank_torque"]}
    for kind in ("no_disagreement", "parameters_only", "ambiguous"):
        assert title(VERDICTS[kind] | doubted) == title(VERDICTS[kind])


def test_steps_that_were_not_searched_are_said():
    (said,) = left_out_summary(
        VERDICTS["unexplained"] | {"not_searched": ["pairs of effects", "slider_spring alone"]}
    )
    assert (
        "limit of simulations" in said
        and "pairs of effects and a linear spring on the slider alone" in said
    )
    assert left_out_summary(VERDICTS["unexplained"]) == ()


def test_a_term_of_a_force_law_is_never_shown_as_a_label():
    law = "a slider force with a formula found by regression"
    because = (
        "the best sum, discovered_slider_force[1] + discovered_slider_force[v*|v|], explains only"
        " 3.0% of it"
    )
    assert (
        names_to_labels(because)
        == f"the best sum, {law} (terms 1 and v*|v|), explains only 3.0% of it"
    )
    assert (
        format_label("gravity + discovered_slider_force[v^3]")
        == f"the weight of the bodies and {law} (term v^3)"
    )
    assert names_to_labels("with gravity + slider_spring it falls").startswith(
        "with the weight of the bodies and a linear"
    )


def test_the_interval_of_a_shape_is_that_of_the_table_of_parameters():
    shape = {"value": 2.0, "sd": 0.1, "interval_90": [1.8, 2.2], "interval_99": [1.6, 2.4]}
    drag = {
        "name": "slider_power_drag",
        "site": "slider",
        "delta_bic": 99.0,
        "parameters": {"exponent": shape},
    }
    drag["families"] = [SHAPE | {"interval_99": [1.6, 2.4]}]
    assert "exponent 1.80 to 2.20, 90 % interval" in format_effect(drag)
    assert estimates([drag])[0].interval == "1.80 to 2.20"


def test_what_would_prove_it_follows_from_what_it_lacks():
    def proves(test, behind, after, words):
        rival = BEST_KNOWN["rival"] | {"behind": behind}
        verdict = unproven(test, held_out=(3.0, after), rival=rival) | {
            "separated_by": "A further run separates them."
        }
        assert words in best_known_summary(verdict)[-1]

    cases = [
        ("rises", 432.0, 4.0, "its BIC is larger"),  # the data contradict it: no advice
        ("stays", 432.0, 3.0, "its BIC is larger"),
        ("stays", 432.0, 2.6, "explain the remaining"),
        ("falls", 9.9, 2.1, "A further run separates them."),  # from the sensitivities
        ("falls", 10.1, 2.1, "explain the remaining"),
        ("cannot_tell", 432.0, 2.1, "a longer held-out run"),
    ]
    each(proves, cases)
