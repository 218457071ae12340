"""Scores rest on truths and verdicts written down by hand."""

import json
import math

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from jointgap.core.errors import InputError
from jointgap.identification.fit import LEVELS
from validation.analyse import greedy_names
from validation.report import FILES, write_score
from validation.score import BASELINES, LEAST_GAP, effect_label, named_labels, rates, score_trial, score_trials

SHOWN = {"listed": True}
DRAG = {"name": "slider_quadratic_drag", "site": "slider", **SHOWN, "parameters": {"drag_N_s2_m2": 2.0}}
SPRING = {"name": "slider_spring", "site": "slider", **SHOWN, "parameters": {"stiffness_N_m": 100.0}}
LAG = {"name": "sensor_lag", "site": "crank_torque", **SHOWN, "parameters": {"lag_s": 1e-3}}


def truth(*effects, kind="single", gap=5.0, name="a") -> dict:
    return {
        "id": name, "kind": kind, "base": "ideal", "size": 5.0 if effects else 0.0, "effects": list(effects),
        "gaps": [gap] * len(effects), "numerics_gap": 1.0, "drive": "constant_speed",
    }  # fmt: skip


def same(low, high) -> dict:
    """The same interval at all levels."""
    return {f"interval_{level}": [low, high] for level in LEVELS}


def named(effect, value=None, low=0.0, high=1e3) -> dict:
    key, true = next(iter(effect["parameters"].items()))
    stated = {key: {"value": true if value is None else value, "sd": 1.0, **same(low, high)}}
    return {"name": effect["name"], "site": effect["site"], "parameters": stated, "delta_bic": 50.0}


def analysis(
    verdict="named", effects=(), equivalent=(), merged=(), undetectable=(), gap=(4.0, 1.0), certain=(), **more
) -> dict:
    return {
        "id": "a", "seconds": 3.0,
        "verdict": {
            "verdict": verdict, "because": "so it is", "basis": "samples", "effects": list(effects),
            "equivalent": [list(labels) for labels in equivalent], "certain": list(certain),
            "preflight": {"merged": [list(labels) for labels in merged], "undetectable": list(undetectable)},
            "gap": {"confirm": {"before": gap[0], "after": gap[1]}},
        },
        **more,
    }  # fmt: skip


def outcome(*arguments, **keys) -> str:
    return score_trial(truth(*arguments), analysis(**keys))["outcome"]


def test_the_true_name_alone_is_right():
    assert outcome(DRAG, effects=[named(DRAG)]) == "right"
    assert outcome(DRAG, verdict="named_with_remaining_misfit", effects=[named(DRAG)]) == "right"
    assert outcome(DRAG, effects=[named(SPRING)]) == "wrong"
    assert outcome(DRAG, effects=[named(DRAG), named(SPRING)]) == "wrong"
    assert outcome(DRAG, verdict="unexplained") == "unexplained"
    assert outcome(DRAG, verdict="no_disagreement") == "missed"


def test_an_effect_that_is_called_certain_and_is_not_hidden_is_a_wrong_name():
    both = [[named(DRAG), named(SPRING)], [named(DRAG), named(LAG)]]
    assert outcome(DRAG, SPRING, verdict="ambiguous", equivalent=both, certain=[named(DRAG)]) == "ambiguous"
    assert outcome(SPRING, verdict="ambiguous", equivalent=both, certain=[named(DRAG)]) == "wrong"
    assert outcome(verdict="ambiguous", equivalent=both, certain=[named(DRAG)]) == "wrong"


def test_a_faulty_sensor_is_right_on_its_own_channel_alone():
    assert effect_label(LAG) == "sensor_lag:crank_torque"
    assert outcome(LAG, effects=[named(LAG)]) == "right"
    assert outcome(LAG, effects=[named({**LAG, "site": "guide_force"})]) == "wrong"


def test_an_ambiguous_verdict_is_right_where_preflight_foresaw_it():
    both = [[named(DRAG)], [named(SPRING)]]
    merged = [["slider_quadratic_drag", "slider_spring"]]
    assert outcome(DRAG, verdict="ambiguous", equivalent=both, merged=merged) == "right"
    assert outcome(DRAG, verdict="ambiguous", equivalent=both) == "ambiguous"
    assert outcome(DRAG, verdict="ambiguous", equivalent=both[1:], merged=merged) == "ambiguous"


