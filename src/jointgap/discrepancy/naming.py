"""From a base to a verdict: the order in which explanations are sought, fitted and weighed."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from jointgap.discrepancy.alike import Subspaces
from jointgap.discrepancy.calibrate import Thresholds
from jointgap.discrepancy.decide import Decision, decide
from jointgap.discrepancy.fit import FAILED, Fit, fit
from jointgap.discrepancy.recalibrate import Recalibrated
from jointgap.discrepancy.screen import Screen, Screened, Signatures
from jointgap.discrepancy.start import fit_screened

SINGLES = 8
"""Candidates that are fitted alone."""

AMONG = 4
"""All pairs among this many of the best are fitted."""

PAIRS = 8
"""Pairs that are fitted beside those, the best by their signatures."""


@dataclass(frozen=True)
class Shortlist:
    """Explanations that are worth a fit, best first."""

    singles: list[Screened]
    pairs: list[Screened]


def shortlist(known: Signatures) -> Shortlist:
    """Screen all candidates and all their pairs by signatures."""
    screen = Screen(known)
    singles = screen.singles()
    pairs = screen.pairs(singles)
    best = {one.label for one in singles[:AMONG]}
    inner = [pair for pair in pairs if {c.label for c in pair.explanation} <= best]
    further = [pair for pair in pairs if pair not in inner][:PAIRS]
    return Shortlist(singles[:SINGLES], sorted(inner + further, key=lambda pair: pair.bic))


def fitted(base: Recalibrated, known: Signatures, chosen: Iterable[Screened]) -> list[Fit]:
    """Forward-simulated fits of screened explanations, each from where its signatures say."""
    return [fit_screened(base.problem, one, known.known(one.signatures), base.differences) for one in chosen]


def refined(base: Recalibrated, one: Fit) -> Fit:
    """A fit with its Jacobian made anew at the end: what intervals need."""
    if one.status == FAILED:
        return one
    return fit(base.problem, one.explanation, one.mapping, differences=base.differences, refresh=True)


def verdict(base: Recalibrated, known: Signatures, fits: Sequence[Fit], limits: Thresholds) -> Decision:
    """Weigh the fits (`jointgap.discrepancy.decide.decide`)."""
    subspaces = Subspaces(known)
    alikeness = {
        one.label: subspaces.nearest(one.explanation)[1] for one in fits if one.status != FAILED and one.explanation
    }
    bounds = {p.name: (p.nominal, p.low, p.high) for p in base.problem.nuisances}
    return decide(base.base, base.nominal, fits, limits, alikeness, bounds)
