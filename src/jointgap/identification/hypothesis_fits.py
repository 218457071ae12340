"""Fits of all hypotheses that are worth one: single effects, then pairs."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointgap.core.progress import with_progress
from jointgap.identification.baseline import Baseline, probed_differences
from jointgap.identification.evidence import reduced_chi2
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.initial_fit import fit_screened, labels_of, lowest_of_each, not_above_its_parts
from jointgap.identification.model_selection import (
    best_sufficient,
    shortlist_pairs,
    shortlist_singles,
    two_effect_thresholds,
)
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.screening import (
    LinearizedFit,
    SignatureRegression,
    Signatures,
    shortlist,
    simulate_signatures,
)
from jointgap.identification.verdict import Thresholds
from jointgap.identification.window_search import search_in_windows

TimedFits = tuple[list[Fit], list[float]]
"""Fits, one of each hypothesis, and how long each took [s]."""

Chosen = tuple[LinearizedFit, Signatures]
"""What is worth a fit, and the signatures that say so."""


def fit_singles(
    baseline: Baseline, signatures: Signatures, limits: Thresholds, part: int = 0, parts: int = 1
) -> TimedFits:
    """Fit every single effect of one part.

    A fit that fails is one of them, with its reason; the others go on. Once one leaves about noise alone, those of the
    same part that stay far behind it end early: they are no rivals, but their chi2 depends on how fits are shared out.
    Those that are never small, such as films, take long and come last. Where joints are loose `fit_pairs` fits all in
    windows of the record.
    """
    if baseline.base.in_windows:
        return [], []
    shortlist = shortlist_singles(signatures, limits, baseline.problem.settings)
    shortlist.sort(key=lambda single: _is_never_small(single.hypothesis))  # these take long, but not if they are beaten
    return _fit_each(baseline, [(single, signatures) for single in shortlist[part::parts]], limits, ())


def _is_never_small(hypothesis: Hypothesis) -> bool:
    """Whether all fits of one of its effects begin at a size, since small ones say nothing of it."""
    return any(all({*guess} & {*one.amplitudes} for guess in one.initial_guesses) for one in hypothesis)


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

    Where no single effect is sufficient the first part searches for one, or for a pair, the cheapest way first:
    clearances of joints in windows; pairs whose signatures explain nearly all, where none does alone; the best
    partners of each leading single effect. Sizes of clearances are not searched on doubted data, which would lead
    anywhere. No further fit begins once as many runs are simulated as the settings say. How far each step goes depends
    on all others, so it is not shared out. Single effects that it finds are among the fits then.

    A clearance may do what two other effects do together: where a pair is worth a fit the first part searches these
    too.
    """
    if baseline.base.in_windows:
        begin = time.monotonic()
        fits = lowest_of_each(search_in_windows(baseline, signatures, limits, sizes=not doubted)) if part == 0 else []
        return fits, [(time.monotonic() - begin) / max(len(fits), 1)] * len(fits)
    if _insufficient(baseline, alone, limits):
        return _search(baseline, signatures, limits, alone, doubted) if part == 0 else ([], [])
    pairs = _pairs_of_best(baseline, signatures, limits, alone)
    fits, seconds = _fit_each(baseline, pairs[part::parts], limits, alone)
    if pairs and part == 0 and not doubted:
        begin = time.monotonic()
        searched = search_in_windows(baseline, signatures, limits)
        share = (time.monotonic() - begin) / max(len(searched), 1)
        fits, seconds = [*fits, *searched], [*seconds, *[share] * len(searched)]
    kept = {id(fit) for fit in lowest_of_each(fits)}
    timed = [(fit, took) for fit, took in zip(fits, seconds, strict=True) if id(fit) in kept]
    return [fit for fit, _ in timed], [took for _, took in timed]


def _insufficient(baseline: Baseline, alone: Sequence[Fit], limits: Thresholds) -> bool:
    """Whether neither the base nor a single effect explains the data."""
    if reduced_chi2(baseline.base) <= limits.omnibus:
        return False
    return best_sufficient(baseline, alone, two_effect_thresholds(baseline, alone, limits)) is None


def _pairs_of_best(
    baseline: Baseline, signatures: Signatures, limits: Thresholds, alone: Sequence[Fit]
) -> list[Chosen]:
    """Pairs that are worth a fit of the best single effect that is sufficient; none where none is."""
    second = two_effect_thresholds(baseline, alone, limits)
    best = best_sufficient(baseline, alone, second)
    if best is None or best.in_windows:  # its partners were sought in windows
        return []
    about = signatures.about(best)
    return [(pair, about) for pair in shortlist_pairs(baseline, signatures, best, alone, second)]


