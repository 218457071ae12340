"""Residuals seen from afar, and fits that come from there.

Impacts make spikes. Where a parameter is a percent off, spikes miss each other by some samples, and by how much they do says nothing
of the way: the valley around the truth is narrow, and elsewhere there are others. Smoothed over the cycle, a residual counts what
an impact does to the motion rather than at which sample. Fits go from the coarsest view to the samples, each from where
the one before ended; what a coarse view leaves open is looked through in the next one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import oaconvolve

from jointgap.errors import InputError, SimulationError
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.fit import FAILED, Fit, bounds_of, fit_hypothesis
from jointgap.identification.gauss_newton import bounded_step
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.protocol import Candidate

WIDTHS = (np.deg2rad(24.0), np.deg2rad(6.0))
"""Standard deviations of the weights by which residuals are smoothed, in the angle of the cycle, coarsest first."""

_REACH = 3.0  # standard deviations
_OPEN = 0.1  # of its range: a parameter that a view leaves more uncertain than that is looked through
_MATTERS = 0.2  # of the noise, over all samples: one that changes less over its whole range is not
_PLACES = 11  # evenly over a range
_RATIOS = np.geomspace(
    1.0 / 3.0, 3.0, 25
)  # of the distance of a size from its bound, to that where the effect is absent


@dataclass(frozen=True)
class Smoother:
    """Residuals smoothed over the cycle, each still of variance 1 where they are noise.

    Attributes
    ----------
    kernels : tuple of ((a, b), (m,) array)
        Place of each series among the residuals and its weights, whose squares sum to 1; a single one leaves a series as it is.
    """

    kernels: tuple[tuple[slice, np.ndarray], ...]

    @property
    def overlap(self) -> float:
        """By how much neighbours that share samples make the errors of slow parameters larger than independent ones would."""
        return float(np.mean([weights.sum() for _, weights in self.kernels]))

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Residuals (n,) or their derivatives (n, k), smoothed."""
        found = np.empty_like(values)
        for place, weights in self.kernels:
            shaped = weights if values.ndim == 1 else weights[:, None]
            found[place] = oaconvolve(values[place], shaped, mode="same", axes=0) if weights.size > 1 else values[place]
        return found


def smoothers_of(problem: Problem) -> tuple[Smoother, ...]:
    """Views of a problem's residuals, coarsest first; none where they would change nothing.

    Statistics over cycles, and series of which no angle is known, stay as they are.
    """
    found = []
    for width in WIDTHS:
        kernels = []
        for part in problem.parts:
            step = np.abs(np.diff(part.series.angle[part.used]))
            step = float(np.median(step[np.isfinite(step)])) if np.isfinite(step).any() else 0.0
            plain = part.series.statistic or not step > 0.0
            kernels.append(
                (part.place, np.ones(1) if plain else _weights(width / step, part.place.stop - part.place.start))
            )
        if any(weights.size > 1 for _, weights in kernels):
            found.append(Smoother(tuple(kernels)))
    return tuple(found)