def test_each_effect_of_a_pair_has_its_own_double_where_preflight_foresaw_the_ambiguity():
    def one(name):
        return {"name": name, "site": "slider", **SHOWN, "parameters": {"a": 1.0}}

    a, b, c, d = (one(name) for name in "abcd")
    doubles = [[named(c), named(d)], [named(a), named(b)]]
    ambiguous = {"verdict": "ambiguous", "equivalent": doubles}
    assert score_trial(truth(c, d, kind="pair"), analysis(**ambiguous, merged=["ac", "bd"]))["outcome"] == "right"
    assert score_trial(truth(c, d, kind="pair"), analysis(**ambiguous, merged=["abc"]))["outcome"] == "ambiguous"


def test_with_nothing_hidden_nothing_is_right_and_any_name_is_wrong():
    for verdict in ("no_disagreement", "parameters_only"):
        assert outcome(verdict=verdict) == "right"
    assert outcome(effects=[named(DRAG)]) == "wrong"
    assert outcome(verdict="unexplained") == "unexplained"


def drag_family(name="slider_quadratic_drag", low=1.6, high=5.0, family=True) -> dict:
    """Drag with what the data leave of its exponent."""
    found = {"law": "slider_power_drag", "shape": "exponent", "value": 2.4, "interval_99": [low, high], "named": family}
    return named(DRAG | {"name": name}) | {"families": [found]}


def test_a_family_is_right_where_the_true_law_lies_in_it_and_its_interval_holds_it():
    viscous = {
        "name": "slider_viscous_friction",
        "site": "slider",
        **SHOWN,
        "parameters": {"damping_N_s_m": 2.0},
    }
    assert outcome(DRAG, effects=[drag_family()]) == "right"
    assert outcome(viscous, effects=[drag_family()]) == "wrong"
    assert outcome(viscous, effects=[drag_family(low=0.8)]) == "right"
    assert outcome(DRAG, effects=[drag_family(low=2.1)]) == "wrong"
    assert outcome(SPRING, effects=[drag_family(low=0.0)]) == "wrong"
    assert outcome(effects=[drag_family(low=0.0)]) == "wrong"
    assert outcome(DRAG, SPRING, effects=[drag_family(), named(SPRING)], kind="pair") == "right"
    assert outcome(DRAG, SPRING, effects=[drag_family()], kind="pair") == "partly"


def test_a_law_off_the_list_is_right_as_its_family_and_wrong_as_another_law():
    fifth = {"name": "fifth_power_drag", "site": "slider", "listed": False, "parameters": {"s": 3.0}}
    stribeck = fifth | {"name": "stribeck_friction"}
    assert outcome(fifth, kind="off_list", effects=[drag_family("slider_power_drag", 4.7, 5.2)]) == "right"
    assert outcome(fifth, kind="off_list", effects=[drag_family("slider_power_drag", 2.7, 3.2)]) == "wrong"
    assert outcome(fifth, kind="off_list", effects=[drag_family()]) == "right"
    assert outcome(fifth, kind="off_list", effects=[drag_family(family=False)]) == "wrong"
    assert outcome(stribeck, kind="off_list", effects=[drag_family(low=0.0)]) == "wrong"
    cubic, found = fifth | {"name": "cubic_spring"}, {"law": "slider_nonlinear_spring", "shape": "cubic_share"}
    for low, high, expected in ((0.9, 1.0, "right"), (-0.2, 1.0, "right"), (0.1, 0.6, "wrong")):
        spring = named(SPRING) | {"families": [found | {"interval_99": [low, high], "named": True}]}
        assert outcome(cubic, kind="off_list", effects=[spring]) == expected
    coulomb = {"law": "slider_stribeck_friction", "shape": "stribeck_share", "interval_99": [0.2, 1.0], "named": True}
    both = drag_family("slider_coulomb_friction", 0.0, 0.4)
    assert outcome(stribeck, kind="off_list", effects=[both]) == "wrong"
    assert outcome(stribeck, kind="off_list", effects=[both | {"families": [*both["families"], coulomb]}]) == "right"
    row = score_trial(truth(fifth, kind="off_list"), analysis(effects=[drag_family()]))
    assert row["named"] == "slider_power_drag"


def test_one_of_a_pair_is_but_a_part():
    row = score_trial(truth(DRAG, SPRING, kind="pair"), analysis(effects=[named(SPRING)]))
    assert row["outcome"] == "partly"


