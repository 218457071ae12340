"""Scores of hand-made ground truths and verdicts."""

import json
import math

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from jointgap.core.errors import InputError
from jointgap.identification.fit import LEVELS
from validation.report import FILES, write_score
from validation.score import (
    LEAST_GAP,
    effect_label,
    named_labels,
    quantile_row,
    rates,
    score_trial,
    score_trials,
)


def hidden(name, site="slider", listed=True, **parameters) -> dict:
    return {"name": name, "site": site, "listed": listed, "parameters": parameters or {"s": 3.0}}


DRAG = hidden("slider_quadratic_drag", drag_N_s2_m2=2.0)
SPRING = hidden("slider_spring", stiffness_N_m=100.0)
VISCOUS = hidden("slider_viscous_friction", damping_N_s_m=2.0)
LAG = hidden("sensor_lag", "crank_torque", lag_s=1e-3)
GAIN = hidden("sensor_gain", "crank_torque", gain_error=0.5)
FIFTH = hidden("fifth_power_drag", listed=False)
STRIBECK = hidden("stribeck_friction", listed=False)
CUBIC = hidden("cubic_spring", listed=False)


def truth(*effects, kind="single", gap=5.0, name="a") -> dict:
    found = {"id": name, "kind": kind, "base": "ideal", "drive": "constant_speed"}
    found |= {"size": 5.0 if effects else 0.0, "effects": list(effects), "numerics_gap": 1.0}
    return found | {"gaps": [gap] * len(effects)}


def same(low, high) -> dict:
    """The same interval at all levels."""
    return {f"interval_{level}": [low, high] for level in LEVELS}


def named(effect, value=None, low=0.0, high=1e3) -> dict:
    key, true = next(iter(effect["parameters"].items()))
    stated = {key: {"value": true if value is None else value, "sd": 1.0, **same(low, high)}}
    return {"name": effect["name"], "site": effect["site"], "parameters": stated}


LISTS = ("effects", "equivalent", "certain", "merged", "undetectable")


def analysis(verdict="named", gap=(4.0, 1.0), **record) -> dict:
    """A record of an analysis; lists of its verdict are empty by default."""
    found = {name: list(record.pop(name, ())) for name in LISTS}
    merged = [list(group) for group in found.pop("merged")]
    found["preflight"] = {"merged": merged, "undetectable": found.pop("undetectable")}
    found |= {"verdict": verdict, "because": "so it is"}
    found["gap"] = {"confirm": {"before": gap[0], "after": gap[1]}}
    return {"id": "a", "seconds": 3.0, "verdict": found, **record}


def ambiguous(*rivals, **more) -> dict:
    equivalent = [[named(effect) for effect in rival] for rival in rivals]
    return {"verdict": "ambiguous", "equivalent": equivalent, **more}


def family(law, low, high, is_named=True) -> dict:
    return {"law": law, "interval_99": [low, high], "named": is_named}


def drag_family(name="slider_quadratic_drag", low=1.6, high=5.0, is_named=True) -> dict:
    families = [family("slider_power_drag", low, high, is_named)]
    return named(DRAG | {"name": name}) | {"families": families}


def spring_family(low, high) -> dict:
    return named(SPRING) | {"families": [family("slider_nonlinear_spring", low, high)]}


