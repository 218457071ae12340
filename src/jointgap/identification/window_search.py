"""Search for clearances: hypotheses are fitted in windows of the record."""

import contextlib
import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import minimize

from jointgap.core.candidates import Candidate
from jointgap.identification.baseline import Baseline
from jointgap.identification.evidence import reduced_chi2
from jointgap.identification.fit import FAILED, Fit
from jointgap.identification.likelihood import FAILURES, Estimate, compete, has_windows
from jointgap.identification.problem import Hypothesis, Problem, SearchLimit
from jointgap.identification.screening import Sensitivities, SensitivityRegression
from jointgap.identification.verdict import Thresholds

Found = list[tuple[Fit | None, Estimate]]
"""Estimates at the end of the search, with a fit if it was completed."""


Start = tuple[Hypothesis, Mapping[str, float]]
"""A hypothesis and start values of its fit by key [SI]."""


def fit_clearances(
    baseline: Baseline,
    starts: Sequence[Start],
    limits: Thresholds,
    alone: Sequence[Fit] = (),
    limit: SearchLimit | None = None,
) -> list[Fit]:
    """Fits of clearances in windows, best first.

    If the best is better than those `alone`, but not consistent with noise, its fit begins again
    from an improved start. If it is better, the best so far gets a second effect. At the limit only
    the best is continued.
    """
    problem = baseline.problem

    def leading() -> Estimate | None:
        best = min(found, key=lambda each: each[1].best.deviance, default=None)
        leads = best and all(_cost(*best) < fit.chi2 for fit in alone)
        return best[1] if leads and not (limit and limit.reached()) else None

    begun = [Estimate(problem, *each) for each in starts]
    found = _fitted(problem, begun, limit, below=math.inf)
    if (best := leading()) and not any(_leaves_noise(fit, limits) for fit, _ in found if fit):
        start = next(start for one, start in zip(begun, starts, strict=True) if one is best)
        found += _fitted(problem, [_improved(Estimate(problem, *start))], limit, below=math.inf)
    if best := leading():
        with contextlib.suppress(*FAILURES):
            about = best.sensitivities(
                [one for one in problem.model.candidates if not one.search_range]
            )
            leaves_noise = any(_leaves_noise(fit, limits) for fit, _ in found if fit)
            chosen = _worth(problem, about, best.hypothesis, limits, leaves_noise)
            found += _fitted(
                problem,
                [Estimate(problem, each, best.mapping | at) for each, at in chosen],
                limit,
            )
    return sorted((fit for fit, _ in found if fit), key=lambda fit: fit.chi2)


def _cost(fit: Fit | None, estimate: Estimate) -> float:
    return fit.chi2 if fit else estimate.stages[-1].cost


def _leaves_noise(fit: Fit, limits: Thresholds) -> bool:
    return fit.status != FAILED and reduced_chi2(fit) <= limits.omnibus


def _worth(
    problem: Problem,
    sensitivities: Sensitivities,
    effects: Hypothesis,
    limits: Thresholds,
    leaves_noise: bool,
) -> list[tuple[Hypothesis, dict[str, float]]]:
    """Selected hypotheses with one effect more than `effects`, and start values of it: the largest
    predicted gains or, if the residual is noise already, significant ones and their rivals."""
    settings, selection = problem.settings.windows, problem.settings.selection
    singles = SensitivityRegression(sensitivities, effects).singles()
    if not singles:
        return []
    before = float(sensitivities.residual @ sensitivities.residual)
    if leaves_noise:
        needed = max(problem.settings.decision.min_delta_bic, limits.max_gain_threshold)
        replaced = sum(len(one.replaces) for one in effects)
        bic = before + (len(sensitivities.parameters) + replaced) * np.log(
            sensitivities.residual.size
        )
        singles = singles[: selection.partners] if bic - singles[0].bic > needed else []
    else:
        least = before - settings.leading_share * max(before - single.chi2 for single in singles)
        singles = [single for single in singles if single.chi2 <= least][: settings.leading]
    return [(single.hypothesis, single.own_start) for single in singles]


def _fitted(
    problem: Problem,
    estimates: Sequence[Estimate],
    limit: SearchLimit | None,
    below: float | None = None,
) -> Found:
    """Competition of the `estimates` over the jumps `below` a value; then fits of those near the
    best to the end.

    One with a large misfit is not continued, as its simulation is slow."""
    settings, found = problem.settings.windows, []
    estimates = compete(estimates, settings.jumps[0] if below is None else below, limit)
    for estimate in estimates:
        if found and limit and limit.reached():
            break
        if estimate.best.deviance > estimates[0].best.deviance + settings.far_behind * problem.size:
            break
        if estimate.stages[-1].cost > problem.settings.stopping.poor_chi2_per_sample * problem.size:
            found.append((None, estimate))
            continue
        with contextlib.suppress(*FAILURES):
            found.append((estimate.branch().to_its_end().fit(), estimate))
    return found


