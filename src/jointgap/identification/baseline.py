"""The model as it stands, at its best: nuisances fitted within their ranges, and what other numerics would say."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.noise_model import numerics_noise
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.protocol import Model
from jointgap.identification.smoother import coarse_to_fine_fit, smoothers_of
from jointgap.identification.whitening import Noise

STARTS = 3
"""Values of the nuisances that a fit is started from where it does not leave noise alone: those given, among the samples and then from
afar, and drawn ones from afar."""

_SAME = 1e-3  # of chi2: two fits that differ by less have come to the same end

_SURE = 3.0  # standard deviations of chi2 that noise alone may leave


@dataclass(frozen=True)
class Baseline:
    """The base that every explanation is compared with.

    Attributes
    ----------
    problem : Problem
        With the noise of the numerics in it.
    differences : FiniteDifferences
    nominal : Fit
        All shared nuisances at nominal; only what belongs to single runs (speed, first angle) is fitted.
    base : Fit
        All nuisances fitted.
    """

    problem: Problem
    differences: FiniteDifferences
    nominal: Fit
    base: Fit


def recalibrate(model: Model, noise: Mapping[tuple[str, str], Noise]) -> Baseline:
    """Fit the nuisances; then count in what equally good numerics would predict, and fit again.

    Raises
    ------
    SimulationError
        The model cannot be simulated as it stands.
    """
    first = Problem(model, noise)
    start = multistart_fit(first, probed_differences(first, {p.key: p.nominal for p in first.nuisances}))
    if start.status == FAILED:
        raise SimulationError(f"{model.name}: cannot be simulated as it stands: {start.reason}")
    problem = Problem(model, numerics_noise(model, start.mapping, noise))
    differences = probed_differences(problem, start.mapping)
    own = [p for p in problem.nuisances if p.run is not None]
    nominal = fit_hypothesis(
        problem,
        start={key: value for key, value in start.mapping.items() if "@" in key},
        differences=differences,
        vary=own,
    )
    base = fit_hypothesis(problem, start=start.mapping, differences=differences, refresh=True)
    return Baseline(problem, probed_differences(problem, base.mapping), nominal, base)  # as they come back from files


def multistart_fit(
    problem: Problem,
    differences: FiniteDifferences,
    hypothesis: Hypothesis = (),
    start: Mapping[str, float] | None = None,
    starts: int = STARTS,
) -> Fit:
    """The best of fits from several values of the nuisances; the first that leaves noise alone ends the search.

    Where joints are loose, fits may be caught in a valley that is not the deepest. So all but the first come from afar
    (`jointgap.identification.smoother`), and one that comes to the same end as the best one before it ends the search too. Where there is
    no view from afar all drawn values are tried.

    Parameters
    ----------
    problem : Problem
    differences : FiniteDifferences
    hypothesis : tuple of Candidate
    start : mapping of str to float
        Where the first fit starts, and what is no shared nuisance always does; nominal where absent.
    starts : int
        From how many values of the nuisances, at most; the first ones also from among the samples.
    """
    at = {p.key: p.nominal for p in problem.parameters(hypothesis)} | dict(start or {})
    best = fit_hypothesis(problem, hypothesis, at, differences=differences)
    through = smoothers_of(problem)
    again = (at,) if through else ()  # the same start once more, from afar
    for values in (*again, *(at | one for one in random_nuisances(problem, hypothesis, starts - 1))):
        dof = max(problem.size - len(best.parameters), 1)
        if best.status == FAILED or best.chi2 < dof + _SURE * np.sqrt(2.0 * dof):
            break
        near = coarse_to_fine_fit(problem, hypothesis, values, differences, through) if through else None
        start = values if near is None or near.status == FAILED else near.mapping
        found = fit_hypothesis(problem, hypothesis, start, differences=differences)
        same = bool(through) and abs(found.chi2 - best.chi2) < _SAME * best.chi2
        best = min(best, found, key=lambda one: one.chi2)
        if same:
            break
    return best


def random_nuisances(problem: Problem, hypothesis: Hypothesis, count: int) -> list[dict[str, float]]:
    """Values of the nuisances that runs share, drawn evenly from their ranges, by key; none where there are no such nuisances."""
    shared = [p for p in problem.parameters(hypothesis) if p.run is None and p in problem.nuisances]
    bounded = [p for p in shared if np.isfinite(p.high - p.low)]
    generator = np.random.default_rng(0)
    return [{p.key: float(generator.uniform(p.low, p.high)) for p in bounded} for _ in range(count if bounded else 0)]


def probed_differences(problem: Problem, values: Mapping[str, float]) -> FiniteDifferences:
    """Differences that know how rough the model is at `values`, if it can be simulated there."""
    differences = FiniteDifferences(problem)
    try:
        differences.probe(problem.nuisances, values, problem.residual(values))
    except (InputError, SimulationError):
        pass  # the fit that starts there says why
    return differences


def other_numerics(problem: Problem, base: Fit) -> np.ndarray:
    """What other numerics change in the whitened residuals of a fit, shape (number of them, n)."""
    changes = []
    for i in range(len(problem.model.numerics)):
        changes.append(problem.residual(base.mapping, base.hypothesis, numerics=i + 1) - base.residual)
    return np.array(changes).reshape(len(changes), problem.size)
