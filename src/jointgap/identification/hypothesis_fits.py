"""Fits of all explanations that are worth one: single effects, then pairs; from the base, and from afar where that is not enough."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointgap.identification.baseline import Baseline, probed_differences
from jointgap.identification.coarse_search import search_pairs, search_singles
from jointgap.identification.decision import reduced_chi2
from jointgap.identification.fit import Fit
from jointgap.identification.initial_fit import fit_screened
from jointgap.identification.model_selection import (
    best_sufficient,
    shortlist_pairs,
    shortlist_singles,
    two_effect_thresholds,
)
from jointgap.identification.screening import Screened, Signatures
from jointgap.identification.thresholds import Thresholds

Fitted = tuple[list[Fit], list[float]]
"""Fits, one of each explanation, and how long each took [s]."""


def fit_singles(found: Baseline, known: Signatures, limits: Thresholds, part: int = 0, parts: int = 1) -> Fitted:
    """Fit every single effect of one part.

    A fit that fails is one of them, with its reason; the others go on. Once one leaves about noise alone, those of the same part
    that stay far behind it end early: they are no rivals, but their chi2 depends on how fits are shared out.

    Parameters
    ----------
    found : Baseline
    known : Signatures
    limits : Thresholds
    part, parts : int
        Which of how many parts, counted from 0.
    """
    return _each(
        found,
        known,
        [(one, None) for one in shortlist_singles(known, limits, found.problem.settings)[part::parts]],
        limits,
    )


def fit_pairs(
    found: Baseline, known: Signatures, limits: Thresholds, alone: Sequence[Fit], part: int = 0, parts: int = 1
) -> Fitted:
    """Fit every pair of one part that is worth it beside the fits of single effects `alone`.

    Where none of those is enough, the first part looks for all of them from afar, and then for pairs: how far each one goes there depends
    on all others, so it is not shared out. Single effects that it found are among the fits then.

    Parameters
    ----------
    found, known, limits, part, parts
        As of `singles`.
    alone : sequence of Fit
        Of all parts.
    """
    if _wanting(found, alone, limits):
        return _from_afar(found, known, limits, alone) if part == 0 else ([], [])
    return _beside(found, known, limits, alone, part, parts)


def _wanting(found: Baseline, alone: Sequence[Fit], limits: Thresholds) -> bool:
    """Whether there is more to be found than the base and single effects explain."""
    return (
        reduced_chi2(found.base) > limits.omnibus
        and best_sufficient(found, alone, two_effect_thresholds(found, alone, limits)) is None
    )


def _beside(found: Baseline, known: Signatures, limits: Thresholds, alone: Sequence[Fit], part=0, parts=1) -> Fitted:
    """Pairs beside the single effect that is enough; none where none is."""
    second = two_effect_thresholds(found, alone, limits)
    best = best_sufficient(found, alone, second)
    return _each(found, known, shortlist_pairs(known, best, alone, second)[part::parts] if best else [], limits)


def _from_afar(found: Baseline, known: Signatures, limits: Thresholds, alone: Sequence[Fit]) -> Fitted:
    """Single effects from afar, and pairs: beside one that is enough now, or from afar too; the better one of each explanation."""
    begin = time.monotonic()
    # steps as nobody else left them: the outcome must not depend on what else ran in this process
    at = {p.key: p.nominal for p in found.problem.nuisances} | found.nominal.mapping
    found = replace(found, differences=probed_differences(found.problem, at))
    more = search_singles(found, limits)
    whole = [*alone, *more]
    more += (
        search_pairs(found, whole, limits)
        if _wanting(found, whole, limits)
        else _beside(found, known, limits, whole)[0]
    )
    best: dict[str, Fit] = {}
    for one in more:
        best[one.label] = min(best.get(one.label, one), one, key=lambda fit: fit.chi2)
    share = (time.monotonic() - begin) / max(len(best), 1)
    return list(best.values()), [share] * len(best)


def _each(
    found: Baseline, known: Signatures, chosen: Sequence[tuple[Screened, Fit | None]], limits: Thresholds
) -> Fitted:
    fits, seconds = [], []
    for one, beside in chosen:
        begin = time.monotonic()
        least = min((one.chi2 for one in fits if reduced_chi2(one) <= limits.omnibus), default=np.inf)
        fits.append(fit_screened(found.problem, found.differences, known, one, beside, least))
        seconds.append(time.monotonic() - begin)
    return fits, seconds