COULOMB_OR_STRIBECK = drag_family("slider_coulomb_friction", 0.0, 0.4)
COULOMB_OR_STRIBECK["families"].append(family("slider_stribeck_friction", 0.2, 1.0))
BOTH = ([DRAG, SPRING], [DRAG, LAG])
FORESEEN = {"merged": [["slider_quadratic_drag", "slider_spring"]]}
A, B, C, D = (hidden(name, a=1.0) for name in "abcd")
OUTCOMES = [  # hidden effects, verdict, outcome
    ((DRAG,), {"effects": [named(DRAG)]}, "right"),
    ((DRAG,), {"verdict": "named_with_remaining_misfit", "effects": [named(DRAG)]}, "right"),
    ((DRAG,), {"effects": [named(SPRING)]}, "wrong"),
    ((DRAG,), {"effects": [named(DRAG), named(SPRING)]}, "wrong"),
    ((DRAG,), {"verdict": "unexplained"}, "unexplained"),
    ((DRAG,), {"verdict": "no_disagreement"}, "missed"),
    ((DRAG, SPRING), {"effects": [named(SPRING)]}, "partly"),
    ((LAG,), {"effects": [named(LAG)]}, "right"),
    # a sensor is faulty on its own channel
    ((LAG,), {"effects": [named({**LAG, "site": "guide_force"})]}, "wrong"),
    ((), {"verdict": "no_disagreement"}, "right"),
    ((), {"verdict": "parameters_only"}, "right"),
    ((), {"effects": [named(DRAG)]}, "wrong"),
    ((), {"verdict": "unexplained"}, "unexplained"),
    # certain effects must be hidden
    ((DRAG, SPRING), ambiguous(*BOTH, certain=[named(DRAG)]), "ambiguous"),
    ((SPRING,), ambiguous(*BOTH, certain=[named(DRAG)]), "wrong"),
    ((), ambiguous(*BOTH, certain=[named(DRAG)]), "wrong"),
    # right where preflight foresaw it, each effect of a pair with its own double
    ((DRAG,), ambiguous([DRAG], [SPRING], **FORESEEN), "right"),
    ((DRAG,), ambiguous([DRAG], [SPRING]), "ambiguous"),
    ((DRAG,), ambiguous([SPRING], **FORESEEN), "ambiguous"),
    ((C, D), ambiguous([C, D], [A, B], merged=["ac", "bd"]), "right"),
    ((C, D), ambiguous([C, D], [A, B], merged=["abc"]), "ambiguous"),
    # a family is right where the true law lies in it and its interval holds it
    ((DRAG,), {"effects": [drag_family()]}, "right"),
    ((VISCOUS,), {"effects": [drag_family()]}, "wrong"),
    ((VISCOUS,), {"effects": [drag_family(low=0.8)]}, "right"),
    ((DRAG,), {"effects": [drag_family(low=2.1)]}, "wrong"),
    ((SPRING,), {"effects": [drag_family(low=0.0)]}, "wrong"),
    ((), {"effects": [drag_family(low=0.0)]}, "wrong"),
    ((DRAG, SPRING), {"effects": [drag_family(), named(SPRING)]}, "right"),
    ((DRAG, SPRING), {"effects": [drag_family()]}, "partly"),
    # a law off the list is right as its family alone
    ((FIFTH,), {"effects": [drag_family("slider_power_drag", 4.7, 5.2)]}, "right"),
    ((FIFTH,), {"effects": [drag_family("slider_power_drag", 2.7, 3.2)]}, "wrong"),
    ((FIFTH,), {"effects": [drag_family()]}, "right"),
    ((FIFTH,), {"effects": [drag_family(is_named=False)]}, "wrong"),
    ((CUBIC,), {"effects": [spring_family(0.9, 1.0)]}, "right"),
    ((CUBIC,), {"effects": [spring_family(0.1, 0.6)]}, "wrong"),
    ((STRIBECK,), {"effects": [drag_family("slider_coulomb_friction", 0.0, 0.4)]}, "wrong"),
    ((STRIBECK,), {"effects": [COULOMB_OR_STRIBECK]}, "right"),
]


def test_outcomes_follow_from_names():

    for effects, found, expected in OUTCOMES:
        kind = "single" if all(effect["listed"] for effect in effects) else "off_list"
        kind = "pair" if len(effects) > 1 else kind
        assert score_trial(truth(*effects, kind=kind), analysis(**found))["outcome"] == expected
    assert effect_label(LAG) == "sensor_lag:crank_torque"
    assert score_trial(truth(DRAG), analysis(verdict="unexplained"))["reason"] == "so it is"
    row = score_trial(truth(DRAG), {"id": "a", "error": "InputError: no", "seconds": 1.0})
    assert (row["outcome"], row["reason"], row["detectable"]) == ("failed", "InputError: no", True)


