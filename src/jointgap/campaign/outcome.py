"""Stage decide: the verdict as far as the fits carry it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.campaign.fit_tables import to_frames
from jointgap.identification.baseline import Recalibrated, best_of
from jointgap.identification.decision import Decision
from jointgap.identification.fit import Fit, fit
from jointgap.identification.model_selection import refined, swapped, verdict
from jointgap.identification.screening import Signatures
from jointgap.identification.thresholds import Thresholds

NOMINAL = "no_disagreement"
"""The verdict with which nuisances stay at nominal."""


@dataclass(frozen=True)
class Outcome:
    """A verdict with all that later stages need of the fits.

    Attributes
    ----------
    verdict, because : str
    chosen : Fit
        The explanation named; the base where none is.
    base : Fit
        What explanations were compared with: the recalibrated base, or a better one that was found on the way.
    equivalent : list of Fit
    ranking : DataFrame
        Table `jointgap.tables.RANKING`.
    """

    verdict: str
    because: str
    chosen: Fit
    base: Fit
    equivalent: list[Fit]
    ranking: pd.DataFrame

    def frame(self) -> pd.DataFrame:
        """Table `jointgap.tables.DECISION`."""
        nuisances = "nominal" if self.verdict == NOMINAL else "base"
        return pd.DataFrame([{"verdict": self.verdict, "because": self.because, "nuisances": nuisances}])


def decide(
    found: Recalibrated, known: Signatures, fits: Sequence[Fit], seconds: Mapping[str, float], limits: Thresholds
) -> Outcome:
    """Choose among the fits; what is chosen is fitted once more to its end, for its intervals.

    What leaving out one of two effects costs is the fit of the other alone, at its best: before two effects are named each is fitted
    alone once more, from the nuisances beside both and from afar, and is open to choice like all others.

    Parameters
    ----------
    found : Recalibrated
    known : Signatures
    fits : sequence of Fit
    seconds : mapping of label to float
        How long each took.
    limits : Thresholds
    """
    fits, done = [*fits, *swapped(found, known, fits)], set()
    decision = verdict(found, known, fits, limits)
    while alone := _members(found, [decision.chosen, *decision.equivalent], done):
        fits += alone
        decision = verdict(found, known, fits, limits)
    base = decision.base if decision.base is found.base else refined(found, decision.base)
    chosen = base if decision.chosen is decision.base else decision.chosen
    if chosen.explanation:
        chosen = refined(found, chosen)
    equivalent = [refined(found, one) for one in decision.equivalent]
    return Outcome(decision.verdict, decision.because, chosen, base, equivalent, ranking_frame(decision, seconds))


def _members(found: Recalibrated, chosen: Sequence[Fit], done: set[str]) -> list[Fit]:
    """Fits of single effects of the pairs among `chosen` that are not `done` yet; then they are."""
    made = []
    for pair in (one for one in chosen if len(one.explanation) > 1):
        for kept in pair.explanation:
            if kept.label in done:
                continue
            done.add(kept.label)
            own = {
                key: value for key, value in pair.mapping.items() if "." not in key or key.startswith(f"{kept.label}.")
            }
            shared = {p.key: p.nominal for p in found.problem.nuisances if p.run is None and p.key in own}
            made.append(fit(found.problem, (kept,), own, differences=found.differences))
            made.append(best_of(found.problem, found.differences, (kept,), own | shared, starts=1))
    return made


def ranking_frame(decision: Decision, seconds: Mapping[str, float]) -> pd.DataFrame:
    """Table `jointgap.tables.RANKING`."""
    fits = [one.fit for one in decision.ranking]
    frame = to_frames(fits, [seconds.get(one.label, np.nan) for one in fits])["fits"]
    named = decision.chosen.label if decision.verdict.startswith("named") else ""
    equal = {one.label for one in decision.equivalent}
    lost = ~np.isfinite([one.delta_bic for one in decision.ranking])
    return frame.assign(
        delta_bic=np.where(lost, np.nan, [one.delta_bic for one in decision.ranking]),
        explained_share=np.where(lost, np.nan, [one.share for one in decision.ranking]),
        passes=[one.passes for one in decision.ranking],
        admissible=[one.admissible for one in decision.ranking],
        place=["named" if one.label == named else "equivalent" if one.label in equal else "" for one in fits],
        remark=[one.remark or None for one in decision.ranking],
    )
