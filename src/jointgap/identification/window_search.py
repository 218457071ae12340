"""The search beside joints that are loose, or may be: hypotheses are fitted in windows of the record, and then as one
trajectory."""

import contextlib
import math
from collections.abc import Mapping, Sequence

import numpy as np

from jointgap.core.candidates import Candidate
from jointgap.identification.baseline import Baseline
from jointgap.identification.evidence import reduced_chi2
from jointgap.identification.fit import FAILED, Fit
from jointgap.identification.likelihood import FAILURES, Estimate, compete, fitted_from, has_windows
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.verdict import Thresholds


def search_in_windows(
    baseline: Baseline, limits: Thresholds, alone: Sequence[Fit] = (), sizes: bool = True
) -> list[Fit]:
    """Fits that no slope of one trajectory leads to, best first: of what explains most beside joints that are loose;
    unless one of these leaves noise, of clearances of joints; and unless one of all, those `alone` too, does, of the
    best of them with what explains most of the rest.

    Of effects slopes in windows say how much they would explain; of clearances each of many `sizes` is tried by the
    filter over one turn of each run.
    """
    problem, settings = baseline.problem, baseline.problem.settings.windows
    start = {key: value for key, value in baseline.nominal.mapping.items() if "@" in key}
    found, known = [], baseline.base.windows
    if has_windows(problem, (), start):
        if known is not None:
            start = dict(zip(baseline.base.mapping, known[0], strict=True))
        try:
            base = Estimate(problem, (), start).anneal(below=math.inf if known is None else settings.jumps[0])
            found = _fitted(baseline, _leading(base))
        except FAILURES:
            return []
        start = base.mapping

    def goes_on() -> bool:
        return not any(fit and fit.status != FAILED and reduced_chi2(fit) <= limits.omnibus for fit, _ in found)

    if sizes and goes_on():
        starts = _best_sizes(problem, problem.model.candidates, start)
        found += _fitted(baseline, [Estimate(problem, *each) for each in starts], below=math.inf)
    best = min((estimate for _, estimate in found), key=lambda estimate: estimate.best.deviance, default=None)
    if best and goes_on() and all(best.stages[-1].cost < fit.chi2 for fit in alone):
        with contextlib.suppress(*FAILURES):
            found += _fitted(baseline, _leading(best))
    return sorted((fit for fit, _ in found if fit), key=lambda fit: fit.chi2)


def _leading(estimate: Estimate) -> list[Estimate]:
    """An estimate with what would explain most of the rest added, each at its start."""
    problem, settings = estimate.problem, estimate.settings
    scores = estimate.scores([one for one in problem.model.candidates if not one.search_range])
    worth = [each for each in scores[: settings.leading] if each[0] > settings.leading_share * scores[0][0]]
    return [Estimate(problem, (*estimate.hypothesis, candidate), values) for _, candidate, values in worth]


def _fitted(
    baseline: Baseline, estimates: Sequence[Estimate], below: float | None = None
) -> list[tuple[Fit | None, Estimate]]:
    """Fits in windows, at all jumps but the first or those `below` some; of what is near the best of them fits to one
    trajectory of each run. Of a clearance whose windows leave much more than noise there is none: what it rattles
    takes minutes."""
    problem, settings, fits = baseline.problem, baseline.problem.settings.windows, []
    estimates = compete(estimates, settings.jumps[0] if below is None else below)
    for estimate in estimates:
        if estimate.best.deviance > estimates[0].best.deviance + settings.far_behind * problem.size:
            break
        poor = estimate.stages[-1].cost > problem.settings.stopping.poor_chi2_per_sample * problem.size
        if poor and any(one.search_range for one in estimate.hypothesis):
            fits.append((None, estimate))
            continue
        least = min((fit.chi2 for fit, _ in fits if fit and fit.status != FAILED), default=math.inf)
        fits.append((fitted_from(estimate, baseline.differences, least), estimate))
    return fits


def _best_sizes(
    problem: Problem, candidates: Sequence[Candidate], start: Mapping[str, float]
) -> list[tuple[Hypothesis, dict[str, float]]]:
    """The best of all sizes of clearances, no two of them neighbours, each with the best of its shapes; best first."""
    settings, found = problem.settings.windows, {}
    grids = {one.label: _sizes(one, settings.size_factor) for one in candidates if one.search_range}
    by_label = {one.label: one for one in candidates}

    def values_of(label: str, place: int, shape: int = 0) -> dict[str, float]:
        candidate = by_label[label]
        guess, size = candidate.initial_guesses[shape], candidate.vanishing_amplitude + grids[label][place]
        shapes = {key: value for key, value in guess.items() if key not in candidate.amplitudes}
        own = shapes | {candidate.amplitudes[0]: float(size)}
        return dict(start) | {f"{label}.{key}": value for key, value in own.items()}

    def deviance(label: str, place: int, shape: int = 0) -> float:
        try:
            estimate = Estimate(problem, (by_label[label],), values_of(label, place, shape))
            return estimate.find_states(settings.jumps[0], turns=1.0)
        except FAILURES:
            return math.inf

    for label, sizes in grids.items():
        if has_windows(problem, (by_label[label],), values_of(label, 0)):
            found |= {(label, place): deviance(label, place) for place in range(sizes.size)}
    best: list[tuple[str, int]] = []
    for label, place in sorted(found, key=found.__getitem__):
        if all(label != other or abs(place - there) > 1 for other, there in best):
            best.append((label, place))
    tried = []
    for label, place in best[: settings.tried_sizes]:
        shapes = range(1, len(by_label[label].initial_guesses))
        others = [(deviance(label, place, shape), label, place, shape) for shape in shapes]
        tried.append(min([(found[label, place], label, place, 0), *others]))
    return [((by_label[one],), values_of(one, *at)) for _, one, *at in sorted(tried)[: settings.fitted_sizes]]


def _sizes(candidate: Candidate, factor: float) -> np.ndarray:
    """Sizes by about the same factor over the range of a candidate [SI]."""
    low, high = (end - candidate.vanishing_amplitude for end in candidate.search_range)
    return np.geomspace(low, high, max(math.ceil(math.log(high / low) / math.log(factor)), 1) + 1)
