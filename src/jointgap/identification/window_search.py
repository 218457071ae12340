"""The search beside joints that are loose, or may be: hypotheses are fitted in windows of the record, and then as one
trajectory."""

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


def search_in_windows(baseline: Baseline, limits: Thresholds, sizes: bool = True) -> list[Fit]:
    """Fits of single effects that no slope of one trajectory leads to, best first: what explains most beside joints
    that are loose and, unless one of these leaves noise, clearances of joints.

    Of effects slopes in windows say how much they would explain; of clearances each of many `sizes` is tried by the
    filter over one turn of each run.
    """
    problem, settings = baseline.problem, baseline.problem.settings.windows
    start = {key: value for key, value in baseline.nominal.mapping.items() if "@" in key}
    candidates, fits, known = problem.model.candidates, [], baseline.base.windows
    if has_windows(problem, (), start):
        if known is not None:
            start = dict(zip(baseline.base.mapping, known[0], strict=True))
        try:
            base = Estimate(problem, (), start).anneal(below=math.inf if known is None else settings.jumps[0])
            scores = base.scores([one for one in candidates if not one.search_range])
        except FAILURES:
            return []
        worth = [each for each in scores[: settings.leading] if each[0] > settings.leading_share * scores[0][0]]
        leading = [((candidate,), values) for _, candidate, values in worth]
        fits = _fitted(baseline, leading, below=settings.jumps[0])
        start = base.mapping
    if sizes and not any(fit.status != FAILED and reduced_chi2(fit) <= limits.omnibus for fit in fits):
        fits += _fitted(baseline, _best_sizes(problem, candidates, start))
    return sorted(fits, key=lambda fit: fit.chi2)


def _fitted(
    baseline: Baseline, starts: Sequence[tuple[Hypothesis, Mapping[str, float]]], below: float = math.inf
) -> list[Fit]:
    """Fits in windows, at jumps `below` some; of what is near the best of them fits to one trajectory of each run."""
    problem, fits = baseline.problem, []
    estimates = compete([Estimate(problem, hypothesis, values) for hypothesis, values in starts], below)
    for estimate in estimates:
        if estimate.best.deviance > estimates[0].best.deviance + problem.settings.windows.far_behind * problem.size:
            break
        least = min((fit.chi2 for fit in fits if fit.status != FAILED), default=math.inf)
        fits.append(fitted_from(estimate, baseline.differences, least))
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