def test_a_discovered_force_is_right_within_10_percent():
    v = np.linspace(-1, 1, 21)
    states = dict.fromkeys(
        ("velocity", "position", "crank_speed", "crank_angle", "time"), [0.5] * 21
    )
    states["velocity"] = v.tolist()
    force = {"kind": "discovered_slider_force", "states": states, "value": (-3 * v**3).tolist()}
    trial_truth = truth(hidden("cubic_drag", listed=False) | {"force": force}, kind="off_list")
    for off, found in ((1.05, "right"), (1.2, "wrong")):
        law = hidden("discovered_slider_force", formula={"value": "-c*v^3"}, c={"value": 3.0 * off})
        assert score_trial(trial_truth, analysis(effects=[law]))["outcome"] == found
    assert score_trial(trial_truth, analysis(effects=[named(DRAG)]))["outcome"] == "wrong"


def test_lag_and_delay_are_right_at_their_own_channel():
    late = {"name": "sensor_delay", "site": "crank_torque"}
    effect = late | {"families": [family("sensor_lag_and_delay", 0.0, 1.0)]}
    for label in ("sensor_lag:crank_torque", "sensor_delay:crank_torque"):
        assert named_labels([effect], frozenset([label])) == {label}
    lag_alone = late | {"families": [family("sensor_lag_and_delay", 0.0, 0.4)]}
    others = (effect, "sensor_lag:guide_force"), (lag_alone, "sensor_delay:crank_torque")
    for found, label in others:
        assert named_labels([found], frozenset([label])) == {"sensor_lag_and_delay:crank_torque"}


def test_undetectable_and_small_effects_are_counted_separately():
    assert pytest.approx(1.5 * 0.84) == LEAST_GAP
    pair = truth(DRAG, SPRING, kind="pair") | {"gaps": [5.0, 1.2]}  # its smallest effect counts
    unseen = analysis(undetectable=["slider_quadratic_drag"])
    cases = [
        (truth(DRAG, gap=LEAST_GAP), analysis(), True, False),
        (truth(DRAG, gap=LEAST_GAP - 1e-9), analysis(), False, False),
        (pair, analysis(), False, False),
        (truth(DRAG), unseen, False, True),
    ]
    for trial_truth, found, detectable, foreseen in cases:
        row = score_trial(trial_truth, found)
        assert (row["detectable"], row["foreseen"]) == (detectable, foreseen)


def test_size_error_coverage_and_closed_share():
    def scores(*effects, gap=(4.0, 1.0)):
        return score_trial(truth(DRAG), analysis(effects=effects, gap=gap))

    row = scores(named(DRAG, 2.1, 1.9, 2.2))
    assert (row["error"], row["covered_90"]) == (pytest.approx(0.05), 1.0)
    assert scores(named(DRAG, 2.1, None, None))["covered_90"] == 0.0
    effects = [named(DRAG, 1.0, 0.5, 2.0), named(SPRING, 110.0, 101.0, 120.0)]
    row = score_trial(truth(DRAG, SPRING, kind="pair"), analysis(effects=effects))
    # 2.0 is covered, 100 is not
    assert (row["error"], row["covered_90"]) == (pytest.approx((0.5 + 0.1) / 2), 0.5)
    for before, after, closed in (
        (3.0, 1.5, 1 - 1.25 / 8),
        (3.0, 5.0, -2.0),
        (1.500001, 1.0, 1.0),
        (3.0, None, 0.0),
        (1.5, 1.0, math.nan),  # too small for a share
    ):
        row = scores(named(DRAG), gap=(before, after))
        assert row["closed"] == pytest.approx(closed, nan_ok=True)


