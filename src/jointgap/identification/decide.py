"""From the fits of a search to the verdict of the fits, with intervals."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.baseline import (
    Baseline,
    leading_over_ensembles,
    other_numerics,
    with_intervals,
)
from jointgap.identification.evidence import reduced_chi2, row_of
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.initial_fit import labels_of
from jointgap.identification.problem import Hypothesis
from jointgap.identification.screening import (
    Sensitivities,
    SensitivitySubspaces,
    crank_orders,
    orthonormal,
)
from jointgap.identification.search import Search
from jointgap.identification.settings import DecisionSettings
from jointgap.identification.verdict import (
    PARAMETERS_ONLY,
    Decision,
    Evidence,
    Row,
    Thresholds,
    verdict,
)


def decide(search: Search) -> Decision:
    """The verdict of the fits of a search, with intervals of the fits that it states."""
    fits = [fit for labels, fit in search.fits.items() if labels]
    decision = verdict_of(search.baseline, search.base, fits, search.sensitivities, search.limits)
    decision = replace(decision, not_searched=tuple(search.not_searched))
    return _with_intervals(search, decision)


def verdict_of(
    baseline: Baseline,
    base: Fit,
    fits: Sequence[Fit],
    sensitivities: Sensitivities,
    limits: Thresholds,
) -> Decision:
    """The verdict of fits with effects over the `base`.

    For non-periodic motion base and leading fits are regressed over ensembles first.
    """
    problem, settings = baseline.problem, baseline.problem.settings
    second = two_effect_thresholds(baseline, fits, limits)
    if problem.has_statistics:
        base, fits = leading_over_ensembles(problem, base, sorted(fits, key=lambda fit: fit.chi2))
    subspaces = SensitivitySubspaces(sensitivities, settings.screening)
    fits = without_repetitions(fits, subspaces.is_special_case, settings.decision.min_delta_bic)
    bounds = {p.name: (p.nominal, p.low, p.high) for p in problem.nuisances}
    # one frequency in runs of different speeds is no order of the crank
    order_label = crank_orders(problem.parts, settings.screening, in_all_runs=True)
    rows = []
    for fit in fits:
        similarity = 0.0 if fit.status == FAILED else subspaces.nearest(fit.hypothesis)[1]
        rows.append(row_of(fit, bounds, settings.decision, order_label, similarity))

    def is_special_case(special: Row, general: Row) -> bool:
        return subspaces.is_special_case(special.fit.hypothesis, general.fit.hypothesis)

    def predicts_same(row: Row, other: Row) -> bool:
        return _differ_in_sensors_only(row.fit, other.fit, base, settings.decision)

    evidence = Evidence(
        row_of(base),
        row_of(baseline.nominal),
        rows,
        replace(limits, omnibus=second.omnibus),
        second.max_gain_threshold,
        is_special_case,
        predicts_same,
    )
    return verdict(evidence, settings.decision)


def two_effect_thresholds(
    baseline: Baseline, fits: Sequence[Fit], limits: Thresholds
) -> Thresholds:
    """The thresholds for pairs, with the solver error of the best single effect.

    With an effect such as a clearance, differences between solver variants may be larger than in
    the base. They are no sign of a second effect as long as they are a small part of the explained
    misfit.
    """
    alone = [fit for fit in fits if fit.status != FAILED and len(fit.hypothesis) == 1]
    best = min(alone, key=lambda fit: fit.chi2, default=None)
    if best is None or best.bic > baseline.base.bic:
        return limits
    nuisances = orthonormal(baseline.base.jacobian)
    try:
        changes = other_numerics(baseline.problem, best)
    except (InputError, SimulationError):
        return limits
    changed = float(
        max((np.sum((row - nuisances @ (nuisances.T @ row)) ** 2) for row in changes), default=0.0)
    )
    small = (1.0 - baseline.problem.settings.decision.min_explained_share) * (
        baseline.base.chi2 - best.chi2
    )
    gain, omnibus = max(limits.max_gain_threshold, min(changed, small)), limits.omnibus
    if limits.max_gain_threshold < changed <= small:
        omnibus += changed / best.residual.size
    return replace(limits, max_gain_threshold=gain, omnibus=omnibus)


def _differ_in_sensors_only(fit: Fit, other: Fit, base: Fit, settings: DecisionSettings) -> bool:
    """Whether two explanations have other sensor faults but predict the same: the difference is a
    negligible part of the change that the effects cause."""
    if FAILED in (fit.status, other.status) or len(fit.hypothesis) != len(other.hypothesis):
        return False
    different = labels_of(fit.hypothesis) ^ labels_of(other.hypothesis)
    if not all(
        one.sensor for one in (*fit.hypothesis, *other.hypothesis) if one.label in different
    ):
        return False
    apart, change = (np.sum((one.residual - fit.residual) ** 2) for one in (other, base))
    return bool(apart <= (1.0 - settings.sure_explained_share) * change)


def without_repetitions(
    fits: Sequence[Fit], is_special_case: Callable[[Hypothesis, Hypothesis], bool], apart: float
) -> list[Fit]:
    """The fits without those equivalent to a simpler limit, such as a very soft spring, which is a
    constant force."""
    sound = [fit for fit in fits if fit.status != FAILED]

    def repeats(fit: Fit, simpler: Fit) -> bool:
        return (
            simpler.bic < fit.bic + apart
            and simpler.active.sum() < fit.active.sum()
            and float(np.sum(np.square(fit.residual - simpler.residual))) < apart
            and is_special_case(simpler.hypothesis, fit.hypothesis)
        )

    repeated = {id(fit) for fit in sound if any(repeats(fit, simpler) for simpler in sound)}
    return [fit for fit in fits if id(fit) not in repeated]


def _with_intervals(search: Search, decision: Decision) -> Decision:
    """The decision with the fits that it states completed for their intervals.

    If the residual exceeds noise, the intervals include other minima of similar chi2.
    """
    baseline, problem = search.baseline, search.baseline.problem

    def stated(fit: Fit) -> Fit:
        fit = with_intervals(problem, with_new_jacobian(baseline, fit))
        return with_other_ends(fit, search.made)

    base = decision.base
    if decision.verdict == PARAMETERS_ONLY:  # else a missing effect biases its parameters
        base = with_intervals(problem, base)
    chosen = base if decision.chosen is decision.base else decision.chosen
    return replace(
        decision,
        base=base,
        chosen=stated(chosen) if chosen.hypothesis else chosen,
        equivalent=[stated(fit) for fit in decision.equivalent],
        twins=[stated(fit) for fit in decision.twins],
        best_known=stated(decision.best_known) if decision.best_known else None,
    )


def with_new_jacobian(baseline: Baseline, fit: Fit) -> Fit:
    """The `fit` with a new Jacobian; unchanged with draws or in windows."""
    if fit.status == FAILED or fit.draws is not None or fit.in_windows:
        return fit
    problem, differences = baseline.problem, baseline.differences
    return fit_hypothesis(
        problem, fit.hypothesis, fit.mapping, differences=differences, refresh=True
    )


def with_other_ends(fit: Fit, others: Sequence[Fit]) -> Fit:
    """The `fit`; if its residual exceeds noise, with a shift to the farthest minimum of similar
    chi2 among `others`."""
    settings, noise = fit.settings.decision, fit.residual.size - len(fit.parameters)
    if fit.status == FAILED or reduced_chi2(fit) <= settings.noise_gap**2:
        return fit
    labels, most = (
        labels_of(fit.hypothesis),
        noise + (fit.chi2 - noise) / settings.max_share_of_wrong_misfit,
    )
    as_good = (
        other for other in others if labels_of(other.hypothesis) == labels and other.chi2 <= most
    )
    ends = [
        np.array([other.mapping[p.key] for p in fit.parameters]) - fit.values for other in as_good
    ]
    if not ends:
        return fit
    errors = np.sqrt(np.diag(fit.covariance()))
    farthest = max(
        ends, key=lambda end: np.max(np.abs(end[errors > 0.0]) / errors[errors > 0.0], initial=0.0)
    )
    return replace(fit, shifts=np.vstack([*([] if fit.shifts is None else [fit.shifts]), farthest]))
