"""Fits of all hypotheses that are worth one: single effects, then pairs; by a coarse search where need be."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointgap.core.candidates import Candidate
from jointgap.core.progress import followed
from jointgap.identification.baseline import Baseline, fit_from_scattered_starts, probed_differences, smoothers_of
from jointgap.identification.coarse_search import search_pairs, search_singles
from jointgap.identification.decide_by_features import leaders_by_features
from jointgap.identification.decide_verdict import reduced_chi2
from jointgap.identification.fit import FAILED, MATCHED, STOPPED, Fit
from jointgap.identification.initial_fit import fit_screened, labels_of, lowest_of_each, moved, not_above_its_parts
from jointgap.identification.law_family import is_law_of_family
from jointgap.identification.model_selection import (
    best_sufficient,
    shortlist_pairs,
    shortlist_singles,
    two_effect_thresholds,
)
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.rough_search import (
    can_be_followed,
    depends_roughly,
    leaves_rough_motion,
    search_rough,
)
from jointgap.identification.screening import (
    LinearizedFit,
    SignatureRegression,
    Signatures,
    can_be_searched,
    only_searched,
    shortlist,
)
from jointgap.identification.thresholds import Thresholds

TimedFits = tuple[list[Fit], list[float]]
"""Fits, one of each hypothesis, and how long each took [s]."""


def fit_singles(
    baseline: Baseline, signatures: Signatures, limits: Thresholds, part: int = 0, parts: int = 1
) -> TimedFits:
    """Fit every single effect of one part.

    A fit that fails is one of them, with its reason; the others go on. Once one leaves about noise alone, those of the
    same part that stay far behind it end early: they are no rivals, but their chi2 depends on how fits are shared out.
    Those that are never small, such as films, take long and come last.
    """
    shortlist = shortlist_singles(signatures, limits, baseline.problem.settings)
    shortlist.sort(key=lambda single: _is_never_small(single.hypothesis))  # these take long, but not if they are beaten
    return _fit_each(baseline, signatures, [(single, None) for single in shortlist[part::parts]], limits, ())


def fit_pairs(
    baseline: Baseline,
    signatures: Signatures,
    limits: Thresholds,
    alone: Sequence[Fit],
    part: int = 0,
    parts: int = 1,
    doubted: bool = False,
) -> TimedFits:
    """Fit every pair of one part that is worth it beside the fits of single effects.

    One effect on which motion depends roughly may do what two others do together: where a pair is worth a fit the first
    part searches these too.

    Where no single effect is sufficient the first part searches for one, or for a pair, the cheapest way first: changes
    of something on which motion depends roughly, such as a clearance; from scattered starts, where chi2 has valleys;
    from the nuisances of the best one; pairs whose signatures explain nearly all, where none does alone; pairs on
    samples, where these can be followed; if no law of a family is sufficient, effects on which motion depends roughly,
    if what is left is rough; by smoothed residuals.
    The first two and the last two are not tried on doubted data, which would lead anywhere. No step of it begins once
    it has simulated as many runs as the settings say, the first two apart. How far each one goes depends on all others,
    so it is not shared out. Single effects that it finds are among the fits then.
    """
    if _insufficient(baseline, alone, limits):
        return _search(baseline, signatures, limits, alone, doubted) if part == 0 else ([], [])
    pairs = _pairs_of_best(baseline, signatures, limits, alone)
    fits, seconds = _fit_each(baseline, signatures, pairs[part::parts], limits, alone)
    if pairs and part == 0:
        begin = time.monotonic()
        searched = _search_alone(baseline, _searched_candidates(baseline.problem), limits)
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


def _search(
    baseline: Baseline, signatures: Signatures, limits: Thresholds, alone: Sequence[Fit], doubted: bool
) -> TimedFits:
    """Fits of single effects and of pairs by other ways than the base's derivatives, the cheapest first, until one is
    sufficient.
    """
    begin = time.monotonic()
    until = baseline.problem.simulations + _max_simulations(baseline.problem)
    # steps as nobody else left them: the result must not depend on what else ran in this process
    start = {p.key: p.nominal for p in baseline.problem.nuisances} | baseline.nominal.mapping
    baseline = replace(baseline, differences=probed_differences(baseline.problem, start))
    before = baseline.problem.simulations
    others = [one for one in _searched_candidates(baseline.problem) if doubted or not one.is_perturbation]
    fits = [] if doubted else _search_perturbations(baseline, limits, until)
    fits += [] if doubted else _from_scattered_starts(baseline, [*alone, *fits], limits)
    until += baseline.problem.simulations - before  # what these simulate is bounded
    fits += _from_nuisances_of_best(baseline, [*alone, *fits], limits, until)
    singles, leaders = [*alone, *fits], []
    if _insufficient(baseline, singles, limits):
        # of motion that never repeats pairs come last: single effects from other starts take a third as long
        repeats = doubted or not baseline.problem.has_statistics
        screened = _masked_pairs(baseline, signatures, singles, limits) if repeats else []
        pairs = _fit_each(baseline, signatures, screened, limits, singles)[0]
        pairs_first = _follows_samples(baseline, singles) and repeats
        if pairs_first and not any(_is_sufficient(fit, limits) for fit in pairs):
            pairs += search_pairs(baseline, singles, limits, (), until)
        if sufficient := [fit for fit in pairs if _is_sufficient(fit, limits)]:
            best = min(sufficient, key=lambda fit: fit.chi2)
            found = [
                *_moved(baseline, singles, best, limits, until),
                *_search_alone(baseline, others, limits, until),
            ]
        elif doubted:
            found = []
        elif is_law_of_family(baseline, singles, pairs, limits):
            found = []  # a law with another shape than those of the list: `with_families` asks for it again
        else:
            found, leaders = _search_far(baseline, limits, singles, pairs, until)
        fits += [*pairs, *found]
        singles += [fit for fit in found if len(fit.hypothesis) == 1]
    done = {labels_of(fit.hypothesis) for fit in fits}
    chosen = [each for each in _pairs_of_best(baseline, signatures, limits, singles) if _labels(each) not in done]
    fits += _fit_each(baseline, signatures, chosen, limits, singles)[0]
    if chosen and not any(only_searched(baseline.problem, one) for fit in fits for one in fit.hypothesis):
        fits += _search_alone(baseline, others, limits, until)
    best = lowest_of_each(fits)
    parts = [baseline.base, *singles, *best]
    sufficient = min((fit.chi2 for fit in parts if _is_sufficient(fit, limits)), default=np.inf)
    found = [not_above_its_parts(baseline.problem, baseline.differences, fit, parts, sufficient) for fit in best]
    led = {labels_of(fit.hypothesis) for fit in leaders}  # these stand for what samples made of the same effects
    found = [*(fit for fit in found if labels_of(fit.hypothesis) not in led), *leaders]
    share = (time.monotonic() - begin) / max(len(found), 1)
    return found, [share] * len(found)


def _masked_pairs(
    baseline: Baseline, signatures: Signatures, alone: Sequence[Fit], limits: Thresholds
) -> list[tuple[LinearizedFit, None]]:
    """The best of all pairs that would explain nearly all of what the base leaves, if all were linear and no single
    effect would be sufficient: two may mask each other. What failed `alone` would fail in a pair."""
    regression, noise = SignatureRegression(signatures), limits.omnibus * baseline.problem.size
    if any(single.chi2 <= noise for single in regression.singles()):
        return []
    failed = {fit.label for fit in alone if fit.status == FAILED} - {fit.label for fit in alone if fit.status != FAILED}
    pairs = (pair for pair in regression.pairs() if _explains(baseline, pair))
    sound = [pair for pair in pairs if not failed & labels_of(pair.hypothesis)]
    return [(pair, None) for pair in shortlist(sound, baseline.problem.settings.selection.partners)]


def _search_far(
    baseline: Baseline, limits: Thresholds, alone: Sequence[Fit], pairs: Sequence[Fit], until: float
) -> tuple[list[Fit], list[Fit]]:
    """Fits of effects that no fit of samples leads to: on which motion depends roughly, if what is left is rough; by
    smoothed residuals, single effects and pairs. And those that lead by features of the cycle, which end the search;
    single effects that were fitted `alone` and `pairs` are their rivals.
    """
    candidates = _searched_candidates(baseline.problem)
    is_rough = bool(candidates) and leaves_rough_motion(baseline.problem, _origins(baseline, alone)[-1])
    fits = _search_rough(baseline, alone, limits, until) if is_rough else []
    matched, fits = [fit for fit in fits if fit.status == MATCHED], [fit for fit in fits if fit.status != MATCHED]
    explaining = [fit for fit in fits if _explains(baseline, fit)]
    if any(can_be_followed(baseline.problem, fit) for fit in explaining):
        return fits, []
    leaders = leaders_by_features(baseline.problem, baseline.base, [*alone, *pairs, *fits], matched)
    if leaders:
        return fits, leaders
    if explaining:
        return fits, []
    singles = [*alone, *(fit for fit in fits if len(fit.hypothesis) == 1)]

    def goes_on() -> bool:
        return baseline.problem.simulations <= until and _insufficient(baseline, singles, limits)

    if goes_on():
        found = search_singles(baseline, limits, until)
        fits, singles = [*fits, *found], [*singles, *found]
    if not is_rough and goes_on():
        others = [one for one in candidates if not one.is_perturbation]
        found = _search_alone(baseline, others, limits, until)
        fits, singles = [*fits, *found], [*singles, *found]
    smoothers = smoothers_of(baseline.problem)
    if (smoothers or baseline.problem.has_statistics) and goes_on():
        fits += search_pairs(baseline, singles, limits, smoothers, until)
    return fits, []


def _max_simulations(problem: Problem) -> int:
    """How many runs a search may simulate until nothing new begins."""
    settings = problem.settings.selection
    return settings.max_simulations_of_statistics if problem.has_statistics else settings.max_simulations


def _from_nuisances_of_best(
    baseline: Baseline, alone: Sequence[Fit], limits: Thresholds, until: float = np.inf
) -> list[Fit]:
    """Fits of the single effects that ended early, from the nuisances of the best one: it may be in a deeper valley,
    which they share. As long as another one becomes the best, until one is sufficient.
    """
    problem = baseline.problem
    found = {fit.label: fit for fit in lowest_of_each(fit for fit in alone if fit.status != FAILED)}
    again: dict[str, Fit] = {}
    least = np.inf
    while found and problem.simulations <= until:
        best = min(found.values(), key=lambda fit: fit.chi2)
        if _is_sufficient(best, limits) or best.chi2 > least - problem.settings.decision.min_delta_bic:
            break
        least = best.chi2
        for never_small in (False, True):  # these last: the motion with a film takes long to simulate
            some = [fit for fit in found.values() if fit is not best and _is_never_small(fit.hypothesis) == never_small]
            better = {fit.label: fit for fit in _moved(baseline, some, best, limits, until)}
            found |= better
            again |= better
            if any(fit.chi2 < least - problem.settings.decision.min_delta_bic for fit in better.values()):
                break
    return list(again.values())


def _from_scattered_starts(baseline: Baseline, alone: Sequence[Fit], limits: Thresholds) -> list[Fit]:
    """Deeper fits of the leading single effects, from scattered starts: none is sufficient, and chi2 has valleys."""
    settings = baseline.problem.settings
    if not depends_roughly(baseline.problem, baseline.base):
        return []
    leading = lowest_of_each(fit for fit in alone if fit.status != FAILED)
    deeper = []
    for fit in leading[: settings.scattered_starts.leading_singles]:
        if not _insufficient(baseline, [*alone, *deeper], limits):
            break
        found = fit_from_scattered_starts(baseline, fit, limits.omnibus * baseline.problem.size)
        if found is not fit:
            deeper.append(found)
    return deeper


def _moved(baseline: Baseline, fits: Sequence[Fit], best: Fit, limits: Thresholds, until: float = np.inf) -> list[Fit]:
    """Those of the `fits` that ended early and are lower from the nuisances of the `best`, lowest first.

    Those far above a sufficient one end early once more. Those that are never small take long to simulate: they do not
    begin where they explain less than the settings' `slow_share` of what the best one does.
    """
    sufficient, better = best.chi2 if _is_sufficient(best, limits) else np.inf, []
    share = baseline.problem.settings.selection.slow_share
    most = baseline.base.chi2 - share * (baseline.base.chi2 - best.chi2)
    stopped = (
        fit for fit in fits if fit.status == STOPPED and not (_is_never_small(fit.hypothesis) and fit.chi2 > most)
    )
    for fit in sorted(stopped, key=lambda fit: fit.chi2):
        if baseline.problem.simulations > until:
            break
        again = moved(baseline.problem, baseline.differences, fit, best, sufficient)
        if again is not fit:
            better.append(again)
        if _is_sufficient(again, limits):
            sufficient = min(sufficient, again.chi2)
    return better


def _is_never_small(hypothesis: Hypothesis) -> bool:
    """Whether all fits of one of its effects begin at a size, since small ones say nothing of it."""
    return any(all({*guess} & {*one.amplitudes} for guess in one.initial_guesses) for one in hypothesis)


def _labels(chosen: tuple[LinearizedFit, Fit | None]) -> frozenset[str]:
    return labels_of(chosen[0].hypothesis)


def _follows_samples(baseline: Baseline, fits: Sequence[Fit]) -> bool:
    """Whether the best fit explains so much of what the base leaves that samples can be followed from there, or there
    is nothing coarser: statistics over cycles are not smoothed.
    """
    chi2, size = baseline.base.chi2, baseline.problem.size
    share = baseline.problem.settings.selection.followed_share
    explains = any(fit.status != FAILED and chi2 - fit.chi2 >= share * (chi2 - size) for fit in fits)
    return explains or not smoothers_of(baseline.problem)


def _is_sufficient(fit: Fit, limits: Thresholds) -> bool:
    return fit.status != FAILED and reduced_chi2(fit) <= limits.omnibus


def _search_rough(baseline: Baseline, alone: Sequence[Fit], limits: Thresholds, until: float) -> list[Fit]:
    """Fits of effects on which motion depends roughly: alone, and beside the best of those that are fitted `alone`."""
    populations, candidates = baseline.problem.settings.rough_search.populations, _searched_candidates(baseline.problem)
    origins = _origins(baseline, alone)
    here = {labels_of(fit.hypothesis) for fit in origins}
    others = [
        fit for fit in lowest_of_each(alone) if _explains_some(baseline, fit) and labels_of(fit.hypothesis) not in here
    ]
    return search_rough(baseline, origins, candidates, limits.omnibus, populations, until, others)


def _search_alone(
    baseline: Baseline,
    candidates: Sequence[Candidate],
    limits: Thresholds,
    until: float = np.inf,
    least_share: float | None = None,
) -> list[Fit]:
    """The best fit to samples of each of some effects on which motion depends roughly, alone: where nothing rings, or
    something else explains the data, one population is enough.
    """
    populations = baseline.problem.settings.rough_search.populations_alone
    found = search_rough(
        baseline, [baseline.base], candidates, limits.omnibus, populations, until, least_share=least_share
    )
    return lowest_of_each(fit for fit in found if fit.status != MATCHED)


def _search_perturbations(baseline: Baseline, limits: Thresholds, until: float) -> list[Fit]:
    """The best fit to samples of each change of something on which motion depends roughly, such as a clearance.

    A fit from the base ends in a valley beside it, and what it gains says little of the change; some dozens of points
    cost less than that fit.
    """
    changes = [candidate for candidate in _searched_candidates(baseline.problem) if candidate.is_perturbation]
    least_share = baseline.problem.settings.rough_search.least_share_of_perturbations
    return _search_alone(baseline, changes, limits, until, least_share) if changes else []


def _searched_candidates(problem: Problem) -> list[Candidate]:
    return [candidate for candidate in problem.model.candidates if can_be_searched(problem, candidate)]


def _origins(baseline: Baseline, alone: Sequence[Fit]) -> list[Fit]:
    """What effects are searched beside: the base, and the best of those that are fitted `alone` if it explains some."""
    base = baseline.base
    best = min((fit for fit in alone if fit.status != FAILED), key=lambda fit: fit.bic, default=base)
    return [base, best] if _explains_some(baseline, best) else [base]


def _explains_some(baseline: Baseline, fit: Fit) -> bool:
    """Whether a fit explains so much of what the base leaves that its effect may be there beside another."""
    problem, base = baseline.problem, baseline.base
    share = problem.settings.rough_search.beside_share
    return fit.status != FAILED and base.chi2 - fit.chi2 > share * max(base.chi2 - problem.size, 0.0)


def _explains(baseline: Baseline, fit: Fit | LinearizedFit) -> bool:
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
    for screened, part_fit in followed(chosen, "fits of effects"):
        begin = time.monotonic()
        sufficient = min((fit.chi2 for fit in fits if reduced_chi2(fit) <= limits.omnibus), default=np.inf)
        fit = fit_screened(problem, differences, signatures, screened, part_fit, sufficient)
        fits.append(not_above_its_parts(problem, differences, fit, parts, sufficient))
        seconds.append(time.monotonic() - begin)
    return fits, seconds