def test_the_interval_of_a_quantile_is_between_order_statistics():
    def row(count, share):
        return quantile_row(pd.Series(np.arange(1.0, count + 1.0)), share)

    for count, low, high in ((1, 1, 1), (5, 1, 5), (6, 1, 6), (9, 2, 8), (20, 6, 15)):
        expected = {"count": count, "low": low, "value": (count + 1) / 2, "high": high}
        assert row(count, 0.5) == expected
    for count in (30, 100):
        low, high = int(row(count, 0.9)["low"]), int(row(count, 0.9)["high"])
        assert low < row(count, 0.9)["value"] < high
        assert binom.cdf(low - 1, count, 0.9) <= 0.025 < binom.cdf(low, count, 0.9)
        if high < count:
            assert binom.sf(high - 1, count, 0.9) <= 0.025 < binom.sf(high - 2, count, 0.9)


def scored(folder, truths, found) -> pd.DataFrame:
    for name, records in (("truth", truths), ("verdicts", found)):
        (folder / name).mkdir(parents=True)
        for record in records:
            (folder / name / f"{record['id']}.json").write_text(json.dumps(record))
    return score_trials(folder)


def test_a_score_has_tables_a_page_and_figures(tmp_path):
    truths = [truth(DRAG, name="a"), truth(name="b", kind="nothing")]
    truths += [truth(DRAG, SPRING, kind="pair", name="c"), truth(SPRING, kind="pair", name="d")]
    found = [
        analysis(effects=[named(DRAG)]),
        analysis("no_disagreement") | {"id": "b"},
        {"id": "c", "error": "SimulationError: it stops", "seconds": 2.0},
        analysis(**ambiguous([DRAG], [SPRING, DRAG])) | {"id": "d"},
    ]
    frame = scored(tmp_path, truths, found)
    shares = rates(frame).set_index(["what", "group"])["value"]
    assert shares["right name", "all"] == shares["nothing found, nothing hidden", "all"] == 1.0
    assert shares["both named and no third", "all"] == 0.0
    text = write_score("hand-made", frame, tmp_path / "score")
    assert "| right name | all | 1 | 1 | 0.025 - 1 |" in text
    assert "SimulationError: it stops" in text
    assert {path.name for path in (tmp_path / "score").iterdir()} >= set(FILES)
    assert pd.read_csv(tmp_path / "score/trials.csv")["id"].tolist() == list("abcd")
    with pytest.raises(InputError, match=r"truth/z\.json: cannot be read .*run `make blind` again"):
        score_trials(tmp_path, ["z"])


def test_bins_of_the_map_are_hits_false_or_missed():
    where = {"run1 crank_torque": [0.0, 0.05, 0.3, 0.6, 3.0, 0.5], "run2 rod_angle": [0.7]}
    found = analysis(effects=[named(DRAG)], map={"run1 crank_torque": [0, 2, 3, 4]})
    row = score_trial(truth(DRAG) | {"where": where}, found)
    assert (row["map_hit"], row["map_false"], row["map_missed"]) == (2, 1, 2)
    assert math.isnan(score_trial(truth(DRAG) | {"where": None}, found)["map_hit"])


