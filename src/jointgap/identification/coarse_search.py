"""A second search for effects, from coarsely smoothed residuals: where no fit that starts at the base is sufficient.

The base took up what it could of an effect with its nuisances, and where impacts make valleys it may lie far from the
truth: what effects change there says little. So the search begins again at nominal nuisances, with residuals in which
impacts are smoothed.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from jointgap.identification.baseline import Baseline, Smoother, coarse_to_fine_fit, coordinate_scan, smoothers_of
from jointgap.identification.decide_verdict import reduced_chi2
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.initial_fit import fit_screened, labels_of, lowest_of_each
from jointgap.identification.problem import Hypothesis
from jointgap.identification.screening import (
    LinearizedFit,
    SignatureRegression,
    Signatures,
    shortlist,
    simulate_signatures,
)
from jointgap.identification.thresholds import Thresholds


def search_singles(baseline: Baseline, limits: Thresholds, until: float = np.inf) -> list[Fit]:
    """Fits of single effects from the nominal nuisances of the `baseline`, best first, the failed ones last.

    `limits` say what is sufficient; once the problem has been simulated more often than `until` nothing new begins.
    """
    smoothers = smoothers_of(baseline.problem)
    if not smoothers:
        return []
    start, smoothers = _first_visible(baseline, (), baseline.nominal.mapping, smoothers)
    if start.status == FAILED:
        return []
    signatures = simulate_signatures(baseline.problem, start, baseline.differences)
    singles = _shortlist(signatures, smoothers[0], baseline.problem.settings.coarse_search.max_singles)
    return successive_elimination(baseline, [(single, signatures) for single in singles], smoothers, limits, until)


def search_pairs(
    baseline: Baseline,
    fits: Sequence[Fit],
    limits: Thresholds,
    smoothers: Sequence[Smoother],
    until: float = np.inf,
) -> list[Fit]:
    """Fits of pairs of effects where no single one is sufficient, best first, the failed ones last.

    The single effects that explain most to the first smoother to which the base leaves something visible are paired
    with what would explain most of the rest: with one of two effects there, neither nuisances nor signatures are the
    base's.
    """
    settings = baseline.problem.settings.coarse_search
    visible = (smoother for smoother in smoothers if _is_visible(baseline.base, smoother, baseline))
    first = next(visible, smoothers[-1] if smoothers else None)
    singles = lowest_of_each((fit for fit in fits if fit.status != FAILED), lambda fit: _chi2(fit, first))
    limit = settings.eliminated_factor * min((_chi2(fit, first) for fit in singles), default=np.inf)
    best: dict[str, Fit] = {}  # of alternatives, which have the same partners; `swap_one_effect` fits the others
    for fit in singles:
        best.setdefault(fit.hypothesis[0].exclusion_group, fit)
    leading = [fit for fit in best.values() if _chi2(fit, first) < limit]
    failed = {fit.label for fit in fits} - {fit.label for fit in singles}  # what failed alone would fail in a pair
    chosen: dict[frozenset[str], tuple[LinearizedFit, Signatures]] = {}
    remaining: Sequence[Smoother] = ()
    for rank, fit in enumerate(leading[: settings.leading_singles]):
        if baseline.problem.simulations > until:
            break
        single, rest = _first_visible(baseline, fit.hypothesis, fit.mapping, smoothers)
        if single.status == FAILED:
            continue
        remaining = max(remaining, rest, key=len)
        signatures = simulate_signatures(baseline.problem, single, baseline.differences)
        smoother = rest[0] if rest else None
        every = rank == 0 and bool(smoothers)
        for pair in _shortlist(signatures, smoother, settings.partners_per_single, single.hypothesis, every):
            if pair.hypothesis[-1].label not in failed:
                chosen.setdefault(labels_of(pair.hypothesis), (pair, signatures))
    pairs = list(chosen.values())
    if not smoothers:  # then none is eliminated on the way, and each is fitted to its end
        kept = shortlist(sorted((pair for pair, _ in pairs), key=lambda pair: pair.chi2), settings.survivors[0])
        pairs = [chosen[labels_of(pair.hypothesis)] for pair in kept]
    return successive_elimination(baseline, pairs, remaining, limits, until)


def _shortlist(
    signatures: Signatures, smoother: Smoother | None, count: int, fitted_effects: Hypothesis = (), every: bool = True
) -> list[LinearizedFit]:
    """The `count` most promising candidates and, if `every`, all those of which small amplitudes say little.

    These are added to the best single effect alone, because a pair costs some fifty simulations.
    """
    singles = SignatureRegression(signatures, fitted_effects, smoother).singles()
    first = shortlist(singles, count)
    kept = set(map(id, first))
    return [*first, *(single for single in singles if every and id(single) not in kept and _is_nonlinear(single))]


def _is_nonlinear(screened: LinearizedFit) -> bool:
    """Whether small amplitudes say little of an effect, so that how much it would explain does not rank it."""
    candidates = [signature.candidate for signature in screened.signatures]
    return any(candidate.replaces or candidate.is_perturbation for candidate in candidates)


def successive_elimination(
    baseline: Baseline,
    chosen: Sequence[tuple[LinearizedFit, Signatures]],
    smoothers: Sequence[Smoother],
    limits: Thresholds,
    until: float = np.inf,
) -> list[Fit]:
    """Fits of hypotheses by way of all smoothers to the samples, best first, the failed ones last.

    After each smoother the worst are eliminated.
    """
    problem, differences = baseline.problem, baseline.differences
    settings = problem.settings.coarse_search
    first = smoothers[0] if smoothers else None
    fits, failed, least = [], [], np.inf
    for screened, signatures in chosen:
        if problem.simulations > until:
            break
        fit = fit_screened(problem, differences, signatures, screened, sufficient_chi2=least, smoother=first)
        if fit.status == FAILED:
            failed.append(fit)
            continue
        if first and _is_nonlinear(screened):
            fit = _refine(baseline, fit, first, first)
        if first:
            least = min(least, _chi2(fit, first))
        fits.append(fit)
    finer_ones = (*smoothers[1:], None)[: len(smoothers)]
    counts = settings.survivors[len(settings.survivors) - len(smoothers) :]
    for smoother, finer, count in zip(smoothers, finer_ones, counts, strict=True):
        ranked = sorted((_chi2(fit, smoother), i) for i, fit in enumerate(fits))
        survivors = [fits[i] for chi2, i in ranked[:count] if chi2 < settings.eliminated_factor * ranked[0][0]]
        fits, least = [], np.inf
        for fit in survivors:
            if problem.simulations > until and any(one.status != FAILED for one in fits):
                break
            fits.append(_refine(baseline, fit, smoother, finer, least))
            least = min(least, _chi2(fits[-1], finer))
        failed += [fit for fit in fits if fit.status == FAILED]
        fits = [fit for fit in fits if fit.status != FAILED]
    fits.sort(key=lambda fit: fit.chi2)
    if fits and first and reduced_chi2(fits[0]) > limits.omnibus:
        for fit in fits[: settings.refitted]:
            if problem.simulations > until:
                break
            coarse = coarse_to_fine_fit(problem, fit.hypothesis, fit.mapping, differences, smoothers)
            if coarse.status != FAILED:
                fits.append(fit_hypothesis(problem, fit.hypothesis, coarse.mapping, differences=differences))
    return [*sorted(fits, key=lambda fit: fit.chi2), *failed]


def _first_visible(
    baseline: Baseline, hypothesis: Hypothesis, start: Mapping[str, float], smoothers: Sequence[Smoother]
) -> tuple[Fit, Sequence[Smoother]]:
    """The fit with the first smoother that leaves something visible, or the last; and the smoothers from there."""
    for i, smoother in enumerate(smoothers):
        fit = fit_hypothesis(
            baseline.problem, hypothesis, start, None, baseline.differences, refresh=True, smoother=smoother
        )
        if fit.status == FAILED or smoother is smoothers[-1] or _is_visible(fit, smoother, baseline):
            return fit, smoothers[i:]
    return fit_hypothesis(baseline.problem, hypothesis, start, None, baseline.differences, refresh=True), smoothers


def _refine(
    baseline: Baseline, fit: Fit, smoother: Smoother, finer: Smoother | None, sufficient_chi2: float = np.inf
) -> Fit:
    """The fit with the finer smoother that starts from one with `smoother`, after a scan of perturbations."""

    def refit(start: Mapping[str, float], derivatives: Mapping[str, np.ndarray] | None) -> Fit:
        return fit_hypothesis(
            baseline.problem,
            fit.hypothesis,
            start,
            derivatives,
            baseline.differences,
            sufficient_chi2=sufficient_chi2,
            smoother=finer,
        )

    scanned = coordinate_scan(baseline.problem, fit, smoother, finer, amplitudes_only=True)
    if scanned is not None and (refitted := refit(scanned, None)).status != FAILED:
        return refitted
    if finer is smoother:
        return fit
    return refit(fit.mapping, dict(zip((p.key for p in fit.parameters), fit.jacobian.T, strict=True)))


def _is_visible(fit: Fit, smoother: Smoother, baseline: Baseline) -> bool:
    limit = baseline.problem.settings.coarse_search.visible_chi2_per_sample
    return _chi2(fit, smoother) > limit * fit.residual.size


def _chi2(fit: Fit, smoother: Smoother | None) -> float:
    """Sum of squared smoothed residuals."""
    return fit.chi2 if smoother is None else float(np.sum(np.square(smoother(fit.residual))))
