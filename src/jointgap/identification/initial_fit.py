"""Start values of fits."""

from collections.abc import Iterable, Sequence

import numpy as np

from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.fit import (
    FAILED,
    STOPPED,
    FiniteDifferences,
    Fit,
    bounded_step,
    bounds_of,
    fit_hypothesis,
)
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.screening import LinearizedFit, Sensitivities


def fit_screened(
    problem: Problem,
    differences: FiniteDifferences,
    sensitivities: Sensitivities,
    screened: LinearizedFit,
    sufficient_chi2: float = np.inf,
) -> Fit:
    """The fit of a screened hypothesis, from the best of 1, 2, 4 ... times the linear estimate, as
    loose joints respond more than proportionally to small forces.
    """
    is_finite = any(
        p.key in one.shape_parameters for one in screened.sensitivities for p in one.amplitudes
    )
    # no multiples of a finite amplitude
    start, near = (screened.start, False) if is_finite else _best_multiple(problem, screened)
    known = sensitivities.derivatives(screened.sensitivities) if near else None
    return fit_hypothesis(
        problem, screened.hypothesis, start, known, differences, sufficient_chi2=sufficient_chi2
    )


def _best_multiple(problem: Problem, screened: LinearizedFit) -> tuple[dict[str, float], bool]:
    """The best of 1, 2, 4 ... times the linear estimate, and whether the factor is 1."""
    amplitudes = {
        f"{s.candidate.label}.{p.key}" for s in screened.sensitivities for p in s.amplitudes
    }
    bounds = {p.key: (p.low, p.high) for p in problem.parameters(screened.hypothesis)}
    start, best, multiple, least = dict(screened.start), 1.0, 1.0, np.inf
    while multiple <= problem.settings.initial_guess.max_multiple:
        trial = {
            key: float(np.clip(value * multiple, *bounds[key])) if key in amplitudes else value
            for key, value in screened.start.items()
        }
        try:
            residual = problem.residual(trial, screened.hypothesis)
        except (InputError, SimulationError):
            break
        chi2 = float(residual @ residual)
        if chi2 >= least:
            break
        start, least, best, multiple = trial, chi2, multiple, 2.0 * multiple
    return start, best <= 1.0


def labels_of(hypothesis: Hypothesis) -> frozenset[str]:
    """The labels of its effects."""
    return frozenset(candidate.label for candidate in hypothesis)


def best_fit_per_hypothesis(fits: Iterable[Fit]) -> list[Fit]:
    """The fit with the least chi2 of each hypothesis (in any order of effects), sorted by chi2."""
    lowest: dict[frozenset[str], Fit] = {}
    for fit in sorted(fits, key=lambda fit: fit.chi2):
        lowest.setdefault(labels_of(fit.hypothesis), fit)
    return list(lowest.values())


def with_effects_absent(problem: Problem, hypothesis: Hypothesis, part: Fit) -> dict[str, float]:
    """Values by key [SI] at which a hypothesis predicts the same as the fit of a part of it, as far
    as bounds allow.

    The amplitude of an effect that replaces a nuisance is the nuisance's deviation from nominal.
    """
    parameters = problem.parameters(hypothesis)
    values, fitted = {p.key: p.nominal for p in parameters}, part.mapping
    nominal = {p.name: p.nominal for p in problem.nuisances}
    for candidate in hypothesis:
        if candidate.label in labels_of(part.hypothesis):
            continue
        shapes = candidate.initial_guesses[0]
        for p in candidate.coordinates_in(problem.runs):
            absent = 0.0 if p.key in candidate.amplitudes else shapes.get(p.key, p.nominal)
            values[f"{candidate.label}.{p.key}"] = (
                fitted.get(p.key, absent) if p.name in nominal else absent
            )
        for name, amplitude in reversed(candidate.replaces.items()):  # the first one has priority
            if name in fitted:
                values[f"{candidate.label}.{amplitude}"] = fitted[name] - nominal[name]
    values |= {key: value for key, value in fitted.items() if key in values}
    low, high = bounds_of(parameters)
    return {
        p.key: float(np.clip(values[p.key], a, b))
        for p, a, b in zip(parameters, low, high, strict=True)
    }


