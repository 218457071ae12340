"""verdict.json: what people script against, number for number, of fits made up for it."""

import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from jsonschema import validate
from scipy.stats import truncnorm

from benchmarks.project import ROOT
from jointgap.campaign import verdict_json
from jointgap.campaign.outcome import Outcome, outcome_of
from jointgap.config.load import load_campaign
from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError
from jointgap.core.schema import TABLES
from jointgap.identification.evidence import weigh_fit
from jointgap.identification.fit import HALF_WIDTHS, LEVELS, Fit
from jointgap.identification.force_law import ForceLawResult, with_force_law
from jointgap.identification.verdict import Decision, Thresholds

SAMPLES = 100
LN = float(np.log(SAMPLES))
MASS, START = Parameter("mass", 1.0, 0.0, 9.0), Parameter("first_angle", 0.0, run="back")
CAMPAIGN = load_campaign(ROOT / "config/campaigns/demonstration.yaml")


def effect(name, coordinate):
    return Candidate(name, "slider", (Parameter(coordinate, 0.0, -50.0),), (coordinate,))


FRICTION, SPRING = effect("friction", "force_N"), effect("spring", "stiffness_N_m")
CUBE = effect("discovered_slider_force[v^3]", "size")
WAVE = effect("discovered_slider_force[sin(theta)]", "size")


def fitted(effects, values, chi2=64.0, nuisances=(MASS,)):
    """A fit whose parameters have the standard errors 0.1, 0.2, 0.3 ..., apart from bounds."""
    coordinates = [(c.label, p) for c in effects for p in c.coordinates]
    sizes = [Parameter(f"{label}.{p.key}", 0.0, p.low, p.high) for label, p in coordinates]
    residual, jacobian = np.zeros(SAMPLES), np.zeros((SAMPLES, len(values)))
    residual[-1] = chi2**0.5
    np.fill_diagonal(jacobian, 10.0 / np.arange(1, len(values) + 1))
    values = np.array(values, float)
    return Fit(tuple(effects), (*nuisances, *sizes), values, residual, jacobian, 1, "converged")


BASE = fitted([], [1.0], 900.0)


def named_outcome(chosen, base=BASE, equivalent=(), ranking=()):
    rows = pd.DataFrame(ranking, columns=["explanation", "bic"]).assign(admissible=True)
    return Outcome("named", chosen, base, list(equivalent), rows, because="it is so")


def ranked(*rows):
    """A ranking: explanation, BIC, explained share and whether it is admissible."""
    columns = ["explanation", "bic", "explained_share", "admissible"]
    return pd.DataFrame(rows, columns=columns)


def unexplained(ranking, best_known=None):
    because = "it is poor"
    return Outcome("unexplained", BASE, BASE, [], ranking, because, best_known=best_known)


LIMITS = Thresholds(rate=0.01, omnibus=1.05, max_gain_threshold=12.0)


def gaps(after=(1.0, 1.05), fall=(60.0, 64.0)):
    """Table of gaps of both roles, all channels and runs together."""
    falls = {"fall_low": fall[0], "fall_high": fall[1], "fall_expected": 62.0}
    falls |= {"run": "all", "channel": "all"}
    rows = [("identify", 9.0, after[0], after[0]), ("confirm", 8.0, after[1], after[1])]
    return pd.DataFrame(rows, columns=["role", "before", "after", "after_low"]).assign(**falls)


WINDOWS = [
    ("slow", "crank_torque", 350.0, 10.0, 2.0, 1e-9),
    ("fast", "guide_force", 20.0, 40.0, 3.0, 0.004),
]


def document(outcome, campaign=CAMPAIGN, undetectable="gravity", **given):
    """The document of an outcome; tables by name, and other arguments."""
    columns = ["run", "channel", "start_deg", "end_deg", "rms", "p_adjusted"]
    tables = {name: pd.DataFrame(columns=TABLES[name].names) for name in verdict_json.TABLES}
    merged = {"first": ["a", "b"], "second": ["b", "a"], "merged": True}
    tables |= {
        "gaps": gaps(),
        "map_windows": pd.DataFrame(WINDOWS, columns=columns),
        "detectable": pd.DataFrame({"label": [undetectable], "detectable": [False]}),
        "confusability": pd.DataFrame(merged),
    }
    tables |= {name: given.pop(name) for name in tables if name in given}
    return verdict_json.document(outcome, tables, campaign, **given)


