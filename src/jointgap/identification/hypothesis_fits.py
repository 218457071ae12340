"""Fits of the selected hypotheses: single effects, then pairs."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointgap.core.progress import with_progress
from jointgap.identification.baseline import Baseline, probed_differences
from jointgap.identification.block_sums import first_sums, fit_from_sums, is_rough
from jointgap.identification.evidence import reduced_chi2
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.initial_fit import best_fit_per_hypothesis, fit_screened, labels_of, refit_from_part
from jointgap.identification.law_family import family_suffices
from jointgap.identification.model_selection import (
    best_sufficient,
    failed_labels,
    shortlist_pairs,
    shortlist_singles,
    swap_one_effect,
    two_effect_thresholds,
)
from jointgap.identification.problem import Hypothesis
from jointgap.identification.screening import (
    LinearizedFit,
    Sensitivities,
    SensitivityRegression,
    shortlist,
    simulate_sensitivities,
)
from jointgap.identification.verdict import Thresholds
from jointgap.identification.window_search import fit_clearances, likely_clearances

TimedFits = tuple[list[Fit], list[float]]
"""Fits, one for each hypothesis, and their durations [s]."""

Chosen = tuple[LinearizedFit, Sensitivities]
"""A hypothesis selected for a fit, and the sensitivities of the selection."""


def fit_singles(
    baseline: Baseline, sensitivities: Sensitivities, limits: Thresholds, part: int = 0, parts: int = 1
) -> TimedFits:
    """Fit every selected single effect of one part.

    Failed fits are included with their reason. Once a fit is consistent with noise, dominated ones of the same part end
    early. Slow effects of finite size, such as films, come last.
    """
    shortlist = shortlist_singles(sensitivities, limits, baseline.problem.settings)
    shortlist.sort(key=lambda single: _is_never_small(single.hypothesis))
    return _fit_each(baseline, [(single, sensitivities) for single in shortlist[part::parts]], limits, ())


def _is_never_small(hypothesis: Hypothesis) -> bool:
    """Whether an effect has finite start sizes only, as it is nonlinear at small ones."""
    return any(all({*guess} & {*one.amplitudes} for guess in one.initial_guesses) for one in hypothesis)


def fit_pairs(
    baseline: Baseline,
    sensitivities: Sensitivities,
    limits: Thresholds,
    alone: Sequence[Fit],
    part: int = 0,
    parts: int = 1,
    inconsistent: bool = False,
) -> TimedFits:
    """Fit the selected pairs of one part.

    If no single effect is sufficient, the first part searches for single effects and pairs, the cheapest step first:
    single effects fitted to sums of samples first; shapes of law families; clearances that are likely by the filter;
    pairs whose sensitivities explain nearly everything; the best partners of each leading single effect, and pairs near
    the best one. The search is sequential, so it is not divided into parts; no step begins after the limit of simulated
    runs. Clearances are not searched on inconsistent data.

    If a pair is selected, the first part searches likely clearances too, as a clearance can resemble two effects.
    """
    if _insufficient(baseline, alone, limits):
        return _search(baseline, sensitivities, limits, alone, inconsistent) if part == 0 else ([], [])
    pairs = _pairs_of_best(baseline, sensitivities, limits, alone)
    fits, seconds = _fit_each(baseline, pairs[part::parts], limits, alone)
    if pairs and part == 0 and not inconsistent:
        begin = time.monotonic()
        searched = fit_clearances(baseline, likely_clearances(baseline), limits, until=baseline.problem.limit_of_search)
        share = (time.monotonic() - begin) / max(len(searched), 1)
        fits, seconds = [*fits, *searched], [*seconds, *[share] * len(searched)]
    kept = {id(fit) for fit in best_fit_per_hypothesis(fits)}
    timed = [(fit, took) for fit, took in zip(fits, seconds, strict=True) if id(fit) in kept]
    return [fit for fit, _ in timed], [took for _, took in timed]


def _insufficient(baseline: Baseline, alone: Sequence[Fit], limits: Thresholds) -> bool:
    """Whether neither the base nor a single effect explains the data."""
    if reduced_chi2(baseline.base) <= limits.omnibus:
        return False
    return best_sufficient(baseline, alone, two_effect_thresholds(baseline, alone, limits)) is None


def _pairs_of_best(
    baseline: Baseline, sensitivities: Sensitivities, limits: Thresholds, alone: Sequence[Fit]
) -> list[Chosen]:
    """Selected pairs with the best sufficient single effect, if any."""
    second = two_effect_thresholds(baseline, alone, limits)
    best = best_sufficient(baseline, alone, second)
    if best is None or best.in_windows:  # then partners were searched in windows
        return []
    about = sensitivities.about(best)
    return [(pair, about) for pair in shortlist_pairs(baseline, sensitivities, best, alone, second)]


def _search(
    baseline: Baseline, sensitivities: Sensitivities, limits: Thresholds, alone: Sequence[Fit], inconsistent: bool
) -> TimedFits:
    """Search beyond linearisation about the base, the cheapest step first, until a fit is sufficient."""
    begin, problem = time.monotonic(), baseline.problem
    # new steps: the result must not depend on earlier fits in this process
    start = {p.key: p.nominal for p in problem.nuisances} | baseline.nominal.mapping
    baseline = replace(baseline, differences=probed_differences(problem, start))
    until = problem.limit_of_search
    fits = _fit_sums_first(baseline, sensitivities, limits, until)
    if not any(_is_sufficient(fit, limits) for fit in fits):
        if family_suffices(baseline, alone, limits):
            return [], []  # the stage decide names it
        clearances = [] if inconsistent else likely_clearances(baseline)
        fits += fit_clearances(baseline, clearances, limits, alone, until)

    def singles() -> list[Fit]:
        return [*alone, *(fit for fit in fits if len(fit.hypothesis) == 1)]

    def found() -> bool:
        return any(_is_sufficient(fit, limits) for fit in fits) or not _insufficient(baseline, singles(), limits)

    if not found():
        masked = _masked_pairs(baseline, sensitivities, singles(), limits)
        fits += _fit_each(baseline, masked, limits, singles(), until)[0]
    if not found():
        # fits in windows have partners already
        leading = [fit for fit in singles() if not fit.in_windows]
        fits += _pairs_of_leading(baseline, sensitivities, leading, limits, until)
    if not found() and problem.simulations <= until:
        fits += swap_one_effect(baseline, sensitivities, [*alone, *fits])
    done = {labels_of(fit.hypothesis) for fit in fits}
    chosen = _pairs_of_best(baseline, sensitivities, limits, singles())
    chosen = [(pair, about) for pair, about in chosen if labels_of(pair.hypothesis) not in done]
    fits += _fit_each(baseline, chosen, limits, singles())[0]
    fits = best_fit_per_hypothesis(fits)
    share = (time.monotonic() - begin) / max(len(fits), 1)
    return fits, [share] * len(fits)


def _fit_sums_first(baseline: Baseline, sensitivities: Sensitivities, limits: Thresholds, until: float) -> list[Fit]:
    """Fits of the single effects that rank first by sums of samples, where chi2 of all samples is rough."""
    problem = baseline.problem
    if not is_rough(problem):
        return []
    sums = first_sums(problem)
    differences, about = probed_differences(sums, baseline.base.mapping), sums.sensitivities(sensitivities)
    chosen = shortlist_singles(about, limits, problem.settings)
    starts = [fit_screened(sums, differences, about, single) for single in chosen]
    fits: list[Fit] = []
    for start in sorted(starts, key=lambda fit: fit.chi2):
        if problem.simulations > until:
            break
        sufficient = min((fit.chi2 for fit in fits if _is_sufficient(fit, limits)), default=np.inf)
        fit = fit_from_sums(problem, start, baseline.differences, sufficient)
        fits += [] if fit is None else [fit]
    return fits


def _masked_pairs(
    baseline: Baseline, sensitivities: Sensitivities, alone: Sequence[Fit], limits: Thresholds
) -> list[Chosen]:
    """The best pairs that explain nearly everything by linear regression, if no single effect is sufficient (masked
    effects); without effects that failed `alone`."""
    regression, noise = SensitivityRegression(sensitivities), limits.omnibus * baseline.problem.size
    if any(single.chi2 <= noise for single in regression.singles()):
        return []
    pairs = [pair for pair in regression.pairs() if not failed_labels(alone) & labels_of(pair.hypothesis)]
    misfit = baseline.base.chi2 - baseline.problem.size
    least = baseline.problem.settings.decision.min_explained_share * misfit
    pairs = [pair for pair in pairs if baseline.base.chi2 - pair.chi2 >= least]
    return [(pair, sensitivities) for pair in shortlist(pairs, baseline.problem.settings.selection.partners)]


def _pairs_of_leading(
    baseline: Baseline, sensitivities: Sensitivities, alone: Sequence[Fit], limits: Thresholds, until: float
) -> list[Fit]:
    """Fits of the leading single effects with their best partners, the best pairs first.

    Partners are found by linearisation about the fit of each single effect, of those that the `sensitivities` about the
    base rank first; these fits are returned too.
    """
    problem, settings = baseline.problem, baseline.problem.settings.selection
    leading: dict[str, Fit] = {}  # one of each exclusion group; `swap_one_effect` fits the others
    for fit in best_fit_per_hypothesis(fit for fit in alone if fit.status != FAILED):
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
        ranked = SensitivityRegression(sensitivities.about(single), single.hypothesis).singles()
        first = [one.hypothesis[-1] for one in shortlist(ranked, settings.linearised_partners)]
        labels = {label for one in first for label in (one.label, one.carrier)}
        likely = [one for one in problem.model.candidates if one.label in labels]
        about = simulate_sensitivities(problem, single, baseline.differences, likely)
        partners = SensitivityRegression(about, single.hypothesis).singles()
        for pair in shortlist(partners, settings.partners):
            if pair.hypothesis[-1].label not in failed_labels(alone):
                labels = labels_of(pair.hypothesis)
                chosen[labels] = min(chosen.get(labels, (pair, about)), (pair, about), key=lambda each: each[0].chi2)
    ranked = sorted(chosen.values(), key=lambda each: each[0].chi2)
    return [*singles, *_fit_each(baseline, ranked, limits, [*alone, *singles], until)[0]]


def _is_sufficient(fit: Fit, limits: Thresholds) -> bool:
    return fit.status != FAILED and reduced_chi2(fit) <= limits.omnibus


def _fit_each(
    baseline: Baseline, chosen: Sequence[Chosen], limits: Thresholds, alone: Sequence[Fit], until: float = np.inf
) -> TimedFits:
    """Fits of the `chosen` hypotheses; none begins after `until` simulated runs."""
    problem, differences, parts = baseline.problem, baseline.differences, [baseline.base, *alone]
    fits, seconds = [], []
    for screened, sensitivities in with_progress(chosen, "fits of effects"):
        if problem.simulations > until:
            break
        begin = time.monotonic()
        sufficient = min((fit.chi2 for fit in fits if reduced_chi2(fit) <= limits.omnibus), default=np.inf)
        fit = fit_screened(problem, differences, sensitivities, screened, sufficient)
        fits.append(refit_from_part(problem, differences, fit, parts, sufficient))
        seconds.append(time.monotonic() - begin)
    return fits, seconds
