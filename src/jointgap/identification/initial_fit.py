"""Start values of fits."""

import numpy as np

from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.fit import (
    STOPPED,
    FiniteDifferences,
    Fit,
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
    provisional: bool = False,
) -> Fit:
    """The fit of a screened hypothesis, from the best of 1, 2, 4 ... times the linear estimate, as
    loose joints respond more than proportionally to small forces; a `provisional` one uses the
    sensitivities as derivatives, and stops where new ones are needed.
    """
    is_finite = any(
        p.key in one.shape_parameters for one in screened.sensitivities for p in one.amplitudes
    )
    # no multiples of a finite amplitude
    start, near = (screened.start, False) if is_finite else _best_multiple(problem, screened)
    known = sensitivities.derivatives(screened.sensitivities) if near or provisional else None
    return fit_hypothesis(
        problem,
        screened.hypothesis,
        start,
        known,
        differences,
        sufficient_chi2=sufficient_chi2,
        provisional=provisional,
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
