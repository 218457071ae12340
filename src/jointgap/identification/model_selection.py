"""Selection of hypotheses for fits, and comparison of the fits."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import permutations, product

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
from jointgap.identification.initial_fit import (
    best_fit_per_hypothesis,
    chi2_without_effects,
    derivatives_of,
    labels_of,
    refit_from_part,
    with_effects_absent,
    with_nuisances_of,
    without_other_effects,
)
from jointgap.identification.likelihood import fitted
from jointgap.identification.problem import Hypothesis, Problem, SearchLimit
from jointgap.identification.screening import (
    LinearizedFit,
    Sensitivities,
    SensitivityRegression,
    SensitivitySubspaces,
    crank_orders,
    orthonormal,
    shortlist,
)
from jointgap.identification.settings import (
    DEFAULT_SETTINGS,
    DecisionSettings,
    IdentificationSettings,
)
from jointgap.identification.verdict import (
    ALIKE,
    ALONE,
    PARAMETERS_ONLY,
    Decision,
    Evidence,
    Row,
    Thresholds,
    verdict,
)


def shortlist_singles(
    sensitivities: Sensitivities,
    limits: Thresholds,
    settings: IdentificationSettings = DEFAULT_SETTINGS,
) -> list[LinearizedFit]:
    """Single effects selected for a fit, best first."""
    selection = settings.selection
    singles = SensitivityRegression(sensitivities).singles()
    dof = sensitivities.residual.size - len(sensitivities.parameters)
    chi2 = sensitivities.residual @ sensitivities.residual
    if chi2 > limits.omnibus * dof:
        return shortlist(singles, selection.max_singles)
    # the base is consistent with noise: effects are small, and the linearisation is accurate
    min_gain = selection.linear_share * max(
        settings.decision.min_delta_bic, limits.max_gain_threshold
    )
    limit = chi2 + len(sensitivities.parameters) * np.log(sensitivities.residual.size) - min_gain
    count = sum(single.bic < limit for single in singles)
    return shortlist(singles[: max(count, selection.partners)], selection.max_singles)


def best_sufficient(baseline: Baseline, fits: Sequence[Fit], second: Thresholds) -> Fit | None:
    """The best of the `fits` of single effects that is better than the base and sufficient by the
    limit of `second`."""
    sufficient = [
        fit for fit in fits if fit.bic < baseline.base.bic and reduced_chi2(fit) <= second.omnibus
    ]
    return min(sufficient, key=lambda fit: fit.bic, default=None)


def shortlist_pairs(
    baseline: Baseline,
    sensitivities: Sensitivities,
    best: Fit,
    fits: Sequence[Fit],
    second: Thresholds,
) -> list[LinearizedFit]:
    """Pairs with the sufficient single effect of `best` that gain significantly, at most `partners`
    of them.

    `fits`: all single effects; `sensitivities`: about the base; `second`: from
    `two_effect_thresholds`.
    """
    failed = failed_labels(fits)
    pairs = SensitivityRegression(sensitivities.about(best), best.hypothesis).singles()
    pairs = [pair for pair in pairs if pair.hypothesis[-1].label not in failed]
    gaining = [pair for pair in pairs if best.bic - pair.bic > second.max_gain_threshold]
    needed = second_effect_gain(baseline.problem, fits, second) if gaining else 0.0
    gaining = [pair for pair in gaining if best.bic - pair.bic > needed]
    return shortlist(gaining, baseline.problem.settings.selection.partners)


def failed_labels(fits: Sequence[Fit]) -> set[str]:
    """Labels of hypotheses whose fits all failed."""
    return {fit.label for fit in fits} - {fit.label for fit in fits if fit.status != FAILED}


def two_effect_thresholds(
    baseline: Baseline, fits: Sequence[Fit], limits: Thresholds
) -> Thresholds:
    """The thresholds for pairs, with the solver error of the best single effect.

    With an effect such as a clearance, differences between solver variants may be larger than in
    the base. They are no sign of a second effect as long as they are a small part of the explained
    misfit.
    """
    best = _best_alone(fits)
    if best is None:
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


def second_effect_gain(problem: Problem, fits: Sequence[Fit], second: Thresholds) -> float:
    """Required gain of a second effect [BIC]; if a single one is sufficient, at least the
    `nonlinearity` of its fit."""
    best = _best_alone(fits)
    is_sufficient = best is not None and reduced_chi2(best) <= second.omnibus
    return max(second.max_gain_threshold, nonlinearity(problem, best) if is_sufficient else 0.0)


def _best_alone(fits: Sequence[Fit]) -> Fit | None:
    alone = [fit for fit in fits if fit.status != FAILED and len(fit.hypothesis) == 1]
    return min(alone, key=lambda fit: fit.chi2, default=None)


def nonlinearity(problem: Problem, fit: Fit) -> float:
    """Largest difference [chi2] between chi2 at one standard error and its linear prediction from
    the other side.

    It measures jumps of chi2 by impacts that appear or vanish; smaller differences of fits are
    meaningless. Parameters at a bound and of single runs are ignored.
    """
    if fit.in_windows:
        return 0.0
    errors, largest = np.sqrt(np.diag(fit.covariance())), 0.0
    for p, value, error in zip(fit.parameters, fit.values, errors, strict=True):
        step = min(error, value - p.low, p.high - value)
        if p.run is not None or not step > 0.0:
            continue
        places = [fit.mapping | {p.key: value + signed} for signed in (step, -step)]
        try:
            sides = [problem.residual(place, fit.hypothesis) for place in places]
        except (InputError, SimulationError):
            continue
        for simulated, opposite in permutations(sides):
            predicted = np.sum((2.0 * fit.residual - opposite) ** 2)
            largest = max(largest, abs(float(np.sum(simulated**2) - predicted)))
    return largest


def refit_jacobian(baseline: Baseline, fit: Fit) -> Fit:
    """The `fit` with a new Jacobian; unchanged with draws or in windows."""
    if fit.status == FAILED or fit.draws is not None or fit.in_windows:
        return fit
    problem, differences = baseline.problem, baseline.differences
    return fit_hypothesis(
        problem, fit.hypothesis, fit.mapping, differences=differences, refresh=True
    )


def refit_and_decide(
    baseline: Baseline, sensitivities: Sensitivities, fits: Sequence[Fit], limits: Thresholds
) -> Decision:
    """The verdict of the fits (`jointgap.identification.verdict`), with the best fit of each
    hypothesis.

    No hypothesis may win by a better local minimum of the nuisances: fits are repeated from better
    parts of their hypotheses, and the base from the nuisances of better fits. For non-periodic
    motion base and leading fits are regressed over ensembles. Arguments as in `select_hypothesis`.
    """
    problem, base = baseline.problem, baseline.base
    settings = problem.settings.decision
    second = two_effect_thresholds(baseline, fits, limits)
    limits = replace(second, max_gain_threshold=limits.max_gain_threshold)
    lowest = best_fit_per_hypothesis(fits)
    needed = max(settings.min_delta_bic, limits.max_gain_threshold)
    base = _where_effects_are(baseline, sorted(lowest, key=lambda fit: fit.bic), needed)
    if problem.has_statistics:
        base, lowest = leading_over_ensembles(problem, base, lowest)
    best = enforce_nested_chi2(baseline, [base, *lowest], limits)
    subspaces = SensitivitySubspaces(sensitivities, problem.settings.screening)
    best = without_repetitions(best, subspaces.is_special_case, settings.min_delta_bic)
    bounds = {p.name: (p.nominal, p.low, p.high) for p in problem.nuisances}
    # one frequency in runs of different speeds is no order of the crank
    order_label = crank_orders(problem.parts, problem.settings.screening, in_all_runs=True)
    rows = []
    for fit in best.values():
        similarity = 0.0 if fit.status == FAILED else subspaces.nearest(fit.hypothesis)[1]
        rows.append(row_of(fit, bounds, settings, order_label, similarity))

    def is_special_case(special: Row, general: Row) -> bool:
        return subspaces.is_special_case(special.fit.hypothesis, general.fit.hypothesis)

    def predicts_same(row: Row, other: Row) -> bool:
        return _differ_in_sensors_only(row.fit, other.fit, base, settings)

    judges = {"is_special_case": is_special_case, "predicts_same": predicts_same}
    evidence = Evidence(row_of(base), row_of(baseline.nominal), rows, limits, **judges)
    said = verdict(replace(evidence, second_effect_gain=second.max_gain_threshold), settings)
    if said.proposed is None or len(said.proposed.hypothesis) < 2:
        return said
    return verdict(
        replace(evidence, second_effect_gain=second_effect_gain(problem, fits, second)), settings
    )


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


def swap_one_effect(
    baseline: Baseline,
    sensitivities: Sensitivities,
    fits: Sequence[Fit],
    limit: SearchLimit | None = None,
) -> list[Fit]:
    """Fits of new pairs that differ from the best pair in one effect, within its minimum of the
    nuisances.

    Without its partner an effect may be confused with another one, which leads to a wrong pair.
    Arguments as in `select_hypothesis`.
    """
    best = _best(fits)
    if best is None or len(best.hypothesis) < 2 or best.in_windows:
        return []
    problem, differences = baseline.problem, baseline.differences
    done, swapped = {labels_of(fit.hypothesis) for fit in fits}, []
    failed = failed_labels(fits)
    for kept in best.hypothesis:
        rest = without_other_effects(problem, best, (kept,))
        partners = SensitivityRegression(sensitivities.about(rest), rest.hypothesis).singles()
        for pair in shortlist(partners, problem.settings.selection.partners):
            if labels_of(pair.hypothesis) not in done and pair.hypothesis[-1].label not in failed:
                if limit and limit.reached():
                    return swapped
                done.add(labels_of(pair.hypothesis))
                start = rest.mapping | pair.start
                swapped.append(
                    fit_hypothesis(problem, pair.hypothesis, start, differences=differences)
                )
    return swapped


def fit_confusable_effects(
    baseline: Baseline, sensitivities: Sensitivities, best: Fit, sufficient_chi2: float = np.inf
) -> list[Fit]:
    """Fits of all candidates with sensitivities similar to those of an effect of the `best`
    explanation, from its nuisances.

    Their earlier fits may have ended in another minimum, and the first sufficient explanation need
    not be true. Arguments as in `select_hypothesis`.
    """
    problem, found = baseline.problem, []
    subspaces = SensitivitySubspaces(sensitivities, problem.settings.screening)
    for out in best.hypothesis:
        if out.label not in subspaces.of or best.in_windows:
            continue
        rest = without_other_effects(
            problem, best, tuple(one for one in best.hypothesis if one is not out)
        )
        space, regression = (
            subspaces.span([out.label]),
            SensitivityRegression(sensitivities.about(rest), rest.hypothesis),
        )
        for other in regression.singles():
            label = other.hypothesis[-1].label
            if (
                label == out.label
                or subspaces.cosine(space, label) <= problem.settings.selection.alike_cosine
            ):
                continue
            known = sensitivities.derivatives(other.sensitivities) | derivatives_of(best)
            start = rest.mapping | other.start
            fit = fit_hypothesis(
                problem,
                other.hypothesis,
                start,
                known,
                baseline.differences,
                sufficient_chi2=sufficient_chi2,
            )
            found.append(fit)
    return found


def fits_beyond_bounds(baseline: Baseline, fits: Sequence[Fit]) -> list[Fit]:
    """If the best explanation has a nuisance at its bound: new fits with an effect that exceeds the
    bound in place of each effect, at most `partners`.

    Such a nuisance is a sign of an effect that the linearisation missed. Arguments as in
    `select_hypothesis`.
    """
    best = _best(fits)
    if best is None or not best.hypothesis or best.in_windows or best.bic >= baseline.base.bic:
        return []
    problem, done = baseline.problem, {labels_of(fit.hypothesis) for fit in fits}
    beyond = {
        labels_of(each): each
        for each in _beyond_bounds(problem, best)
        if labels_of(each) not in done
    }
    return [
        fitted(
            problem,
            each,
            with_effects_absent(problem, each, best),
            differences=baseline.differences,
        )
        for each in list(beyond.values())[: problem.settings.selection.partners]
    ]


def _best(fits: Sequence[Fit]) -> Fit | None:
    return min((fit for fit in fits if fit.status != FAILED), key=lambda fit: fit.bic, default=None)


def _beyond_bounds(problem: Problem, best: Fit) -> Iterator[Hypothesis]:
    """The hypothesis of a fit with each effect replaced by one that can exceed the bound of a
    nuisance."""
    ends = {
        p.name: (p, value)
        for p, value in zip(best.parameters, best.values, strict=True)
        if p.run is None
    }
    ends = {
        name: value - p.nominal for name, (p, value) in ends.items() if not p.low < value < p.high
    }
    for name, candidate in product(ends, problem.model.candidates):
        if name not in candidate.replaces:
            continue
        amplitude = next(
            each for each in candidate.coordinates if each.key == candidate.replaces[name]
        )
        if amplitude.low < ends[name] < amplitude.high:
            for out in best.hypothesis:
                kept = tuple(one for one in best.hypothesis if one is not out)
                if not any({*candidate.replaces} & {*one.replaces} for one in kept):
                    yield (*kept, candidate)


def enforce_nested_chi2(
    baseline: Baseline, fits: Sequence[Fit], limits: Thresholds
) -> dict[frozenset[str], Fit]:
    """The `fits` with effects by their labels, repeated from a part of the hypothesis if that has a
    smaller chi2."""
    done: list[Fit] = []
    sufficient = min(
        (fit.chi2 for fit in fits if reduced_chi2(fit) <= limits.omnibus), default=np.inf
    )
    for fit in sorted(fits, key=lambda fit: len(fit.hypothesis)):
        done.append(refit_from_part(baseline.problem, baseline.differences, fit, done, sufficient))
    return {labels_of(fit.hypothesis): fit for fit in done if fit.hypothesis}


def without_repetitions(
    best: Mapping[frozenset[str], Fit],
    is_special_case: Callable[[Hypothesis, Hypothesis], bool],
    apart: float,
) -> dict[frozenset[str], Fit]:
    """The fits without those equivalent to a simpler limit, such as a very soft spring, which is a
    constant force."""
    sound = [fit for fit in best.values() if fit.status != FAILED]

    def repeats(fit: Fit, simpler: Fit) -> bool:
        return (
            simpler.bic < fit.bic + apart
            and simpler.active.sum() < fit.active.sum()
            and float(np.sum(np.square(fit.residual - simpler.residual))) < apart
            and is_special_case(simpler.hypothesis, fit.hypothesis)
        )

    repeated = {id(fit) for fit in sound if any(repeats(fit, simpler) for simpler in sound)}
    return {labels: fit for labels, fit in best.items() if id(fit) not in repeated}


def _where_effects_are(baseline: Baseline, ranked: Sequence[Fit], needed: float) -> Fit:
    """The base, re-fitted from the nuisances of the best `ranked` fits if their effects explain too
    little of the gain: less than `needed` [BIC] or than `linear_share`.
    """
    problem, base = baseline.problem, baseline.base
    share = problem.settings.selection.linear_share
    for fit in ranked[: 1 + problem.settings.selection.partners]:
        if base.bic - fit.bic <= needed:
            break
        parameters = (fit.bic - fit.chi2) - (base.bic - base.chi2)
        accounted = chi2_without_effects(problem, fit) - fit.chi2
        if accounted >= max(needed + parameters, share * (base.chi2 - fit.chi2)):
            break
        start = with_nuisances_of(problem, base, fit)
        again = fitted(problem, start=start, differences=baseline.differences)
        base = min(base, again, key=lambda fit: fit.chi2)
    return base


def select_hypothesis(
    baseline: Baseline, sensitivities: Sensitivities, fits: Sequence[Fit], limits: Thresholds
) -> Decision:
    """Decide on the fits; the selected fits are completed for their intervals.

    Before a pair is named, each of its effects is fitted alone from the nuisances of the pair and
    from nominal ones; the same for the best pair if it is not admissible. Before anything is named,
    confusable effects are fitted from its nuisances. Before effects are certain, pairs without them
    are fitted. If the residual exceeds noise, the intervals include other minima of similar chi2.
    """
    fits, given = [*fits, *fits_beyond_bounds(baseline, fits)], baseline.base
    found = fits = [*fits, *swap_one_effect(baseline, sensitivities, fits)]
    decision, done = refit_and_decide(baseline, sensitivities, fits, limits), set()
    while further := _needed(baseline, sensitivities, decision, done):
        baseline = replace(baseline, base=decision.base)
        fits, found = [*(row.fit for row in decision.ranking), *further], [*found, *further]
        decision = refit_and_decide(baseline, sensitivities, fits, limits)

    def stated(fit: Fit) -> Fit:
        fit = with_intervals(baseline.problem, refit_jacobian(baseline, fit))
        return with_other_ends(fit, found)

    base = decision.base if decision.base is given else refit_jacobian(baseline, decision.base)
    if (
        decision.verdict == PARAMETERS_ONLY
    ):  # otherwise its parameters are biased by the missing effect
        base = with_intervals(baseline.problem, base)
    chosen = base if decision.chosen is decision.base else decision.chosen
    chosen = stated(chosen) if chosen.hypothesis else chosen
    equivalent, twins = (
        [stated(fit) for fit in fits] for fits in (decision.equivalent, decision.twins)
    )
    best_known = stated(decision.best_known) if decision.best_known else None
    return replace(
        decision,
        chosen=chosen,
        base=base,
        equivalent=equivalent,
        twins=twins,
        best_known=best_known,
    )


def _needed(
    baseline: Baseline, sensitivities: Sensitivities, decision: Decision, done: set[tuple[str, str]]
) -> list[Fit]:
    """The required fits of a decision that are not `done` yet; marks them as done."""
    fits, passing = [], {id(row.fit) for row in decision.ranking if row.passes}
    for kind, label, fit in decision.needs:
        if (kind, label) not in done:
            done.add((kind, label))
            sufficient = fit.chi2 if id(fit) in passing else np.inf
            if kind == ALONE:
                fits += _fit_alone(baseline, fit, label)
            elif kind == ALIKE:
                fits += fit_confusable_effects(baseline, sensitivities, fit, sufficient)
            else:
                fits += _fit_pairs_without(baseline, sensitivities, decision)
    return fits


def _fit_pairs_without(
    baseline: Baseline, sensitivities: Sensitivities, decision: Decision
) -> list[Fit]:
    """Fits of new pairs without the certain effects: the best single effects other than those, with
    their partners."""
    problem, count = baseline.problem, baseline.problem.settings.selection.partners
    fits = [row.fit for row in decision.ranking if row.fit.status != FAILED]
    tried, limit = (
        {labels_of(fit.hypothesis) for fit in fits},
        problem.limit("pairs without the certain effects"),
    )
    singles: dict[str, Fit] = {}  # one of each exclusion group
    for fit in best_fit_per_hypothesis(fits):
        if len(fit.hypothesis) == 1 and not fit.in_windows and fit.label not in decision.certain:
            singles.setdefault(fit.hypothesis[0].exclusion_group, fit)
    found = []
    for fit in list(singles.values())[:count]:
        fit = refit_jacobian(baseline, fit)
        others = sensitivities.about(fit)
        others = replace(
            others, entries=[s for s in others.entries if s.candidate.label not in decision.certain]
        )
        for pair in shortlist(SensitivityRegression(others, fit.hypothesis).singles(), count):
            if labels_of(pair.hypothesis) not in tried and not limit.reached():
                tried.add(labels_of(pair.hypothesis))
                start = fit.mapping | pair.start
                found.append(
                    fit_hypothesis(
                        problem, pair.hypothesis, start, differences=baseline.differences
                    )
                )
    return found


def _fit_alone(baseline: Baseline, pair: Fit, label: str) -> list[Fit]:
    """Fits of one effect of a pair alone, from the pair's nuisances and from nominal shared
    ones."""
    kept = tuple(candidate for candidate in pair.hypothesis if candidate.label == label)
    own = {
        key: value
        for key, value in pair.mapping.items()
        if "." not in key or key.startswith(f"{label}.")
    }
    shared = {
        p.key: p.nominal for p in baseline.problem.nuisances if p.run is None and p.key in own
    }
    starts = own, own | shared
    starts = starts[:1] if pair.in_windows else starts
    return [
        fitted(baseline.problem, kept, start, differences=baseline.differences) for start in starts
    ]


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
