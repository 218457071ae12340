"""Where a fit begins: as far along the linear answer as simulation bears it out."""

from collections.abc import Mapping

import numpy as np

from jointgap.discrepancy.differences import Differences
from jointgap.discrepancy.fit import Fit, fit
from jointgap.discrepancy.problem import Problem
from jointgap.discrepancy.screen import Screened
from jointgap.errors import InputError, SimulationError

_FARTHEST = 16.0  # times the linear answer


def fit_screened(problem: Problem, one: Screened, known: Mapping[str, np.ndarray], differences: Differences) -> Fit:
    """The fit from the best of 1, 2, 4 ... times the linear answer.

    A loose joint answers to a little force more than in proportion, so that an effect found by small steps may be several times
    as large as they say.

    Parameters
    ----------
    problem : Problem
    one : Screened
    known : mapping of str to (n,) array
        Derivatives by key about the base; used where the start is near it.
    differences : Differences
    """
    sizes = {f"{new.candidate.label}.{p.key}" for new in one.signatures for p in new.sizes}
    bounds = {p.key: (p.low, p.high) for p in problem.parameters(one.explanation)}
    start, multiple, least = one.start, 1.0, np.inf
    while multiple <= _FARTHEST:
        trial = {
            key: float(np.clip(value * multiple, *bounds[key])) if key in sizes else value
            for key, value in one.start.items()
        }
        try:
            chi2 = float(np.sum(problem.residual(trial, one.explanation) ** 2))
        except (InputError, SimulationError):
            break
        if chi2 >= least:
            break
        start, least, multiple = trial, chi2, 2.0 * multiple
    near = multiple <= 2.0  # derivatives at the base are good enough
    return fit(problem, one.explanation, start, known if near else None, differences)