def likely_clearances(baseline: Baseline) -> list[Start]:
    """The best clearance sizes that are not neighbours, each with the best of its shapes, best
    first; none if ideal joints are more likely.

    The filter rates sizes of each clearance over one revolution. A size is likely if its marginal
    likelihood exceeds the likelihood of ideal joints, by a share of what the best one gains.
    """
    problem, settings = baseline.problem, baseline.problem.settings.windows
    candidates = problem.model.candidates
    # the values of runs, fitted with ideal joints, and those before, as a clearance biases the fit
    fitted = {key: value for key, value in baseline.nominal.mapping.items() if "@" in key}
    starts = (fitted, {})
    grids = {one.label: _sizes(one, settings.size_factor) for one in candidates if one.search_range}
    by_label = {one.label: one for one in candidates}

    def estimate(label: str, place: int, shape: int = 0, start: int = 0) -> Estimate:
        candidate = by_label[label]
        guess = candidate.initial_guesses[shape]
        values = {key: value for key, value in guess.items() if key not in candidate.amplitudes}
        size = candidate.vanishing_amplitude + grids[label][place]
        values |= {candidate.amplitudes[0]: float(size)}
        own = {f"{label}.{key}": value for key, value in values.items()}
        return Estimate(problem, (candidate,), starts[start] | own)

    def deviance(label: str, place: int) -> float:
        nonlocal least
        try:
            value = estimate(label, place).find_states(settings.jumps[0], 1.0, least)
        except FAILURES:
            return math.inf
        least = min(least, ideal - settings.leading_share * (ideal - value))
        return value

    def shaped(label: str, place: int) -> Estimate:
        """The start with the best shape at a smaller jump, where states compensate less."""
        best, lowest = estimate(label, place), math.inf
        for shape in range(len(by_label[label].initial_guesses)):
            for start in range(len(starts)):
                one = estimate(label, place, shape, start)
                with contextlib.suppress(*FAILURES):
                    value = one.find_states(settings.jumps[1], 1.0, lowest)
                    if value < lowest:
                        best, lowest = one, value
        return best

    searched = [
        label
        for label in grids
        if has_windows(problem, (first := estimate(label, 0)).hypothesis, first.mapping)
    ]
    if not searched:
        return []
    ideal = least = estimate(searched[0], 0).deviance_without(turns=1.0)
    # every third size first, so that most others end early
    places = [(label, place) for label in searched for place in range(grids[label].size)]
    rated = {at: deviance(*at) for at in sorted(places, key=lambda at: at[1] % 3 != 1)}
    best: list[tuple[str, int]] = []
    for label, place in sorted(rated, key=rated.__getitem__):
        apart = all(label != other or abs(place - there) > 1 for other, there in best)
        if apart and rated[label, place] < least:
            best.append((label, place))
    chosen = [shaped(*at) for at in best[: settings.fitted_sizes]]
    return [(one.hypothesis, one.mapping) for one in chosen]


def _improved(one: Estimate) -> Estimate:
    """An estimate with its shared parameters improved by the filter over some revolutions: a
    simplex search, as impacts make the deviance rough."""
    problem, settings = one.problem, one.settings
    varied = [p for p in one.parameters if p.run is None]
    low, high, steps = (
        np.array([getattr(p, key) for p in varied]) for key in ("low", "high", "step")
    )
    start = np.array([one.mapping[p.key] for p in varied])
    own = {p.key for p in problem.parameters(one.hypothesis)} - {
        p.key for p in problem.parameters(())
    }
    is_own = np.array([p.key in own for p in varied])
    widths = settings.first_steps * steps
    widths[~is_own] = settings.first_share * (high - low)[~is_own]

    def at(moved: np.ndarray) -> Estimate:
        values = zip(varied, start + widths * moved, strict=True)
        return Estimate(
            problem, one.hypothesis, one.mapping | {p.key: float(value) for p, value in values}
        )

    def deviance(moved: np.ndarray) -> float:
        values = start + widths * moved
        if (values < low).any() or (values > high).any():
            return math.inf
        try:
            return at(moved).find_states(settings.jumps[2], settings.refined_turns)
        except FAILURES:
            return math.inf

    options = {
        "maxfev": settings.refinements,
        "fatol": settings.refined_to * problem.size,
        "xatol": math.inf,
        "initial_simplex": np.vstack([np.zeros(start.size), np.eye(start.size)]),
    }
    found = minimize(deviance, np.zeros(start.size), method="Nelder-Mead", options=options)
    return at(found.x) if found.fun < math.inf else one


def _sizes(candidate: Candidate, factor: float) -> np.ndarray:
    """Geometric grid of sizes [SI] over the search range of a candidate."""
    low, high = (end - candidate.vanishing_amplitude for end in candidate.search_range)
    return np.geomspace(low, high, max(math.ceil(math.log(high / low) / math.log(factor)), 1) + 1)
