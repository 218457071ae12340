"""verdict.json: what people script against, number for number, of fits made up for it."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import truncnorm

from benchmarks.project import ROOT
from jointgap.campaign import verdict_json
from jointgap.campaign.fits_on_disk import Outcome, outcome_with_law, ranking_frame
from jointgap.config.load import load_campaign
from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError
from jointgap.core.schema import TABLES
from jointgap.identification.evidence import weigh_fit
from jointgap.identification.fit import HALF_WIDTHS, LEVELS, Fit
from jointgap.identification.force_law import ForceLawResult
from jointgap.identification.verdict import Thresholds

SAMPLES = 100
LN = float(np.log(SAMPLES))
MASS = Parameter("mass", 1.0, 0.0, 9.0)
START = Parameter("first_angle", 0.0, run="back")


def effect(name, coordinate, **more):
    return Candidate(name, "slider", (Parameter(coordinate, 0.0, -50.0),), (coordinate,), **more)


def fitted(effects, values, chi2=64.0, nuisances=(MASS,)):
    """A fit with standard errors of 0.1, 0.2, 0.3 ... of its parameters, as far as bounds say nothing."""
    own = [Parameter(f"{c.label}.{p.key}", 0.0, p.low, p.high) for c in effects for p in c.coordinates]
    residual = np.zeros(SAMPLES)
    residual[-1] = chi2**0.5
    jacobian = np.zeros((SAMPLES, len(values)))
    for column in range(len(values)):
        jacobian[column, column] = 10.0 / (column + 1)
    parameters = (*nuisances, *own)
    return Fit(tuple(effects), parameters, np.array(values, float), residual, jacobian, 1, "converged")


FRICTION, SPRING = effect("friction", "force_N"), effect("spring", "stiffness_N_m")
CUBE, WAVE = effect("discovered_slider_force[v^3]", "size"), effect("discovered_slider_force[sin(theta)]", "size")


def outcome_of(chosen, base=None, equivalent=(), ranking=()):
    rows = pd.DataFrame(ranking, columns=["explanation", "bic"]).assign(admissible=True)
    base = base or fitted([], [1.0], 900.0)
    return Outcome("named", chosen, base, list(equivalent), rows, because="it is so")


def gaps(after=(1.0, 1.05), fall=(60.0, 64.0)):
    """Table of gaps of both roles, all channels and runs together."""
    rows = [
        {"role": role, "run": "all", "channel": "all", "before": before, "after": ends}
        | {"fall_low": fall[0], "fall_high": fall[1], "fall_expected": 62.0}
        | {"after_low": ends}
        for role, before, ends in (("identify", 9.0, after[0]), ("confirm", 8.0, after[1]))
    ]
    return pd.DataFrame(rows)


CAMPAIGN = load_campaign(ROOT / "config/campaigns/demonstration.yaml")


def document(outcome, campaign=CAMPAIGN, **given):
    windows = [("slow", "crank_torque", 350.0, 10.0, 2.0, 1e-9), ("fast", "guide_force", 20.0, 40.0, 3.0, 0.004)]
    columns = ["run", "channel", "start_deg", "end_deg", "rms", "p_adjusted"]
    tables = {name: pd.DataFrame(columns=TABLES[name].names) for name in verdict_json.TABLES}
    tables |= {"gaps": given.pop("gaps", gaps()), "map_windows": pd.DataFrame(windows, columns=columns)}
    tables["detectable"] = pd.DataFrame({"label": ["gravity"], "detectable": [False]})
    tables["confusability"] = pd.DataFrame({"first": ["a", "b"], "second": ["b", "a"], "merged": True})
    return verdict_json.document(outcome, tables, campaign, **given)


def test_the_document_holds_what_was_decided_where_it_disagrees_and_how_well_it_is_met():
    chosen = fitted([FRICTION], [1.5, 20.0])
    content = document(outcome_of(chosen))
    assert {key: content[key] for key in content if key not in ("effects", "nuisances")} == {
        "schema_version": 2,
        "campaign": "demonstration",
        "verdict": "named",
        "because": "it is so",
        "basis": "samples",
        "equivalent": [],
        "certain": [],
        "separated_by": "",
        "best_known": None,
        "interval_factor": 1.0,
        "held_out_test": "falls",
        "doubted_channels": [],
        "where": [
            {"run": "slow", "channel": "crank_torque", "crank_angle_deg": [350.0, 10.0], "p_adjusted": 1e-9},
            {"run": "fast", "channel": "guide_force", "crank_angle_deg": [20.0, 40.0], "p_adjusted": 0.004},
        ],
        "orders": [],
        "gap": {"identify": {"before": 9.0, "after": 1.0}, "confirm": {"before": 8.0, "after": 1.05}},
        "held_out": [],
        "preflight": {"undetectable": ["gravity"], "merged": [["a", "b"]]},
        "false_alarm_rate": None,
    }
    assert list(content)[5:9] == ["effects", "equivalent", "certain", "separated_by"]


def normal(value, sd, **tolerance):
    """The intervals of a normal number."""
    halves = {level: half_width * sd for level, half_width in HALF_WIDTHS.items()}
    return {
        f"interval_{level}": pytest.approx([value - half, value + half], **tolerance) for level, half in halves.items()
    }


def test_an_effect_stands_with_its_site_its_gain_over_the_base_and_its_estimates():
    (stated,) = document(outcome_of(fitted([FRICTION], [1.5, 20.0])))["effects"]
    assert (stated["name"], stated["site"], set(stated)) == (
        "friction",
        "slider",
        {"name", "site", "delta_bic", "parameters"},
    )
    assert stated["delta_bic"] == pytest.approx(900.0 - 64.0 - LN)  # one parameter more, worth ln n
    assert stated["parameters"]["force_N"] == {
        "value": 20.0,
        "sd": pytest.approx(0.2),
        **normal(20.0, 0.2),
    }


def test_of_two_effects_each_gains_over_the_other_alone_as_the_ranking_has_it():
    both = fitted([FRICTION, SPRING], [1.5, 20.0, 7.0])
    ranking = [("friction", both.bic + 30.0), ("spring", both.bic + 70.0), ("unheard_of", np.nan)]
    friction, spring = document(outcome_of(both, ranking=ranking))["effects"]
    assert (friction["name"], spring["name"]) == ("friction", "spring")
    assert (friction["delta_bic"], spring["delta_bic"]) == (pytest.approx(70.0), pytest.approx(30.0))
    friction, spring = document(outcome_of(both, ranking=[("friction", np.nan), *ranking[1:]]))["effects"]
    assert (friction["delta_bic"], spring["delta_bic"]) == (pytest.approx(70.0), None)


def test_explanations_that_fit_equally_well_are_lists_of_effects_with_their_gains():
    rivals = [fitted([FRICTION], [1.5, 20.0], 70.0), fitted([SPRING], [1.5, 7.0], 72.0)]
    content = document(outcome_of(fitted([], [1.0], 900.0), equivalent=rivals))
    assert content["effects"] == []
    assert [[one["name"] for one in rival] for rival in content["equivalent"]] == [["friction"], ["spring"]]
    assert [rival[0]["delta_bic"] for rival in content["equivalent"]] == pytest.approx([830.0 - LN, 828.0 - LN])


def test_terms_of_a_law_are_one_effect_with_a_formula_beside_the_other_effects():
    chosen = fitted([CUBE, FRICTION, WAVE], [1.5, -2.5, 20.0, 4.0])
    friction, law = verdict_json.effects(chosen, {"base": 900.0, "friction": chosen.bic + 55.0})
    assert friction["name"] == "friction"
    assert friction["delta_bic"] is None  # the law alone is not known
    assert (law["name"], law["site"], law["delta_bic"]) == ("discovered_slider_force", "slider", pytest.approx(55.0))
    assert list(law["parameters"]) == ["formula", "c1", "c2"]
    assert law["parameters"]["formula"] == {"value": "c1*v^3 + c2*sin(theta)"}
    assert law["parameters"]["c1"] == {
        "value": -2.5,
        "sd": pytest.approx(0.2),
        **normal(-2.5, 0.2),
    }
    assert (law["parameters"]["c2"]["value"], law["parameters"]["c2"]["sd"]) == (4.0, pytest.approx(0.4))


def test_the_interval_of_a_coefficient_ends_at_its_bound():
    law = verdict_json.effects(fitted([CUBE], [1.5, -49.9]), {})[0]
    assert law["parameters"]["c1"]["interval_90"] == pytest.approx(
        truncnorm(-0.5, math.inf, -49.9, 0.2).ppf([0.05, 0.95]), abs=0.02
    )


def test_nuisances_stand_with_value_and_standard_error_or_the_reason_why_there_is_none():
    chosen = fitted([FRICTION], [9.0, 20.0])
    stated = document(outcome_of(chosen))["nuisances"]
    lows, highs = zip(*(stated["mass"].pop(f"interval_{level}") for level in LEVELS), strict=True)
    assert stated == {"mass": {"value": 9.0, "sd": None, "remark": "at its bound", "kept": True}}
    assert sorted(lows, reverse=True) == list(lows) and set(highs) == {9.0}
    chosen = fitted([], [0.3, 1.5], nuisances=(START, MASS))
    angle = {"value": 0.3, "sd": pytest.approx(0.1)} | normal(0.3, 0.1, abs=0.02)
    assert document(outcome_of(chosen))["nuisances"]["first_angle@back"] == angle
    back = CAMPAIGN.runs[0].model_copy(update={"id": "back", "direction": "clockwise"})
    turned = document(outcome_of(chosen), CAMPAIGN.model_copy(update={"runs": (back,)}))["nuisances"]
    mirrored = {"value": -0.3} | normal(-0.3, 0.1, abs=0.02)
    assert turned["first_angle@back"] == angle | mirrored
    assert turned["mass"]["value"] == 1.5


def test_the_text_has_null_for_what_is_no_number_and_plain_numbers_for_arrays_ones():
    content = {
        "gap": {"before": np.float64(2.5), "after": float("nan")},
        "runs": (np.int64(3), [np.inf, "µ"]),
        "held_out": None,
    }
    assert verdict_json.text(content) == (
        '{\n  "gap": {\n    "before": 2.5,\n    "after": null\n  },\n'
        '  "runs": [\n    3,\n    [\n      null,\n      "µ"\n    ]\n  ],'
        '\n  "held_out": null\n}\n'
    )
    assert verdict_json.text({"low": np.float32(-np.inf), "ok": True}) == '{\n  "low": null,\n  "ok": true\n}\n'


def test_a_document_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "verdict.json"
    path.write_text(verdict_json.text({"schema_version": 2, "campaign": "Prüfstand"}), encoding="utf-8")
    assert verdict_json.read(path) == {"schema_version": 2, "campaign": "Prüfstand"}


def test_a_document_is_read_as_utf_8():
    asked = []
    path = SimpleNamespace(read_text=lambda encoding: asked.append(encoding) or '{"schema_version": 2}')
    verdict_json.read(path)
    assert asked == ["utf-8"]


@pytest.mark.parametrize("content", [{"schema_version": 1}, {}, [1]])
def test_what_is_no_verdict_of_this_version_is_refused(tmp_path, content):
    path = tmp_path / "verdict.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError) as refused:
        verdict_json.read(path)
    assert str(refused.value) == f"{path}: is no verdict of schema_version 2; run the campaign's stages again"


def test_a_file_that_is_not_there_or_not_json_is_refused_with_the_reason(tmp_path):
    path = tmp_path / "verdict.json"
    with pytest.raises(InputError) as refused:
        verdict_json.read(path)
    assert str(refused.value).startswith(f"{path}: is no verdict ([Errno 2]")
    path.write_text("{")
    with pytest.raises(InputError) as refused:
        verdict_json.read(path)
    assert str(refused.value).endswith("; run the campaign's stages first")


def test_what_several_explanations_hold_is_certain_with_the_values_of_the_best():
    rivals = [
        fitted([FRICTION, SPRING], [1.5, 20.0, 7.0], 70.0),
        fitted([WAVE, FRICTION], [1.5, 4.0, 21.0], 72.0),
    ]
    outcome = replace(outcome_of(fitted([], [1.0], 900.0), equivalent=rivals), verdict="ambiguous")
    (certain,) = document(outcome)["certain"]
    assert (certain["name"], certain["parameters"]["force_N"]["value"]) == ("friction", 20.0)
    assert document(replace(outcome, equivalent=rivals[:1] + [fitted([WAVE], [1.5, 4.0], 72.0)]))["certain"] == []
    ends = [(fit.label, fit.bic) for fit in rivals]
    for behind, names in (
        (-0.1, []),
        (0.1, ["friction"]),
    ):  # without friction, and as near or not
        near = outcome_of(outcome.chosen, equivalent=rivals, ranking=[*ends, ("wave", rivals[1].bic + behind)])
        assert [one["name"] for one in document(near)["certain"]] == names


def test_what_is_best_but_not_proven_stands_with_its_end_its_test_and_its_nearest_rival():
    best, base = fitted([FRICTION, SPRING], [1.5, 20.0, 7.0], 400.0), fitted([], [1.0], 900.0)
    columns = ["explanation", "bic", "explained_share", "admissible"]
    rows = [
        ("friction + spring", best.bic, 0.56, True),
        ("friction", best.bic + 5.0, 0.5, True),  # a part of it is no rival
        ("lost", best.bic + 6.0, 0.5, False),
        ("failed", np.nan, np.nan, True),
        ("wave", best.bic + 432.0, 0.1, True),
    ]
    ranking = pd.DataFrame(rows, columns=columns)
    outcome = Outcome("unexplained", base, base, [], ranking, because="it is poor", best_known=best)
    content = document(outcome, gaps=gaps((6.0, 5.9), (-3.0, 40.0)), doubted=["torque"])
    known = content["best_known"]
    assert content["effects"] == []
    assert [one["name"] for one in known["effects"]] == ["friction", "spring"]
    assert known["gap"] == {"identify": {"before": 9.0, "after": 6.0}, "confirm": {"before": 8.0, "after": 5.9}}
    assert known["explained_share"] == 0.56
    assert known["rival"] == {"explanation": "wave", "behind": pytest.approx(432.0), "explained_share": 0.1}
    assert (content["held_out_test"], content["doubted_channels"]) == ("stays", ["torque"])
    alone = document(replace(outcome, ranking=ranking.head(1)))["best_known"]
    assert alone["rival"] is None
    assert document(replace(outcome, best_known=None))["best_known"] is None


@pytest.mark.parametrize(
    ("chi2", "known", "shown"),
    [
        (50.0, 60.0, "law"),
        (70.0, 60.0, "effect"),
        (880.0, None, "law"),  # ahead of the base by 900 - 880 less ln n
        (890.0, None, None),
    ],
)
def test_a_formula_that_is_not_named_is_best_known_where_it_is_better_than_every_effect(chi2, known, shown):
    base, law = fitted([], [1.0], 900.0), fitted([CUBE], [1.5, -2.5], chi2)
    effect = None if known is None else fitted([FRICTION], [1.5, 20.0], known)
    limits = Thresholds(rate=0.01, omnibus=1.05, max_gain_threshold=12.0)
    found = Outcome("unexplained", base, base, [], ranking_frame([]), because="it is poor", best_known=effect)
    proposed = ForceLawResult(law, False, "it explains little", ranking=[weigh_fit(base, law, limits)])
    outcome = outcome_with_law(found, proposed)
    best = {"law": law, "effect": effect, None: None}[shown]
    assert outcome.best_known is best
    (row,) = outcome.placed_ranking.to_dict("records")
    assert row["place"] == ("best_known" if shown == "law" else "")


def test_motion_that_never_repeats_is_decided_on_statistics():
    chosen = fitted([FRICTION], [1.5, 20.0])
    assert document(outcome_of(chosen), repeats=False)["basis"] == "statistics"
    assert document(outcome_of(chosen))["basis"] == "samples"