def test_the_document_contains_the_decision_the_map_and_the_gaps():
    outcome = named_outcome(fitted([FRICTION], [1.5, 20.0]))
    content = document(outcome)
    empty = "equivalent certain not_searched doubted_channels orders held_out".split()
    fitted_gap, held_out_gap = {"before": 9.0, "after": 1.0}, {"before": 8.0, "after": 1.05}
    expected = {name: [] for name in empty} | {
        "schema_version": 3,
        "campaign": "demonstration",
        "verdict": "named",
        "because": "it is so",
        "basis": "samples",
        "separated_by": "",
        "best_known": None,
        "interval_factor": 1.0,
        "held_out_test": "falls",
        "where": [
            {"run": run, "channel": channel, "crank_angle_deg": [start, end], "p_adjusted": p}
            for run, channel, start, end, _, p in WINDOWS
        ],
        "gap": {"identify": fitted_gap, "confirm": held_out_gap},
        "preflight": {"undetectable": ["gravity"], "merged": [["a", "b"]]},
        "false_alarm_rate": None,
    }
    del content["effects"], content["nuisances"]
    assert content == expected
    assert document(outcome, repeats=False)["basis"] == "statistics"


def test_without_held_out_samples_the_gap_is_that_of_the_fitted_data():
    content = document(
        named_outcome(fitted([FRICTION], [1.5, 20.0])), gaps=gaps().query("role == 'identify'")
    )
    assert (content["verdict"], content["held_out_test"]) == ("named", "nothing_held_out")
    gap = {"identify": {"before": 9.0, "after": 1.0}, "confirm": {"before": None, "after": None}}
    assert content["gap"] == gap
    schema = json.loads((ROOT / "workflow/schemas/verdict.schema.json").read_text(encoding="utf-8"))
    validate(gap, schema | schema["properties"]["gap"] | {"required": ["identify", "confirm"]})


@pytest.mark.parametrize(
    "undetectable, name, has_interval",
    [
        ("common_pin_restitution", "restitution", False),
        ("pin_restitution:crank_pin", "restitution_crank_pin", False),
        ("pin_restitution:crank_pin", "restitution_piston_pin", True),
        ("pin_restitution:crank_pin", "joint_friction", True),
        ("gravity", "restitution", True),
    ],
)
def test_a_nuisance_without_detectable_deviation_has_no_interval(undetectable, name, has_interval):
    base = fitted([], [0.5], nuisances=(Parameter(name, 0.5, -9.0, 9.0),))
    stated = document(named_outcome(base), undetectable=undetectable)["nuisances"][name]
    assert (stated["interval_90"] != [None, None]) == (stated["sd"] is not None) == has_interval
    assert stated["value"] == 0.5 and "kept" not in stated  # as in the mechanism file


def normal(value, sd, **tolerance):
    """A normal number as it is stated: value, standard error and intervals."""
    halves = {level: half_width * sd for level, half_width in HALF_WIDTHS.items()}
    intervals = {
        level: pytest.approx([value - half, value + half], **tolerance)
        for level, half in halves.items()
    }
    return {"value": value, "sd": pytest.approx(sd)} | {
        f"interval_{level}": ends for level, ends in intervals.items()
    }


def test_an_effect_stands_with_its_site_its_gain_over_the_base_and_its_estimates():
    (stated,) = document(named_outcome(fitted([FRICTION], [1.5, 20.0])))["effects"]
    gain = pytest.approx(900.0 - 64.0 - LN)  # one parameter more, worth ln n
    parameters = {"force_N": normal(20.0, 0.2) | {"unit": FRICTION.coordinates[0].unit}}
    key = {"name": "friction", "site": "slider", "delta_bic": gain}
    assert stated == key | {"parameters": parameters}


@pytest.mark.parametrize("bic, gain", [(30.0, 30.0), (np.nan, None)])
def test_each_of_two_effects_has_its_gain_over_the_other_one(bic, gain):
    pair = fitted([FRICTION, SPRING], [1.5, 20.0, 7.0])
    ranking = [("friction", pair.bic + bic), ("spring", pair.bic + 70.0)]
    friction, spring = document(named_outcome(pair, ranking=ranking))["effects"]
    assert (friction["name"], friction["delta_bic"]) == ("friction", pytest.approx(70.0))
    assert (spring["name"], spring["delta_bic"]) == ("spring", gain and pytest.approx(gain))


def test_equivalent_explanations_have_their_gains():
    rivals = [fitted([FRICTION], [1.5, 20.0], 70.0), fitted([SPRING], [1.5, 7.0], 72.0)]
    content = document(named_outcome(BASE, equivalent=rivals))
    effects = [effect for (effect,) in content["equivalent"]]
    assert content["effects"] == []
    assert [effect["name"] for effect in effects] == ["friction", "spring"]
    gains = [effect["delta_bic"] for effect in effects]
    assert gains == pytest.approx([830.0 - LN, 828.0 - LN])


