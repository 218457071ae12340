"""What a verdict says in words, and the numbers at which it turns: each is met from both sides."""

from jointgap.campaign.page import page, title
from jointgap.campaign.sentences import answer, best_known_summary, held_out_summary
from jointgap.core.page import to_markdown
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.campaign.verdicts import BIAS, COULOMB, NAMED, VERDICTS, WEIGHT
from tests.catalogue import each

TOLERATED = DEFAULT_SETTINGS.decision.noise_gap
UNMET = "The model does not fit the held-out data"
FRICTION = "The model lacks Coulomb friction of the slider"
FAULT = "The measurement has a fault: a bias of the sensor of crank torque (0.5000 N m)."
SHAPE = {"law": "slider_power_drag", "shape": "exponent", "value": 0.4, "interval_99": [0.0, 1.3], "named": True}
LEFT = {"identify": {"before": 9.0, "after": 2.2}, "confirm": {"before": 8.0, "after": 1.0}}


def held_out(verdict, before, after):
    """A verdict of a kind with other gaps on held-out data; what was not added changes nothing."""
    gap = {"identify": {"before": 9.0, "after": 1.0}, "confirm": {"before": before, "after": after}}
    return VERDICTS[verdict] | {"gap": gap}


def test_every_verdict_says_what_is_missing_and_tells_effects_faults_and_families_apart():
    several = VERDICTS["ambiguous"] | {"equivalent": [[COULOMB, BIAS], [COULOMB, WEIGHT]], "certain": [COULOMB]}
    doubted = {"doubted_channels": ["crank_torque", "slider_acceleration"], "best_known": BEST_KNOWN}
    cases = [
        (VERDICTS["no_disagreement"], "No missing effect", "consistent with noise"),
        (VERDICTS["parameters_only"], "No missing effect", "re-fitting", "consistent with noise"),
        (NAMED, f"{FRICTION}.", "consistent with noise"),
        (VERDICTS["named_with_remaining_misfit"] | {"gap": LEFT}, f"{FRICTION}.", "gap falls from 9.00 to 2.20"),
        (VERDICTS["ambiguous"], "An effect is missing", "2 explanations fit equally well", "None was added"),
        (several, "All contain Coulomb friction of the slider."),
        (VERDICTS["unexplained"], "An effect is missing", "no tested effect", "No effect was added"),
        (VERDICTS["unexplained"] | doubted, "Channels are inconsistent", "crank torque and slider acceleration"),
        (NAMED | {"effects": [BIAS]}, f"The mechanism model lacks no effect. {FAULT}"),
        (NAMED | {"effects": [COULOMB, BIAS]}, f"{FRICTION}. {FAULT}"),
        (NAMED | {"effects": [COULOMB, WEIGHT]}, f"{FRICTION} and the weight of the bodies."),
        (NAMED | {"effects": [COULOMB | {"families": [SHAPE]}]}, "drag of the slider (exponent 0 to 1.3; Coulomb"),
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
            assert "No held-out data confirm it" in text and "None" not in text.replace("None was added", "")

    each(says, [*VERDICTS.values(), VERDICTS["unexplained"] | {"best_known": best, "held_out_test": "falls"}])


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
    assert held_out_summary(VERDICTS["parameters_only"]) == "The gap on held-out data is 1.02"  # nothing was added


BEST_KNOWN = {
    "effects": [COULOMB],
    "explained_share": 0.56,
    "gap": {"identify": {"before": 3.0, "after": 2.0}, "confirm": {"before": 3.0, "after": 2.1}},
    "rival": {"explanation": "gravity + slider_spring", "behind": 432.4, "explained_share": 0.31},
}


def unproven(test="falls", **changed):
    """A verdict that shows what is best but not proven."""
    return VERDICTS["unexplained"] | {"best_known": BEST_KNOWN | changed, "held_out_test": test}


def test_the_best_candidate_is_shown_as_not_proven_with_its_share_its_rest_its_test_and_its_rival():
    for share, part in ((0.56, "56 %"), (0.994, "99 %"), (0.996, ""), (1.01, "")):
        said, head = answer(unproven(explained_share=share)), title(unproven(explained_share=share))
        assert "Coulomb friction of the slider (21.30 N)" in said and "not confirmed" in said
        assert (f"{part} of the misfit" in said) == bool(part) and (f"({part})" in head) == bool(part)
    rest, held, rival, _ = best_known_summary(unproven())
    assert "from 3.00 to 2.00" in rest and "56 %" in rest and "from 3.00 to 2.10" in held
    assert "the weight of the bodies and a linear spring on the slider" in rival and "432" in rival
    assert len(best_known_summary(unproven(rival=None))) == 3
    assert best_known_summary(VERDICTS["unexplained"]) == ()


def test_what_would_prove_it_follows_from_what_it_lacks():
    def proves(test, behind, after, words):
        gap = {"identify": {"before": 3.0, "after": 2.0}, "confirm": {"before": 3.0, "after": after}}
        rival = BEST_KNOWN["rival"] | {"behind": behind}
        assert words in best_known_summary(unproven(test, rival=rival, gap=gap))[-1]

    cases = [
        ("rises", 432.0, 4.0, "a held-out run on which its gap falls"),
        ("stays", 432.0, 3.0, "a held-out run on which its gap falls"),
        ("stays", 432.0, 2.6, "explain the remaining"),
        ("falls", 9.9, 2.1, "in which it differs from the next best"),
        ("falls", 10.1, 2.1, "explain the remaining"),
        ("cannot_tell", 432.0, 2.1, "a longer held-out run"),
    ]
    each(proves, cases)