def _search(
    baseline: Baseline, signatures: Signatures, limits: Thresholds, alone: Sequence[Fit], doubted: bool
) -> TimedFits:
    """Fits of single effects and of pairs by other ways than the base's derivatives, the cheapest first, until one is
    sufficient.
    """
    begin, problem = time.monotonic(), baseline.problem
    # steps as nobody else left them: the result must not depend on what else ran in this process
    start = {p.key: p.nominal for p in problem.nuisances} | baseline.nominal.mapping
    baseline = replace(baseline, differences=probed_differences(problem, start))
    fits = search_in_windows(baseline, signatures, limits, alone, sizes=not doubted)
    until = problem.simulations + _max_simulations(problem)

    def singles() -> list[Fit]:
        return [*alone, *(fit for fit in fits if len(fit.hypothesis) == 1)]

    def found() -> bool:
        return any(_is_sufficient(fit, limits) for fit in fits) or not _insufficient(baseline, singles(), limits)

    if not found():
        masked = _masked_pairs(baseline, signatures, singles(), limits)
        fits += _fit_each(baseline, masked, limits, singles(), until)[0]
    if not found():
        # what is fitted in windows has its partners from there
        leading = [fit for fit in singles() if not fit.in_windows]
        fits += _pairs_of_leading(baseline, leading, limits, until)
    done = {labels_of(fit.hypothesis) for fit in fits}
    chosen = _pairs_of_best(baseline, signatures, limits, singles())
    chosen = [(pair, about) for pair, about in chosen if labels_of(pair.hypothesis) not in done]
    fits += _fit_each(baseline, chosen, limits, singles())[0]
    fits = lowest_of_each(fits)
    share = (time.monotonic() - begin) / max(len(fits), 1)
    return fits, [share] * len(fits)


def _max_simulations(problem: Problem) -> int:
    """How many runs a search may simulate until nothing new begins."""
    settings = problem.settings.selection
    return settings.max_simulations_of_statistics if problem.has_statistics else settings.max_simulations


def _masked_pairs(baseline: Baseline, signatures: Signatures, alone: Sequence[Fit], limits: Thresholds) -> list[Chosen]:
    """The best of all pairs that would explain nearly all of what the base leaves, if all were linear and no single
    effect would be sufficient: two may mask each other. What failed `alone` would fail in a pair."""
    regression, noise = SignatureRegression(signatures), limits.omnibus * baseline.problem.size
    if any(single.chi2 <= noise for single in regression.singles()):
        return []
    pairs = [pair for pair in regression.pairs() if not _failed(alone) & labels_of(pair.hypothesis)]
    misfit = baseline.base.chi2 - baseline.problem.size
    least = baseline.problem.settings.decision.min_explained_share * misfit
    pairs = [pair for pair in pairs if baseline.base.chi2 - pair.chi2 >= least]
    return [(pair, signatures) for pair in shortlist(pairs, baseline.problem.settings.selection.partners)]


def _pairs_of_leading(baseline: Baseline, alone: Sequence[Fit], limits: Thresholds, until: float) -> list[Fit]:
    """Fits of the leading single effects with what would explain most of the rest, the most promising pairs first.

    Signatures are taken about the fit of each: with one of two effects there, neither nuisances nor signatures are
    those of the base. These fits are returned too.
    """
    problem, settings = baseline.problem, baseline.problem.settings.selection
    leading: dict[str, Fit] = {}  # of alternatives, which have the same partners; `swap_one_effect` fits the others
    for fit in lowest_of_each(fit for fit in alone if fit.status != FAILED):
        leading.setdefault(fit.hypothesis[0].exclusion_group, fit)
    singles: list[Fit] = []
    chosen: dict[frozenset[str], Chosen] = {}
    for fit in list(leading.values())[: settings.leading_singles]:
        if problem.simulations > until:
            break
        single = fit_hypothesis(problem, fit.hypothesis, fit.mapping, differences=baseline.differences, refresh=True)
        if single.status == FAILED:
            continue
        singles.append(single)
        about = simulate_signatures(problem, single, baseline.differences)
        partners = SignatureRegression(about, single.hypothesis).singles()
        for pair in shortlist(partners, settings.partners):
            if pair.hypothesis[-1].label not in _failed(alone):
                labels = labels_of(pair.hypothesis)
                chosen[labels] = min(chosen.get(labels, (pair, about)), (pair, about), key=lambda each: each[0].chi2)
    ranked = sorted(chosen.values(), key=lambda each: each[0].chi2)
    return [*singles, *_fit_each(baseline, ranked, limits, [*alone, *singles], until)[0]]


def _failed(fits: Sequence[Fit]) -> set[str]:
    """Labels of what none of its fits could be simulated for."""
    return {fit.label for fit in fits} - {fit.label for fit in fits if fit.status != FAILED}


def _is_sufficient(fit: Fit, limits: Thresholds) -> bool:
    return fit.status != FAILED and reduced_chi2(fit) <= limits.omnibus


def _fit_each(
    baseline: Baseline, chosen: Sequence[Chosen], limits: Thresholds, alone: Sequence[Fit], until: float = np.inf
) -> TimedFits:
    """Fits of what is `chosen`, one after the other, none of which begins once `until` runs are simulated."""
    problem, differences, parts = baseline.problem, baseline.differences, [baseline.base, *alone]
    fits, seconds = [], []
    for screened, signatures in with_progress(chosen, "fits of effects"):
        if problem.simulations > until:
            break
        begin = time.monotonic()
        sufficient = min((fit.chi2 for fit in fits if reduced_chi2(fit) <= limits.omnibus), default=np.inf)
        fit = fit_screened(problem, differences, signatures, screened, sufficient)
        fits.append(not_above_its_parts(problem, differences, fit, parts, sufficient))
        seconds.append(time.monotonic() - begin)
    return fits, seconds