def law(formula: str, **coefficients: float) -> dict:
    stated = {key: {"value": value} for key, value in coefficients.items()}
    return {
        "name": "discovered_slider_force", "site": "slider", "delta_bic": 50.0,
        "parameters": {"formula": {"value": formula}, **stated},
    }  # fmt: skip


@pytest.mark.parametrize(("off", "found"), [(1.05, "right"), (1.2, "wrong")])
def test_a_discovered_force_is_right_within_a_tenth_of_the_true_one(off, found):
    v = np.linspace(-1, 1, 21)
    states = dict.fromkeys(("slider_velocity", "slider_position", "crank_speed", "crank_angle", "time"), [0.5] * 21)
    states["slider_velocity"] = v.tolist()
    force = {"kind": "discovered_slider_force", "states": states, "value": (-3 * v**3).tolist()}
    hidden = {
        "name": "cubic_drag",
        "site": "slider",
        "listed": False,
        "parameters": {"s": 3.0},
        "force": force,
    }
    sealed = truth(hidden, kind="off_list")
    assert score_trial(sealed, analysis(effects=[law("-c*v^3", c=3.0 * off)]))["outcome"] == found
    assert score_trial(sealed, analysis(effects=[named(DRAG)]))["outcome"] == "wrong"
    assert score_trial(sealed, analysis(verdict="unexplained"))["outcome"] == "unexplained"


def test_what_preflight_calls_undetectable_is_apart_and_so_is_what_could_not_be_made_large_enough():
    assert score_trial(truth(DRAG), analysis(effects=[named(DRAG)]))["detectable"]
    assert not score_trial(truth(DRAG), analysis(undetectable=["slider_quadratic_drag"]))["detectable"]
    assert not score_trial(truth(DRAG, gap=1.1), analysis())["detectable"]
    assert score_trial(truth(DRAG), analysis(undetectable=["slider_quadratic_drag"]))["foreseen"]
    assert not score_trial(truth(DRAG, gap=1.1), analysis())["foreseen"]


def test_error_coverage_and_the_share_of_the_excess_closed():
    row = score_trial(truth(DRAG), analysis(effects=[named(DRAG, 2.1, 1.9, 2.2)], gap=(3.0, 1.5)))
    assert row["error"] == pytest.approx(0.05)
    assert row["covered_90"] == 1.0
    assert row["closed"] == pytest.approx(1 - 1.25 / 8)
    assert score_trial(truth(DRAG), analysis(effects=[named(DRAG, 2.1, 2.05, 2.2)]))["covered_90"] == 0.0
    assert math.isnan(score_trial(truth(DRAG), analysis(effects=[named(DRAG)], gap=(1.4, 1.0)))["closed"])
    at_a_bound = score_trial(truth(DRAG), analysis(effects=[named(DRAG, 2.1, None, None)], gap=(3.0, None)))
    assert (at_a_bound["covered_90"], at_a_bound["closed"]) == (0.0, 0.0)


def test_what_is_not_named_is_listed_with_the_reason_that_the_verdict_gives():
    assert score_trial(truth(DRAG), analysis(verdict="unexplained"))["reason"] == "so it is"


def test_a_trial_that_failed_counts_and_says_why():
    row = score_trial(truth(DRAG), {"id": "a", "error": "InputError: no", "seconds": 1.0})
    assert (row["outcome"], row["reason"], row["detectable"]) == ("failed", "InputError: no", True)


def test_greedy_steps_follow_the_least_bic_whatever_remains():
    frame = pd.DataFrame(
        {
            "explanation": ["base", "a", "b", "a + b", "b + c", "a + c", "b"],
            "kind": ["base", "single", "single", "pair", "pair", "pair", "single"],
            "bic": [100.0, 60.0, 50.0, 49.0, 51.0, 10.0, 70.0],
        }
    )
    assert greedy_names(frame) == ["a", "b"]
    assert greedy_names(frame[:1]) == []


@pytest.mark.parametrize(("count", "ranks"), [(1, (1, 1)), (5, (1, 5)), (6, (1, 6)), (9, (2, 8)), (20, (6, 15))])
def test_the_interval_of_a_median_lies_between_the_order_statistics_of_the_tables(count, ranks):
    frame = trials_of(seconds=np.arange(1.0, count + 1.0))
    row = rates(frame).set_index(["what", "group"]).loc[("seconds, median", "base ideal")]
    assert (row["low"], row["value"], row["high"]) == (ranks[0], (count + 1) / 2, ranks[1])
    assert row["count"] == count


