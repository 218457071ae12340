"""Stages fit and pair: explanations by forward simulation, each started where it would explain most."""

import time
from collections.abc import Sequence

import numpy as np

from jointgap.discrepancy.decide import SLIGHT, reduced
from jointgap.discrepancy.fit import FAILED, Fit
from jointgap.discrepancy.naming import fitted
from jointgap.discrepancy.recalibrate import Recalibrated
from jointgap.discrepancy.screen import Screened, Signatures

Chosen = Sequence[tuple[Screened, Fit | None]]
"""Explanations to fit, each with the fit that it adds to; None for the base."""


def fits(
    found: Recalibrated, known: Signatures, chosen: Chosen, part: int = 0, parts: int = 1
) -> tuple[list[Fit], list[float]]:
    """Fit every explanation of one part, and say how long each took [s].

    A fit that fails is one of them, with its reason; the others go on. Once one leaves about noise alone, those of the same part
    that stay far behind it end early: they are no rivals, but their chi2 depends on how fits are shared out.

    Parameters
    ----------
    found : Recalibrated
    known : Signatures
    chosen : sequence
        The explanations of all parts.
    part, parts : int
        Which of how many parts, counted from 0.
    """
    fits, seconds = [], []
    for one, beside in chosen[part::parts]:
        begin = time.monotonic()
        enough = min((one.chi2 for one in fits if one.status != FAILED and reduced(one) <= SLIGHT), default=np.inf)
        fits.append(fitted(found, known, one, beside, enough))
        seconds.append(time.monotonic() - begin)
    return fits, seconds
