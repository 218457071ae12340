"""From a base to a verdict: the order in which explanations are sought, fitted and weighed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointgap.errors import InputError, SimulationError
from jointgap.identification.baseline import Baseline, multistart_fit, other_numerics, random_nuisances
from jointgap.identification.decision import Decision, decide, reduced_chi2
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.initial_fit import fit_screened
from jointgap.identification.problem import Problem
from jointgap.identification.screening import Screen, Screened, Signatures
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from jointgap.identification.signature_subspaces import SignatureSubspaces, orthonormal
from jointgap.identification.smoother import coarse_to_fine_fit, smoothers_of
from jointgap.identification.thresholds import Thresholds

SINGLES = 8
"""Candidates that are fitted alone, at most, beside those that have to be sought on a grid."""

LACKING = 0.1
"""Where the best signature would leave more than this part of the misfit, effects that have to be sought on a grid are fitted too:
signatures say little of these."""

NEAR = 30.0
"""Where the base leaves no more than noise, effects are small and signatures exact: those whose BIC is this much above the
best one's are not fitted, nor those that gain less than half of what would be called an effect."""

FEWEST = 2

_SMOOTH = 0.01  # of chi2: less roughness than this makes no valleys

AMONG = 3
"""Partners of an effect that is enough that are fitted, and rivals of the best explanation that are fitted again."""

EVERYWHERE = 4
"""Values of the nuisances from which the base is fitted again before an effect is named that hardly shows: a clearance some percent
off holds impacts at other instants, a valley of its own."""


def shortlist_singles(
    known: Signatures, limits: Thresholds, settings: IdentificationSettings = DEFAULT_SETTINGS
) -> list[Screened]:
    """Single effects that are worth a fit, best first.

    Parameters
    ----------
    known : Signatures
        Of all candidates.
    limits : Thresholds
    settings : IdentificationSettings
    """
    singles = Screen(known).singles()
    free = known.residual.size - len(known.parameters)
    left = known.residual @ known.residual
    if left > limits.omnibus * free:
        short = singles[:SINGLES]
        if singles and singles[0].chi2 - free > LACKING * (left - free):
            short += [one for one in singles[SINGLES:] if one.signatures[0].candidate.grid]
        return short
    worth = (
        left
        + len(known.parameters) * np.log(known.residual.size)
        - 0.5 * max(settings.decision.min_delta_bic, limits.max_gain_threshold)
    )
    near = [one for one in singles if one.bic < min(singles[0].bic + NEAR, worth)]
    return singles[: min(max(len(near), FEWEST), SINGLES)]


def best_sufficient(base: Baseline, fits: Sequence[Fit], second: Thresholds) -> Fit | None:
    """The best of the fits of single effects that leave no more than null campaigns and other numerics do; None if none does.

    Parameters
    ----------
    base : Baseline
    fits : sequence of Fit
    second : Thresholds
        As `two_effect_thresholds` says.
    """
    good = [one for one in fits if one.bic < base.base.bic and reduced_chi2(one) <= second.omnibus]
    return min(good, key=lambda one: one.bic, default=None)


def shortlist_pairs(
    known: Signatures, best: Fit, fits: Sequence[Fit], second: Thresholds
) -> list[tuple[Screened, Fit]]:
    """Pairs of effects that are worth a fit beside a single one that is enough, each with the fit of that.

    Only partners that would add to it beyond chance.

    Parameters
    ----------
    known : Signatures
    best : Fit
        Of the effect that is enough.
    fits : sequence of Fit
        Of the single effects.
    second : Thresholds
        As `two_effect_thresholds` says.
    """
    lost = {one.label for one in fits} - {one.label for one in fits if one.status != FAILED}
    partners = Screen(known.about(best), best.hypothesis).singles()
    worth = [
        one
        for one in partners
        if one.hypothesis[-1].label not in lost and best.bic - one.bic > second.max_gain_threshold
    ]
    return [(one, best) for one in worth[:AMONG]]


