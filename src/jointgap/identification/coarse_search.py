"""A second look for effects, from afar: where none of the fits that start at the base is enough.

The base took up what it could of an effect with its nuisances, and where impacts make valleys it may lie far from the truth: what
effects change there says little. So the search begins again at nominal nuisances, in views that smooth impacts out.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from jointgap.identification.baseline import Recalibrated
from jointgap.identification.decision import reduced
from jointgap.identification.fit import FAILED, Fit, fit
from jointgap.identification.model_selection import fitted
from jointgap.identification.problem import Explanation
from jointgap.identification.screening import Screen, Screened, Signatures, signatures
from jointgap.identification.smoother import View, descended, looked_through, views
from jointgap.identification.thresholds import Thresholds

SOUGHT = 8
"""Candidates that are looked for from afar, at most, beside those of which small sizes say little."""

KEPT = 6, 4
"""How many of these go on from each view to what follows it: those of which least is left. Where there are no views, how many pairs
are fitted: those that would explain most."""

CAREFUL = 2
"""Of the best, how many are fitted once more where none is enough, with all looked through that a view leaves open."""

LEADING, PARTNERS = 3, 4
"""Where no single effect is enough, how many of the best are paired, at most, and with how many partners each. The untold ones
(`_untold`) are partners of the best alone: a pair costs some fifty simulations."""

_SHOWS = 1.5  # chi2 per sample that is left in a view in which something is to be seen
_BEHIND = 3.0  # times the chi2 of the best one: too far behind to go on


def sought(base: Recalibrated, limits: Thresholds) -> list[Fit]:
    """Fits of single effects that come from afar, best first, the failed ones last."""
    through = views(base.problem)
    if not through:
        return []
    far, through = _about(base, (), base.nominal.mapping, through)
    if far.status == FAILED:
        return []
    known = signatures(base.problem, far, base.differences)
    return raced(base, [(one, known) for one in _shortlist(known, through[0], SOUGHT)], through, limits)


def sought_pairs(base: Recalibrated, fits: Sequence[Fit], limits: Thresholds) -> list[Fit]:
    """Fits of pairs of effects where no single one is enough, best first, the failed ones last.

    The single effects that explain most in the first view in which the base leaves something to be seen are paired with what would
    explain most of the rest: with one of two effects there, neither nuisances nor signatures are the base's.

    Parameters
    ----------
    base : Recalibrated
    fits : sequence of Fit
        Of the single effects.
    limits : Thresholds
    """
    through = views(base.problem)
    first = next((view for view in through if _shows(base.base, view)), next(iter(through[-1:]), None))
    best: dict[str, Fit] = {}
    for one in sorted((one for one in fits if one.status != FAILED), key=lambda one: _left(one, first)):
        best.setdefault(one.label, one)
    leading = [one for one in best.values() if _left(one, first) < _BEHIND * _left(next(iter(best.values())), first)]
    # what is sought on a grid may come nearer beside another effect though it does not alone
    lost = {one.label for one in fits if not any(c.grid for c in one.explanation)} - best.keys()
    chosen: dict[frozenset[str], tuple[Screened, Signatures]] = {}
    rest: Sequence[View] = ()
    for rank, one in enumerate(leading[:LEADING]):
        about, here = _about(base, one.explanation, one.mapping, through)
        if about.status == FAILED:
            continue
        rest = max(rest, here, key=len)
        beside = signatures(base.problem, about, base.differences)
        for pair in _shortlist(beside, next(iter(here), None), PARTNERS, about.explanation, untold=rank == 0):
            if pair.explanation[-1].label not in lost:
                chosen.setdefault(frozenset(c.label for c in pair.explanation), (pair, beside))
    going = list(chosen.values())
    if not through:  # none is left behind on the way then, and each is fitted to its end
        going = sorted(going, key=lambda pair: pair[0].chi2)[: KEPT[0]]
    return raced(base, going, rest, limits)


def _shortlist(
    known: Signatures, view: View | None, most: int, beside: Explanation = (), untold: bool = True
) -> list[Screened]:
    singles = Screen(known, beside, view).singles()
    return [*singles[:most], *(one for one in singles[most:] if untold and _untold(one))]


def _untold(one: Screened) -> bool:
    """Whether small sizes say little of an effect, so that how much it would explain does not rank it."""
    candidates = [new.candidate for new in one.signatures]
    return any(candidate.replaces or candidate.grid or candidate.is_perturbation for candidate in candidates)


def raced(
    base: Recalibrated, chosen: Sequence[tuple[Screened, Signatures]], through: Sequence[View], limits: Thresholds
) -> list[Fit]:
    """Fits of explanations through all views to the samples, best first, the failed ones last; after each view the worst are left
    behind.

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
    going, lost, first = [], [], next(iter(through), None)
    least = np.inf
    for one, known in chosen:
        found = fitted(base, known, one, enough=least, view=first)
        if found.status == FAILED:
            lost.append(found)
            continue
        if first and _untold(one):
            found = _onward(base, found, first, first)
        if first:
            least = min(least, _left(found, first))
        going.append(found)
    onward = (*through[1:], None)[: len(through)]
    for view, finer, most in zip(through, onward, KEPT[len(KEPT) - len(through) :], strict=True):
        left = sorted((_left(one, view), i) for i, one in enumerate(going))
        best = [going[i] for value, i in left[:most] if value < _BEHIND * left[0][0]]
        going, least = [], np.inf
        for one in best:
            going.append(_onward(base, one, view, finer, least))
            least = min(least, _left(going[-1], finer))
        lost += [one for one in going if one.status == FAILED]
        going = [one for one in going if one.status != FAILED]
    going.sort(key=lambda one: one.chi2)
    if going and first and reduced(going[0]) > limits.omnibus:
        for one in going[:CAREFUL]:
            near = descended(problem, one.explanation, one.mapping, differences, through)
            if near.status != FAILED:
                going.append(fit(problem, one.explanation, near.mapping, differences=differences))
    return [*sorted(going, key=lambda one: one.chi2), *lost]


def _about(
    base: Recalibrated, explanation: Explanation, start: Mapping[str, float], through: Sequence[View]
) -> tuple[Fit, Sequence[View]]:
    """The fit of an explanation in the first view in which it leaves something to be seen, or in the last; and the views from there."""
    for i, view in enumerate(through):
        one = fit(base.problem, explanation, start, None, base.differences, refresh=True, view=view)
        if one.status == FAILED or view is through[-1] or _shows(one, view):
            return one, through[i:]
    return fit(base.problem, explanation, start, None, base.differences, refresh=True), through


def _onward(base: Recalibrated, one: Fit, view: View, finer: View | None, enough: float = np.inf) -> Fit:
    """The fit in the finer view that starts from one in `view`, where changes of what is known are looked through."""
    moved = looked_through(base.problem, one, view, finer, sizes_alone=True)
    if moved is not None:
        found = fit(base.problem, one.explanation, moved, None, base.differences, enough=enough, view=finer)
        if found.status != FAILED:
            return found
    if finer is view:
        return one
    near = dict(zip((p.key for p in one.parameters), one.jacobian.T, strict=True))
    return fit(base.problem, one.explanation, one.mapping, near, base.differences, enough=enough, view=finer)


def _shows(one: Fit, view: View) -> bool:
    return _left(one, view) > _SHOWS * one.residual.size


def _left(one: Fit, view: View | None) -> float:
    return one.chi2 if view is None else float(np.sum(np.square(view(one.residual))))
