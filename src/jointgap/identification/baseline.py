"""The model as it stands, at its best: nuisances fitted within their ranges, and what other numerics would say."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.curved_valley import draws_along_valley
from jointgap.identification.ensemble_regression import fit_over_ensembles, regressed_over_ensemble
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.fit import FAILED, Fit, bounds_of, fit_hypothesis
from jointgap.identification.noise_model import numerics_noise
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.protocol import Model, Parameter
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from jointgap.identification.smoother import fit_via_smoothers, smoothers_of
from jointgap.identification.whitening import Noise


@dataclass(frozen=True)
class Baseline:
    """The model as it stands, that every hypothesis is compared with."""

    problem: Problem  # With the noise of the numerics in it
    differences: FiniteDifferences
    nominal: Fit  # All shared nuisances at nominal; only what belongs to single runs (speed, first angle) is fitted
    base: Fit  # All nuisances fitted


def recalibrate(
    model: Model, noise: Mapping[tuple[str, str], Noise], settings: IdentificationSettings = DEFAULT_SETTINGS
) -> Baseline:
    """Fit the nuisances; then count in what equally good numerics would predict, and fit again."""
    first = Problem(model, noise, settings=settings)
    start = multistart_fit(first, probed_differences(first, {p.key: p.nominal for p in first.nuisances}))
    if start.status == FAILED:
        raise SimulationError(f"{model.name}: cannot be simulated as it stands: {start.reason}")
    problem = Problem(model, numerics_noise(model, start.mapping, noise, settings.noise), settings=settings)
    differences = probed_differences(problem, start.mapping)
    nominal = fit_hypothesis(
        problem,
        start={key: value for key, value in start.mapping.items() if "@" in key},
        differences=differences,
        vary=[p for p in problem.nuisances if p.run is not None],
    )
    base = fit_hypothesis(problem, start=start.mapping, differences=differences, refresh=True)
    if problem.has_statistics:
        base = fit_over_ensembles(problem, base, _enough(problem, base))
    # differences probed anew, as they are when a later stage reads the fits from files
    return Baseline(problem, probed_differences(problem, base.mapping), nominal, base)


def multistart_fit(
    problem: Problem,
    differences: FiniteDifferences,
    hypothesis: Hypothesis = (),
    start: Mapping[str, float] | None = None,
    max_starts: int | None = None,
) -> Fit:
    """The best of fits from several values of the nuisances; the first that leaves noise alone ends the search.

    Where joints are loose, fits may be caught in a valley that is not the deepest. So all but the first go from
    coarsely smoothed residuals to the samples, where these can be smoothed. One that ends in the same minimum as the
    best before it ends the search too.
    """
    settings = problem.settings.baseline
    count = settings.max_starts if max_starts is None else max_starts
    given = {p.key: p.nominal for p in problem.parameters(hypothesis)} | dict(start or {})
    best = fit_hypothesis(problem, hypothesis, given, differences=differences)
    smoothers = smoothers_of(problem)
    again = (given,) if smoothers else ()  # the same start once more, by way of smoothed residuals
    for values in (*again, *(given | drawn for drawn in random_nuisances(problem, hypothesis, count - 1))):
        if best.status == FAILED or best.chi2 < _enough(problem, best):
            break
        fit = fit_via_smoothers(problem, hypothesis, values, differences, smoothers)
        same = is_same_minimum(fit, best, differences)
        best = min(best, fit, key=lambda fit: fit.chi2)
        if same:
            break
    return best


def _enough(problem: Problem, fit: Fit) -> float:
    """chi2 that noise alone leaves of a fit."""
    dof = max(problem.size - len(fit.parameters), 1)
    return dof + problem.settings.baseline.noise_sigmas * float(np.sqrt(2.0 * dof))


def is_same_minimum(fit: Fit, other: Fit, differences: FiniteDifferences) -> bool:
    """Whether two fits ended in the same minimum, as far as chi2 says and its numerical noise lets it."""
    least = differences.problem.settings.baseline.same_minimum * other.chi2
    return abs(fit.chi2 - other.chi2) < max(least, differences.numerical_noise_chi2)


def shared_nuisances(problem: Problem, hypothesis: Hypothesis) -> list[Parameter]:
    """The bounded nuisances that runs share."""
    shared = [p for p in problem.parameters(hypothesis) if p.run is None and p in problem.nuisances]
    return [p for p in shared if np.isfinite(p.high - p.low)]


def random_nuisances(problem: Problem, hypothesis: Hypothesis, count: int) -> list[dict[str, float]]:
    """Values of the nuisances that runs share, drawn evenly from their ranges; none where there are no such
    nuisances.
    """
    bounded = shared_nuisances(problem, hypothesis)
    generator = np.random.default_rng(0)
    return [{p.key: float(generator.uniform(p.low, p.high)) for p in bounded} for _ in range(count if bounded else 0)]


def probed_differences(problem: Problem, values: Mapping[str, float]) -> FiniteDifferences:
    """Finite differences that know the numerical noise at `values` (by key [SI]), if `problem` can be simulated."""
    differences = FiniteDifferences(problem)
    try:
        differences.probe(problem.nuisances, values, problem.residual(values))
    except (InputError, SimulationError):
        pass  # the fit that starts there says why
    return differences


def with_intervals(problem: Problem, fit: Fit, differences: FiniteDifferences) -> Fit:
    """A fit to the `problem` that knows what its intervals ask for: draws of chaotic motion's parameters, or along a
    curved valley of chi2, or shifts.

    Where chi2 is quadratic, intervals count what other numerics, another start among them, change in the values: it is
    projected onto the parameters as the data and the widths of the bounds determine them. Along a curved valley a
    projection would lead astray, and there numerics count in the noise alone. Of chaotic motion the values are those of
    the regression, and what is left is as it was. A fit that failed, that has draws, that cannot be regressed, or that
    cannot be simulated by other numerics, is left as it is; the `differences` know the numerical noise.
    """
    if fit.status == FAILED or fit.draws is not None:
        return fit
    if problem.has_statistics:
        # what is left stays as it is: by that explanations were compared
        return replace(regressed_over_ensemble(problem, fit), residual=fit.residual)
    draws = draws_along_valley(problem, fit, differences.numerical_noise_chi2)
    if draws is not None:
        return replace(fit, draws=draws)
    try:
        changes = other_numerics(problem, fit)
    except (InputError, SimulationError):
        return fit
    low, high = bounds_of(fit.parameters)
    widths = np.diag(np.where(np.isfinite(high - low), np.sqrt(12.0) / (high - low), 0.0))
    rows = np.vstack([fit.jacobian, widths])
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    changes = np.hstack([changes, np.zeros((len(changes), scale.size))])
    least = problem.settings.intervals.least_singular_value
    return replace(fit, shifts=np.linalg.lstsq(rows / scale, changes.T, rcond=least)[0].T / scale)


def other_numerics(problem: Problem, base: Fit) -> np.ndarray:
    """What other numerics change in the whitened residuals of the fit `base` to `problem`: (number of numerics, n)."""
    changes = []
    for i in range(len(problem.model.numerics)):
        changes.append(problem.residual(base.mapping, base.hypothesis, numerics=i + 1) - base.residual)
    return np.array(changes).reshape(len(changes), problem.size)
