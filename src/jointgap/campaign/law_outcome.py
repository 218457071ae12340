"""Stage regress: a force law as a formula, where no effect of the list explains what is missing."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from jointgap.campaign.fit_tables import to_frames
from jointgap.campaign.outcome import Outcome
from jointgap.identification.baseline import Recalibrated
from jointgap.identification.decision import reduced
from jointgap.identification.fit import FAILED, Fit
from jointgap.identification.force_law import regress as regressed
from jointgap.identification.protocol import Candidate
from jointgap.identification.thresholds import Thresholds

UNEXPLAINED = "unexplained"


def regress(found: Recalibrated, limits: Thresholds, library: Sequence[Candidate], outcome: Outcome) -> Outcome:
    """The outcome with a law for what is missing, where one passes the gate of the listed effects.

    Parameters
    ----------
    found : Recalibrated
    limits : Thresholds
    library : sequence of Candidate
        Terms of a law.
    outcome : Outcome
        Of the listed effects: ``unexplained``.
    """
    proposed = regressed(found.problem, found.base, library, limits, found.differences)
    fits = [*([] if proposed.fit is None else [proposed.fit]), *proposed.rivals, *proposed.others]
    unique = proposed.accepted and not proposed.rivals
    rows = _rows(found, limits, list({one.label: one for one in fits}.values()), proposed.fit.label if unique else "")
    ranking = pd.concat([outcome.ranking, rows], ignore_index=True)
    if not proposed.accepted:
        because = f"{outcome.because}; {proposed.because}"
        return replace(outcome, because=because, ranking=ranking)
    if proposed.rivals:
        alike = ", ".join(one.label for one in (proposed.fit, *proposed.rivals))
        because = f"{outcome.because}; several laws explain it equally well: {alike}"
        return replace(outcome, because=because, ranking=ranking)
    passes = reduced(proposed.fit) <= limits.omnibus
    verdict = "named" if passes else "named_with_remaining_misfit"
    because = f"no effect of the list explains it, but {proposed.law.words} does: {proposed.because}"
    return Outcome(verdict, because, proposed.fit, outcome.base, [], ranking)


def _rows(found: Recalibrated, limits: Thresholds, fits: list[Fit], named: str) -> pd.DataFrame:
    """Laws as rows of the table ranking."""
    base = found.base
    spare = base.chi2 - (base.residual.size - len(base.parameters))
    lost = np.array([one.status == FAILED for one in fits], dtype=bool)
    return to_frames(fits)["fits"].assign(
        delta_bic=[np.nan if gone else base.bic - one.bic for one, gone in zip(fits, lost, strict=True)],
        explained_share=[
            np.nan if gone else (base.chi2 - one.chi2) / spare for one, gone in zip(fits, lost, strict=True)
        ],
        passes=[bool(reduced(one) <= limits.omnibus) for one in fits],
        admissible=~lost,
        place=["named" if one.label == named else "" for one in fits],
        remark=[one.reason or None for one in fits],
    )
