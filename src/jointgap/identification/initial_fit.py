"""Where a fit begins: as far along the linear answer as simulation bears it out."""

from collections.abc import Callable, Mapping

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.fit import Fit, fit_hypothesis
from jointgap.identification.problem import Problem
from jointgap.identification.screening import Screened, Signature
from jointgap.identification.signature_subspaces import orthonormal

_FARTHEST = 16.0  # times the linear answer

_BINS = 24  # of a cycle, in which departures are compared
_LIKELY = 0.5  # of the distance to the course without the effect: a size that comes no nearer is not looked at further
_BESIDE, _FINE = 1.35, 31  # how far around the best of a grid samples are looked at, and at how many sizes


def fit_from_signatures(
    problem: Problem,
    one: Screened,
    known: Mapping[str, np.ndarray],
    differences: FiniteDifferences,
    sufficient_chi2: float = np.inf,
    smoother: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Fit:
    """The fit from the best of 1, 2, 4 ... times the linear answer, or of the sizes on a candidate's grid.

    A loose joint answers to a little force more than in proportion, so that an effect found by small steps may be several times
    as large as they say.

    Parameters
    ----------
    problem : Problem
    one : Screened
    known : mapping of str to (n,) array
        Derivatives by key about the base; used where the start is near it.
    differences : FiniteDifferences
    sufficient_chi2, smoother
        As of `jointgap.identification.fit.fit_hypothesis`.

    Returns
    -------
    Fit
        Failed, with the reason, where its start cannot be simulated.

    Raises
    ------
    SimulationError
        No size on a candidate's grid comes nearer to the data than none, or none can be simulated.
    """
    for new in one.signatures:
        if new.candidate.grid and not any(part.series.statistic for part in problem.parts):
            start, left = _from_grid(problem, one, new, known)
            if left >= float(new.origin @ new.origin):
                raise SimulationError(
                    f"no size of {new.candidate.label} that was tried comes nearer to the data than none"
                )
            return fit_hypothesis(
                problem,
                one.hypothesis,
                start,
                differences=differences,
                sufficient_chi2=sufficient_chi2,
                smoother=smoother,
            )
    if any(
        p.key in new.shape_parameters for new in one.signatures for p in new.amplitudes
    ):  # it starts far from the base already
        return fit_hypothesis(
            problem,
            one.hypothesis,
            one.start,
            differences=differences,
            sufficient_chi2=sufficient_chi2,
            smoother=smoother,
        )
    start, multiple = _stretched(problem, one, smoother)
    near = multiple <= 1.0  # derivatives at the base are good enough
    return fit_hypothesis(
        problem,
        one.hypothesis,
        start,
        known if near else None,
        differences,
        sufficient_chi2=sufficient_chi2,
        smoother=smoother,
    )


def _stretched(
    problem: Problem, one: Screened, smoother: Callable[[np.ndarray], np.ndarray] | None
) -> tuple[dict[str, float], float]:
    """The best of 1, 2, 4 ... times the linear answer, as a start, and which it is."""
    sizes = {f"{new.candidate.label}.{p.key}" for new in one.signatures for p in new.amplitudes}
    bounds = {p.key: (p.low, p.high) for p in problem.parameters(one.hypothesis)}
    start, best, multiple, least = dict(one.start), 1.0, 1.0, np.inf
    while multiple <= _FARTHEST:
        trial = {
            key: float(np.clip(value * multiple, *bounds[key])) if key in sizes else value
            for key, value in one.start.items()
        }
        try:
            residual = problem.residual(trial, one.hypothesis)
        except (InputError, SimulationError):
            break
        chi2 = float(np.sum(np.square(residual if smoother is None else smoother(residual))))
        if chi2 >= least:
            break
        start, least, best, multiple = trial, chi2, multiple, 2.0 * multiple
    return start, best


def _from_grid(
    problem: Problem, one: Screened, new: Signature, known: Mapping[str, np.ndarray]
) -> tuple[dict[str, float], float]:
    """The start with the size of an effect that leaves least once nuisances take up what they can, and the chi2 that is left.

    Samples answer to sizes that are some percent off alone; where over the cycle the motion departs from what it is without the
    effect, and how far, says more from afar. So sizes are told apart by that first, and by samples beside the best one.
    """
    (size,) = new.amplitudes
    key = f"{new.candidate.label}.{size.key}"
    # nuisances stay where the origin was seen from: the answer to a secant that does not hold would lead them astray
    start = {name: one.near.get(name, value) for name, value in one.start.items()}
    kept = [known[p.key] for p in problem.parameters(one.hypothesis) if p.key in known and p.key != key]
    across = orthonormal(np.column_stack(kept) if kept else np.empty((problem.size, 0)))
    origin = new.origin
    sought = _course(problem, np.square(origin))

    def departure(left: np.ndarray) -> float:
        return float(np.mean(np.square(_course(problem, 1.0 + np.square(left - origin)) - sought)))

    def misfit(left: np.ndarray) -> float:
        return float(left @ left - np.sum(np.square(across.T @ left)))

    within = [value for value in new.candidate.grid if value <= size.high]
    start, away = _best_of(problem, one, start, key, within, departure)
    if away > _LIKELY * departure(origin):
        return start, np.inf
    fine = np.minimum(start[key] * np.geomspace(1.0 / _BESIDE, _BESIDE, _FINE), size.high)
    return _best_of(problem, one, start, key, fine, misfit)


def _best_of(problem: Problem, one: Screened, start, key: str, values, measure) -> tuple[dict[str, float], float]:
    """The start with that of `values` of which `measure` is least, and the measure; infinite where none can be simulated."""
    best, least = start, np.inf
    for value in values:
        trial = {**start, key: float(value)}
        try:
            found = measure(problem.residual(trial, one.hypothesis))
        except (InputError, SimulationError):
            continue
        if found < least:
            best, least = trial, found
    return best, least


def _course(problem: Problem, squares: np.ndarray) -> np.ndarray:
    """Logarithm of the mean square over the cycle, in bins of each channel of each run, one behind the other."""
    found = []
    for part in problem.parts:
        angle = np.nan_to_num(part.series.angle[part.used])
        at = np.floor(np.mod(angle, 2.0 * np.pi) / (2.0 * np.pi) * _BINS).astype(int) % _BINS
        total, count = np.bincount(at, squares[part.place], _BINS), np.bincount(at, minlength=_BINS)
        found.append(np.log(np.maximum(total[count > 0] / count[count > 0], 1e-3)))
    return np.concatenate(found)
