"""Fits of screened hypotheses: where each starts, as far along the linear answer as simulation bears it out."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.screening import LinearizedFit, Signature, Signatures
from jointgap.identification.settings import InitialGuessSettings
from jointgap.identification.signature_subspaces import orthonormal

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
    several times as large as they say. So it starts from the best of 1, 2, 4 ... times the linear answer, or of the
    amplitudes on a candidate's grid.

    Parameters
    ----------
    problem : Problem
    differences : FiniteDifferences
    signatures : Signatures
        About the base.
    screened : LinearizedFit
    part_fit : Fit, optional
        The fit of a part of the hypothesis that the rest is added to.
    sufficient_chi2, smoother
        As of `jointgap.identification.fit.fit_hypothesis`.

    Returns
    -------
    Fit
        Failed, with the reason, where its start cannot be simulated or no amplitude on a grid comes nearer to the data
        than none.
    """
    derivatives = (signatures if part_fit is None else signatures.about(part_fit)).derivatives(screened.signatures)
    try:
        start, near = _start(problem, screened, derivatives, smoother)
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


def _start(
    problem: Problem, screened: LinearizedFit, derivatives: Mapping[str, np.ndarray], smoother: Smooth | None
) -> tuple[Mapping[str, float], bool]:
    """Values by key to start from, and whether that is so near the base that derivatives there are good enough."""
    for signature in screened.signatures:
        if signature.candidate.grid and not any(part.series.statistic for part in problem.parts):
            start, misfit = _best_on_grid(problem, screened, signature, derivatives)
            if misfit >= float(signature.origin @ signature.origin):
                label = signature.candidate.label
                raise SimulationError(f"no size of {label} that was tried comes nearer to the data than none")
            return start, False
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


def _best_on_grid(
    problem: Problem, screened: LinearizedFit, signature: Signature, derivatives: Mapping[str, np.ndarray]
) -> tuple[dict[str, float], float]:
    """The start whose amplitude leaves the smallest chi2 once nuisances take up what they can, and that chi2.

    Samples respond only to amplitudes that are right to some percent. Where over the cycle the motion departs from what
    it is without the effect, and how far, ranks amplitudes from farther away. So that chooses on the grid, and samples
    beside the best.
    """
    settings: InitialGuessSettings = problem.settings.initial_guess
    (amplitude,) = signature.amplitudes
    key = f"{signature.candidate.label}.{amplitude.key}"
    # nuisances stay where the origin was simulated: the answer to a secant that does not hold would lead them astray
    start = {name: screened.near.get(name, value) for name, value in screened.start.items()}
    varied = [
        derivatives[p.key] for p in problem.parameters(screened.hypothesis) if p.key in derivatives and p.key != key
    ]
    nuisances = orthonormal(np.column_stack(varied) if varied else np.empty((problem.size, 0)))
    origin = signature.origin
    measured = _log_power(problem, np.square(origin), settings.cycle_bins)

    def departure(residual: np.ndarray) -> float:
        simulated = _log_power(problem, 1.0 + np.square(residual - origin), settings.cycle_bins)
        return float(np.mean(np.square(simulated - measured)))

    def misfit(residual: np.ndarray) -> float:
        return float(residual @ residual - np.sum(np.square(nuisances.T @ residual)))

    grid = [value for value in signature.candidate.grid if value <= amplitude.high]
    start, smallest = _best_of(problem, screened, start, key, grid, departure)
    if smallest > settings.max_departure_share * departure(origin):
        return start, np.inf
    around = np.geomspace(1.0 / settings.refinement_factor, settings.refinement_factor, settings.refinement_points)
    return _best_of(problem, screened, start, key, np.minimum(start[key] * around, amplitude.high), misfit)


def _best_of(
    problem: Problem,
    screened: LinearizedFit,
    start: dict[str, float],
    key: str,
    values: Iterable[float],
    measure: Callable[[np.ndarray], float],
) -> tuple[dict[str, float], float]:
    """The start with that value whose residuals measure least, and the measure; infinite where all fail."""
    best, least = start, np.inf
    for value in values:
        trial = {**start, key: float(value)}
        try:
            measured = measure(problem.residual(trial, screened.hypothesis))
        except (InputError, SimulationError):
            continue
        if measured < least:
            best, least = trial, measured
    return best, least


def _log_power(problem: Problem, squares: np.ndarray, bins: int) -> np.ndarray:
    """Logarithm of the mean of the squares (n,) in bins of the cycle; channels and runs one behind the other."""
    levels = []
    for part in problem.parts:
        angle = np.nan_to_num(part.series.angle[part.used])
        place = np.floor(np.mod(angle, 2.0 * np.pi) / (2.0 * np.pi) * bins).astype(int) % bins
        total, count = np.bincount(place, squares[part.place], bins), np.bincount(place, minlength=bins)
        levels.append(np.log(np.maximum(total[count > 0] / count[count > 0], 1e-3)))
    return np.concatenate(levels)
