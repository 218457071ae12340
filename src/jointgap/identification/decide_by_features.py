"""A verdict on features of the cycle alone, where samples of rough motion cannot be followed.

The lowest rung of what residuals tell: where in the cycle impacts come and how hard they are
(`jointgap.identification.features`), not when exactly. Fits of samples have the first say; only what they leave
``unexplained`` is decided here, and what the held-out data say of a name: samples that are met at other speeds no more
than before were met by chance.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from jointgap.identification.baseline import Baseline
from jointgap.identification.confirmation import HeldOutTest
from jointgap.identification.decide_verdict import (
    AMBIGUOUS,
    NAMED,
    NAMED_WITH_REMAINING_MISFIT,
    UNEXPLAINED,
    Decision,
    is_within_range,
)
from jointgap.identification.features import CycleFeatures
from jointgap.identification.fit import FAILED, MATCHED, Fit
from jointgap.identification.initial_fit import labels_of, lowest_of_each
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.rough_search import can_be_followed, fit_to_features
from jointgap.identification.screening import can_be_searched

_Decided = TypeVar("_Decided")


def leaders_by_features(problem: Problem, base: Fit, fits: Sequence[Fit], matched: Sequence[Fit]) -> list[Fit]:
    """Explanations whose features are met, and so much better than those of all others that one of them must be
    true.
    """
    features, misfit = _misfits_of(problem, base)
    settings = problem.settings.rough_search
    matched = lowest_of_each(matched, misfit)
    ranked = sorted(((misfit(fit), place) for place, fit in enumerate(matched)))
    if not ranked or ranked[0][0] > settings.matched_misfit * features.size:
        return []
    enough = ranked[0][0] + settings.min_misfit_ahead
    own = {labels_of(fit.hypothesis) for fit in matched}
    rivals = [base, *(fit for fit in fits if fit.status != FAILED and labels_of(fit.hypothesis) not in own)]
    if min(map(misfit, rivals)) < enough:
        return []
    leaders = [matched[place] for found, place in ranked if found < enough]
    # an effect that features do not ask for says nothing beside one that they do
    labels = [labels_of(fit.hypothesis) for fit in leaders]
    leaders = [fit for fit, own in zip(leaders, labels, strict=True) if not any(other < own for other in labels)]
    return [] if any(can_be_followed(problem, fit) for fit in leaders) else leaders


def refitted_to_features(baseline: Baseline, decision: _Decided, test: HeldOutTest) -> _Decided:
    """The decision with the joint that it names fitted to features, where the held-out data are met by these alone.

    A fit of samples that the held-out samples contradict was led by chance: its intervals are as narrow as the valley
    where it ended, which need not be that of the truth. The verdict stays; so do changes of what was loose already.
    """
    chosen, problem = decision.chosen, baseline.problem
    is_named = decision.verdict in (NAMED, NAMED_WITH_REMAINING_MISFIT) and len(chosen.hypothesis) == 1
    if not is_named or chosen.status == MATCHED or test.features is None or test.after < test.before:
        return decision
    (candidate,) = chosen.hypothesis
    if candidate.is_perturbation or not can_be_searched(problem, candidate):
        return decision
    if (found := fit_to_features(baseline, chosen)) is None:
        return decision
    return replace(decision, because=f"{decision.because}; its size is the one that meets these", chosen=found)


def with_feature_gains(problem: Problem, decision: Decision) -> Decision:
    """The decision with the `feature_gain` of each explanation in its ranking."""
    features, misfit = _misfits_of(problem, decision.base)
    if not features.size:
        return decision
    absent = misfit(decision.base)
    gains = [np.nan if each.fit.status == FAILED else absent - misfit(each.fit) for each in decision.ranking]
    ranking = [replace(each, feature_gain=gain) for each, gain in zip(decision.ranking, gains, strict=True)]
    return replace(decision, ranking=ranking)


def _misfits_of(problem: Problem, base: Fit) -> tuple[CycleFeatures, Callable[[Fit], float]]:
    """The features of a base, and how far those of a fit are from them."""
    features = CycleFeatures(problem, base.residual)
    return features, lambda fit: sum(features.misfit(base.residual - fit.residual, run) for run in problem.runs)


def decided_by_features(
    problem: Problem,
    decision: Decision,
    leaders: Sequence[Fit],
    is_special_case: Callable[[Hypothesis, Hypothesis], bool],
) -> Decision:
    """The decision of samples, or that of features where samples leave ``unexplained`` what is missing.

    It stays that of samples where a leader changes no more than a parameter within its range: then nothing need be
    missing. Of two leaders of which one is a special case of the other the special one counts, unless features ask for
    more.
    """
    if decision.verdict != UNEXPLAINED or not leaders:
        return decision
    bounds = {p.name: (p.nominal, p.low, p.high) for p in problem.nuisances}
    if any(is_within_range(fit, effect, bounds) for fit in leaders for effect in fit.hypothesis):
        return decision
    led = {labels_of(fit.hypothesis) for fit in leaders}
    _, misfit = _misfits_of(problem, decision.base)
    apart = 0.5 * problem.settings.decision.min_delta_bic  # as log likelihood
    leaders = [
        fit
        for fit in leaders
        if not any(
            is_special_case(one.hypothesis, fit.hypothesis) and misfit(one) < misfit(fit) + apart for one in leaders
        )
    ]
    decision = replace(
        decision, ranking=[ranked for ranked in decision.ranking if labels_of(ranked.fit.hypothesis) not in led]
    )
    if len(leaders) > 1:
        because = "several explanations meet where in the cycle impacts come and how hard they are equally well"
        return replace(decision, verdict=AMBIGUOUS, because=because, equivalent=list(leaders), best_known=None)
    because = (
        "samples cannot be followed, but where in the cycle impacts come and how hard they are is met by this alone"
    )
    return replace(decision, verdict=NAMED, because=because, chosen=leaders[0], best_known=None)