def refit_from_part(
    problem: Problem,
    differences: FiniteDifferences,
    fit: Fit,
    parts: Sequence[Fit],
    sufficient_chi2: float = np.inf,
) -> Fit:
    """The `fit` or, if a part of its hypothesis has a smaller chi2 and that is better, one that
    starts from the part."""
    own = labels_of(fit.hypothesis)
    nonsmooth = (
        () if problem.has_statistics else (one.label for one in fit.hypothesis if one.is_nonsmooth)
    )
    lower = [
        part
        for part in parts
        if {*nonsmooth} <= labels_of(part.hypothesis) < own and part.chi2 < fit.chi2
    ]
    if fit.status == FAILED or fit.in_windows or not lower:
        return fit
    lowest = min(lower, key=lambda part: part.chi2)
    start = with_effects_absent(problem, fit.hypothesis, lowest)
    known = derivatives_of(fit) | derivatives_of(lowest)
    again = fit_hypothesis(
        problem, fit.hypothesis, start, known, differences, sufficient_chi2=sufficient_chi2
    )
    return again if again.chi2 < fit.chi2 else fit


def with_nuisances_of(problem: Problem, fit: Fit, other: Fit) -> dict[str, float]:
    """Values of a fit by key [SI] with the nuisances of another fit, including those that its
    effects replace."""
    nominal = {p.name: p.nominal for p in problem.nuisances}
    nuisances = {key: value for key, value in other.mapping.items() if "." not in key}
    for candidate in other.hypothesis:
        for name, amplitude in candidate.replaces.items():
            nuisances[name] = nominal[name] + other.mapping[f"{candidate.label}.{amplitude}"]
    return fit.mapping | {key: value for key, value in nuisances.items() if key in fit.mapping}


def without_other_effects(problem: Problem, fit: Fit, kept: Hypothesis) -> Fit:
    """The fit with only the `kept` effects, by linearisation in the amplitudes of the others; other
    values unchanged."""
    columns = {p.key: column for p, column in zip(fit.parameters, fit.jacobian.T, strict=True)}
    parameters, residual, values = problem.parameters(kept), fit.residual.copy(), fit.mapping
    names = {p.name for p in problem.nuisances}
    for candidate in (each for each in fit.hypothesis if each not in kept):
        own = {p.key: f"{candidate.label}.{p.key}" for p in candidate.coordinates_in(problem.runs)}
        for key in candidate.amplitudes:
            if key in own:
                residual -= columns[own[key]] * values[own[key]]
        for key in names & own.keys():  # a partly replaced nuisance
            values[key], columns[key] = values[own[key]], columns[own[key]]
        for name, amplitude in candidate.replaces.items():
            columns[name] = columns.get(name, 0.0) + columns[own[amplitude]]
    here = np.array([values.get(p.key, p.nominal) for p in parameters])
    jacobian = (
        np.array([columns[p.key] for p in parameters]).reshape(len(parameters), residual.size).T
    )
    return Fit(kept, parameters, here, residual, jacobian, 0, STOPPED, settings=fit.settings)


def chi2_without_effects(problem: Problem, fit: Fit) -> float:
    """chi2 of the current model within the minimum of a fit, by linearisation: without effects,
    nuisances re-fitted."""
    keys = [p.key for p in fit.parameters]
    low, high = bounds_of(fit.parameters)
    low, high = low - fit.values, high - fit.values
    ranges = {p.name: (p.low - p.nominal, p.high - p.nominal) for p in problem.nuisances}
    for candidate in fit.hypothesis:
        replaced = {amplitude: name for name, amplitude in candidate.replaces.items()}
        for p in candidate.coordinates_in(problem.runs):
            place = keys.index(f"{candidate.label}.{p.key}")
            if p.key in candidate.amplitudes:
                absent = ranges[replaced[p.key]] if p.key in replaced else (0.0, 0.0)
                low[place], high[place] = np.subtract(absent, fit.values[place])
            elif p.name not in ranges:  # the shape of an absent effect
                low[place], high[place] = 0.0, 0.0
    # at a minimum only the curvature of chi2 counts, so a compressed Jacobian suffices
    first = np.clip(0.0, low, high)
    _, rise = bounded_step(fit.jacobian, fit.jacobian @ first, low - first, high - first)
    return fit.chi2 + rise


def derivatives_of(fit: Fit) -> dict[str, np.ndarray]:
    """Derivatives of a fit's residuals by key, each (n,) [1/SI]; none if read from a file (fewer
    rows) or in windows."""
    if fit.in_windows or fit.jacobian.shape[0] != fit.residual.size:
        return {}
    return dict(zip((p.key for p in fit.parameters), fit.jacobian.T, strict=True))
