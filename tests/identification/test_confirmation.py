"""Gaps before and after, on data that took no part: exact on a model that can be worked out by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointgap.identification.confirmation import confirm, fit_run_parameters
from jointgap.identification.fit import Fit
from jointgap.identification.likelihood import fitted
from jointgap.identification.problem import Problem
from tests.identification.linear import SAMPLES, SLOPE, Levels
from tests.identification.oscillator import SD, SPRING, SWING, linear


def fit_of(model, values, hypothesis=()):
    """A fit with these values, of the runs for fitting."""
    parameters = Problem(model, model.noise).parameters(hypothesis)
    found = np.array([values[p.key] for p in parameters])
    return Fit(hypothesis, parameters, found, np.zeros(SAMPLES), np.zeros((SAMPLES, len(parameters))), 1, "converged")


@pytest.fixture
def case():
    """A shared level of 2 and a rise of 3 in every run; the held-out run has a level of its own, 5, that nobody has
    fitted.
    """
    model = Levels({"one": (2.0, 3.0), "two": (2.0, 3.0), "held": (7.0, 3.0)}, held_out=("held",))
    base = fit_of(model, {"shared": 2.0, "own@one": 0.0, "own@two": 0.0})
    named = fit_of(model, {"shared": 2.0, "own@one": 0.0, "own@two": 0.0, "slope.rise": 3.0}, (SLOPE,))
    return SimpleNamespace(model=model, base=base, named=named, found=confirm(model, model.noise, base, named))


def gap(case, run, role, column, channel="all"):
    rows = case.found.gaps.set_index(["run", "role", "channel"])
    return rows.loc[(run, role, channel), column]


def test_the_gap_is_the_root_mean_square_of_the_whitened_residual(case):
    rise = 3.0 * np.linspace(0.0, 1.0, SAMPLES) / case.model.noise_sd
    scatter = case.model._scatter() / case.model.noise_sd
    expected = np.sqrt(np.mean((rise + scatter) ** 2))
    assert gap(case, "one", "identify", "before") == pytest.approx(expected)
    assert gap(case, "all", "identify", "before") == pytest.approx(expected)
    assert gap(case, "one", "identify", "after") == pytest.approx(1.0)
    assert gap(case, "one", "identify", "before", "y") == pytest.approx(expected)


def test_the_gap_of_several_runs_is_that_of_their_mean_squares(case):
    lone = Levels({"one": (2.0, 3.0), "two": (2.0, 0.0)})
    found = confirm(lone, lone.noise, fit_of(lone, {"shared": 2.0, "own@one": 0.0, "own@two": 0.0})).gaps
    by_run = found[found["channel"] == "all"].set_index("run")["before"]
    assert by_run["two"] == pytest.approx(1.0)
    assert by_run["all"] == pytest.approx(np.sqrt((by_run["one"] ** 2 + 1.0) / 2))
    assert (found["after"] == found["before"]).all()
    assert found["closed"].dropna().eq(0.0).all()


def test_what_a_held_out_run_has_for_itself_is_fitted_to_it_before_and_after(case):
    x = np.linspace(0.0, 1.0, SAMPLES)
    scatter = case.model._scatter() / case.model.noise_sd
    left = 3.0 * (x - x.mean()) / case.model.noise_sd + scatter  # the best level takes up the mean
    assert gap(case, "held", "confirm", "before") == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-3)
    assert gap(case, "held", "confirm", "after") == pytest.approx(1.0, rel=1e-3)
    assert set(case.found.gaps["run"]) == {"one", "two", "held", "all"}


def test_the_share_closed_is_of_squares_beyond_noise(case):
    before, after = (gap(case, "held", "confirm", column) for column in ("before", "after"))
    assert gap(case, "held", "confirm", "closed") == pytest.approx(1 - (after**2 - 1) / (before**2 - 1))


def test_intervals_hold_the_gap_and_are_repeated_by_the_same_seed(case):
    gaps = case.found.gaps
    assert (gaps["before_low"] <= gaps["before"]).all()
    assert (gaps["before"] <= gaps["before_high"]).all()
    assert (gaps["before_low"] < gaps["before_high"]).all()
    again = confirm(case.model, case.model.noise, case.base, case.named).gaps
    assert again.equals(gaps)
    other = confirm(case.model, case.model.noise, case.base, case.named, seed=1).gaps
    assert not other["before_low"].equals(gaps["before_low"])
    assert gaps[["after_low", "after_high"]].to_numpy() == pytest.approx(np.ones((len(gaps), 2)), rel=1e-3)


def test_the_interval_of_the_gap_is_as_wide_as_independent_stretches_scatter():
    model = Levels({"one": (2.0, 0.0)})
    wild = np.random.default_rng(3).normal(size=SAMPLES)
    object.__setattr__(model.series[0], "value", 2.0 + model.noise_sd * wild)
    found = confirm(model, model.noise, fit_of(model, {"shared": 2.0, "own@one": 0.0})).gaps.iloc[-1]
    pairs = (wild**2).reshape(20, 2).mean(axis=1)  # twenty stretches of two samples
    error = np.std(pairs) / np.sqrt(20) / (2 * found["before"])
    assert found["before_high"] - found["before_low"] == pytest.approx(2 * 1.645 * error, rel=0.1)


def test_residuals_are_told_sample_by_sample(case):
    residuals = case.found.residuals
    assert list(residuals["run"].unique()) == ["one", "two", "held"]
    one = residuals[residuals["run"] == "one"]
    x = np.linspace(0.0, 1.0, SAMPLES)
    assert one["sample"].tolist() == list(range(SAMPLES))
    assert one["crank_angle"].to_numpy() == pytest.approx(x)
    assert one["measured"].to_numpy() == pytest.approx(case.model.series[0].value)
    assert one["base"].to_numpy() == pytest.approx(np.full(SAMPLES, 2.0))
    assert one["augmented"].to_numpy() == pytest.approx(2.0 + 3.0 * x)
    assert one["spread"].to_numpy() == pytest.approx(np.full(SAMPLES, case.model.noise_sd))
    assert one["whitened_base"].to_numpy() == pytest.approx((one["measured"] - one["base"]) / case.model.noise_sd)
    assert one["whitened_augmented"].to_numpy() == pytest.approx(
        (one["measured"] - one["augmented"]) / case.model.noise_sd
    )
    assert not one["held_out"].any()
    assert residuals[residuals["run"] == "held"]["held_out"].all()
    assert "role" not in residuals


def test_a_held_out_run_that_cannot_be_simulated_with_the_effect_says_why():
    model = Levels({"one": (2.0, 12.0), "stiff": (2.0, 12.0)}, held_out=("stiff",))
    base = fit_of(model, {"shared": 2.0, "own@one": 0.0})
    named = fit_of(model, {"shared": 2.0, "own@one": 0.0, "slope.rise": 12.0}, (SLOPE,))
    found = confirm(model, model.noise, base, named)
    held = found.gaps[found.gaps["role"] == "confirm"]
    assert held["after"].isna().all()
    assert held["before"].notna().all()
    assert held[held["run"] == "stiff"]["remark"].eq("too steep").all()
    assert found.gaps[found.gaps["role"] == "identify"]["remark"].isna().all()
    stiff = found.residuals[found.residuals["run"] == "stiff"]
    assert stiff[["augmented", "whitened_augmented"]].isna().all(axis=None)
    assert stiff[["base", "whitened_base"]].notna().all(axis=None)


def test_without_held_out_runs_there_is_nothing_to_confirm():
    model = Levels({"one": (2.0, 3.0)})
    found = confirm(model, model.noise, fit_of(model, {"shared": 2.0, "own@one": 0.0}))
    assert set(found.gaps["role"]) == {"identify"}
    assert list(found.gaps["run"]) == ["one", "one", "all"]
    assert list(found.gaps["samples"]) == [SAMPLES] * 3


def test_what_a_run_has_for_itself_is_kept_where_it_was_fitted(case):
    assert fit_run_parameters(Problem(case.model, case.model.noise), case.base) == case.base.mapping


def test_a_held_out_runs_own_level_is_found(case):
    values = fit_run_parameters(Problem(case.model, case.model.noise, held_out=True), case.named)
    assert values["own@held"] == pytest.approx(5.0, abs=1e-3)
    assert values["shared"] == 2.0


def test_the_fall_that_an_effect_foretells_is_the_mean_square_of_what_it_changes(case):
    x = np.linspace(0.0, 1.0, SAMPLES)
    change = 3.0 * (x - x.mean()) / case.model.noise_sd  # the run's own level takes up the mean
    expected = gap(case, "held", "confirm", "fall_expected")
    assert expected == pytest.approx(np.mean(change**2), rel=1e-3)
    before, after = (gap(case, "held", "confirm", column) for column in ("before", "after"))
    low, high = (gap(case, "held", "confirm", f"fall_{end}") for end in ("low", "high"))
    assert low < before**2 - after**2 < high
    assert low > 0.0
    assert case.found.test.outcome == "falls"


def test_an_effect_that_is_not_there_lets_the_held_out_gap_rise(case):
    level = Levels({"one": (2.0, 3.0), "two": (2.0, 3.0), "held": (7.0, 0.0)}, held_out=("held",))
    assert confirm(level, level.noise, case.base, case.named).test.outcome == "rises"
    alike = Levels({"one": (2.0, 3.0), "two": (2.0, 3.0), "held": (7.0, 1.5)}, held_out=("held",))
    found = confirm(alike, alike.noise, case.base, case.named).test  # half as steep: the misfit only changes its sign
    assert found.outcome == "stays"
    assert found.after == pytest.approx(found.before, rel=0.1)


def oscillating(**more):
    """A problem of the run ``slow`` of an oscillator; another run is held out."""
    problem = linear(**more)
    series, noise = problem.model.series, {part.series.key: part.noise for part in problem.parts}
    problem.model.series = [replace(one, held_out=np.full(one.value.size, one.run == "fast")) for one in series]
    return Problem(problem.model, noise), noise


@pytest.mark.parametrize("only_with_it", [True, False], ids=["joint_became_loose", "joint_is_loose"])
def test_runs_of_a_fit_in_windows_are_as_it_left_them_and_held_out_ones_from_their_likeliest_states(only_with_it):
    effect, size = (SPRING, {"size": 0.3, "damping": 0.0}) if only_with_it else (SWING, {"size": 0.3})
    problem, noise = oscillating(hidden={effect.name: size}, candidates=(effect,))
    if only_with_it:
        problem.model.windowed = lambda effects: effect.name in effects
    base, named = fitted(problem), fitted(problem, (effect,), {f"{effect.name}.size": 0.28})
    assert named.in_windows and base.in_windows != only_with_it
    found = confirm(problem.model, noise, base, named)
    runs = {run: rows for run, rows in found.residuals.groupby("run")}
    # the residual of a fit counts jumps too: it is a little longer
    np.testing.assert_allclose(runs["slow"]["whitened_augmented"], named.residual, rtol=0.01)
    np.testing.assert_allclose(runs["slow"]["whitened_base"], base.residual, rtol=0.01)
    after, before = (found.gaps.set_index(["run", "role", "channel"])[name] for name in ("after", "before"))
    assert after["slow", "identify", "all"] == pytest.approx(1.0, abs=0.15)
    assert after["fast", "confirm", "all"] == pytest.approx(1.0, abs=0.2)
    assert before["fast", "confirm", "all"] > 2.0
    for rows in runs.values():
        assert np.std(rows["measured"] - rows["augmented"]) == pytest.approx(SD, rel=0.35)
        assert np.std(rows["measured"] - rows["base"]) > 2.0 * SD
    assert found.test.outcome == "falls"


def test_a_held_out_run_without_windows_is_predicted_by_one_trajectory():
    problem, noise = oscillating(hidden={"swing": {"size": 0.3}})
    base, named = fitted(problem), fitted(problem, (SWING,), {"swing.size": 0.28})
    make = problem.model.windows
    problem.model.windows = lambda run, *more: None if run == "fast" else make(run, *more)
    found = confirm(problem.model, noise, base, named)
    gaps = found.gaps.set_index(["run", "role", "channel"])["after"]
    assert gaps["fast", "confirm", "all"] == pytest.approx(1.0, abs=0.2)
