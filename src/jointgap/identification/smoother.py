"""Residuals smoothed over the cycle, and fits that go from coarsely smoothed residuals to the samples.

Impacts make spikes. Where a parameter is a percent off, spikes miss each other by some samples, and by how much they do
says nothing of the direction: the valley around the truth is narrow, and elsewhere there are others. Smoothed over the
cycle, a residual counts what an impact does to the motion rather than at which sample. Fits go from the coarsest
smoother to the samples, each from where the one before ended; parameters that a coarse one leaves undetermined are
scanned in the next one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import oaconvolve

from jointgap.errors import InputError, SimulationError
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.fit import FAILED, Fit, bounds_of, fit_hypothesis
from jointgap.identification.gauss_newton import bounded_step
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.protocol import Candidate
from jointgap.identification.settings import SmoothingSettings


@dataclass(frozen=True)
class Smoother:
    """Residuals smoothed over the cycle, each still of variance 1 where they are noise."""

    kernels: tuple[tuple[slice, np.ndarray], ...]

    @property
    def overlap(self) -> float:
        """Factor on the errors of slow parameters: neighbours share samples, so they are not independent."""
        return float(np.mean([weights.sum() for _, weights in self.kernels]))

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Residuals (n,) or their derivatives (n, k), smoothed."""
        smoothed = np.empty_like(values)
        for place, weights in self.kernels:
            if weights.size > 1:
                shaped = weights if values.ndim == 1 else weights[:, None]
                smoothed[place] = oaconvolve(values[place], shaped, mode="same", axes=0)
            else:
                smoothed[place] = values[place]
        return smoothed


def smoothers_of(problem: Problem) -> tuple[Smoother, ...]:
    """Smoothers of a problem's residuals, coarsest first; none where they would change nothing.

    Statistics over cycles, and series of which no angle is known, stay as they are.
    """
    settings, smoothers = problem.settings.smoothing, []
    for width in np.deg2rad(settings.widths_deg):
        kernels = []
        for part in problem.parts:
            step = np.abs(np.diff(part.series.angle[part.used]))
            step = float(np.median(step[np.isfinite(step)])) if np.isfinite(step).any() else 0.0
            plain = part.series.statistic or not step > 0.0
            count = part.place.stop - part.place.start
            kernels.append((part.place, np.ones(1) if plain else _weights(width / step, count, settings.kernel_reach)))
        if any(weights.size > 1 for _, weights in kernels):
            smoothers.append(Smoother(tuple(kernels)))
    return tuple(smoothers)


