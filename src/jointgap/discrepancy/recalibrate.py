"""The model as it stands, at its best: nuisances fitted within their ranges, and what other numerics would say."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from jointgap.discrepancy.differences import Differences
from jointgap.discrepancy.fit import FAILED, Fit, fit
from jointgap.discrepancy.noise import numerics_noise
from jointgap.discrepancy.problem import Problem
from jointgap.discrepancy.protocol import Model
from jointgap.discrepancy.whiten import Noise
from jointgap.errors import InputError, SimulationError


@dataclass(frozen=True)
class Recalibrated:
    """The base that every explanation is compared with.

    Attributes
    ----------
    problem : Problem
        With the noise of the numerics in it.
    differences : Differences
    nominal : Fit
        All shared nuisances at nominal; only what belongs to single runs (speed, first angle) is fitted.
    base : Fit
        All nuisances fitted.
    """

    problem: Problem
    differences: Differences
    nominal: Fit
    base: Fit


def recalibrate(model: Model, noise: Mapping[tuple[str, str], Noise]) -> Recalibrated:
    """Fit the nuisances; then count in what equally good numerics would predict, and fit again.

    Raises
    ------
    SimulationError
        The model cannot be simulated as it stands.
    """
    first = Problem(model, noise)
    start = fit(first, differences=_differences(first, {p.key: p.nominal for p in first.nuisances}))
    if start.status == FAILED:
        raise SimulationError(f"{model.name}: cannot be simulated as it stands: {start.reason}")
    problem = Problem(model, numerics_noise(model, start.mapping, noise))
    differences = _differences(problem, start.mapping)
    own = [p for p in problem.nuisances if p.run is not None]
    nominal = fit(
        problem,
        start={key: value for key, value in start.mapping.items() if "@" in key},
        differences=differences,
        vary=own,
    )
    base = fit(problem, start=start.mapping, differences=differences, refresh=True)
    return Recalibrated(problem, differences, nominal, base)


def _differences(problem: Problem, values: Mapping[str, float]) -> Differences:
    """Differences that know how rough the model is at `values`, if it can be simulated there."""
    differences = Differences(problem)
    try:
        differences.probe(problem.nuisances, values, problem.residual(values))
    except (InputError, SimulationError):
        pass  # the fit that starts there says why
    return differences


def other_numerics(problem: Problem, base: Fit) -> np.ndarray:
    """What other numerics change in the whitened residuals of a fit, shape (number of them, n)."""
    changes = []
    for i in range(len(problem.model.numerics)):
        changes.append(problem.residual(base.mapping, base.explanation, numerics=i + 1) - base.residual)
    return np.array(changes).reshape(len(changes), problem.size)
