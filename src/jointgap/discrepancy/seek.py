"""A second look for effects, from afar: where none of the fits that start at the base is enough.

The base took up what it could of an effect with its nuisances, and where impacts make valleys it may lie far from the truth: what
effects change there says little. So the search begins again at nominal nuisances, in views that smooth impacts out.
"""

from collections.abc import Sequence

import numpy as np

from jointgap.discrepancy.calibrate import Thresholds
from jointgap.discrepancy.coarse import View, descended, looked_through, two_sided, views
from jointgap.discrepancy.decide import reduced
from jointgap.discrepancy.fit import FAILED, Fit, fit
from jointgap.discrepancy.recalibrate import Recalibrated
from jointgap.discrepancy.screen import Screen, Screened, Signatures, signatures
from jointgap.discrepancy.start import stretched

SOUGHT = 8
"""Candidates that are looked for from afar, at most, beside those of which small sizes say little."""

KEPT = 6, 4
"""How many of these go on from each view to what follows it: those of which least is left."""

CAREFUL = 2
"""Of the best, how many are fitted once more where none is enough, with all looked through that a view leaves open."""

_SHOWS = 1.2  # chi2 per sample that is left in a view in which something is to be seen
_BEHIND = 3.0  # times the chi2 of the best one: too far behind to go on


def showing(one: Fit, through: Sequence[View]) -> Sequence[View]:
    """The views from the first on in which a fit leaves more than noise; the last one where none is such."""
    places = [i for i, view in enumerate(through) if _left(one, view) > _SHOWS * one.residual.size]
    return through[places[0] :] if places else through[-1:]


def sought(base: Recalibrated, limits: Thresholds, part: int = 0, parts: int = 1) -> list[Fit]:
    """Fits of single effects that come from afar, best first; of every `parts`-th candidate, from number `part` on."""
    through = views(base.problem)
    for i, view in enumerate(through):
        far = fit(base.problem, (), base.nominal.mapping, differences=base.differences, refresh=True, view=view)
        if far.status == FAILED:
            return []
        if view is through[-1] or _left(far, view) > _SHOWS * far.residual.size:
            known = signatures(base.problem, far, base.differences)
            chosen = [(one, known) for one in _shortlist(known, view)]
            return raced(base, chosen[part::parts], through[i:], limits)
    return []


def _shortlist(known: Signatures, view: View) -> list[Screened]:
    singles = Screen(known, view=view).singles()
    return [*singles[:SOUGHT], *(one for one in singles[SOUGHT:] if _untold(one))]


def _untold(one: Screened) -> bool:
    """Whether small sizes say little of an effect."""
    return any(
        new.candidate.replaces or new.candidate.grid or any(two_sided(p) for p in new.sizes) for new in one.signatures
    )


def raced(
    base: Recalibrated, chosen: Sequence[tuple[Screened, Signatures]], through: Sequence[View], limits: Thresholds
) -> list[Fit]:
    """Fits of explanations through all views to the samples, best first; after each view the worst are left behind.

    Parameters
    ----------
    base : Recalibrated
    chosen : sequence of (Screened, Signatures)
        Explanations, each with the signatures that it was found by.
    through : sequence of View
        Coarsest first; none to begin with the samples.
    limits : Thresholds
    """
    problem, differences = base.problem, base.differences
    going, first = [], next(iter(through), None)
    least = np.inf
    for one, known in chosen:
        start, multiple = stretched(problem, one, first)
        near = known.known(one.signatures) if multiple == 1.0 else None
        found = fit(problem, one.explanation, start, near, differences, enough=least, view=first)
        if first and _untold(one):
            found = _onward(base, found, first, first)
        if first and found.status != FAILED:
            least = min(least, _left(found, first))
        going.append(found)
    for view, finer, most in zip(through, (*through[1:], None), KEPT[len(KEPT) - len(through) :], strict=True):
        left = sorted(((_left(one, view), i) for i, one in enumerate(going) if one.status != FAILED))
        best = [going[i] for value, i in left[:most] if value < _BEHIND * left[0][0]]
        going = [_onward(base, one, view, finer) for one in best]
    going.sort(key=lambda one: one.chi2)
    if going and first and reduced(going[0]) > limits.omnibus:
        for one in going[:CAREFUL]:
            near = descended(problem, one.explanation, one.mapping, differences, through)
            if near.status != FAILED:
                going.append(fit(problem, one.explanation, near.mapping, differences=differences))
    return sorted(going, key=lambda one: one.chi2)


def _onward(base: Recalibrated, one: Fit, view: View, finer: View | None) -> Fit:
    """The fit in the finer view that starts from one in `view`; what nuisances were left open there stays where it is."""
    if one.status == FAILED:
        return one
    moved = looked_through(base.problem, one, view, finer, sizes_alone=True)
    if moved is None and finer is view:
        return one
    near = dict(zip((p.key for p in one.parameters), one.jacobian.T, strict=True)) if moved is None else None
    return fit(base.problem, one.explanation, moved or one.mapping, near, base.differences, view=finer)


def _left(one: Fit, view: View) -> float:
    return float(np.sum(np.square(view(one.residual))))