def test_terms_of_a_law_are_one_effect_with_a_formula_beside_the_other_effects():
    chosen = fitted([CUBE, FRICTION, WAVE], [1.5, -2.5, 20.0, 4.0])
    friction, law = verdict_json.effects_of(chosen, {"base": 900.0, "friction": chosen.bic + 55.0})
    # the fit of the law alone is unknown
    assert (friction["name"], friction["delta_bic"]) == ("friction", None)
    assert law["name"] == "discovered_slider_force"
    assert law["site"] == "slider"
    assert law["delta_bic"] == pytest.approx(55.0)
    formula = {"value": "c1*v^3 + c2*sin(theta)"}
    sizes = {"c1": normal(-2.5, 0.2), "c2": normal(4.0, 0.4)}
    assert law["parameters"] == {"formula": formula} | sizes
    law = verdict_json.effects_of(fitted([CUBE], [1.5, -49.9]), {})[
        0
    ]  # the interval ends at the bound
    ends = truncnorm(-0.5, math.inf, -49.9, 0.2).ppf([0.05, 0.95])
    assert law["parameters"]["c1"]["interval_90"] == pytest.approx(ends, abs=0.02)


def test_nuisances_stand_with_value_and_standard_error_or_the_reason_why_there_is_none():
    stated = document(named_outcome(fitted([FRICTION], [9.0, 20.0])))["nuisances"]
    lows, highs = zip(*(stated["mass"].pop(f"interval_{level}") for level in LEVELS), strict=True)
    unit = {"unit": MASS.unit}  # as no list of quantities has it
    at_bound = {"value": 9.0, "sd": None, "remark": "at its bound", "kept": True}
    assert stated == {"mass": at_bound | unit}
    assert sorted(lows, reverse=True) == list(lows) and set(highs) == {9.0}
    chosen = fitted([], [0.3, 1.5], nuisances=(START, MASS))
    assert document(named_outcome(chosen))["nuisances"]["first_angle@back"] == normal(
        0.3, 0.1, abs=0.02
    )
    back = CAMPAIGN.runs[0].model_copy(update={"id": "back", "direction": "clockwise"})
    turned = document(named_outcome(chosen), CAMPAIGN.model_copy(update={"runs": (back,)}))[
        "nuisances"
    ]
    assert turned["first_angle@back"] == normal(-0.3, 0.1, abs=0.02)
    assert turned["mass"]["value"] == 1.5


def test_the_text_has_null_for_numbers_that_are_not_finite_and_is_read_again(tmp_path):
    path = tmp_path / "verdict.json"
    numbers = {"before": np.float64(2.5), "after": math.nan, "runs": (np.int64(3), [np.inf])}
    content = {"schema_version": 3, "campaign": "Prüfstand"}
    path.write_text(verdict_json.text(content | numbers), encoding="utf-8")
    plain = {"before": 2.5, "after": None, "runs": [3, [None]]}
    assert verdict_json.read(path) == content | plain


@pytest.mark.parametrize(
    "text, message",
    [
        ('{"schema_version": 2}', "not a verdict of schema_version 3; repeat the campaign's"),
        ("[1]", "not a verdict of schema_version 3; repeat the campaign's stages"),
        ("{", r"not a verdict .*; run the campaign's stages first"),
        (None, r"not a verdict \(\[Errno 2\]"),
    ],
)
def test_other_files_are_not_read_as_a_verdict(tmp_path, text, message):
    path = tmp_path / "verdict.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=f"verdict.json: {message}"):
        verdict_json.read(path)


def test_what_is_certain_has_the_values_of_the_best_explanation():
    first = fitted([FRICTION, SPRING], [1.5, 20.0, 7.0], 70.0)
    rivals = [first, fitted([WAVE, FRICTION], [1.5, 4.0, 21.0], 72.0)]
    outcome = replace(
        named_outcome(BASE, equivalent=rivals), verdict="ambiguous", certain=("friction",)
    )
    (certain,) = document(outcome)["certain"]
    assert (certain["name"], certain["parameters"]["force_N"]["value"]) == ("friction", 20.0)
    assert document(replace(outcome, certain=()))["certain"] == []
    refuted = unexplained(ranked((first.label, first.bic, 0.56, True)), first)
    content = document(replace(refuted, certain=("spring",), not_searched=("pairs of effects",)))
    (certain,) = content["certain"]
    assert (certain["name"], certain["parameters"]["stiffness_N_m"]["value"]) == ("spring", 7.0)
    assert content["not_searched"] == ["pairs of effects"]


def test_a_named_sensor_fault_has_those_that_predict_the_same_beside_it():
    late, lag = (replace(effect(name, "late_s"), sensor=True) for name in ("delay", "lag"))
    named, twin = (fitted([FRICTION, one], [1.5, 20.0, 2e-3], 70.0) for one in (late, lag))
    friction, fault = document(replace(named_outcome(named), twins=[twin]))["effects"]
    assert "alternatives" not in friction
    assert [
        (one["name"], one["parameters"]["late_s"]["value"]) for one in fault["alternatives"]
    ] == [("lag", 2e-3)]