def _weights(sd: float, count: int, reach: float) -> np.ndarray:
    """Gaussian weights over samples, `sd` in samples, at most about as many as there are samples."""
    half = min(int(np.ceil(reach * sd)), max((count - 1) // 2, 0))
    weights = np.exp(-0.5 * np.square(np.arange(-half, half + 1) / max(sd, 1e-9)))
    return weights / np.linalg.norm(weights)


def coarse_to_fine_fit(
    problem: Problem,
    hypothesis: Hypothesis,
    start: Mapping[str, float],
    differences: FiniteDifferences,
    smoothers: Sequence[Smoother],
) -> Fit:
    """The fit with the last smoother by way of all before it; what each leaves undetermined is scanned in the next."""
    result, derivatives = None, None
    for smoother, finer in zip(smoothers, (*smoothers[1:], None), strict=True):
        fit = fit_hypothesis(problem, hypothesis, start, derivatives, differences, smoother=smoother)
        if fit.status == FAILED:
            return result or fit
        result, start, derivatives = (
            fit,
            fit.mapping,
            dict(zip((p.key for p in fit.parameters), fit.jacobian.T, strict=True)),
        )
        scanned = coordinate_scan(problem, fit, smoother, finer)
        if scanned is not None:
            start, derivatives = scanned, None  # after a jump derivatives do not hold any more
            if finer is None:
                values = np.array([scanned[p.key] for p in fit.parameters])
                result = replace(fit, values=values, residual=problem.residual(scanned, hypothesis), reason="")
    return result


def fit_via_smoothers(
    problem: Problem,
    hypothesis: Hypothesis,
    start: Mapping[str, float],
    differences: FiniteDifferences,
    smoothers: Sequence[Smoother],
) -> Fit:
    """The fit to the samples that starts from the coarse-to-fine fit; from `start` where there is none or it fails.

    Arguments as in `coarse_to_fine_fit`, but there may be no smoothers.
    """
    coarse = coarse_to_fine_fit(problem, hypothesis, start, differences, smoothers) if smoothers else None
    start = start if coarse is None or coarse.status == FAILED else coarse.mapping
    return fit_hypothesis(problem, hypothesis, start, differences=differences)


def coordinate_scan(
    problem: Problem, fit: Fit, smoother: Smoother, finer: Smoother | None, amplitudes_only: bool = False
) -> dict[str, float] | None:
    """Better values by key, from scans of undetermined parameters one after the other; None if none are better.

    At each value of a scan the other parameters take up what they can linearly; chi2 is that of the finer smoother.
    """
    smooth = (lambda values: values) if finer is None else finer
    low, high = bounds_of(fit.parameters)
    matrix, values = smooth(fit.jacobian), fit.mapping
    _, best_chi2 = bounded_step(matrix, smooth(fit.residual), low - fit.values, high - fit.values)
    moved, amplitudes = False, _amplitudes(fit)
    for i, scan in _undetermined(fit, smoother, matrix, problem.settings.smoothing):
        p, others = fit.parameters[i], np.delete(matrix, i, axis=1)
        if amplitudes_only and p.key not in amplitudes:
            continue
        here = np.array([values[q.key] for q in fit.parameters])
        room = np.delete(low - here, i), np.delete(high - here, i)
        best = values
        for value in scan:
            trial = {**values, p.key: float(np.clip(value, p.low, p.high))}
            try:
                residual = problem.residual(trial, fit.hypothesis)
            except (InputError, SimulationError):
                continue
            _, chi2 = bounded_step(others, smooth(residual), *room)
            if chi2 < best_chi2:
                best_chi2, best, moved = chi2, trial, True
        values = best
    return values if moved else None


def _amplitudes(fit: Fit) -> dict[str, Candidate]:
    """The amplitudes of effects among the parameters, by key, and whose they are."""
    return {f"{candidate.label}.{name}": candidate for candidate in fit.hypothesis for name in candidate.amplitudes}


def _undetermined(
    fit: Fit, smoother: Smoother, finer_jacobian: np.ndarray, settings: SmoothingSettings
) -> list[tuple[int, np.ndarray]]:
    """Which parameters are to be scanned, and at what values.

    Those are nuisances and shapes that the smoother leaves uncertain though they matter to the finer one, and
    perturbations of known quantities, of which small ones say little of large ones.
    """
    if not fit.parameters:
        return []
    width = np.array([p.high - p.low for p in fit.parameters])
    bounded = np.isfinite(width) & (width > 0.0)
    prior = np.where(bounded, np.sqrt(12.0) / np.where(bounded, width, 1.0), 0.0)
    scale = np.where(bounded, width, 1.0) / np.sqrt(12.0)
    matrix = np.vstack([smoother(fit.jacobian) / smoother.overlap, np.diag(prior)]) * scale
    _, singular_values, right = np.linalg.svd(matrix, full_matrices=False)
    errors = np.linalg.norm(right.T / np.maximum(singular_values, 1e-12 * singular_values[0]), axis=1) * scale
    influence = np.linalg.norm(finer_jacobian, axis=0) * np.where(bounded, width, 0.0)
    factor, amplitudes, scans = settings.perturbation_scan_factor, _amplitudes(fit), []
    ratios = np.geomspace(1.0 / factor, factor, settings.perturbation_scan_points)
    for i, p in enumerate(fit.parameters):
        if not bounded[i] or p.run is not None:
            continue
        if p.key in amplitudes:
            if amplitudes[p.key].is_perturbation:
                values = np.unique(np.clip(p.low + (p.nominal - p.low) * ratios, p.low, p.high))
                scans.append((i, values[~np.isclose(values, p.nominal, rtol=0.0, atol=1e-6 * width[i])]))
            continue
        matters = influence[i] > settings.min_influence * np.sqrt(finer_jacobian.shape[0])
        if matters and errors[i] > settings.undetermined_error * width[i]:
            scans.append((i, np.linspace(p.low, p.high, settings.scan_points)))
    return scans
