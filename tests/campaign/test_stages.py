"""Stages of a campaign on a model in closed form: what they find, and that files hand it on unchanged."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from jsonschema import validate

from benchmarks.project import ROOT
from jointgap.campaign import plan, verdict_json
from jointgap.campaign.campaign_files import FIT_TABLES, NOISE_TABLES
from jointgap.campaign.fits_on_disk import (
    fits_from_frames,
    fits_to_frames,
    hypothesis_of,
    noise_from_frames,
    noise_to_frames,
    parameter_frame,
    screened_frame,
    signatures_from_frames,
    signatures_to_frames,
)
from jointgap.campaign.plan import confusable_groups
from jointgap.campaign.stages import CAMPAIGN_STAGES
from jointgap.campaign.verdict_json import gap_of, held_out
from jointgap.config.load import load_campaign
from jointgap.core.candidates import Parameter
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import TABLES
from jointgap.identification import hypothesis_fits, model_selection
from jointgap.identification.baseline import Baseline
from jointgap.identification.confirmation import confirm, fit_run_parameters
from jointgap.identification.fit import FAILED, FiniteDifferences, fit_hypothesis
from jointgap.identification.likelihood import fitted, signatures_about
from jointgap.identification.noise import noise_of_model
from jointgap.identification.problem import Problem
from jointgap.identification.screening import SignatureRegression
from tests.campaign.conftest import TRUTH
from tests.identification.oscillator import PULL, PUSH, SWING, WOBBLE, linear
from tests.identification.toy import SPEEDS, candidate_of, stated_noise, toy


def test_the_hidden_effect_is_named_with_its_size_within_its_interval(chain):
    assert chain.outcome.verdict == "named"
    assert chain.outcome.chosen.label == "coulomb"
    shown = parameter_frame([chain.outcome.chosen]).set_index("key").loc["coulomb.force_N"]
    assert shown["value"] == pytest.approx(TRUTH, abs=4 * shown["sd"])
    assert shown["low_90"] < shown["value"] < shown["high_90"]


def test_the_gap_on_held_out_runs_falls_to_that_of_noise(chain):
    found = confirm(chain.model, chain.noise, chain.recalibrated.base, chain.outcome.chosen)
    gap = gap_of(found.gaps, "confirm")
    assert gap["before"] > 2.0
    assert gap["after"] == pytest.approx(1.0, abs=0.1)
    whole = found.gaps[found.gaps["role"] == "confirm"].query("run == 'all'").iloc[0]
    assert whole["after_low"] < whole["after"] < whole["after_high"]
    assert whole["closed"] == pytest.approx(1.0, abs=0.05)


def test_gaps_are_those_of_the_residuals_that_are_handed_on(chain):
    found = confirm(chain.model, chain.noise, chain.recalibrated.base, chain.outcome.chosen)
    squares = found.residuals.assign(square=found.residuals["whitened_augmented"] ** 2)
    held_out = squares[squares["held_out"]].groupby(["run", "channel"])["square"].mean()
    assert gap_of(found.gaps, "confirm")["after"] == pytest.approx(np.sqrt(held_out.mean()))
    assert gap_of(found.gaps, "identify")["before"] == pytest.approx(
        chain.recalibrated.problem.gap(chain.recalibrated.base.residual)
    )


def test_noise_is_found_where_no_run_is_held_out():
    model = toy({"coulomb": {"force_N": TRUTH}}, held_out=(), stated=False)
    assert noise_of_model(model).keys() == {series.key for series in model.series}


def test_without_an_effect_the_gap_after_is_the_gap_before(chain):
    found = confirm(chain.model, chain.noise, chain.recalibrated.base)
    gap = gap_of(found.gaps, "confirm")
    assert gap["before"] == gap["after"]


def test_what_a_held_out_run_has_for_itself_is_fitted_to_it_and_nothing_else(chain):
    base = chain.recalibrated.base
    held_out_problem = Problem(chain.model, chain.noise, held_out=True)
    values = fit_run_parameters(held_out_problem, base)
    assert {key for key, value in values.items() if value != base.mapping.get(key)} == {"speed@fast"}


class _Breaking:
    """A model that cannot simulate one run with any effect."""

    def __init__(self, model, run):
        self.model, self.run = model, run

    def __getattr__(self, name):
        return getattr(self.model, name)

    def simulate(self, run, values, effects=(), numerics=0):
        if run == self.run and effects:
            raise SimulationError(f"run {run}: the rod does not reach the slide")
        return self.model.simulate(run, values, effects, numerics)


def test_a_held_out_run_that_cannot_be_simulated_with_the_effect_has_no_gap_after_and_the_reason(tmp_path):
    model = toy({"coulomb": {"force_N": TRUTH}}, held_out=("mid", "fast"))
    noise_ = stated_noise(model)
    problem = Problem(model, noise_)
    base, named = fit_hypothesis(problem), fit_hypothesis(problem, (candidate_of("coulomb"),))
    whole = confirm(model, noise_, base, named).gaps
    folder = ResultsFolder(tmp_path)
    found = confirm(_Breaking(model, "fast"), noise_, base, named)
    folder.write("residuals", found.residuals)
    folder.write("gaps", found.gaps)
    gaps = folder.read("gaps")
    listed = {one["run"]: one for one in held_out(gaps, dict.fromkeys(SPEEDS, "confirm"))}
    before = {run: gap_of(whole, "confirm", run)["before"] for run in ("mid", "fast")}
    assert listed["fast"]["gap"] == {"before": pytest.approx(before["fast"]), "after": None}
    assert "does not reach the slide" in listed["fast"]["not_simulated"]
    assert listed["mid"]["gap"]["after"] == pytest.approx(1.0, abs=0.1)
    assert "not_simulated" not in listed["mid"]
    assert gap_of(gaps, "confirm")["after"] is None
    assert gap_of(gaps, "identify") == gap_of(whole, "identify")


def test_the_verdict_says_of_which_runs_only_the_last_third_is_held_out(chain):
    found = confirm(chain.model, chain.noise, chain.recalibrated.base)
    roles = {"slow": "identify", "mid": "identify", "fast": "split"}
    (listed,) = held_out(found.gaps, roles)
    assert (listed["run"], listed["part"]) == ("fast", "last_third")
    assert held_out(found.gaps, roles | {"fast": "confirm"})[0]["part"] == "whole"


def test_fits_come_back_from_files_with_the_same_intervals(chain, tmp_path):
    folder = ResultsFolder(tmp_path)
    folder.write_all(fits_to_frames(chain.fits, range(len(chain.fits))), "fit/0")
    again = fits_from_frames(folder.read_all(FIT_TABLES, "fit/0"), chain.recalibrated.problem)
    assert [one.label for one in again] == [one.label for one in chain.fits]
    for one, other in zip(again, chain.fits, strict=True):
        assert one.mapping == other.mapping
        assert one.chi2 == other.chi2
    named = next(one for one in again if one.label == chain.outcome.chosen.label)
    same = next(one for one in chain.fits if one.label == named.label)
    np.testing.assert_allclose(np.diag(named.covariance()), np.diag(same.covariance()), rtol=1e-6)


def test_what_a_verdict_states_comes_back_from_files_with_what_intervals_need(chain, tmp_path):
    folder, chosen = ResultsFolder(tmp_path), chain.outcome.chosen
    shifts, draws = (np.arange(count * chosen.values.size, dtype=float).reshape(count, -1) for count in (2, 12))
    known = {"shifts": shifts, "draws": draws, "gap_left": 1.5}
    folder.write_all(fits_to_frames([replace(chosen, **known)]), "decide")
    (again,) = fits_from_frames(folder.read_all(FIT_TABLES, "decide"), chain.recalibrated.problem)
    assert again.gap_left == 1.5 and not again.in_windows
    np.testing.assert_allclose(again.half_derivative, chosen.half_derivative, rtol=1e-12)
    np.testing.assert_array_equal(again.shifts, shifts)
    np.testing.assert_array_equal(again.draws, draws)


def test_fits_in_windows_come_back_from_files_with_their_states(tmp_path):
    problem, folder = linear(hidden={"swing": {"size": 0.1}}), ResultsFolder(tmp_path)
    fits = fitted(problem), fitted(problem, (SWING,)), fit_hypothesis(problem, (WOBBLE,))
    folder.write_all(fits_to_frames(fits), "fit/0")
    again = fits_from_frames(folder.read_all(FIT_TABLES, "fit/0"), problem)
    assert [one.in_windows for one in again] == [True, True, False]
    for one, other in zip(again[:2], fits, strict=False):
        assert one.states.keys() == other.states.keys() == {"slow", "fast"}
        for run, states in other.states.items():
            np.testing.assert_array_equal(one.states[run], states)
        assert one.mapping == other.mapping and one.chi2 == other.chi2
        np.testing.assert_allclose(one.distribution.covariance, other.distribution.covariance, rtol=1e-6)


def test_a_parameter_at_its_bound_has_no_standard_error_and_says_why(tmp_path):
    model = toy({"coulomb": {"force_N": TRUTH}}, {"slider_mass": 0.53})  # beyond its range
    problem = Problem(model, stated_noise(model))
    bounded = replace(candidate_of("coulomb"), coordinates=(Parameter("force_N", 0.0, 0.0, 1.0, 0.3, "N"),))
    derived = replace(bounded, parameters=lambda at: {"push_N": 2.0 * at["force_N"], "length_m": 0.1})
    for candidate, names in ((bounded, ["force_N"]), (derived, ["push_N", "length_m"])):
        one = fit_hypothesis(problem, (candidate,))
        folder = ResultsFolder(tmp_path)
        folder.write("fit_parameters", parameter_frame([one]), "decide")
        shown = folder.read("fit_parameters", "decide").set_index("key")
        drawn = ["slider_mass", *(f"coulomb.{name}" for name in names if name != "length_m")]
        assert shown.loc[drawn, "sd"].isna().all()
        assert (shown.loc[drawn, "low_90"] < shown.loc[drawn, "high_90"]).all()
        ends = shown.loc["slider_mass", ["value", "high_90"]]  # the data ask for more: to one side
        assert ends["value"] == ends["high_90"]
        assert (shown.loc[drawn, "remark"] == "at its bound").all()
        assert (shown.loc[shown["remark"].isna(), "sd"] > 0).all()
        assert shown["remark"].isna().any()
        (effect,) = verdict_json.effects(one, {"base": 0.0})
        assert effect["parameters"][names[0]]["remark"] == "at its bound"
    assert effect["parameters"]["length_m"]["remark"] == "not estimated"
    assert verdict_json.effects(one, {"base": 0.0})[0]["parameters"]["push_N"]["sd"] is None


def test_noise_comes_back_from_files(chain, tmp_path):
    folder, first = ResultsFolder(tmp_path), next(iter(chain.noise))
    drive = np.random.default_rng(0).standard_normal((chain.noise[first].sd.size, 12))
    noise = chain.noise | {first: replace(chain.noise[first], drive=drive)}
    folder.write_all(noise_to_frames(noise), "noise")
    again = noise_from_frames(folder.read_all(NOISE_TABLES, "noise"))
    assert again.keys() == noise.keys()
    np.testing.assert_array_equal(again[first].drive, drive)
    for key, one in again.items():
        assert key == first or one.drive is None
        np.testing.assert_array_equal(one.spread, chain.noise[key].spread)
        assert one.autocorrelation == chain.noise[key].autocorrelation
        assert one.remarks == chain.noise[key].remarks


def test_signatures_come_back_from_files_and_choose_the_same_explanations(chain, tmp_path):
    folder, signatures = ResultsFolder(tmp_path), chain.screening.signatures
    expected = model_selection.shortlist_singles(signatures, chain.screening.limits)
    again = from_files(folder, signatures, chain.recalibrated, expected)
    chosen = model_selection.shortlist_singles(again, chain.screening.limits)
    assert [one.label for one in chosen] == [one.label for one in expected]
    assert [one.start for one in chosen] == [one.start for one in expected]
    assert again.residual is chain.recalibrated.base.residual


def from_files(folder, signatures, baseline, shortlist):
    """Signatures about a base as a later stage reads them."""
    frames = signatures_to_frames(signatures, baseline.base) | {"screened": screened_frame(signatures, shortlist)}
    folder.write_all(frames, "screen")
    return signatures_from_frames(folder.read_all(("signatures", "signature_shapes", "screened"), "screen"), baseline)


def test_signatures_about_a_base_in_windows_are_not_those_of_its_fit_and_come_back_from_files(tmp_path):
    turning = replace(WOBBLE, initial_guesses=({"turn": 0.5}, {"turn": 1.5}))
    turning = replace(turning, coordinates=(*WOBBLE.coordinates, Parameter("turn", 1.0, 0.0, 2.0, 0.1)))
    problem = linear(hidden={"swing": {"size": 0.1}}, candidates=(SWING, PUSH, turning, PULL))
    make = problem.model.windows

    def without_pull(run, values, effects=()):
        if any(one.name == "pull" for one, _ in effects):
            raise SimulationError("nothing pulls here")
        return make(run, values, effects)

    problem.model.windows = without_pull
    base, differences = fitted(problem), FiniteDifferences(problem)
    signatures = signatures_about(problem, base, differences)
    assert np.abs(signatures.residual - base.residual).max() > 1.0
    assert np.abs(signatures.jacobian - base.jacobian).max() > 1.0
    singles = SignatureRegression(signatures).singles()
    again = from_files(ResultsFolder(tmp_path), signatures, Baseline(problem, differences, base, base), singles)
    np.testing.assert_array_equal(again.residual, signatures.residual)
    np.testing.assert_array_equal(again.jacobian, signatures.jacobian)
    assert again.failed == signatures.failed == {"pull": "nothing pulls here"}
    assert [(one.candidate.label, one.shape_parameters) for one in again.entries] == [
        ("swing", {}),
        ("push", {}),
        ("wobble", {"turn": 0.5}),
        ("wobble", {"turn": 1.5}),
    ]
    for one, other in zip(again.entries, signatures.entries, strict=True):
        np.testing.assert_array_equal(one.columns, other.columns)
        np.testing.assert_array_equal(one.origin, other.origin)
    assert not np.array_equal(again.of("push")[0].origin, again.residual)  # it begins where the drive is nominal
    assert [one.label for one in SignatureRegression(again).singles()] == [one.label for one in singles]


def test_so_do_the_values_about_which_they_are(tmp_path):
    problem = linear(hidden={"swing": {"size": 0.1}})
    base, differences = fitted(problem), FiniteDifferences(problem)
    signatures = signatures_about(problem, base, differences)
    again = from_files(ResultsFolder(tmp_path), signatures, Baseline(problem, differences, base, base), ())
    np.testing.assert_array_equal(again.values, signatures.values)


def test_parts_of_the_fits_together_are_all_of_them(chain):
    of = chain.recalibrated, chain.screening.signatures, chain.screening.limits
    whole = [one.label for one in hypothesis_fits.fit_singles(*of)[0]]
    parts = [hypothesis_fits.fit_singles(*of, part, 2)[0] for part in (0, 1)]
    assert all(parts)
    assert sorted(one.label for part in parts for one in part) == sorted(whole)


def test_a_fit_that_fails_is_a_row_with_its_reason_and_the_others_go_on(chain, monkeypatch):
    def fails(problem, values, hypothesis=(), *others):
        if any(one.label == "viscous" for one in hypothesis):
            raise SimulationError("the slide flies off")
        return residual(problem, values, hypothesis, *others)

    residual = Problem.residual
    monkeypatch.setattr(Problem, "residual", fails)
    found, _ = hypothesis_fits.fit_singles(chain.recalibrated, chain.screening.signatures, chain.screening.limits)
    rows = fits_to_frames(found)["fits"].set_index("explanation")
    assert rows.loc["viscous", "status"] == FAILED
    assert rows.loc["viscous", "reason"] == "the slide flies off"
    assert (rows["status"] != FAILED).sum() == len(rows) - 1


def test_a_verdict_follows_its_schema_and_leaves_no_number_that_json_lacks(chain):
    found = confirm(chain.model, chain.noise, chain.recalibrated.base, chain.outcome.chosen)
    tables = {name: pd.DataFrame(columns=TABLES[name].names) for name in verdict_json.TABLES} | {"gaps": found.gaps}
    window = {"run": "slow", "channel": "torque", "start_deg": 350.0, "end_deg": 10.0, "p_adjusted": np.float64(1e-9)}
    tables["map_windows"] = pd.DataFrame([window])
    tables["confusability"] = pd.DataFrame({"first": ["a", "b"], "second": ["b", "a"], "merged": True})
    campaign = load_campaign(ROOT / "config/campaigns/demonstration.yaml")
    made = verdict_json.document(chain.outcome, tables, campaign) | {"false_alarm_rate": 0.01}
    read = json.loads(verdict_json.text(made | {"seconds": {"fit": 1.0}}))
    validate(read, json.loads((ROOT / "workflow/schemas/verdict.schema.json").read_text()))
    (effect,) = read["effects"]
    assert effect["name"] == "coulomb"
    assert effect["parameters"]["force_N"]["value"] == pytest.approx(TRUTH, rel=0.05)
    assert read["where"][0]["crank_angle_deg"] == [350.0, 10.0]
    assert set(read["nuisances"]) == {"slider_mass", "crank_length", "speed@slow", "speed@mid"}


def test_in_a_pair_each_effect_has_what_leaving_it_out_costs(chain):
    by_label = {candidate.label: candidate for candidate in chain.model.candidates}
    pair = fit_hypothesis(chain.recalibrated.problem, (by_label["coulomb"], by_label["constant_force"]))
    alone = {"coulomb": 900.0, "constant_force": 2000.0}
    for effect, other in zip(verdict_json.effects(pair, alone), reversed(pair.hypothesis), strict=True):
        assert effect["delta_bic"] == pytest.approx(alone[other.label] - pair.bic)


def test_what_leaving_an_effect_out_costs_is_not_known_where_the_rest_cannot_be_simulated(chain):
    by_label = {candidate.label: candidate for candidate in chain.model.candidates}
    pair = fit_hypothesis(chain.recalibrated.problem, (by_label["coulomb"], by_label["constant_force"]))
    first, second = verdict_json.effects(pair, {"base": 2000.0, "coulomb": 900.0})
    assert first["delta_bic"] is None
    assert second["delta_bic"] == pytest.approx(900.0 - pair.bic)


def test_look_alikes_survive_as_groups_and_advice_names_what_separates_them():
    pairs = pd.DataFrame({"first": list("abcac"), "second": list("abcca"), "merged": [False] * 3 + [True] * 2})
    assert confusable_groups(pairs) == [["a", "c"]]
    advice = pd.DataFrame({"change": ["channel x", "run y"], "separated": ["b | c", "a | c, a | b"]})
    told = plan.separated_by(advice, [{"a"}, {"c"}], [["a", "c"]])
    assert told == "A further run y would separate them."
    assert "No single" in plan.separated_by(advice, [{"a", "d"}, {"a", "e"}], [["d", "e"]])


def test_what_the_plan_could_tell_apart_is_told_apart_by_more_or_better_data():
    advice = pd.DataFrame({"change": ["run y"], "separated": ["b | c"]})
    for explanations in ([{"a"}, {"c"}], [{"a"}, {"a", "b"}]):
        assert "a longer record" in plan.separated_by(advice, explanations, [["b", "c"]])


def test_every_table_of_a_stage_has_a_place_of_its_own():
    places = [path for stage in CAMPAIGN_STAGES.values() for path in stage.outputs()]
    assert len(places) == len(set(places)) > 60


def test_a_label_of_no_candidate_is_refused(chain):
    with pytest.raises(InputError, match="no candidate"):
        hypothesis_of("coulomb + ghost", chain.model.candidates)


def test_a_file_that_is_no_verdict_is_refused(tmp_path):
    place = tmp_path / "verdict.json"
    for text in ("[]", "{", '{"schema_version": 1}'):
        place.write_text(text)
        with pytest.raises(InputError, match=r"verdict\.json"):
            verdict_json.read(place)
