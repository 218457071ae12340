"""Stages of a campaign on a model in closed form, and their results in files."""

import json

import numpy as np
import pandas as pd
import pytest
from jsonschema import validate

from benchmarks.project import ROOT
from jointgap.campaign import plan, verdict_json
from jointgap.campaign.campaign_files import costs, recorded_costs
from jointgap.campaign.outcome import ranking_frame
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.campaign.verdict_json import gap_of, held_out
from jointgap.config.load import load_campaign
from jointgap.core.errors import SimulationError
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import TABLES
from jointgap.identification.confirmation import confirm, fit_run_parameters
from jointgap.identification.evidence import weigh_fit
from jointgap.identification.fit import FAILED, fit_hypothesis
from jointgap.identification.noise import noise_of_model
from jointgap.identification.problem import Problem
from jointgap.identification.search import Search, SingleEffects
from tests.campaign.conftest import TRUTH
from tests.identification.toy import SPEEDS, candidate_of, stated_noise, toy

SCHEMA = json.loads((ROOT / "workflow/schemas/verdict.schema.json").read_text())


@pytest.fixture(scope="module")
def confirmed(chain):
    return confirm(chain.model, chain.noise, chain.recalibrated.base, chain.outcome.chosen)


def test_the_hidden_effect_is_named_with_its_size_within_its_interval(chain):
    assert (chain.outcome.verdict, chain.outcome.chosen.label) == ("named", "coulomb")
    (effect,) = verdict_json.effects_of(chain.outcome.chosen, {})
    force = effect["parameters"]["force_N"]
    assert force["value"] == pytest.approx(TRUTH, abs=4 * force["sd"])
    assert force["interval_90"][0] < force["value"] < force["interval_90"][1]
    unstated = toy({"coulomb": {"force_N": TRUTH}}, held_out=(), stated=False)
    assert noise_of_model(unstated).keys() == chain.noise.keys()


def test_the_held_out_gap_falls_to_noise_level(chain, confirmed):
    gap = gap_of(confirmed.gaps, "confirm")
    assert gap["before"] > 2.0 and gap["after"] == pytest.approx(1.0, abs=0.1)
    total = confirmed.gaps[confirmed.gaps["role"] == "confirm"].query("run == 'all'").iloc[0]
    assert total["after_low"] < total["after"] < total["after_high"]
    assert total["closed"] == pytest.approx(1.0, abs=0.05)
    squares = confirmed.residuals.assign(square=confirmed.residuals["whitened_augmented"] ** 2)
    own = squares[squares["held_out"]].groupby(["run", "channel"])["square"].mean()
    assert gap["after"] == pytest.approx(np.sqrt(own.mean()))
    base = chain.recalibrated.base
    before = chain.recalibrated.problem.gap(base.residual)
    assert gap_of(confirmed.gaps, "identify")["before"] == pytest.approx(before)
    values = fit_run_parameters(Problem(chain.model, chain.noise, held_out=True), base)
    assert {key for key, value in values.items() if value != base.mapping.get(key)} == {
        "speed@fast"
    }


def test_without_an_effect_the_gap_stays_and_the_part_that_is_held_out_is_reported(chain):
    gaps = confirm(chain.model, chain.noise, chain.recalibrated.base).gaps
    gap, roles = gap_of(gaps, "confirm"), {"slow": "identify", "mid": "identify"}
    assert gap["before"] == gap["after"]
    (listed,) = held_out(gaps, roles | {"fast": "split"})
    assert (listed["run"], listed["part"]) == ("fast", "last_third")
    assert held_out(gaps, roles | {"fast": "confirm"})[0]["part"] == "whole"


