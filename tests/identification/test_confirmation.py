"""Gaps before and after, on a model with an exact solution."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from jointgap.core.candidates import Candidate, Parameter, Series
from jointgap.identification.confirmation import _gap, _squares, confirm, fit_run_parameters
from jointgap.identification.fit import Fit
from jointgap.identification.likelihood import fitted
from jointgap.identification.problem import Noise, Problem
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.draws import check_rate
from tests.identification.oscillator import SD, SPRING, linear, noise_of

SAMPLES = 40
X = np.linspace(0.0, 1.0, SAMPLES)
SLOPE = Candidate("slope", "sensor", (Parameter("rise", 0.0, step=0.1),), ("rise",))


@dataclass
class Levels:
    """Channel ``y`` of each run: shared + own + rise * (0 .. 1)."""

    runs: dict[str, tuple[float, float]]
    held_out: tuple[str, ...] = ()
    noise_sd: float = 0.5
    name: str = "levels"
    numerics: tuple[str, ...] = ()
    candidates: tuple[Candidate, ...] = (SLOPE,)
    nuisances: tuple[Parameter, ...] = field(init=False)
    series: list[Series] = field(init=False)

    def __post_init__(self):
        own = tuple(Parameter("own", 0.0, step=0.1, run=run) for run in self.runs)
        self.nuisances = (Parameter("shared", 0.0, step=0.1), *own)
        self.series = []
        for run, (level, rise) in self.runs.items():
            held_out = np.full(SAMPLES, run in self.held_out)
            value = level + rise * X + self._scatter()
            self.series.append(Series(run, "y", "1", value, X, X, held_out))

    def _scatter(self):
        """Alternating by one standard deviation: its mean square is exactly 1."""
        return self.noise_sd * np.resize([1.0, -1.0, -1.0, 1.0], SAMPLES)

    def simulate(self, run, values, effects=(), numerics=0):
        rise = sum(amplitudes["rise"] for _, amplitudes in effects)
        return {"y": values["shared"] + values["own"] + rise * X}

    @property
    def noise(self):
        return {series.key: Noise(np.full(SAMPLES, self.noise_sd)) for series in self.series}


def fit_of(model, hypothesis=(), **values):
    """A fit with a shared level of 2, these values and else 0, of the runs for fitting."""
    parameters = Problem(model, model.noise).parameters(hypothesis)
    names = [p.name.partition(".")[2] or p.name for p in parameters]
    found = np.array([({"shared": 2.0} | values).get(name, 0.0) for name in names])
    residual, jacobian = np.zeros(SAMPLES), np.zeros((SAMPLES, len(parameters)))
    return Fit(hypothesis, parameters, found, residual, jacobian, 1, "converged")


def confirmed(model, rise=None):
    """The gaps, with an effect of that rise if any is named."""
    named = [] if rise is None else [fit_of(model, (SLOPE,), rise=rise)]
    return confirm(model, model.noise, fit_of(model), *named)


def held_out(rise):
    """Level 2 and rise 3 in two runs, and a held-out run with an own level of 5."""
    return Levels({"one": (2.0, 3.0), "two": (2.0, 3.0), "held": (7.0, rise)}, held_out=("held",))


@pytest.fixture(scope="module")
def case():
    model = held_out(3.0)
    scatter = model._scatter() / model.noise_sd
    return SimpleNamespace(
        model=model, scatter=scatter, slope=3.0 / model.noise_sd, found=confirmed(model, 3.0)
    )


def gaps_of(found, run, role, channel="all"):
    return found.gaps.set_index(["run", "role", "channel"]).loc[(run, role, channel)]


def test_the_gap_is_the_root_mean_square_of_the_whitened_residual(case):
    expected = np.sqrt(np.mean((case.slope * X + case.scatter) ** 2))
    for run, channel in (("one", "all"), ("all", "all"), ("one", "y")):
        gaps = gaps_of(case.found, run, "identify", channel)
        assert (gaps["before"], gaps["after"]) == (pytest.approx(expected), pytest.approx(1.0))
    lone = confirmed(Levels({"one": (2.0, 3.0), "two": (2.0, 0.0)})).gaps
    by_run = lone[lone["channel"] == "all"].set_index("run")["before"]
    assert by_run["two"] == pytest.approx(1.0)
    assert by_run["all"] == pytest.approx(np.sqrt((by_run["one"] ** 2 + 1.0) / 2))
    assert (lone["after"] == lone["before"]).all() and lone["closed"].dropna().eq(0.0).all()
    alone = confirmed(Levels({"one": (2.0, 3.0)})).gaps  # there is nothing to confirm
    assert set(alone["role"]) == {"identify"}
    assert list(zip(alone["run"], alone["samples"], strict=True)) == [
        (run, SAMPLES) for run in ("one", "one", "all")
    ]


def test_run_parameters_are_refitted_on_the_held_out_run(case):
    # the level takes up the mean
    gaps, change = (gaps_of(case.found, "held", "confirm"), case.slope * (X - X.mean()))
    assert gaps["before"] == pytest.approx(np.sqrt(np.mean((change + case.scatter) ** 2)), rel=1e-3)
    assert gaps["after"] == pytest.approx(1.0, rel=1e-3)
    assert gaps["closed"] == pytest.approx(1 - (gaps["after"] ** 2 - 1) / (gaps["before"] ** 2 - 1))
    assert set(case.found.gaps["run"]) == {"one", "two", "held", "all"}
    # the expected fall is the mean square of the effect
    assert gaps["fall_expected"] == pytest.approx(np.mean(change**2), rel=1e-3)
    assert 0.0 < gaps["fall_low"] < gaps["before"] ** 2 - gaps["after"] ** 2 < gaps["fall_high"]
    base, named = fit_of(case.model), fit_of(case.model, (SLOPE,), rise=3.0)
    # where it was fitted
    assert fit_run_parameters(Problem(case.model, case.model.noise), base) == base.mapping
    values = fit_run_parameters(Problem(case.model, case.model.noise, held_out=True), named)
    assert values["own@held"] == pytest.approx(5.0, abs=1e-3) and values["shared"] == 2.0


def test_gap_intervals_contain_the_gap_are_seeded_and_match_the_scatter_of_stretches(case):
    gaps = case.found.gaps
    assert (gaps["before_low"] <= gaps["before"]).all()
    assert (gaps["before"] <= gaps["before_high"]).all()
    assert (gaps["before_low"] < gaps["before_high"]).all()
    assert gaps[["after_low", "after_high"]].to_numpy() == pytest.approx(
        np.ones((len(gaps), 2)), rel=1e-3
    )
    assert confirmed(case.model, 3.0).gaps.equals(gaps)
    other = confirm(case.model, case.model.noise, fit_of(case.model), seed=1).gaps
    assert not other["before_low"].equals(gaps["before_low"])
    model = Levels({"one": (2.0, 0.0)})
    wild = np.random.default_rng(3).normal(size=SAMPLES)
    object.__setattr__(model.series[0], "value", 2.0 + model.noise_sd * wild)
    found = confirmed(model).gaps.iloc[-1]
    pairs = (wild**2).reshape(20, 2).mean(axis=1)  # twenty stretches of two samples
    error = np.std(pairs) / np.sqrt(20) / (2 * found["before"])
    assert found["before_high"] - found["before_low"] == pytest.approx(2 * 1.645 * error, rel=0.1)


def test_90_percent_intervals_of_the_gap_of_noise_cover_90_percent():
    inside, settings = [], DEFAULT_SETTINGS.confirmation
    for seed in range(250):
        random = np.random.default_rng([31, seed])
        noise = random.standard_normal(200)
        whitened = pd.DataFrame({"whitened_base": noise, "whitened_augmented": noise})
        gap = _gap([_squares(whitened, random, settings)])
        inside.append(gap["before_low"] <= 1.0 <= gap["before_high"])
    check_rate(inside, 0.88, 0.92)


def test_the_held_out_gap_rises_without_the_effect_and_stays_with_half_of_it(case):
    tests = [confirmed(held_out(rise), 3.0).test for rise in (3.0, 0.0, 1.5)]
    assert [test.outcome for test in tests] == ["falls", "rises", "stays"]
    # the misfit only changes its sign
    assert tests[2].after == pytest.approx(tests[2].before, rel=0.1)


# In windows


def test_with_a_clearance_runs_keep_the_states_of_the_fit_and_held_out_runs_get_new_states():
    problem = linear(hidden={"spring": {"size": 0.3, "damping": 0.0}}, candidates=(SPRING,))
    noise = noise_of(problem)
    problem.model.series = [
        replace(one, held_out=np.full(one.value.size, one.run == "fast"))
        for one in problem.model.series
    ]
    problem = Problem(problem.model, noise)
    base, named = fitted(problem), fitted(problem, (SPRING,), {"spring.size": 0.28})
    assert named.in_windows and not base.in_windows
    found = confirm(problem.model, noise, base, named)
    runs = {run: rows for run, rows in found.residuals.groupby("run")}
    # the residual of a fit counts jumps too: it is a little longer
    np.testing.assert_allclose(runs["slow"]["whitened_augmented"], named.residual, rtol=0.01)
    np.testing.assert_allclose(runs["slow"]["whitened_base"], base.residual, rtol=0.01)
    assert gaps_of(found, "slow", "identify")["after"] == pytest.approx(1.0, abs=0.15)
    assert gaps_of(found, "fast", "confirm")["before"] > 2.0
    for rows in runs.values():
        assert np.std(rows["measured"] - rows["augmented"]) == pytest.approx(SD, rel=0.35)
        assert np.std(rows["measured"] - rows["base"]) > 2.0 * SD
    assert found.test.outcome == "falls"
    # a held-out run without windows is predicted by one trajectory
    make = problem.model.windows
    for windows in (make, lambda run, *more: None if run == "fast" else make(run, *more)):
        problem.model.windows = windows
        found = confirm(problem.model, noise, base, named)
        assert gaps_of(found, "fast", "confirm")["after"] == pytest.approx(1.0, abs=0.2)
