"""Stages of a campaign on a model in closed form, and their results in files."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from jsonschema import validate

from benchmarks.project import ROOT
from jointgap.campaign import plan, stages, verdict_json
from jointgap.campaign.campaign_files import FIT_TABLES, NOISE_TABLES, costs, recorded_costs
from jointgap.campaign.fits_on_disk import (
    fits_from_frames,
    fits_to_frames,
    hypothesis_of,
    noise_from_frames,
    noise_to_frames,
)
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.campaign.state import CampaignState
from jointgap.campaign.verdict_json import gap_of, held_out
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import TABLES
from jointgap.identification import hypothesis_fits
from jointgap.identification.confirmation import confirm, fit_run_parameters
from jointgap.identification.fit import FAILED, fit_hypothesis
from jointgap.identification.likelihood import fitted
from jointgap.identification.noise import noise_of_model
from jointgap.identification.problem import Problem
from tests.campaign.conftest import TRUTH
from tests.identification.oscillator import SPRING, linear
from tests.identification.toy import SPEEDS, candidate_of, stated_noise, toy

SCHEMA = json.loads((ROOT / "workflow/schemas/verdict.schema.json").read_text())


@pytest.fixture(scope="module")
def confirmed(chain):
    return confirm(chain.model, chain.noise, chain.recalibrated.base, chain.outcome.chosen)


def same(one, other, *attributes):
    for name in attributes:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


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


def test_fits_come_back_from_files_with_all_that_intervals_need(chain, tmp_path):
    folder = ResultsFolder(tmp_path)
    chosen = chain.outcome.chosen
    problem = chain.recalibrated.problem
    folder.write_all(fits_to_frames(chain.fits, range(len(chain.fits))), "fit/0")
    again = fits_from_frames(folder.read_all(FIT_TABLES, "fit/0"), problem)
    found, wanted = (
        [(one.label, one.mapping, one.chi2) for one in fits] for fits in (again, chain.fits)
    )
    assert found == wanted
    for one, other in zip(again, chain.fits, strict=True):
        if one.label == chosen.label:
            np.testing.assert_allclose(
                np.diag(one.covariance()), np.diag(other.covariance()), rtol=1e-6
            )
    shifts, draws = (
        np.arange(count * chosen.values.size, dtype=float).reshape(count, -1) for count in (2, 12)
    )
    stated = replace(chosen, shifts=shifts, draws=draws, gap_left=1.5)
    folder.write_all(fits_to_frames([stated]), "verdict")
    (again,) = fits_from_frames(folder.read_all(FIT_TABLES, "verdict"), problem)
    assert again.gap_left == 1.5 and not again.in_windows
    np.testing.assert_allclose(again.half_derivative, chosen.half_derivative, rtol=1e-12)
    same(again, stated, "shifts", "draws")


def test_fits_in_windows_come_back_from_files_with_their_states(tmp_path):
    problem = linear(hidden={"spring": {"size": 0.3, "damping": 0.0}}, candidates=(SPRING,))
    folder = ResultsFolder(tmp_path)
    fits = fitted(problem, (SPRING,), {"spring.size": 0.28}), fitted(problem)
    folder.write_all(fits_to_frames(fits), "fit/0")
    one, base = fits_from_frames(folder.read_all(FIT_TABLES, "fit/0"), problem)
    assert (one.in_windows, base.in_windows) == (True, False)
    assert one.states.keys() == fits[0].states.keys() == {"slow", "fast"}
    for run, states in fits[0].states.items():
        np.testing.assert_array_equal(one.states[run], states)
    assert one.mapping == fits[0].mapping and one.chi2 == fits[0].chi2
    np.testing.assert_allclose(
        one.distribution.covariance, fits[0].distribution.covariance, rtol=1e-6
    )


def test_noise_comes_back_from_files(chain, tmp_path):
    folder, first = ResultsFolder(tmp_path), next(iter(chain.noise))
    drive = np.random.default_rng(0).standard_normal((chain.noise[first].sd.size, 12))
    noise = chain.noise | {first: replace(chain.noise[first], drive=drive)}
    folder.write_all(noise_to_frames(noise))
    again = noise_from_frames(folder.read_all(NOISE_TABLES))
    assert again.keys() == noise.keys()
    np.testing.assert_array_equal(again[first].drive, drive)
    for key, one in again.items():
        assert key == first or one.drive is None
        same(one, chain.noise[key], "spread", "autocorrelation", "remarks")


def test_recalibrate_adds_solver_error_to_the_noise(chain, tmp_path, monkeypatch):
    simulate = type(chain.model).simulate

    def off(self, run, values, effects=(), numerics=0):
        read = simulate(self, run, values, effects, numerics)
        return read | ({"torque": read["torque"] + 0.5} if numerics else {})

    monkeypatch.setattr(type(chain.model), "simulate", off)
    state = CampaignState(ROOT / "config/campaigns/demonstration.yaml", tmp_path)
    state.model = chain.model
    stages.recalibrate(state, anyway=True)
    again = noise_from_frames(state.folder.read_all(NOISE_TABLES))
    noise = noise_of_model(chain.model)
    assert again.keys() == {series.key for series in chain.model.series}
    for (run, channel), one in again.items():
        added = 0.5 if channel == "torque" else 0.0
        np.testing.assert_allclose(one.spread, np.hypot(noise[run, channel].sd, added))


def test_an_explanation_of_another_model_is_refused(chain):
    with pytest.raises(InputError, match=r"no candidate .*repeat the earlier stages"):
        hypothesis_of("coulomb + ghost", chain.model.candidates)


def test_parts_contain_all_fits_and_failed_ones_have_a_reason(chain, monkeypatch):
    of = (chain.recalibrated, chain.screening.sensitivities, chain.screening.limits)
    residual = Problem.residual
    labels = [one.label for one in hypothesis_fits.fit_singles(*of)[0]]
    parts = [hypothesis_fits.fit_singles(*of, part, 2)[0] for part in (0, 1)]
    assert all(parts) and sorted(one.label for part in parts for one in part) == sorted(labels)

    def fails(problem, values, hypothesis=(), *others):
        if any(one.label == "viscous" for one in hypothesis):
            raise SimulationError("the slide flies off")
        return residual(problem, values, hypothesis, *others)

    monkeypatch.setattr(Problem, "residual", fails)
    rows = fits_to_frames(hypothesis_fits.fit_singles(*of)[0])["fits"]
    rows = rows.drop_duplicates("explanation").set_index("explanation")
    assert rows.loc["viscous", ["status", "reason"]].tolist() == [FAILED, "the slide flies off"]
    assert (rows["status"] != FAILED).sum() == len(rows) - 1


def test_a_verdict_follows_its_schema(chain, confirmed, tmp_path):
    with recorded_costs(ResultsFolder(tmp_path), "fit", 1, 2):
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


def test_look_alikes_survive_as_groups_and_advice_names_what_separates_them():
    pairs = pd.DataFrame(
        {"first": list("abcac"), "second": list("abcca"), "merged": [False] * 3 + [True] * 2}
    )
    assert plan.confusable_groups(pairs) == [["a", "c"]]
    advice = pd.DataFrame(
        {"change": ["channel x", "run y"], "separated": ["b | c", "a | c, a | b"]}
    )
    for explanations, merged, advised in (
        ([{"a"}, {"c"}], [["a", "c"]], "A further run y would separate them."),
        ([{"a", "d"}, {"a", "e"}], [["d", "e"]], "No single"),
        ([{"a"}, {"d"}], [["b", "c"]], "a longer record"),  # the plan distinguishes them
        ([{"a"}, {"a", "b"}], [["b", "c"]], "a longer record"),
    ):
        assert advised in plan.separated_by(advice, explanations, merged)


def test_every_table_of_a_stage_has_a_place_of_its_own():
    places = [path for stage in CAMPAIGN_STAGES.values() for path in stage.outputs()]
    assert len(places) == len(set(places)) > 25
