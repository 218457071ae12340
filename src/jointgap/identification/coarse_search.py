"""A second look for effects, from afar: where none of the fits that start at the base is enough.

The base took up what it could of an effect with its nuisances, and where impacts make valleys it may lie far from the truth: what
effects change there says little. So the search begins again at nominal nuisances, in views that smooth impacts out.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from jointgap.identification.baseline import Baseline
from jointgap.identification.decision import reduced_chi2
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.initial_fit import fit_screened
from jointgap.identification.problem import Hypothesis
from jointgap.identification.screening import Screen, Screened, Signatures, signatures
from jointgap.identification.smoother import Smoother, coarse_to_fine_fit, coordinate_scan, smoothers_of
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


def search_singles(base: Baseline, limits: Thresholds) -> list[Fit]:
    """Fits of single effects that come from afar, best first, the failed ones last."""
    smoothers = smoothers_of(base.problem)
    if not smoothers:
        return []
    far, smoothers = _about(base, (), base.nominal.mapping, smoothers)
    if far.status == FAILED:
        return []
    known = signatures(base.problem, far, base.differences)
    return successive_elimination(
        base, [(one, known) for one in _shortlist(known, smoothers[0], SOUGHT)], smoothers, limits
    )


def search_pairs(base: Baseline, fits: Sequence[Fit], limits: Thresholds) -> list[Fit]:
    """Fits of pairs of effects where no single one is enough, best first, the failed ones last.

    The single effects that explain most in the first view in which the base leaves something to be seen are paired with what would
    explain most of the rest: with one of two effects there, neither nuisances nor signatures are the base's.

    Parameters
    ----------
    base : Baseline
    fits : sequence of Fit
        Of the single effects.
    limits : Thresholds
    """
    smoothers = smoothers_of(base.problem)
    first = next((smoother for smoother in smoothers if _shows(base.base, smoother)), next(iter(smoothers[-1:]), None))
    best: dict[str, Fit] = {}
    for one in sorted((one for one in fits if one.status != FAILED), key=lambda one: _left(one, first)):
        best.setdefault(one.label, one)
    leading = [one for one in best.values() if _left(one, first) < _BEHIND * _left(next(iter(best.values())), first)]
    # what is sought on a grid may come nearer beside another effect though it does not alone
    lost = {one.label for one in fits if not any(c.grid for c in one.hypothesis)} - best.keys()
    chosen: dict[frozenset[str], tuple[Screened, Signatures]] = {}
    rest: Sequence[Smoother] = ()
    for rank, one in enumerate(leading[:LEADING]):
        about, here = _about(base, one.hypothesis, one.mapping, smoothers)
        if about.status == FAILED:
            continue
        rest = max(rest, here, key=len)
        beside = signatures(base.problem, about, base.differences)
        for pair in _shortlist(beside, next(iter(here), None), PARTNERS, about.hypothesis, untold=rank == 0):
            if pair.hypothesis[-1].label not in lost:
                chosen.setdefault(frozenset(c.label for c in pair.hypothesis), (pair, beside))
    going = list(chosen.values())
    if not smoothers:  # none is left behind on the way then, and each is fitted to its end
        going = sorted(going, key=lambda pair: pair[0].chi2)[: KEPT[0]]
    return successive_elimination(base, going, rest, limits)


def _shortlist(
    known: Signatures, smoother: Smoother | None, most: int, beside: Hypothesis = (), untold: bool = True
) -> list[Screened]:
    singles = Screen(known, beside, smoother).singles()
    return [*singles[:most], *(one for one in singles[most:] if untold and _untold(one))]


def _untold(one: Screened) -> bool:
    """Whether small sizes say little of an effect, so that how much it would explain does not rank it."""
    candidates = [new.candidate for new in one.signatures]
    return any(candidate.replaces or candidate.grid or candidate.is_perturbation for candidate in candidates)


def successive_elimination(
    base: Baseline, chosen: Sequence[tuple[Screened, Signatures]], smoothers: Sequence[Smoother], limits: Thresholds
) -> list[Fit]:
    """Fits of explanations through all views to the samples, best first, the failed ones last; after each view the worst are left
    behind.

    Parameters
    ----------
    base : Baseline
    chosen : sequence of (Screened, Signatures)
        Explanations, each with the signatures that it was found by.
    smoothers : sequence of Smoother
        Coarsest first; none to begin with the samples.
    limits : Thresholds
    """
    problem, differences = base.problem, base.differences
    going, lost, first = [], [], next(iter(smoothers), None)
    least = np.inf
    for one, known in chosen:
        found = fit_screened(base.problem, base.differences, known, one, sufficient_chi2=least, smoother=first)
        if found.status == FAILED:
            lost.append(found)
            continue
        if first and _untold(one):
            found = _onward(base, found, first, first)
        if first:
            least = min(least, _left(found, first))
        going.append(found)
    onward = (*smoothers[1:], None)[: len(smoothers)]
    for smoother, finer, most in zip(smoothers, onward, KEPT[len(KEPT) - len(smoothers) :], strict=True):
        left = sorted((_left(one, smoother), i) for i, one in enumerate(going))
        best = [going[i] for value, i in left[:most] if value < _BEHIND * left[0][0]]
        going, least = [], np.inf
        for one in best:
            going.append(_onward(base, one, smoother, finer, least))
            least = min(least, _left(going[-1], finer))
        lost += [one for one in going if one.status == FAILED]
        going = [one for one in going if one.status != FAILED]
    going.sort(key=lambda one: one.chi2)
    if going and first and reduced_chi2(going[0]) > limits.omnibus:
        for one in going[:CAREFUL]:
            near = coarse_to_fine_fit(problem, one.hypothesis, one.mapping, differences, smoothers)
            if near.status != FAILED:
                going.append(fit_hypothesis(problem, one.hypothesis, near.mapping, differences=differences))
    return [*sorted(going, key=lambda one: one.chi2), *lost]


def _about(
    base: Baseline, hypothesis: Hypothesis, start: Mapping[str, float], smoothers: Sequence[Smoother]
) -> tuple[Fit, Sequence[Smoother]]:
    """The fit of an explanation in the first view in which it leaves something to be seen, or in the last; and the views from there."""
    for i, smoother in enumerate(smoothers):
        one = fit_hypothesis(base.problem, hypothesis, start, None, base.differences, refresh=True, smoother=smoother)
        if one.status == FAILED or smoother is smoothers[-1] or _shows(one, smoother):
            return one, smoothers[i:]
    return fit_hypothesis(base.problem, hypothesis, start, None, base.differences, refresh=True), smoothers


def _onward(
    base: Baseline, one: Fit, smoother: Smoother, finer: Smoother | None, sufficient_chi2: float = np.inf
) -> Fit:
    """The fit in the finer view that starts from one in `smoother`, where changes of what is known are looked through."""
    moved = coordinate_scan(base.problem, one, smoother, finer, amplitudes_only=True)
    if moved is not None:
        found = fit_hypothesis(
            base.problem, one.hypothesis, moved, None, base.differences, sufficient_chi2=sufficient_chi2, smoother=finer
        )
        if found.status != FAILED:
            return found
    if finer is smoother:
        return one
    near = dict(zip((p.key for p in one.parameters), one.jacobian.T, strict=True))
    return fit_hypothesis(
        base.problem,
        one.hypothesis,
        one.mapping,
        near,
        base.differences,
        sufficient_chi2=sufficient_chi2,
        smoother=finer,
    )


def _shows(one: Fit, smoother: Smoother) -> bool:
    return _left(one, smoother) > _SHOWS * one.residual.size


def _left(one: Fit, smoother: Smoother | None) -> float:
    return one.chi2 if smoother is None else float(np.sum(np.square(smoother(one.residual))))
