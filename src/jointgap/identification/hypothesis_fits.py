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
from jointgap.identification.initial_fit import (
    best_fit_per_hypothesis,
    fit_screened,
    labels_of,
    refit_from_part,
)
from jointgap.identification.law_family import family_suffices
from jointgap.identification.model_selection import (
    best_sufficient,
    failed_labels,
    shortlist_pairs,
    shortlist_singles,
    swap_one_effect,
    two_effect_thresholds,
)
from jointgap.identification.problem import Hypothesis, SearchLimit
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
    baseline: Baseline,
    sensitivities: Sensitivities,
    limits: Thresholds,
    part: int = 0,
    parts: int = 1,
) -> TimedFits:
    """Fit every selected single effect of one part.

    Failed fits are included with their reason. Once a fit is consistent with noise, dominated ones
    of the same part end early. Slow effects of finite size, such as films, come last.
    """
    shortlist = shortlist_singles(sensitivities, limits, baseline.problem.settings)
    shortlist.sort(key=lambda single: _is_never_small(single.hypothesis))
    return _fit_each(
        baseline, [(single, sensitivities) for single in shortlist[part::parts]], limits, ()
    )


def _is_never_small(hypothesis: Hypothesis) -> bool:
    """Whether an effect has finite start sizes only, as it is nonlinear at small ones."""
    return any(
        all({*guess} & {*one.amplitudes} for guess in one.initial_guesses) for one in hypothesis
    )


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

    If no single effect is sufficient, the first part searches for single effects and pairs
    (`_search`), which is sequential, so not divided into parts. Clearances are not searched on
    inconsistent data.

    If a pair is selected, the first part searches likely clearances too, as a clearance can
    resemble two effects.
    """
    if _insufficient(baseline, alone, limits):
        return (
            _search(baseline, sensitivities, limits, alone, inconsistent) if part == 0 else ([], [])
        )
    pairs = _pairs_of_best(baseline, sensitivities, limits, alone)
    fits, seconds = _fit_each(baseline, pairs[part::parts], limits, alone)
    if pairs and part == 0 and not inconsistent:
        begin = time.monotonic()
        limit = baseline.problem.limit(_CLEARANCES)
        searched = fit_clearances(baseline, likely_clearances(baseline), limits, limit=limit)
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


_CLEARANCES = "likely clearances"


def _search(
    baseline: Baseline,
    sensitivities: Sensitivities,
    limits: Thresholds,
    alone: Sequence[Fit],
    inconsistent: bool,
) -> TimedFits:
    """Search beyond linearisation about the base, until a fit is sufficient.

    The steps: clearances that are likely by the filter; pairs whose sensitivities explain nearly
    everything; the best partners of the leading single effects. If no law family suffices (the
    stage decide names it) these follow: single effects fitted to sums of samples first; partners of
    further single effects; pairs near the best one. Each step has an equal share of the simulated
    runs, so that none uses those of the next ones.
    """
    begin, problem = time.monotonic(), baseline.problem
    # new steps: the result must not depend on earlier fits in this process
    start = {p.key: p.nominal for p in problem.nuisances} | baseline.nominal.mapping
    baseline = replace(baseline, differences=probed_differences(problem, start))
    fits: list[Fit] = []
    partnered: set[str] = set()

    def singles() -> list[Fit]:
        return [*alone, *(fit for fit in fits if len(fit.hypothesis) == 1)]

    def clearances(limit: SearchLimit) -> list[Fit]:
        starts = [] if inconsistent else likely_clearances(baseline)
        return fit_clearances(baseline, starts, limits, alone, limit)

    def masked(limit: SearchLimit) -> list[Fit]:
        pairs = _masked_pairs(baseline, sensitivities, singles(), limits)
        return _fit_each(baseline, pairs, limits, singles(), limit)[0]

    def partners(limit: SearchLimit) -> list[Fit]:
        leading: dict[
            str, Fit
        ] = {}  # one of each exclusion group; `swap_one_effect` fits the others
        for fit in best_fit_per_hypothesis(singles()):
            # fits in windows have partners already
            if fit.status != FAILED and not fit.in_windows and fit.label not in partnered:
                leading.setdefault(fit.hypothesis[0].exclusion_group, fit)
        chosen = list(leading.values())[: problem.settings.selection.partners]
        found = _pairs_of_leading(baseline, sensitivities, chosen, singles(), limits, limit)
        partnered.update(fit.label for fit in found if len(fit.hypothesis) == 1)
        return found

    def sums(limit: SearchLimit) -> list[Fit]:
        return _fit_sums_first(baseline, sensitivities, limits, limit)

    def swaps(limit: SearchLimit) -> list[Fit]:
        return swap_one_effect(baseline, sensitivities, [*alone, *fits], limit)

    steps = {
        _CLEARANCES: clearances,
        "effects that mask each other": masked,
        "pairs with the leading effects": partners,
        "effects fitted to sums of samples": sums,
        "pairs with further effects": partners,
        "exchanges of one effect of the best pair": swaps,
    }
    for step, search in steps.items():
        if search is sums and family_suffices(baseline, singles(), limits):
            break
        fits += search(problem.limit(step, 1.0 / len(steps)))
        if any(_is_sufficient(fit, limits) for fit in fits) or not _insufficient(
            baseline, singles(), limits
        ):
            break
    done = {labels_of(fit.hypothesis) for fit in fits}
    chosen = _pairs_of_best(baseline, sensitivities, limits, singles())
    chosen = [(pair, about) for pair, about in chosen if labels_of(pair.hypothesis) not in done]
    fits += _fit_each(baseline, chosen, limits, singles())[0]
    fits = best_fit_per_hypothesis(fits)
    share = (time.monotonic() - begin) / max(len(fits), 1)
    return fits, [share] * len(fits)


def _fit_sums_first(
    baseline: Baseline, sensitivities: Sensitivities, limits: Thresholds, limit: SearchLimit
) -> list[Fit]:
    """Fits of the single effects that rank first by sums of samples, where chi2 of all samples is
    rough."""
    problem = baseline.problem
    if not is_rough(problem):
        return []
    sums = first_sums(problem)
    differences, about = (
        probed_differences(sums, baseline.base.mapping),
        sums.sensitivities(sensitivities),
    )
    chosen = shortlist_singles(about, limits, problem.settings)
    starts = [fit_screened(sums, differences, about, single) for single in chosen]
    fits: list[Fit] = []
    for start in sorted(starts, key=lambda fit: fit.chi2):
        if limit.reached():
            break
        sufficient = min((fit.chi2 for fit in fits if _is_sufficient(fit, limits)), default=np.inf)
        fit = fit_from_sums(problem, start, baseline.differences, sufficient)
        fits += [] if fit is None else [fit]
    return fits


def _masked_pairs(
    baseline: Baseline, sensitivities: Sensitivities, alone: Sequence[Fit], limits: Thresholds
) -> list[Chosen]:
    """The best pairs that explain nearly everything by linear regression, if no single effect is
    sufficient (masked effects); without effects that failed `alone`."""
    regression, noise = SensitivityRegression(sensitivities), limits.omnibus * baseline.problem.size
    if any(single.chi2 <= noise for single in regression.singles()):
        return []
    pairs = [
        pair for pair in regression.pairs() if not failed_labels(alone) & labels_of(pair.hypothesis)
    ]
    misfit = baseline.base.chi2 - baseline.problem.size
    least = baseline.problem.settings.decision.min_explained_share * misfit
    pairs = [pair for pair in pairs if baseline.base.chi2 - pair.chi2 >= least]
    return [
        (pair, sensitivities)
        for pair in shortlist(pairs, baseline.problem.settings.selection.partners)
    ]


def _pairs_of_leading(
    baseline: Baseline,
    sensitivities: Sensitivities,
    leading: Sequence[Fit],
    alone: Sequence[Fit],
    limits: Thresholds,
    limit: SearchLimit,
) -> list[Fit]:
    """Fits of the `leading` single effects with their best partners, the best pairs first.

    Partners are found by linearisation about the fit of each single effect, of those that the
    `sensitivities` about the base rank first; these fits are returned too.
    """
    problem, settings = baseline.problem, baseline.problem.settings.selection
    singles: list[Fit] = []
    chosen: dict[frozenset[str], Chosen] = {}
    for fit in leading:
        if limit.reached():
            break
        single = fit_hypothesis(
            problem, fit.hypothesis, fit.mapping, differences=baseline.differences, refresh=True
        )
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
                chosen[labels] = min(
                    chosen.get(labels, (pair, about)), (pair, about), key=lambda each: each[0].chi2
                )
    ranked = sorted(chosen.values(), key=lambda each: each[0].chi2)
    return [*singles, *_fit_each(baseline, ranked, limits, [*alone, *singles], limit)[0]]


def _is_sufficient(fit: Fit, limits: Thresholds) -> bool:
    return fit.status != FAILED and reduced_chi2(fit) <= limits.omnibus


def _fit_each(
    baseline: Baseline,
    chosen: Sequence[Chosen],
    limits: Thresholds,
    alone: Sequence[Fit],
    limit: SearchLimit | None = None,
) -> TimedFits:
    """Fits of the `chosen` hypotheses; none begins at the limit."""
    problem, differences, parts = baseline.problem, baseline.differences, [baseline.base, *alone]
    fits, seconds = [], []
    for screened, sensitivities in with_progress(chosen, "fits of effects"):
        if limit and limit.reached():
            break
        begin = time.monotonic()
        sufficient = min(
            (fit.chi2 for fit in fits if reduced_chi2(fit) <= limits.omnibus), default=np.inf
        )
        fit = fit_screened(problem, differences, sensitivities, screened, sufficient)
        fits.append(refit_from_part(problem, differences, fit, parts, sufficient))
        seconds.append(time.monotonic() - begin)
    return fits, seconds
