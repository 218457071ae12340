"""Fits of screened hypotheses: where each starts, as far along the linear answer as simulation bears it out."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.screening import LinearizedFit, Signatures

Smooth = Callable[[np.ndarray], np.ndarray]


def fit_screened(
    problem: Problem,
    differences: FiniteDifferences,
    signatures: Signatures,
    screened: LinearizedFit,
    part_fit: Fit | None = None,
    sufficient_chi2: float = np.inf,
    smoother: Smooth | None = None,
) -> Fit:
    """The fit of a screened hypothesis, from where its signatures say.

    A loose joint answers to a little force more than in proportion, so that an effect found by small steps may be
    several times as large as they say. So it starts from the best of 1, 2, 4 ... times the linear answer.
    """
    derivatives = (signatures if part_fit is None else signatures.about(part_fit)).derivatives(screened.signatures)
    try:
        start, near = _start(problem, screened, smoother)
    except (InputError, SimulationError) as error:
        parameters = problem.parameters(screened.hypothesis)
        values = np.array([screened.start.get(p.key, p.nominal) for p in parameters])
        residual, jacobian = np.full(problem.size, np.nan), np.empty((0, len(parameters)))
        failed = Fit(screened.hypothesis, parameters, values, residual, jacobian, 0, FAILED, str(error))
        return replace(failed, settings=problem.settings)
    return fit_hypothesis(
        problem,
        screened.hypothesis,
        start,
        derivatives if near else None,
        differences,
        sufficient_chi2=sufficient_chi2,
        smoother=smoother,
    )


def _start(problem: Problem, screened: LinearizedFit, smoother: Smooth | None) -> tuple[Mapping[str, float], bool]:
    """Values by key to start from, and whether that is so near the base that derivatives there are good enough."""
    if any(p.key in signature.shape_parameters for signature in screened.signatures for p in signature.amplitudes):
        return screened.start, False  # a finite amplitude: far from the base already
    return _best_multiple(problem, screened, smoother)


def _best_multiple(problem: Problem, screened: LinearizedFit, smoother: Smooth | None) -> tuple[dict[str, float], bool]:
    """The best of 1, 2, 4 ... times the linear answer, and whether it is the answer itself."""
    amplitudes = {f"{s.candidate.label}.{p.key}" for s in screened.signatures for p in s.amplitudes}
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
        chi2 = float(np.sum(np.square(residual if smoother is None else smoother(residual))))
        if chi2 >= least:
            break
        start, least, best, multiple = trial, chi2, multiple, 2.0 * multiple
    return start, best <= 1.0