@pytest.mark.parametrize("count", [30, 100])
def test_the_interval_of_what_nine_of_ten_take_holds_it_in_95_of_100_sets(count):
    frame = trials_of(seconds=np.arange(1.0, count + 1.0))
    row = rates(frame).set_index(["what", "group"]).loc[("seconds, of 90 % at most", "base ideal")]
    assert row["low"] < row["value"] < row["high"]
    low, high = int(row["low"]), int(row["high"])
    assert binom.cdf(low - 1, count, 0.9) <= 0.025 < binom.cdf(low, count, 0.9)  # so few are as rare as half of it
    if high < count:
        assert binom.sf(high - 1, count, 0.9) <= 0.025 < binom.sf(high - 2, count, 0.9)


def trials_of(seconds) -> pd.DataFrame:
    names = [f"t{place}" for place in range(len(seconds))]
    rows = [
        score_trial(
            truth(name=name, kind="nothing"), {**analysis(verdict="no_disagreement"), "id": name, "seconds": one}
        )
        for name, one in zip(names, seconds, strict=True)
    ]
    return pd.DataFrame(rows)


@pytest.fixture
def set_of_trials(tmp_path) -> pd.DataFrame:
    sealed = [truth(DRAG, name="a"), truth(name="b", kind="nothing"), truth(DRAG, SPRING, kind="pair", name="c")]
    sealed.append(truth(SPRING, kind="pair", name="d"))
    found = [
        {
            **analysis(effects=[named(DRAG)], greedy=["slider_quadratic_drag"], sparse=["slider_viscous_friction"]),
            "id": "a",
        },
        {**analysis(verdict="no_disagreement", greedy=[], sparse=None), "id": "b"},
        {"id": "c", "error": "SimulationError: it stops", "seconds": 2.0},
        {**analysis(verdict="ambiguous", equivalent=[[named(DRAG)], [named(SPRING), named(DRAG)]]), "id": "d"},
    ]
    return scored(tmp_path, sealed, found)


def scored(folder, sealed, found) -> pd.DataFrame:
    for name, records in (("sealed", sealed), ("verdicts", found)):
        (folder / name).mkdir(parents=True)
        for record in records:
            (folder / name / f"{record['id']}.json").write_text(json.dumps(record))
    return score_trials(folder)


def test_a_verdict_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"sealed/a\.json: cannot be read .*run `make blind` again"):
        score_trials(tmp_path, ["a"])


def test_a_set_becomes_a_table_a_page_numbers_and_figures(set_of_trials, tmp_path):
    found = rates(set_of_trials).set_index(["what", "group"])["value"]
    assert found["right name", "all"] == 1.0
    assert found["nothing found, nothing hidden", "all"] == 1.0
    assert found["both named and no third", "all"] == 0.0
    assert found["sparse regression: wrong name", "all"] == 1.0
    text = write_score("hand-made", set_of_trials, tmp_path / "score")
    assert "| right name | all | 1 | 1 | 0.025 - 1 |" in text
    assert "SimulationError: it stops" in text
    assert "| slider_quadratic_drag or slider_quadratic_drag + slider_spring |" in text
    assert {path.name for path in (tmp_path / "score").iterdir()} >= set(FILES)
    assert pd.read_csv(tmp_path / "score/trials.csv")["id"].tolist() == list("abcd")


def test_a_wrong_name_counts_where_the_effect_is_undetectable_too(tmp_path):
    sealed = [truth(DRAG, name="a"), truth(DRAG, gap=1.1, name="b"), truth(DRAG, name="c")]
    both = [[named(DRAG)], [named(SPRING)]]
    merged = [["slider_quadratic_drag", "slider_spring"]]
    found = [
        {**analysis(effects=[named(DRAG)]), "id": "a"},
        {**analysis(effects=[named(SPRING)]), "id": "b"},
        {**analysis(verdict="ambiguous", equivalent=both, merged=merged), "id": "c"},
    ]
    score = rates(scored(tmp_path, sealed, found)).set_index(["what", "group"])["value"]
    assert score["wrong name", "all"] == 0.0
    assert score["wrong name, effect undetectable", "all"] == 1.0
    assert (score["right name", "all"], score["right, of which ambiguous as foreseen", "all"]) == (1.0, 0.5)