def test_the_best_candidate_has_its_share_its_test_and_its_nearest_rival():
    best = fitted([FRICTION, SPRING], [1.5, 20.0, 7.0], 400.0)
    ranking = ranked(
        ("friction + spring", best.bic, 0.56, True),
        ("friction", best.bic + 5.0, 0.5, True),  # a part of it is no rival
        ("lost", best.bic + 6.0, 0.5, False),
        ("failed", np.nan, np.nan, True),
        ("wave", best.bic + 432.0, 0.1, True),
    )
    outcome = unexplained(ranking, best)
    content = document(outcome, gaps=gaps((6.0, 5.9), (-3.0, 40.0)), inconsistent=["torque"])
    known, rival = content["best_known"], {"explanation": "wave", "explained_share": 0.1}
    assert content["effects"] == []
    assert [effect["name"] for effect in known["effects"]] == ["friction", "spring"]
    assert content["gap"]["identify"] == {"before": 9.0, "after": 6.0}
    assert content["gap"]["confirm"] == {"before": 8.0, "after": 5.9}
    assert known["explained_share"] == 0.56
    assert known["rival"] == rival | {"behind": pytest.approx(432.0)}
    assert (content["held_out_test"], content["doubted_channels"]) == ("stays", ["torque"])
    assert document(replace(outcome, ranking=ranking.head(1)))["best_known"]["rival"] is None
    assert document(replace(outcome, best_known=None))["best_known"] is None


@pytest.mark.parametrize(
    "chi2, chi2_of_effect, best",
    # alone it has to gain 10 plus ln n over the base of 900
    [(50.0, 60.0, "law"), (70.0, 60.0, "effect"), (880.0, None, "law"), (890.0, None, None)],
)
def test_a_formula_is_best_known_if_it_is_better_than_every_effect(chi2, chi2_of_effect, best):
    law = fitted([CUBE], [1.5, -2.5], chi2)
    effect = chi2_of_effect and fitted([FRICTION], [1.5, 20.0], chi2_of_effect)
    ranking = [weigh_fit(BASE, law, LIMITS)]
    decision = Decision("unexplained", BASE, BASE, best_known=effect)
    result = ForceLawResult(law, False, "it explains little", ranking=ranking)
    outcome = outcome_of(with_force_law(decision, result), {})
    assert outcome.best_known is {"law": law, "effect": effect, None: None}[best]
    (row,) = outcome.placed_ranking.to_dict("records")
    assert row["place"] == ("best_known" if best == "law" else "")


def test_a_listed_effect_that_is_fitted_again_has_one_row_in_the_ranking():
    earlier, better = (fitted([FRICTION], [1.5, 20.0], chi2) for chi2 in (800.0, 70.0))
    decision = Decision("unexplained", BASE, BASE, ranking=[weigh_fit(BASE, earlier, LIMITS)])
    result = ForceLawResult(better, True, "", ranking=[weigh_fit(BASE, better, LIMITS)])
    outcome = outcome_of(with_force_law(decision, result), {})
    assert (outcome.verdict, len(outcome.ranking)) == ("named", 1)
    refuted = replace(outcome, verdict="unexplained", chosen=BASE, best_known=better)
    share = document(refuted)["best_known"]["explained_share"]
    assert share == pytest.approx((900 - 70) / (900 - SAMPLES + 1))


def test_the_gap_after_is_that_of_the_best_candidate_or_of_the_first_equivalent_explanation():
    best = fitted([FRICTION], [1.5, 20.0], 400.0)
    table = gaps((6.0, 1.18), (-3.0, 40.0))
    run = table[table["role"] == "confirm"].assign(run="slow", remark=None)
    table = pd.concat([table, run])
    content = document(unexplained(ranked(("friction", best.bic, 0.2, True)), best), gaps=table)
    gap = {"before": 8.0, "after": 1.18}
    assert content["gap"]["confirm"] == content["held_out"][0]["gap"] == gap
    equivalent = document(named_outcome(BASE, equivalent=[best]), gaps=table)
    assert equivalent["gap"]["confirm"] == gap


def test_the_99_percent_interval_of_a_shape_contains_that_of_90_percent():
    drag = effect("slider_power_drag", "exponent")
    row = ("slider_power_drag", "slider_power_drag", "exponent", 20.0, 19.9, 20.05, True, False)
    families = pd.DataFrame([row], columns=TABLES["law_families"].names)
    chosen = fitted([drag], [1.5, 20.0])
    (stated,) = document(named_outcome(chosen), law_families=families)["effects"]
    shape, (family,) = stated["parameters"]["exponent"], stated["families"]
    assert shape["interval_99"] == family["interval_99"] == shape["interval_90"]
    assert shape["interval_90"][0] < 19.9 and shape["interval_90"][1] > 20.05
