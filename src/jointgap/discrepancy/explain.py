"""Fits of all explanations that are worth one: single effects, then pairs; from the base, and from afar where that is not enough."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from jointgap.discrepancy.calibrate import Thresholds
from jointgap.discrepancy.decide import SLIGHT, reduced
from jointgap.discrepancy.fit import FAILED, Fit
from jointgap.discrepancy.naming import enough, fitted, pairs, shortlist
from jointgap.discrepancy.recalibrate import Recalibrated
from jointgap.discrepancy.screen import Screened, Signatures
from jointgap.discrepancy.seek import sought, sought_pairs

Fitted = tuple[list[Fit], list[float]]
"""Fits, the best of each explanation, and how long each took [s]."""


def singles(
    found: Recalibrated,
    known: Signatures,
    limits: Thresholds,
    part: int = 0,
    parts: int = 1,
) -> Fitted:
    """Fit every single effect of one part; where none of them is enough, look for more from afar.

    A fit that fails is one of them, with its reason; the others go on. Once one leaves about noise alone, those of the same part
    that stay far behind it end early: they are no rivals, but their chi2 depends on how fits are shared out.

    Parameters
    ----------
    found : Recalibrated
    known : Signatures
    limits : Thresholds
    part, parts : int
        Which of how many parts, counted from 0.
    """
    fits, seconds = _each(found, known, [(one, None) for one in shortlist(known, limits)[part::parts]])
    if reduced(found.base) > limits.omnibus and not enough(found, fits, limits):
        return _with(fits, seconds, lambda: sought(found, limits, part, parts))
    return fits, seconds


def doubles(
    found: Recalibrated,
    known: Signatures,
    limits: Thresholds,
    alone: Sequence[Fit],
    part: int = 0,
    parts: int = 1,
) -> Fitted:
    """Fit every pair of one part that is worth it beside the fits of single effects `alone`.

    Parameters
    ----------
    found, known, limits, part, parts
        As of `singles`.
    alone : sequence of Fit
        Of all parts.
    """
    if enough(found, alone, limits):
        return _each(found, known, pairs(found, known, alone, limits)[part::parts])
    if reduced(found.base) <= limits.omnibus:
        return [], []
    return _with([], [], lambda: sought_pairs(found, alone, limits, part, parts))


def _each(found: Recalibrated, known: Signatures, chosen: Sequence[tuple[Screened, Fit | None]]) -> Fitted:
    fits, seconds = [], []
    for one, beside in chosen:
        begin = time.monotonic()
        least = min((one.chi2 for one in fits if one.status != FAILED and reduced(one) <= SLIGHT), default=np.inf)
        fits.append(fitted(found, known, one, beside, least))
        seconds.append(time.monotonic() - begin)
    return fits, seconds


def _with(fits: Sequence[Fit], seconds: Sequence[float], look: Callable[[], list[Fit]]) -> Fitted:
    """The fits and those of a second look, the better one of each explanation; these share the time that they took together."""
    begin = time.monotonic()
    more = look()
    share = (time.monotonic() - begin) / max(len(more), 1)
    best: dict[frozenset[str], tuple[Fit, float]] = {}
    for one, took in (*zip(fits, seconds, strict=True), *((one, share) for one in more)):
        names = frozenset(candidate.label for candidate in one.explanation)
        before, spent = best.get(names, (one, 0.0))
        best[names] = min(before, one, key=lambda fit: fit.chi2), spent + took
    return [one for one, _ in best.values()], [took for _, took in best.values()]