def test_bins_of_the_map_are_right_false_or_missed_but_for_those_that_hardly_differ():
    shown = truth(DRAG) | {"where": {"run1 crank_torque": [0.0, 0.05, 0.3, 0.6, 3.0, 0.5], "run2 rod_angle": [0.7]}}
    row = score_trial(shown, analysis(effects=[named(DRAG)], map={"run1 crank_torque": [0, 2, 3, 4]}))
    assert (row["map_hit"], row["map_false"], row["map_missed"]) == (2, 1, 2)
    for other in (shown | {"where": None}, truth(DRAG)):
        assert math.isnan(score_trial(other, analysis(effects=[named(DRAG)], map={}))["map_hit"])


def test_f1_of_the_map_is_that_of_the_bins_of_all_trials():
    frame = rows_of(*[("single", "ideal", 5.0, 5.0, True, False, "named", "right")] * 3)
    frame[["map_hit", "map_false", "map_missed"]] = [[10.0, 0.0, 0.0], [20.0, 10.0, 10.0], [np.nan] * 3]
    frame[["names_hit", "names_false", "names_missed"]] = [[3.0, 1.0, 0.0], [3.0, 0.0, 3.0], [np.nan] * 3]
    of_names = rates(frame).set_index(["what", "group"])["value"]
    assert of_names["names: precision", "all"] == pytest.approx(6 / 7)
    assert of_names["names: recall", "all"] == pytest.approx(6 / 9)
    assert of_names["names: F1", "all"] == pytest.approx(12 / 16)
    row = rates(frame).set_index(["what", "group"]).loc[("map: F1 of the bins", "all")]
    assert (row["count"], row["value"]) == (2, pytest.approx(60 / 80))
    assert 40 / 60 <= row["low"] <= row["value"] <= row["high"] <= 1.0


def test_names_are_hit_false_or_missed_and_a_law_off_the_list_cannot_be_missed():
    def counts(hidden, *effects):
        row = score_trial(truth(*hidden), analysis(effects=[named(one) for one in effects]))
        return row["names_hit"], row["names_false"], row["names_missed"]

    assert counts([DRAG], DRAG) == (1, 0, 0)
    assert counts([DRAG], SPRING) == (0, 1, 1)
    assert counts([DRAG, SPRING], DRAG) == (1, 0, 1)
    assert counts([DRAG]) == (0, 0, 1)


@pytest.mark.parametrize(
    "bic, cause",
    [
        ({"base": 50.0}, "not fitted"),
        ({"base": 50.0, "slider_quadratic_drag": 10.0}, "fit best"),
        ({"slider_spring": 4.0, "slider_quadratic_drag": 10.0}, "slider_spring fits better, BIC lower by 6"),
    ],
)
def test_a_miss_has_the_cause_that_the_fits_show(bic, cause):
    assert cause in score_trial(truth(DRAG), analysis(verdict="unexplained", bic=bic))["cause"]
    assert score_trial(truth(DRAG), analysis(effects=[named(DRAG)], bic=bic))["cause"] == ""


def rows_of(*rows) -> pd.DataFrame:
    """A table of trials of kind, base, size, gap caused, detectable, foreseen, verdict and outcome; numbers by hand."""
    names = ("kind", "base", "size", "gap_caused", "detectable", "foreseen", "verdict", "outcome")
    frame = pd.DataFrame([dict(zip(names, row, strict=True)) for row in rows])
    numbers = {"error": 0.1, "covered_90": 0.5, "closed": 0.9, "gap_after": 1.1, "seconds": 1.0}
    numbers |= {"covered_50": 0.0, "covered_99": 1.0, "nuisances_covered_50": 4.0, "nuisances_covered_99": 8.0}
    numbers |= {"nuisances": 8.0, "nuisances_covered_90": 7.0}
    ends = ("hit", "false", "missed")
    numbers |= dict.fromkeys([f"{found}_{end}" for found in ("map", "names") for end in ends], np.nan)
    hidden = np.where(frame["kind"] == "clearance", "piston_pin_clearance", "gravity")
    hidden[frame["size"] == 0.0] = "nothing"
    baselines = dict.fromkeys(BASELINES, "not asked") | {"greedy": "wrong"}
    words = {"named": "gravity", "drive": "constant_speed"}
    return frame.assign(hidden=hidden, told=False, **words, **baselines, **numbers)