def test_f1_is_that_of_all_trials():
    frame = rows_of(*[("single", "ideal", 5.0, 5.0, True, False, "named", "right")] * 3)
    unknown = [np.nan] * 3
    bins, names = [[10.0, 0.0, 0.0], [20.0, 10.0, 10.0]], [[3.0, 1.0, 0.0], [3.0, 0.0, 3.0]]
    frame[["map_hit", "map_false", "map_missed"]] = [*bins, unknown]
    frame[["names_hit", "names_false", "names_missed"]] = [*names, unknown]
    found = rates(frame).set_index(["what", "group"])
    names = [
        found.loc[(f"names: {what}", "all"), "value"] for what in ("precision", "recall", "F1")
    ]
    assert names == pytest.approx([6 / 7, 6 / 9, 12 / 16])
    row = found.loc[("map: F1 of the bins", "all")]
    assert (row["count"], row["value"]) == (2, pytest.approx(60 / 80))
    assert 0.0 < row["low"] < 40 / 60 < row["value"] < row["high"] <= 1.0  # two trials say little
    for effects, names, counts in (
        ([DRAG], [DRAG], (1, 0, 0)),
        ([DRAG], [SPRING], (0, 1, 1)),
        ([DRAG, SPRING], [DRAG], (1, 0, 1)),
        ([FIFTH], [], (0, 0, 0)),
    ):
        row = score_trial(truth(*effects), analysis(effects=[named(one) for one in names]))
        assert (row["names_hit"], row["names_false"], row["names_missed"]) == counts


def test_a_miss_has_a_cause():
    for bic, cause in (
        ({"base": 50.0}, "not fitted"),
        ({"base": 50.0, "slider_quadratic_drag": 10.0}, "fit best"),
        ({"slider_spring": 4.0, "slider_quadratic_drag": 10.0}, "fits better, BIC lower by 6"),
    ):
        assert cause in score_trial(truth(DRAG), analysis(verdict="unexplained", bic=bic))["cause"]
        assert score_trial(truth(DRAG), analysis(effects=[named(DRAG)], bic=bic))["cause"] == ""


COLUMNS = "kind base size gap_caused detectable foreseen verdict outcome".split()
NUMBERS = {"error": 0.1, "closed": 0.9, "gap_after": 1.1, "seconds": 1.0, "nuisances": 8.0}
NUMBERS |= {"covered_50": 0.0, "covered_90": 0.5, "covered_99": 1.0}
NUMBERS |= {f"nuisances_covered_{level}": n for level, n in ((50, 4.0), (90, 7.0), (99, 8.0))}
NUMBERS |= dict.fromkeys(("map_hit", "map_false", "map_missed"), np.nan)
NUMBERS |= dict.fromkeys(("names_hit", "names_false", "names_missed"), np.nan)


def rows_of(*rows) -> pd.DataFrame:
    """Trials of kind, base, size, gap caused, detectable, foreseen, verdict and outcome."""
    frame = pd.DataFrame(rows, columns=COLUMNS)
    effects = np.where(frame["kind"] == "clearance", "piston_pin_clearance", "gravity")
    effects[frame["size"] == 0.0] = "nothing"
    words = {"named": "gravity", "drive": "constant_speed"}
    return frame.assign(hidden=effects, told=False, **words, **NUMBERS)


def counted(frame) -> dict:
    """Hits and trials by rate and group."""
    found = rates(frame).set_index(["what", "group"])
    return {
        key: (round(row["value"] * row["count"]), row["count"]) for key, row in found.iterrows()
    }