def _weights(sd: float, count: int) -> np.ndarray:
    """Gaussian weights over samples, `sd` in samples, at most about as many as there are samples."""
    half = min(int(np.ceil(_REACH * sd)), max((count - 1) // 2, 0))
    weights = np.exp(-0.5 * np.square(np.arange(-half, half + 1) / max(sd, 1e-9)))
    return weights / np.linalg.norm(weights)


def coarse_to_fine_fit(
    problem: Problem,
    hypothesis: Hypothesis,
    start: Mapping[str, float],
    differences: FiniteDifferences,
    smoothers: Sequence[Smoother],
) -> Fit:
    """The fit in the last of the views, from one to the next; what each leaves open is looked through in what follows it.

    Parameters
    ----------
    problem : Problem
    hypothesis : tuple of Candidate
    start : mapping of str to float
        Values by key; nominal where absent.
    differences : FiniteDifferences
    smoothers : sequence of Smoother
        Coarsest first.

    Returns
    -------
    Fit
        Its residual is as the samples have it, and so is its Jacobian, which may be from near by: enough for a fit that starts there.
        The last one that could be simulated; failed where the start cannot be.
    """
    found, known = None, None
    for smoother, finer in zip(smoothers, (*smoothers[1:], None), strict=True):
        one = fit_hypothesis(problem, hypothesis, start, known, differences, smoother=smoother)
        if one.status == FAILED:
            return found or one
        found = one
        moved = coordinate_scan(problem, found, smoother, finer)
        # derivatives hold about as long as nothing jumped
        known = dict(zip((p.key for p in found.parameters), found.jacobian.T, strict=True)) if moved is None else None
        start = found.mapping if moved is None else moved
        if moved is not None and finer is None:
            residual = problem.residual(moved, hypothesis)
            values = np.array([moved[p.key] for p in found.parameters])
            found = Fit(hypothesis, found.parameters, values, residual, found.jacobian, found.simulations, found.status)
    return found


def coordinate_scan(
    problem: Problem, found: Fit, smoother: Smoother, finer: Smoother | None, sizes_alone: bool = False
) -> dict[str, float] | None:
    """Values that are better in the finer view, by one after the other of the parameters that `smoother` leaves open; None if none are.

    Parameters
    ----------
    problem : Problem
    found : Fit
        In `smoother`.
    smoother, finer : View
        None for the samples themselves.
    sizes_alone : bool
        Whether to look through sizes of effects alone, and to leave all else where it is.
    """
    seen = (lambda values: values) if finer is None else finer
    low, high = bounds_of(found.parameters)
    matrix, at = seen(found.jacobian), found.mapping
    least, moved = _left(matrix, seen(found.residual), low - found.values, high - found.values), False
    for i, places in _open(found, smoother, matrix):
        if sizes_alone and found.parameters[i].key not in _sized(found):
            continue
        p, others = found.parameters[i], np.delete(matrix, i, axis=1)
        here = np.array([at[one.key] for one in found.parameters])
        room = np.delete(low - here, i), np.delete(high - here, i)
        for place in places:
            trial = {**at, p.key: float(np.clip(place, p.low, p.high))}
            try:
                left = _left(others, seen(problem.residual(trial, found.hypothesis)), *room)
            except (InputError, SimulationError):
                continue
            if left < least:
                least, best, moved = left, trial, True
        at = best if moved else at
    return at if moved else None


def _left(matrix: np.ndarray, residual: np.ndarray, low: np.ndarray, high: np.ndarray) -> float:
    return bounded_step(matrix, residual, low, high)[1]


def _sized(found: Fit) -> dict[str, Candidate]:
    """The sizes of effects among the parameters, by key, and whose they are."""
    return {f"{candidate.label}.{name}": candidate for candidate in found.hypothesis for name in candidate.amplitudes}


def _open(found: Fit, smoother: Smoother, finer: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Which parameters are to be looked through, and where: nuisances and shapes that `smoother` leaves open though they matter in the
    finer one, and changes of what is known, of which small ones say little."""
    if not found.parameters:
        return []
    width = np.array([p.high - p.low for p in found.parameters])
    bounded = np.isfinite(width) & (width > 0.0)
    prior = np.where(bounded, np.sqrt(12.0) / np.where(bounded, width, 1.0), 0.0)
    scale = np.where(bounded, width, 1.0) / np.sqrt(12.0)
    matrix = np.vstack([smoother(found.jacobian) / smoother.overlap, np.diag(prior)]) * scale
    _, sizes, turned = np.linalg.svd(matrix, full_matrices=False)
    errors = np.linalg.norm(turned.T / np.maximum(sizes, 1e-12 * sizes[0]), axis=1) * scale
    changes = np.linalg.norm(finer, axis=0) * np.where(bounded, width, 0.0)
    sized, chosen = _sized(found), []
    for i, p in enumerate(found.parameters):
        if not bounded[i] or p.run is not None:
            continue
        if p.key in sized:
            if sized[p.key].is_perturbation:
                places = np.unique(np.clip(p.low + (p.nominal - p.low) * _RATIOS, p.low, p.high))
                chosen.append((i, places[~np.isclose(places, p.nominal, rtol=0.0, atol=1e-6 * width[i])]))
        elif errors[i] > _OPEN * width[i] and changes[i] > _MATTERS * np.sqrt(finer.shape[0]):
            chosen.append((i, np.linspace(p.low, p.high, _PLACES)))
    return chosen