def two_effect_thresholds(base: Baseline, fits: Sequence[Fit], limits: Thresholds) -> Thresholds:
    """The thresholds for explanations of more effects, with the best single one there.

    The numerics may matter more where it is there: a joint that was ideal hits and slides. What other numerics change there,
    beyond what nuisances can, may be left and is no sign of a second effect, as long as it is a small part of what the effect explains;
    of more than that, the small part is what a second effect has to gain. Where the single one is enough, a second effect has to gain
    more than fits gain by ending at this side of a jump or that too (`nonlinearity`).
    """
    alone = [one for one in fits if one.status != FAILED and len(one.hypothesis) == 1]
    best = min(alone, key=lambda one: one.chi2, default=None)
    if best is None:
        return limits
    across = orthonormal(base.base.jacobian)
    try:
        changes = other_numerics(base.problem, best)
    except (InputError, SimulationError):
        return limits
    left = float(max((np.sum((row - across @ (across.T @ row)) ** 2) for row in changes), default=0.0))
    most = (1.0 - base.problem.settings.decision.min_explained_share) * (base.base.chi2 - best.chi2)
    found = replace(limits, max_gain_threshold=max(limits.max_gain_threshold, min(left, most)))
    if limits.max_gain_threshold < left <= most:
        found = replace(found, omnibus=limits.omnibus + left / best.residual.size)
    if reduced_chi2(best) > found.omnibus:
        return found
    return replace(found, max_gain_threshold=max(found.max_gain_threshold, nonlinearity(base.problem, best)))


def nonlinearity(problem: Problem, one: Fit) -> float:
    """How far chi2, a standard error of one parameter off, is from what the residuals as far to the other side foretell; at most.

    Where an impact comes or does not come, chi2 jumps by more than parameters change it otherwise, and a fit ends at this side of
    the jump or that: differences between fits that are smaller say nothing. 0 where residuals depend on parameters linearly.
    Parameters at a bound, and those of single runs, are left out.
    """
    errors, most = np.sqrt(np.diag(one.covariance())), 0.0
    for p, value, error in zip(one.parameters, one.values, errors, strict=True):
        step = min(error, value - p.low, p.high - value)
        if p.run is not None or not step > 0.0:
            continue
        try:
            there, back = (
                problem.residual(one.mapping | {p.key: value + signed}, one.hypothesis) for signed in (step, -step)
            )
        except (InputError, SimulationError):
            continue
        for seen, other in ((there, back), (back, there)):
            most = max(most, abs(float(np.sum(seen**2) - np.sum((2.0 * one.residual - other) ** 2))))
    return most


def refit_jacobian(base: Baseline, one: Fit) -> Fit:
    """A fit with its Jacobian made anew at the end: what intervals need."""
    if one.status == FAILED:
        return one
    return fit_hypothesis(base.problem, one.hypothesis, one.mapping, differences=base.differences, refresh=True)


def refit_and_decide(base: Baseline, known: Signatures, fits: Sequence[Fit], limits: Thresholds) -> Decision:
    """Weigh the fits (`jointgap.identification.decision.decide`), the best of each explanation.

    Where the motion is rough, base and rivals are first fitted again from the best one's nuisances: an explanation must not win
    by having found a deeper valley of parameters that all share.
    """
    settings = base.problem.settings.decision
    second = two_effect_thresholds(base, fits, limits)
    limits = replace(second, max_gain_threshold=limits.max_gain_threshold)
    best: dict[frozenset[str], Fit] = {}
    for one in sorted(fits, key=lambda one: one.chi2):
        best.setdefault(frozenset(candidate.label for candidate in one.hypothesis), one)
    plain, ranked = base.base, sorted(best.values(), key=lambda one: one.bic)
    if ranked and limits.numerical_noise > _SMOOTH and ranked[0].bic < plain.bic:
        plain = _moved(base, plain, ranked[0])
        for names, rival in list(best.items()):
            if any(rival is one for one in ranked[1 : 1 + AMONG]) and rival.status != FAILED:
                best[names] = _moved(base, rival, ranked[0])
        if (
            reduced_chi2(plain) <= max(limits.omnibus, settings.tolerated_reduced_chi2)
            and plain.bic - ranked[0].bic > settings.min_delta_bic
        ):
            deeper = _deepest(base, plain)
            if deeper.chi2 < plain.chi2:
                plain = deeper
                for one in ranked[: 1 + AMONG]:
                    names = frozenset(candidate.label for candidate in one.hypothesis)
                    if one.status != FAILED:
                        best[names] = _moved(base, best[names], deeper)
    subspaces = SignatureSubspaces(known)
    similarity = {
        one.label: subspaces.nearest(one.hypothesis)[1]
        for one in best.values()
        if one.status != FAILED and one.hypothesis
    }
    bounds = {p.name: (p.nominal, p.low, p.high) for p in base.problem.nuisances}
    return decide(
        plain,
        base.nominal,
        list(best.values()),
        limits,
        similarity,
        bounds,
        subspaces.is_special_case,
        second.max_gain_threshold,
        settings,
    )