def test_a_failed_held_out_run_has_a_reason_and_no_gap(tmp_path, monkeypatch):
    model = toy({"coulomb": {"force_N": TRUTH}}, held_out=("mid", "fast"))
    folder = ResultsFolder(tmp_path)
    noise, simulate = stated_noise(model), type(model).simulate
    problem = Problem(model, noise)
    base, named = fit_hypothesis(problem), fit_hypothesis(problem, (candidate_of("coulomb"),))
    complete = confirm(model, noise, base, named).gaps

    def breaks(self, run, values, effects=(), numerics=0):
        if run == "fast" and effects:
            raise SimulationError(f"run {run}: the rod does not reach the slide")
        return simulate(self, run, values, effects, numerics)

    monkeypatch.setattr(type(model), "simulate", breaks)
    found = confirm(model, noise, base, named)
    folder.write("residuals", found.residuals)
    folder.write("gaps", found.gaps)
    gaps = folder.read("gaps")
    listed = {one["run"]: one for one in held_out(gaps, dict.fromkeys(SPEEDS, "confirm"))}
    before = gap_of(complete, "confirm", "fast")["before"]
    assert listed["fast"]["gap"] == {"before": pytest.approx(before), "after": None}
    assert "does not reach the slide" in listed["fast"]["not_simulated"]
    assert listed["mid"]["gap"]["after"] == pytest.approx(1.0, abs=0.1)
    assert "not_simulated" not in listed["mid"]
    assert gap_of(gaps, "confirm")["after"] is None
    assert gap_of(gaps, "identify") == gap_of(complete, "identify")


def test_a_failed_fit_has_its_reason_in_the_ranking(chain, monkeypatch):
    of = (chain.recalibrated, chain.screening.sensitivities, chain.screening.limits)
    residual = Problem.residual

    def fails(problem, values, hypothesis=(), *others):
        if any(one.label == "coulomb" for one in hypothesis):
            raise SimulationError("the slide flies off")
        return residual(problem, values, hypothesis, *others)

    monkeypatch.setattr(Problem, "residual", fails)
    base, limits = chain.recalibrated.base, chain.screening.limits
    fits = Search(*of, (SingleEffects(),)).run().made
    weighed = [weigh_fit(base, fit, limits) for fit in fits]
    rows = ranking_frame(weighed).set_index("explanation")
    assert rows.loc["coulomb", ["status", "reason"]].tolist() == [FAILED, "the slide flies off"]
    assert (rows["status"] != FAILED).sum() == len(rows) - 1


def test_a_verdict_follows_its_schema(chain, confirmed, tmp_path):
    with recorded_costs(ResultsFolder(tmp_path), "identify"):
        pass
    tables = {name: pd.DataFrame(columns=TABLES[name].names) for name in verdict_json.TABLES}
    window = {"run": "slow", "channel": "torque", "start_deg": 350.0, "end_deg": 10.0}
    window["p_adjusted"] = np.float64(1e-9)
    tables |= {"gaps": confirmed.gaps, "map_windows": pd.DataFrame([window])}
    tables["confusability"] = pd.DataFrame(
        {"first": ["a", "b"], "second": ["b", "a"], "merged": True}
    )
    campaign = load_campaign(ROOT / "config/campaigns/demonstration.yaml")
    made = verdict_json.document(chain.outcome, tables, campaign) | {"false_alarm_rate": 0.01}
    read = json.loads(verdict_json.text(made | {"costs": costs(ResultsFolder(tmp_path))}))
    validate(read, SCHEMA)
    assert set(read["nuisances"]) == {"slider_mass", "crank_length", "speed@slow", "speed@mid"}


def test_look_alikes_survive_as_groups_and_advice_names_what_separates_them(monkeypatch):
    pairs = pd.DataFrame(
        {"first": list("abcac"), "second": list("abcca"), "merged": [False] * 3 + [True] * 2}
    )
    assert plan.confusable_groups(pairs) == [["a", "c"]]
    advice = pd.DataFrame(
        {"change": ["channel x", "run y"], "separated": ["b | c", "a | c, a | b"]}
    )
    monkeypatch.setattr(plan, "_advise", lambda *given: (None, advice))
    campaign = load_campaign(ROOT / "config/campaigns/demonstration.yaml")
    for explanations, merged, advised in (
        ([{"a"}, {"c"}], [["a", "c"]], "A further run y would separate them."),
        ([{"a", "d"}, {"a", "e"}], [["d", "e"]], "No single"),
        ([{"a"}, {"d"}], [["b", "c"]], "A longer record"),  # their sensitivities differ
        ([{"a"}, {"a", "b"}], [["b", "c"]], "A longer record"),
    ):
        assert advised in plan.separated_by(campaign, explanations, merged, 0.01)


def test_every_table_of_a_stage_has_a_place_of_its_own():
    places = [path for stage in CAMPAIGN_STAGES.values() for path in stage.outputs()]
    assert len(places) == len(set(places)) > 15
