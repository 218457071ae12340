"""Fits of all hypotheses that are worth one: single effects, then pairs; by a coarse search where need be."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointgap.identification.baseline import Baseline, probed_differences
from jointgap.identification.coarse_search import search_pairs, search_singles
from jointgap.identification.decide_by_features import leaders_by_features
from jointgap.identification.decide_verdict import reduced_chi2
from jointgap.identification.fit import FAILED, MATCHED, STOPPED, Fit
from jointgap.identification.initial_fit import fit_screened
from jointgap.identification.model_selection import (
    best_sufficient,
    shortlist_pairs,
    shortlist_singles,
    two_effect_thresholds,
)
from jointgap.identification.nesting import moved, not_above_its_parts
from jointgap.identification.problem import Problem
from jointgap.identification.protocol import Candidate
from jointgap.identification.rough_search import leaves_rough_motion, search_rough
from jointgap.identification.screening import LinearizedFit, Signatures, is_searched
from jointgap.identification.smoother import smoothers_of
from jointgap.identification.thresholds import Thresholds

TimedFits = tuple[list[Fit], list[float]]
"""Fits, one of each hypothesis, and how long each took [s]."""


def fit_singles(
    baseline: Baseline, signatures: Signatures, limits: Thresholds, part: int = 0, parts: int = 1
) -> TimedFits:
    """Fit every single effect of one part.

    A fit that fails is one of them, with its reason; the others go on. Once one leaves about noise alone, those of the
    same part that stay far behind it end early: they are no rivals, but their chi2 depends on how fits are shared out.

    Parameters
    ----------
    baseline : Baseline
    signatures : Signatures
        Of all candidates.
    limits : Thresholds
    part, parts : int
        Which of how many parts, counted from 0.
    """
    shortlist = shortlist_singles(signatures, limits, baseline.problem.settings)
    return _fit_each(baseline, signatures, [(single, None) for single in shortlist[part::parts]], limits, ())


def fit_pairs(
    baseline: Baseline, signatures: Signatures, limits: Thresholds, alone: Sequence[Fit], part: int = 0, parts: int = 1
) -> TimedFits:
    """Fit every pair of one part that is worth it beside the fits of single effects.

    One effect on which motion depends roughly may do what two others do together: where a pair is worth a fit the first
    part searches these too.

    Where no single effect is sufficient, the first part searches: effects on which motion depends roughly, if what is
    left is rough, then single effects by smoothed residuals, then effects on which motion depends roughly all the same,
    then pairs. How far each one goes there depends on all others, so it is not shared out. Single effects that it finds
    are among the fits then.

    Parameters
    ----------
    baseline, signatures, limits, part, parts
        As of `fit_singles`.
    alone : sequence of Fit
        Of single effects, from all parts.
    """
    if _insufficient(baseline, alone, limits):
        return _search(baseline, signatures, limits, alone) if part == 0 else ([], [])
    pairs = _pairs_of_best(baseline, signatures, limits, alone)
    fits, seconds = _fit_each(baseline, signatures, pairs[part::parts], limits, alone)
    if pairs and part == 0:
        begin = time.monotonic()
        searched = _search_alone(baseline, limits)
        share = (time.monotonic() - begin) / max(len(searched), 1)
        fits, seconds = [*fits, *searched], [*seconds, *[share] * len(searched)]
    return fits, seconds


def _insufficient(baseline: Baseline, alone: Sequence[Fit], limits: Thresholds) -> bool:
    """Whether neither the base nor a single effect explains the data."""
    if reduced_chi2(baseline.base) <= limits.omnibus:
        return False
    return best_sufficient(baseline, alone, two_effect_thresholds(baseline, alone, limits)) is None


def _pairs_of_best(
    baseline: Baseline, signatures: Signatures, limits: Thresholds, alone: Sequence[Fit]
) -> list[tuple[LinearizedFit, Fit]]:
    """Pairs that are worth a fit of the best single effect that is sufficient, each with this; none where none is."""
    second = two_effect_thresholds(baseline, alone, limits)
    best = best_sufficient(baseline, alone, second)
    count = baseline.problem.settings.selection.partners
    return [(pair, best) for pair in shortlist_pairs(signatures, best, alone, second, count)] if best else []


def _search(baseline: Baseline, signatures: Signatures, limits: Thresholds, alone: Sequence[Fit]) -> TimedFits:
    """Fits of single effects and of pairs by other ways than the base's derivatives, the cheapest first, until one is
    sufficient.
    """
    begin = time.monotonic()
    # steps as nobody else left them: the result must not depend on what else ran in this process
    start = {p.key: p.nominal for p in baseline.problem.nuisances} | baseline.nominal.mapping
    baseline = replace(baseline, differences=probed_differences(baseline.problem, start))
    fits = _from_nuisances_of_best(baseline, alone, limits)
    singles, leaders = [*alone, *fits], []
    if _insufficient(baseline, singles, limits):
        pairs = search_pairs(baseline, singles, limits, ()) if _follows_samples(baseline, singles) else []
        if any(_is_sufficient(fit, limits) for fit in pairs):
            fits += [*pairs, *_search_alone(baseline, limits)]
        else:
            found, leaders = _search_far(baseline, limits, singles)
            fits += [*pairs, *found]
            singles += [fit for fit in found if len(fit.hypothesis) == 1]
    if not any(len(fit.hypothesis) > 1 for fit in fits):
        pairs = _pairs_of_best(baseline, signatures, limits, singles)
        fits += _fit_each(baseline, signatures, pairs, limits, singles)[0]
    best: dict[str, Fit] = {}
    for fit in fits:
        best[fit.label] = min(best.get(fit.label, fit), fit, key=lambda fit: fit.chi2)
    parts = [baseline.base, *singles, *best.values()]
    sufficient = min((fit.chi2 for fit in parts if _is_sufficient(fit, limits)), default=np.inf)
    found = [
        not_above_its_parts(baseline.problem, baseline.differences, fit, parts, sufficient) for fit in best.values()
    ]
    found += leaders
    share = (time.monotonic() - begin) / max(len(found), 1)
    return found, [share] * len(found)


def _search_far(baseline: Baseline, limits: Thresholds, alone: Sequence[Fit]) -> tuple[list[Fit], list[Fit]]:
    """Fits of effects that no fit of samples leads to: on which motion depends roughly, if what is left is rough; by
    smoothed residuals, single effects and pairs. And those that lead by features of the cycle, which end the search.
    """
    candidates = _searched_candidates(baseline.problem)
    is_rough = bool(candidates) and leaves_rough_motion(baseline.problem, _origins(baseline, alone)[-1])
    fits = _search_rough(baseline, alone, limits) if is_rough else []
    matched, fits = [fit for fit in fits if fit.status == MATCHED], [fit for fit in fits if fit.status != MATCHED]
    if any(_explains(baseline, fit) for fit in fits):
        return fits, []
    leaders = leaders_by_features(baseline.problem, baseline.base, [*alone, *fits], matched)
    if leaders:
        led = {fit.label for fit in leaders}
        return [fit for fit in fits if fit.label not in led], leaders
    singles = [*alone, *(fit for fit in fits if len(fit.hypothesis) == 1)]
    if _insufficient(baseline, singles, limits):
        found = search_singles(baseline, limits)
        fits, singles = [*fits, *found], [*singles, *found]
    if not is_rough and _insufficient(baseline, singles, limits):
        found = _search_alone(baseline, limits)
        fits, singles = [*fits, *found], [*singles, *found]
    smoothers = smoothers_of(baseline.problem)
    if smoothers and _insufficient(baseline, singles, limits):
        fits += search_pairs(baseline, singles, limits, smoothers)
    return fits, []


def _from_nuisances_of_best(baseline: Baseline, alone: Sequence[Fit], limits: Thresholds) -> list[Fit]:
    """Fits of the single effects that ended early, from the nuisances of the best one: it may be in a deeper valley,
    which they share. As long as another one becomes the best, until one is sufficient.
    """
    found: dict[str, Fit] = {fit.label: fit for fit in alone if fit.status != FAILED}
    again: dict[str, Fit] = {}
    for large in (False, True):  # first those that may be small: the motion with a film takes long to simulate
        best = None
        while found and best is not (best := min(found.values(), key=lambda fit: fit.chi2)):
            for label, fit in sorted(found.items(), key=lambda item: item[1].chi2):
                if fit is best or fit.status != STOPPED or _starts_large(fit) != large:
                    continue
                found[label] = moved(baseline.problem, baseline.differences, fit, best)
                if found[label] is not fit:
                    again[label] = found[label]
                if _is_sufficient(found[label], limits):
                    return list(again.values())
    return list(again.values())


def _starts_large(fit: Fit) -> bool:
    candidates = fit.hypothesis
    return any({*guess} & {*one.amplitudes} for one in candidates for guess in one.initial_guesses)


def _follows_samples(baseline: Baseline, fits: Sequence[Fit]) -> bool:
    """Whether the best fit explains so much of what the base leaves that samples can be followed from there, or there
    is nothing coarser: statistics over cycles are not smoothed.
    """
    chi2, size = baseline.base.chi2, baseline.problem.size
    share = baseline.problem.settings.rough_search.reached_share
    explains = any(fit.status != FAILED and chi2 - fit.chi2 >= share * (chi2 - size) for fit in fits)
    return explains or not smoothers_of(baseline.problem)


def _is_sufficient(fit: Fit, limits: Thresholds) -> bool:
    return fit.status != FAILED and reduced_chi2(fit) <= limits.omnibus


def _search_rough(baseline: Baseline, alone: Sequence[Fit], limits: Thresholds) -> list[Fit]:
    """Fits of effects on which motion depends roughly: alone, and beside the best of those that are fitted `alone`."""
    fits: list[Fit] = []
    populations = baseline.problem.settings.rough_search.populations
    for origin in _origins(baseline, alone):
        taken = {candidate.label for candidate in origin.hypothesis}
        others = [candidate for candidate in _searched_candidates(baseline.problem) if candidate.label not in taken]
        fits += search_rough(baseline, origin, others, limits.omnibus, populations)
        if any(_explains(baseline, fit) or fit.status == MATCHED for fit in fits):
            break
    return fits


def _search_alone(baseline: Baseline, limits: Thresholds) -> list[Fit]:
    """The best fit to samples of each effect on which motion depends roughly, alone: where nothing rings, or something
    else explains the data, one population is enough.
    """
    found: dict[str, Fit] = {}
    for fit in search_rough(baseline, baseline.base, _searched_candidates(baseline.problem), limits.omnibus, 1):
        if fit.status != MATCHED:
            found[fit.label] = min(found.get(fit.label, fit), fit, key=lambda fit: fit.chi2)
    return list(found.values())


def _searched_candidates(problem: Problem) -> list[Candidate]:
    return [candidate for candidate in problem.model.candidates if is_searched(problem, candidate)]


def _origins(baseline: Baseline, alone: Sequence[Fit]) -> list[Fit]:
    """What effects are searched beside: the base, and the best of those that are fitted `alone` where it is better."""
    best = min((fit for fit in alone if fit.status != FAILED), key=lambda fit: fit.bic, default=baseline.base)
    return [baseline.base] if best.bic >= baseline.base.bic else [baseline.base, best]


def _explains(baseline: Baseline, fit: Fit) -> bool:
    """Whether a fit explains so much of what the base leaves that nothing else is searched for."""
    chi2, size = baseline.base.chi2, baseline.problem.size
    return chi2 - fit.chi2 >= baseline.problem.settings.decision.min_explained_share * (chi2 - size)


def _fit_each(
    baseline: Baseline,
    signatures: Signatures,
    chosen: Sequence[tuple[LinearizedFit, Fit | None]],
    limits: Thresholds,
    alone: Sequence[Fit],
) -> TimedFits:
    problem, differences, parts = baseline.problem, baseline.differences, [baseline.base, *alone]
    fits, seconds = [], []
    for screened, part_fit in chosen:
        begin = time.monotonic()
        sufficient = min((fit.chi2 for fit in fits if reduced_chi2(fit) <= limits.omnibus), default=np.inf)
        fit = fit_screened(problem, differences, signatures, screened, part_fit, sufficient)
        fits.append(not_above_its_parts(problem, differences, fit, parts, sufficient))
        seconds.append(time.monotonic() - begin)
    return fits, seconds