def test_every_rate_counts_its_trials():
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
        ("triple", "loose", 5.0, 5.0, True, False, "named", "right"),
        ("triple", "loose", 5.0, 1.1, False, False, "named", "wrong"),  # too small
        ("off_list", "ideal", 5.0, 5.0, True, False, "unexplained", "unexplained"),
        ("off_list", "ideal", 5.0, 5.0, True, False, "named", "right"),
        ("off_list", "ideal", 5.0, 5.0, True, False, "named", "wrong"),
        ("off_list", "loose", 5.0, 5.0, True, False, "ambiguous", "ambiguous"),
        ("nothing", "ideal", 0.0, np.nan, False, False, "no_disagreement", "right"),
        ("nothing", "ideal", 0.0, np.nan, False, False, "failed", "failed"),
        ("single", "chaotic", 5.0, 5.0, True, False, "unfinished", "unfinished"),
        ("coupling", "loose", 5.0, 5.0, True, False, "named", "right"),
        ("eccentric_disc", "ideal", 5.0, 5.0, True, False, "named", "wrong"),
        ("ac_coupled", "ideal", 0.0, 5.0, True, False, "unfinished", "unfinished"),
        ("counter", "ideal", 0.0, np.nan, False, False, "named", "wrong"),
        ("counter", "ideal", 0.0, np.nan, False, False, "no_disagreement", "right"),
    )
    frame.loc[frame["kind"] == "ac_coupled", "hidden"] = "sensor_high_pass:crank_torque"
    shares = counted(frame)
    assert {key[1]: shares[key] for key in shares if key[0] == "right name"} == {
        "all": (2, 6),
        "base ideal": (2, 3),
        "base loose": (0, 1),
        "base chaotic": (0, 2),
        "gap 1.5": (0, 2),
        "gap 5": (2, 3),
        "gap larger than asked for": (0, 1),
        "from Exudyn, joints ideal": (0, 1),
    }
    wanted = {
        "right name": (2, 6),
        "right, of which ambiguous as foreseen": (1, 6),
        "right, small effects too that preflight does not exclude": (2, 7),
        "right name, motion never repeats": (0, 2),
        "wrong name, effect undetectable": (2, 3),
        "missed": (1, 6),
        "wrong name, effect off the list": (1, 4),
        "unexplained or the force found, effect off the list": (2, 4),
        "nothing found, nothing hidden": (1, 2),
        "both named and no third": (0, 2),
        "all three named and no other": (1, 1),
        "wrong name, three effects": (0, 1),
        "undetectable": (3, 12),
        "undetectable, as preflight says": (1, 12),
        "right name, encoder fault": (1, 2),
        "wrong name, encoder fault": (1, 2),
        "right name, AC-coupled channel": (0, 1),
        "wrong name, AC-coupled channel": (0, 1),
        "nothing found, truncating counter": (1, 2),
        "wrong name, truncating counter": (1, 2),
        "failed": (1, 23),
        "unfinished": (2, 23),
        "size within the 90 % interval": (3, 6),  # six halves
        # without triples and the kinds after the unfinished trial
        "nuisance within its 90 % interval": (112, 128),
    }
    assert {what: shares[what, "all"] for what in wanted} == wanted
    assert "drive measured_angle" not in set(rates(frame)["group"])
    shares = counted(frame[:3].assign(drive=["constant_speed", "measured_angle", "measured_angle"]))
    assert shares["right name", "drive constant_speed"] == (1, 1)
    assert shares["right name", "drive measured_angle"] == (1, 2)


def test_hidden_clearances_are_scored_separately():
    frame = rows_of(
        ("single", "ideal", 5.0, 5.0, True, False, "named", "right"),
        ("clearance", "ideal", 5.0, 5.0, True, False, "named", "wrong"),
        ("clearance", "loose", 1.5, 1.5, True, False, "named", "right"),
        # a clearance (set below)
        ("exudyn", "ideal", 5.0, 5.0, True, False, "named", "right"),
        ("exudyn", "loose", 5.0, 5.0, True, False, "named", "missed"),
        ("exudyn", "loose", 0.0, np.nan, False, False, "no_disagreement", "right"),
    )
    frame.loc[3, "hidden"] = "crank_pin_clearance"
    frame["error"] = [0.5, 0.5, 0.11, 0.1, 0.5, np.nan]
    shares = counted(frame)
    wanted = {
        ("right name", "all"): (2, 3),
        ("right name", "from Exudyn, joints loose"): (1, 2),
        ("right joint, a clearance hidden", "all"): (2, 3),
        ("wrong name, a clearance hidden", "all"): (1, 3),
        ("size within 10 %, a clearance named right", "all"): (1, 2),
        ("nothing found, nothing hidden", "from Exudyn, joints loose"): (1, 1),
        ("undetectable", "all"): (0, 3),
        ("undetectable, a clearance hidden", "all"): (0, 3),
    }
    assert {key: shares[key] for key in wanted} == wanted
    assert ("right name", "from Exudyn, joints ideal") not in shares


