"""Search with loose joints: hypotheses are fitted in windows of the record."""

import contextlib
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from jointgap.core.candidates import Candidate
from jointgap.identification.baseline import Baseline
from jointgap.identification.evidence import reduced_chi2
from jointgap.identification.fit import FAILED, Fit
from jointgap.identification.likelihood import FAILURES, Estimate, compete, fitted, has_windows, noise_alone
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.screening import Sensitivities, SensitivityRegression
from jointgap.identification.verdict import Thresholds

Found = list[tuple[Fit | None, Estimate]]
"""Estimates at the end of the search, with a fit if it was completed."""


def search_in_windows(
    baseline: Baseline, sensitivities: Sensitivities, limits: Thresholds, alone: Sequence[Fit] = (), sizes: bool = True
) -> list[Fit]:
    """Fits in windows, best first.

    1. With loose joints: single effects selected by their sensitivities.
    2. Unless one is consistent with noise: clearances, each of many `sizes` tried by the filter over one revolution.
    3. Unless a fit of `alone` is better: the best so far with a second effect.
    4. Unless one is consistent with noise: films.

    Steps 3 and 4 are skipped after `max_simulations`.
    """
    problem, base = baseline.problem, baseline.base
    until = problem.simulations + problem.settings.selection.max_simulations
    start = base.mapping if base.in_windows else {k: v for k, v in baseline.nominal.mapping.items() if "@" in k}
    found: Found = []
    if base.in_windows:
        chosen = _worth(problem, sensitivities, (), limits, _leaves_noise(base, limits))
        found = _fitted(problem, [Estimate(problem, each, base.mapping | at) for each, at in chosen])

    def goes_on() -> bool:
        fits = [*([base] if base.in_windows else []), *(fit for fit, _ in found if fit)]
        return not any(_leaves_noise(fit, limits) for fit in fits)

    if sizes and goes_on():
        starts = _best_sizes(problem, problem.model.candidates, start)
        found += _fitted(problem, [Estimate(problem, *each) for each in starts], below=math.inf)
    best = min(found, key=lambda each: each[1].best.deviance, default=None)
    if best and problem.simulations <= until and all(_cost(*best) < fit.chi2 for fit in alone):
        with contextlib.suppress(*FAILURES):
            about = best[1].sensitivities([one for one in problem.model.candidates if not one.search_range])
            chosen = _worth(problem, about, best[1].hypothesis, limits, not goes_on())
            found += _fitted(problem, [Estimate(problem, each, best[1].mapping | at) for each, at in chosen])
    films = _films(problem, base) if base.in_windows and problem.simulations <= until and goes_on() else []
    return sorted([*(fit for fit, _ in found if fit), *films], key=lambda fit: fit.chi2)


def _cost(fit: Fit | None, estimate: Estimate) -> float:
    return fit.chi2 if fit else estimate.stages[-1].cost


def _leaves_noise(fit: Fit, limits: Thresholds) -> bool:
    return fit.status != FAILED and reduced_chi2(fit) <= limits.omnibus


def _worth(
    problem: Problem, sensitivities: Sensitivities, effects: Hypothesis, limits: Thresholds, enough: bool = False
) -> list[tuple[Hypothesis, dict[str, float]]]:
    """Selected hypotheses with one effect more than `effects`, and start values of it: the largest predicted gains or,
    if the residual is noise already (`enough`), significant ones and their rivals."""
    settings, selection = problem.settings.windows, problem.settings.selection
    singles = SensitivityRegression(sensitivities, effects).singles()
    if not singles:
        return []
    before = float(sensitivities.residual @ sensitivities.residual)
    if enough:
        share = 1.0 if effects else selection.linear_share
        needed = share * max(problem.settings.decision.min_delta_bic, limits.max_gain_threshold)
        replaced = sum(len(one.replaces) for one in effects)
        bic = before + (len(sensitivities.parameters) + replaced) * np.log(sensitivities.residual.size)
        singles = singles[: selection.partners] if bic - singles[0].bic > needed else []
    else:
        least = before - settings.leading_share * max(before - single.chi2 for single in singles)
        singles = [single for single in singles if single.chi2 <= least][: settings.leading]
    return [(single.hypothesis, single.own_start) for single in singles]


def _films(problem: Problem, base: Fit) -> list[Fit]:
    """The best film in place of a dry joint, fitted to one trajectory (the state of a film needs no windows)."""
    tried: list[tuple[float, Candidate, dict[str, float]]] = []
    for candidate in problem.model.candidates:
        guesses: Iterable = candidate.initial_guesses if not candidate.search_range else ()
        for guess in (guess for guess in guesses if set(guess) & set(candidate.amplitudes)):
            at = base.mapping | {f"{candidate.label}.{key}": value for key, value in guess.items()}
            if not has_windows(problem, (candidate,), at):
                with contextlib.suppress(*FAILURES):
                    left = problem.residual(at, (candidate,))
                    tried.append((float(left @ left), candidate, at))
    best = min(tried, key=lambda each: each[0], default=None)
    return [fitted(problem, (best[1],), best[2])] if best and best[0] < base.chi2 else []


def fit_together(problem: Problem, starts: Sequence[tuple[Hypothesis, Mapping[str, float]]]) -> list[Fit]:
    """Fits of hypotheses from their start values; only those near the best."""
    return [fit for fit, _ in _fitted(problem, [Estimate(problem, *each) for each in starts]) if fit]


def _fitted(problem: Problem, estimates: Sequence[Estimate], below: float | None = None) -> Found:
    """Competition of the `estimates` over the jumps `below` a value; then fits of those near the best to the end.

    The best one is polished unless it is a clearance. A clearance with a large misfit is not continued, as its
    simulation is slow."""
    settings, found = problem.settings.windows, []
    estimates = compete(estimates, settings.jumps[0] if below is None else below)
    for estimate in estimates:
        if estimate.best.deviance > estimates[0].best.deviance + settings.far_behind * problem.size:
            break
        became_loose = any(one.search_range for one in estimate.hypothesis)
        if became_loose and estimate.stages[-1].cost > problem.settings.stopping.poor_chi2_per_sample * problem.size:
            found.append((None, estimate))
            continue
        with contextlib.suppress(*FAILURES):
            ended = estimate.branch().to_its_end()
            is_good = ended.stages[-1].cost < noise_alone(problem) + problem.size
            if estimate is estimates[0] and is_good and not became_loose:
                estimate = ended = ended.polished()
            found.append((ended.fit(), estimate))
    return found


def _best_sizes(
    problem: Problem, candidates: Sequence[Candidate], start: Mapping[str, float]
) -> list[tuple[Hypothesis, dict[str, float]]]:
    """The best clearance sizes that are not neighbours, each with the best of its shapes; best first."""
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
    """Geometric grid of sizes [SI] over the search range of a candidate."""
    low, high = (end - candidate.vanishing_amplitude for end in candidate.search_range)
    return np.geomspace(low, high, max(math.ceil(math.log(high / low) / math.log(factor)), 1) + 1)