def test_names_are_counted_by_drive_where_some_cranks_follow_the_angle_read():
    named = ("single", "ideal", 5.0, 5.0, True, False, "named")
    frame = rows_of((*named, "right"), (*named, "right"), (*named, "wrong"))
    assert "drive measured_angle" not in set(rates(frame)["group"])
    frame["drive"] = ["constant_speed", "measured_angle", "measured_angle"]
    found = rates(frame).set_index(["what", "group"])["value"]
    assert found["right name", "drive constant_speed"] == 1.0
    assert found["right name", "drive measured_angle"] == 0.5


def test_every_rate_counts_the_trials_that_it_says():
    frame = rows_of(
        ("single", "ideal", 5.0, 5.0, True, False, "named", "right"),
        ("single", "ideal", 5.0, 5.7, True, False, "ambiguous", "right"),
        ("single", "loose", 5.0, 6.0, True, False, "named", "wrong"),  # larger than asked for
        ("single", "chaotic", 1.5, 1.5, True, False, "ambiguous", "ambiguous"),
        ("exudyn", "ideal", 1.5, 1.4, True, False, "no_disagreement", "missed"),
        ("single", "ideal", 1.5, 1.1, False, False, "named", "wrong"),  # too small
        ("single", "ideal", 1.5, 1.5, False, True, "named", "right"),  # foreseen
        ("pair", "ideal", 5.0, 5.0, True, False, "named", "partly"),
        ("pair", "ideal", 5.0, 5.0, True, False, "named", "wrong"),
        ("off_list", "ideal", 5.0, 5.0, True, False, "unexplained", "unexplained"),
        ("off_list", "ideal", 5.0, 5.0, True, False, "named", "right"),
        ("off_list", "ideal", 5.0, 5.0, True, False, "named", "wrong"),
        ("off_list", "loose", 5.0, 5.0, True, False, "ambiguous", "ambiguous"),
        ("nothing", "ideal", 0.0, np.nan, False, False, "no_disagreement", "right"),
        ("nothing", "ideal", 0.0, np.nan, False, False, "failed", "failed"),
    )
    found = rates(frame).set_index(["what", "group"])
    shares = {key: (round(row["value"] * row["count"]), row["count"]) for key, row in found.iterrows()}
    assert {key: shares[key] for key in shares if key[0] == "right name"} == {
        ("right name", "all"): (2, 5),
        ("right name", "base ideal"): (2, 3),
        ("right name", "base loose"): (0, 1),
        ("right name", "base chaotic"): (0, 1),
        ("right name", "gap 1.5"): (0, 2),
        ("right name", "gap 5"): (2, 2),
        ("right name", "gap larger than asked for"): (0, 1),
        ("right name", "from Exudyn, joints ideal"): (0, 1),
    }
    assert {key[0]: shares[key] for key in shares if key[1] == "all" and "median" not in key[0]} == {
        "right name": (2, 5),
        "right, of which ambiguous as foreseen": (1, 5),
        "right, small effects too that preflight does not exclude": (2, 6),
        "wrong name": (1, 5),
        "wrong name, effect undetectable": (1, 2),
        "ambiguous": (1, 5),
        "unexplained": (0, 5),
        "missed": (1, 5),
        "wrong name, effect off the list": (1, 4),
        "unexplained or the force found, effect off the list": (2, 4),
        "ambiguous or missed, effect off the list": (1, 4),
        "nothing found, nothing hidden": (1, 2),
        "both named and no third": (0, 2),
        "wrong name, two effects": (1, 2),
        "undetectable": (2, 9),
        "undetectable, as preflight says": (1, 9),
        "failed": (1, 15),
        "size within the 90 % interval": (2, 5),  # five halves, to the even number
        "size within the 50 % interval": (0, 5),
        "size within the 99 % interval": (5, 5),
        "nuisance within its 50 % interval": (60, 120),
        "nuisance within its 90 % interval": (105, 120),
        "nuisance within its 99 % interval": (120, 120),
        "greedy BIC: right name": (0, 5),
        "greedy BIC: wrong name": (5, 5),
        "greedy BIC: false alarm": (2, 2),
        "greedy BIC: wrong name, effect off the list": (4, 4),
    }