def damaged(what="sign", *channels):
    damage = {"what": what, "channels": list(channels or ("crank_torque",))}
    return truth(kind="wiring") | {"damage": damage}


DOUBT = {"doubts": [{"run": "run1", "channel": "crank_torque", "other": "", "kind": "sign"}]}


def test_an_unfinished_analysis_abstains_with_its_seconds():
    stopped = {"id": "a", "error": "unfinished", "seconds": 120.0, "code": "1a2b3c"}
    where = {"run1 crank_torque": [0.0, 0.8, 0.3]}
    row = score_trial(truth(DRAG, SPRING, kind="pair") | {"where": where}, stopped)
    assert [row[key] for key in ("verdict", "outcome", "detectable")] == 2 * ["unfinished"] + [True]
    assert (row["seconds"], row["code"]) == (120.0, "1a2b3c")
    assert [row[f"names_{end}"] for end in ("hit", "false", "missed")] == [0, 0, 2]
    assert [row[f"map_{end}"] for end in ("hit", "false", "missed")] == [0, 0, 1]
    assert score_trial(truth(FIFTH, kind="off_list"), stopped)["names_missed"] == 0
    assert score_trial(damaged(), stopped)["outcome"] == "unfinished"


def test_data_faults_are_right_if_the_channel_is_reported():
    error = "InputError: run1.csv, column t: check the run's speed"
    refused = {"id": "a", "seconds": 1.0, "error": error}
    for trial_truth, found, outcome, doubted in (
        (damaged(), analysis(verdict="unexplained", **DOUBT), "right", True),
        (damaged("sign", "guide_force"), analysis(verdict="unexplained", **DOUBT), "missed", False),
        (damaged("gain"), analysis(effects=[named(GAIN)]), "right", True),
        (damaged("gain", "guide_force"), analysis(effects=[named(GAIN)]), "wrong", False),
        (damaged(), analysis(effects=[named(DRAG)], **DOUBT), "wrong", True),
        (damaged(), analysis(verdict="ambiguous", certain=[named(DRAG)], **DOUBT), "wrong", True),
        (damaged("wrong_speed", "time"), refused, "right", True),
        (damaged(), refused, "failed", False),
    ):
        row = score_trial(trial_truth, found)
        assert (row["outcome"], row["told"]) == (outcome, doubted), (trial_truth["damage"], outcome)
    rows = [
        score_trial(damaged(), analysis(verdict="unexplained", **DOUBT)),
        score_trial(damaged("gain"), analysis()),
    ]
    assert rows[0]["hidden"] == "sign: crank_torque"
    shares = counted(pd.DataFrame(rows))
    rate = "told which channel, data wired wrongly"
    assert [shares[rate, group] for group in ("all", "sign", "gain")] == [(1, 2), (1, 1), (0, 1)]


def test_nuisance_coverage_counts_stated_intervals():
    stated = {
        "slider_mass": {"value": 0.5, "sd": 0.1, **same(0.4, 0.6), "interval_50": [0.45, 0.55]},
        "rod_mass": {"value": 0.7, "sd": None, **same(0.65, 0.7), "interval_99": [0.6, 0.8]},
        "rod_inertia": {"value": 0.1, "sd": None, **same(None, None)},
        "first_angle@slow": {"value": 0.1, "sd": 0.1, **same(0.0, 0.2)},
    }
    known = truth(DRAG) | {"nuisances": {"slider_mass": 0.58, "rod_mass": 0.8, "rod_inertia": 0.1}}
    found = analysis(effects=[named(DRAG)])
    found["verdict"]["nuisances"] = stated
    row = score_trial(known, found)
    assert row["nuisances"] == 2.0
    assert [row[f"nuisances_covered_{level}"] for level in LEVELS] == [0.0, 1.0, 2.0]
    found["verdict"]["effects"] = [named(SPRING)]
    assert math.isnan(score_trial(known, found)["nuisances"])