def swap_one_effect(base: Baseline, known: Signatures, fits: Sequence[Fit]) -> list[Fit]:
    """Fits of the pairs that differ from the best one in one effect, as far as they are not among `fits`.

    One of two effects may stand for another as long as the second is not beside it, and lead to the wrong pair.
    """
    best = min((one for one in fits if one.status != FAILED), key=lambda one: one.bic, default=None)
    if best is None or len(best.hypothesis) < 2:
        return []
    done, found = {frozenset(c.label for c in one.hypothesis) for one in fits}, []
    for kept in best.hypothesis:
        alone = min((one for one in fits if one.label == kept.label), key=lambda one: one.chi2, default=None)
        if alone is None or alone.status == FAILED:
            start = {
                key: value for key, value in best.mapping.items() if "." not in key or key.startswith(f"{kept.label}.")
            }
            alone = fit_hypothesis(base.problem, (kept,), start, differences=base.differences)
        if alone.status == FAILED:
            continue
        partners = Screen(known.about(alone), alone.hypothesis).singles()
        for pair in partners[:AMONG]:
            names = frozenset(candidate.label for candidate in pair.hypothesis)
            if names not in done:
                done.add(names)
                found.append(fit_screened(base.problem, base.differences, known, pair, alone))
    return found


def _deepest(base: Baseline, plain: Fit) -> Fit:
    """The base or, if it is better, the best fit of it that comes from afar (`jointgap.identification.smoother`), from everywhere.

    An effect that is called missing where the base leaves no more than noise must not be the way out of a valley.
    """
    problem, smoothers = base.problem, smoothers_of(base.problem)
    nominal = {p.key: p.nominal for p in problem.nuisances if p.run is None}
    for values in (nominal, *random_nuisances(problem, (), EVERYWHERE - 1)):
        near = (
            coarse_to_fine_fit(problem, (), plain.mapping | values, base.differences, smoothers) if smoothers else None
        )
        start = plain.mapping | values if near is None or near.status == FAILED else near.mapping
        found = fit_hypothesis(problem, (), start, differences=base.differences)
        plain = min(plain, found, key=lambda one: one.chi2)
    return plain


def _moved(base: Baseline, one: Fit, to: Fit) -> Fit:
    """A fit or, if it is better, one that starts from the nuisances of another."""
    start = {key: to.mapping.get(key, value) if "." not in key else value for key, value in one.mapping.items()}
    again = fit_hypothesis(base.problem, one.hypothesis, start, differences=base.differences)
    return again if again.chi2 < one.chi2 else one


def select_hypothesis(base: Baseline, known: Signatures, fits: Sequence[Fit], limits: Thresholds) -> Decision:
    """Choose among the fits; what is chosen is fitted once more to its end, for its intervals.

    What leaving out one of two effects costs is the fit of the other alone, at its best: before two effects are named each is fitted
    alone once more, from the nuisances of the pair and from other starts, and is open to choice like all others.

    Parameters
    ----------
    base : Baseline
    known : Signatures
        Of all candidates.
    fits : sequence of Fit
        Of single effects and pairs.
    limits : Thresholds
    """
    fits, done = [*fits, *swap_one_effect(base, known, fits)], set()
    decision = refit_and_decide(base, known, fits, limits)
    while members := _members_alone(base, [decision.chosen, *decision.equivalent], done):
        fits += members
        decision = refit_and_decide(base, known, fits, limits)
    plain = decision.base if decision.base is base.base else refit_jacobian(base, decision.base)
    chosen = plain if decision.chosen is decision.base else decision.chosen
    if chosen.hypothesis:
        chosen = refit_jacobian(base, chosen)
    equivalent = [refit_jacobian(base, fit) for fit in decision.equivalent]
    return replace(decision, chosen=chosen, base=plain, equivalent=equivalent)


def _members_alone(base: Baseline, chosen: Sequence[Fit], done: set[str]) -> list[Fit]:
    """Fits of single effects of the pairs among `chosen` that are not `done` yet; then they are."""
    fits = []
    for pair in (one for one in chosen if len(one.hypothesis) > 1):
        for kept in pair.hypothesis:
            if kept.label in done:
                continue
            done.add(kept.label)
            own = {
                key: value for key, value in pair.mapping.items() if "." not in key or key.startswith(f"{kept.label}.")
            }
            shared = {p.key: p.nominal for p in base.problem.nuisances if p.run is None and p.key in own}
            fits.append(fit_hypothesis(base.problem, (kept,), own, differences=base.differences))
            fits.append(multistart_fit(base.problem, base.differences, (kept,), own | shared, max_starts=1))
    return fits