def test_clearances_hidden_on_purpose_are_scored_by_themselves_and_those_from_exudyn_by_how_its_joints_are():
    frame = rows_of(
        ("single", "ideal", 5.0, 5.0, True, False, "named", "right"),
        ("clearance", "ideal", 5.0, 5.0, True, False, "named", "wrong"),
        ("clearance", "loose", 1.5, 1.5, True, False, "named", "right"),
        ("exudyn", "ideal", 5.0, 5.0, True, False, "named", "right"),  # a clearance, by what is set below
        ("exudyn", "loose", 5.0, 5.0, True, False, "named", "missed"),
        ("exudyn", "loose", 0.0, np.nan, False, False, "no_disagreement", "right"),
    )
    frame.loc[3, "hidden"] = "crank_pin_clearance"
    frame["error"] = [0.5, 0.5, 0.11, 0.1, 0.5, np.nan]
    found = rates(frame).set_index(["what", "group"])
    shares = {key: (round(row["value"] * row["count"]), row["count"]) for key, row in found.iterrows()}
    assert shares["right name", "all"] == (2, 3)
    assert shares["right name", "from Exudyn, joints loose"] == (1, 2)
    assert ("right name", "from Exudyn, joints ideal") not in shares
    assert shares["right joint, a clearance hidden", "all"] == (2, 3)
    assert shares["wrong name, a clearance hidden", "all"] == (1, 3)
    assert shares["size within 10 %, a clearance named right", "all"] == (1, 2)
    assert shares["nothing found, nothing hidden", "from Exudyn, joints loose"] == (1, 1)
    assert shares["undetectable", "all"] == (0, 3)
    assert shares["undetectable, a clearance hidden", "all"] == (0, 3)


def test_a_trial_is_detectable_from_the_least_gap_on_and_by_its_smallest_effect():
    assert pytest.approx(1.5 * 0.84) == LEAST_GAP
    assert score_trial(truth(DRAG, gap=LEAST_GAP), analysis())["detectable"]
    assert not score_trial(truth(DRAG, gap=LEAST_GAP - 1e-9), analysis())["detectable"]
    both = truth(DRAG, SPRING, kind="pair") | {"gaps": [5.0, 1.2]}
    row = score_trial(both, analysis())
    assert (row["gap_caused"], row["detectable"]) == (1.2, False)


@pytest.mark.parametrize(
    ("before", "after", "closed"), [(3.0, 1.0, 1.0), (3.0, 3.0, 0.0), (3.0, 5.0, -2.0), (1.500001, 1.0, 1.0)]
)
def test_the_share_closed_is_that_of_the_excess_of_the_mean_square(before, after, closed):
    row = score_trial(truth(DRAG), analysis(effects=[named(DRAG)], gap=(before, after)))
    assert (row["gap_before"], row["gap_after"], row["closed"]) == (before, after, pytest.approx(closed))


def test_a_gap_of_one_and_a_half_before_is_too_small_for_a_share():
    assert math.isnan(score_trial(truth(DRAG), analysis(effects=[named(DRAG)], gap=(1.5, 1.0)))["closed"])


def test_errors_of_a_pair_are_averaged_and_ends_of_an_interval_belong_to_it():
    effects = [named(DRAG, 1.0, 0.5, 2.0), named(SPRING, 110.0, 101.0, 120.0)]
    row = score_trial(truth(DRAG, SPRING, kind="pair"), analysis(effects=effects))
    assert (row["error"], row["covered_90"]) == (pytest.approx((0.5 + 0.1) / 2), 0.5)  # 2.0 is covered, 100 is not


def test_a_baseline_that_names_too_much_is_wrong_and_one_of_two_is_partly_right():
    def outcomes(sealed, names):
        row = score_trial(sealed, analysis(greedy=names, sparse=names))
        assert row["greedy"] == row["sparse"]
        return row["greedy"]

    assert outcomes(truth(DRAG), ["slider_quadratic_drag"]) == "right"
    assert outcomes(truth(DRAG), ["slider_quadratic_drag", "gravity"]) == "wrong"
    assert outcomes(truth(DRAG, SPRING, kind="pair"), ["slider_spring"]) == "partly"
    assert outcomes(truth(DRAG), []) == "missed"
    assert outcomes(truth(), []) == "right"
    assert outcomes(truth(), ["gravity"]) == "wrong"
    assert outcomes(truth(DRAG | {"listed": False}, kind="off_list"), ["slider_quadratic_drag"]) == "wrong"
    assert outcomes(truth(DRAG, kind="off_list"), ["slider_quadratic_drag"]) == "right"  # it is a candidate by now


def wired(what="sign", *channels):
    return truth(kind="wiring") | {"damage": {"what": what, "channels": list(channels or ("crank_torque",))}}


