"""The search beside joints that are loose, or may be: hypotheses are fitted in windows of the record, and then as one
trajectory."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from jointgap.core.candidates import Candidate
from jointgap.identification.baseline import Baseline
from jointgap.identification.evidence import reduced_chi2
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.likelihood import FAILURES, Estimate, has_windows
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.verdict import Thresholds


def search_in_windows(baseline: Baseline, limits: Thresholds, sizes: bool = True) -> list[Fit]:
    """Fits of single effects that no slope of one trajectory leads to, best first: what explains most beside joints
    that are loose and, unless one of these leaves noise, clearances of joints.

    Of effects slopes in windows say how much they would explain; of clearances each of many `sizes` is tried by the
    filter over one turn of each run.
    """
    problem, leading = baseline.problem, baseline.problem.settings.windows.leading
    start = {key: value for key, value in baseline.nominal.mapping.items() if "@" in key}
    candidates, fits = problem.model.candidates, []
    if has_windows(problem, (), start):
        try:
            base = Estimate(problem, (), start).anneal()
            scores = base.scores([one for one in candidates if not one.search_range])
        except FAILURES:
            return []
        fits = _fitted(baseline, [((candidate,), values) for _, candidate, values in scores[:leading]])
        start = base.mapping
    if sizes and not any(fit.status != FAILED and reduced_chi2(fit) <= limits.omnibus for fit in fits):
        fits += _fitted(baseline, _best_sizes(problem, candidates, start))
    return sorted(fits, key=lambda fit: fit.chi2)


def _fitted(baseline: Baseline, starts: Sequence[tuple[Hypothesis, Mapping[str, float]]]) -> list[Fit]:
    """Fits in windows, and of what is near the best of them fits to one trajectory of each run."""
    problem, estimates, fits = baseline.problem, [], []
    for hypothesis, values in starts:
        rival = min(estimates, key=lambda each: each.best.deviance, default=None)
        try:
            estimates.append(Estimate(problem, hypothesis, values).anneal(rival))
        except FAILURES:
            continue
    estimates.sort(key=lambda each: each.best.deviance)
    for estimate in estimates:
        if estimate.best.deviance > estimates[0].best.deviance + problem.settings.windows.far_behind * problem.size:
            break
        least = min((fit.chi2 for fit in fits if fit.status != FAILED), default=math.inf)
        fits.append(
            fit_hypothesis(
                problem,
                estimate.hypothesis,
                estimate.mapping,
                differences=baseline.differences,
                sufficient_chi2=least,
            )
        )
    return fits


def _best_sizes(
    problem: Problem, candidates: Sequence[Candidate], start: Mapping[str, float]
) -> list[tuple[Hypothesis, dict[str, float]]]:
    """The best of all sizes of clearances, no two of them neighbours, each with the best of its shapes; best first."""
    settings, found = problem.settings.windows, []

    def deviance(candidate: Candidate, values: Mapping[str, float]) -> float:
        try:
            return Estimate(problem, (candidate,), values).find_states(settings.jumps[0], turns=1.0)
        except FAILURES:
            return math.inf

    for candidate in (one for one in candidates if one.search_range):
        vanishing, label = candidate.vanishing_amplitude, candidate.label
        low, high = (end - vanishing for end in candidate.search_range)
        count = max(math.ceil(math.log(high / low) / math.log(settings.size_factor)), 1) + 1
        shapes = [_shapes(candidate, guess) for guess in candidate.initial_guesses]
        for place, size in enumerate(np.geomspace(low, high, count)):
            values = dict(start) | shapes[0] | {f"{label}.{candidate.amplitudes[0]}": float(vanishing + size)}
            if not has_windows(problem, (candidate,), values):
                break
            found.append((deviance(candidate, values), place, candidate, values, shapes[1:]))
    found.sort(key=lambda each: each[0])
    best: list[tuple] = []
    for each in found:
        if len(best) < settings.tried_sizes and not any(
            each[2] is other[2] and abs(each[1] - other[1]) < 2 for other in best
        ):
            best.append(each)
    tried = [(least, candidate, values) for least, _, candidate, values, _ in best]
    for _, _, candidate, values, shapes in best:
        tried += [(deviance(candidate, values | other), candidate, values | other) for other in shapes]
    tried.sort(key=lambda each: each[0])
    return [((candidate,), values) for _, candidate, values in tried[: settings.fitted_sizes]]


def _shapes(candidate: Candidate, guess: Mapping[str, float]) -> dict[str, float]:
    """By key, what a guess says but for the size."""
    return {f"{candidate.label}.{key}": value for key, value in guess.items() if key not in candidate.amplitudes}