DOUBT = {"run": "run1", "channel": "crank_torque", "other": "", "kind": "sign"}
GAIN = {"name": "sensor_gain", "site": "crank_torque", **SHOWN, "parameters": {"gain_error": 0.5}}


def test_wrongly_wired_data_are_right_where_the_channel_is_told_and_no_effect_is_named():
    row = score_trial(wired(), analysis(verdict="unexplained", doubts=[DOUBT]))
    assert (row["outcome"], row["told"], row["hidden"]) == ("right", True, "sign: crank_torque")
    assert not score_trial(wired(), analysis(verdict="unexplained"))["told"]
    row = score_trial(wired("sign", "guide_force"), analysis(verdict="unexplained", doubts=[DOUBT]))
    assert (row["outcome"], row["told"]) == ("missed", False)


def test_a_fault_of_the_damaged_sensor_is_a_right_name_and_any_other_name_is_wrong():
    assert score_trial(wired("gain"), analysis(effects=[named(GAIN)]))["outcome"] == "right"
    assert score_trial(wired("gain", "guide_force"), analysis(effects=[named(GAIN)]))["outcome"] == "wrong"
    row = score_trial(wired(), analysis(effects=[named(DRAG)], doubts=[DOUBT]))
    assert (row["outcome"], row["told"]) == ("wrong", True)
    certain = score_trial(wired(), analysis(verdict="ambiguous", certain=[named(DRAG)], doubts=[DOUBT]))
    assert certain["outcome"] == "wrong"


def test_files_that_are_refused_for_the_damaged_channel_tell_it():
    refused = {"id": "a", "seconds": 1.0, "error": "InputError: run1.csv, column t: check the run's speed"}
    assert score_trial(wired("wrong_speed", "time"), refused)["outcome"] == "right"
    assert score_trial(wired(), refused)["outcome"] == "failed"


def test_the_rates_of_wrongly_wired_data_are_by_base_and_damage():
    rows = [
        score_trial(wired(), analysis(verdict="unexplained", doubts=[DOUBT])),
        score_trial(wired("gain"), analysis()),
    ]
    table = rates(pd.DataFrame(rows))
    told = table[table["what"] == "told which channel, data wired wrongly"].set_index("group")
    assert told.loc[["all", "base ideal", "sign", "gain"], "value"].tolist() == [0.5, 0.5, 1.0, 0.0]


def test_nuisances_count_where_the_model_is_right_and_an_interval_is_stated():
    stated = {
        "slider_mass": {"value": 0.5, "sd": 0.1, **same(0.4, 0.6), "interval_50": [0.45, 0.55]},
        "rod_mass": {"value": 0.7, "sd": None, **same(0.65, 0.7), "interval_99": [0.6, 0.8], "remark": "at its bound"},
        "rod_inertia": {"value": 0.1, "sd": None, **same(None, None), "remark": "changes nothing"},
        "first_angle@slow": {"value": 0.1, "sd": 0.1, **same(0.0, 0.2)},
    }
    known = truth(DRAG) | {"nuisances": {"slider_mass": 0.58, "rod_mass": 0.8, "rod_inertia": 0.1}}
    found = analysis(effects=[named(DRAG)])
    found["verdict"]["nuisances"] = stated
    row = score_trial(known, found)
    assert [row["nuisances"], *(row[f"nuisances_covered_{level}"] for level in LEVELS)] == [2.0, 0.0, 1.0, 2.0]
    found["verdict"]["effects"] = [named(SPRING)]
    assert math.isnan(score_trial(known, found)["nuisances"])


def test_a_late_sensor_that_is_named_as_lag_or_delay_is_right_whichever_it_is_and_at_its_own_channel_alone():
    family = {"law": "sensor_lag_and_delay", "shape": "delay_share", "interval_99": [0.0, 1.0], "named": True}
    effect = {"name": "sensor_delay", "site": "crank_torque", "families": [family]}
    for hidden in ("sensor_lag:crank_torque", "sensor_delay:crank_torque"):
        assert named_labels([effect], frozenset([hidden])) == {hidden}
    others = frozenset(["sensor_lag:guide_force"])
    assert named_labels([effect], others) == {"sensor_lag_and_delay:crank_torque"}
    lag_alone = effect | {"families": [family | {"interval_99": [0.0, 0.4]}]}
    assert named_labels([lag_alone], frozenset(["sensor_delay:crank_torque"])) == {"sensor_lag_and_delay:crank_torque"}
