"""From a base to a decision: which hypotheses are worth a fit, and how fits are made comparable."""

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
    chi2_without_effects,
    derivatives_of,
    labels_of,
    lowest_of_each,
    not_above_its_parts,
    with_effects_absent,
    with_nuisances_of,
    without_other_effects,
)
from jointgap.identification.likelihood import fitted
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.screening import (
    LinearizedFit,
    SignatureRegression,
    Signatures,
    SignatureSubspaces,
    orders_of_cranks,
    orthonormal,
    shortlist,
)
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from jointgap.identification.verdict import ALONE, PARAMETERS_ONLY, Decision, Evidence, Row, Thresholds, verdict


def shortlist_singles(
    signatures: Signatures, limits: Thresholds, settings: IdentificationSettings = DEFAULT_SETTINGS
) -> list[LinearizedFit]:
    """Single effects that are worth a fit, best first: `signatures` of all candidates, by `limits` and `settings`."""
    selection = settings.selection
    singles = SignatureRegression(signatures).singles()
    dof = signatures.residual.size - len(signatures.parameters)
    chi2 = signatures.residual @ signatures.residual
    if chi2 > limits.omnibus * dof:
        return shortlist(singles, selection.max_singles)
    # the base leaves noise alone: effects are small, and signatures nearly exact
    min_gain = selection.linear_share * max(settings.decision.min_delta_bic, limits.max_gain_threshold)
    limit = chi2 + len(signatures.parameters) * np.log(signatures.residual.size) - min_gain
    count = sum(single.bic < limit for single in singles)
    return shortlist(singles[: max(count, selection.partners)], selection.max_singles)


def best_sufficient(baseline: Baseline, fits: Sequence[Fit], second: Thresholds) -> Fit | None:
    """The best of the `fits` of single effects that leave no more than null campaigns and other numerics do, if any.

    It is better than the base of the `baseline`; the limit is that of `second`, from `two_effect_thresholds`.
    """
    sufficient = [fit for fit in fits if fit.bic < baseline.base.bic and reduced_chi2(fit) <= second.omnibus]
    return min(sufficient, key=lambda fit: fit.bic, default=None)


def shortlist_pairs(
    baseline: Baseline, signatures: Signatures, best: Fit, fits: Sequence[Fit], second: Thresholds
) -> list[LinearizedFit]:
    """Pairs with a sufficient single effect that are worth a fit: those that would gain beyond chance.

    At most as many as the settings have `partners`; the sufficient effect is that of `best`, `fits` are those of all
    single effects, `signatures` the signatures about the base, and `second` is from `two_effect_thresholds`.
    """
    failed = {fit.label for fit in fits} - {fit.label for fit in fits if fit.status != FAILED}
    pairs = SignatureRegression(signatures.about(best), best.hypothesis).singles()
    pairs = [pair for pair in pairs if pair.hypothesis[-1].label not in failed]
    gaining = [pair for pair in pairs if best.bic - pair.bic > second.max_gain_threshold]
    needed = second_effect_gain(baseline.problem, fits, second) if gaining else 0.0
    gaining = [pair for pair in gaining if best.bic - pair.bic > needed]
    return shortlist(gaining, baseline.problem.settings.selection.partners)


def two_effect_thresholds(baseline: Baseline, fits: Sequence[Fit], limits: Thresholds) -> Thresholds:
    """The thresholds for hypotheses of more effects, with the best single one there.

    The numerics may matter more where it is there: a joint that was ideal hits and slides. What other numerics change
    there, beyond what nuisances can take up, may remain and is no sign of a second effect, as long as it is a small
    part of what the effect explains; of more than that, the small part is what a second effect has to gain.
    """
    best = _best_alone(fits)
    if best is None or baseline.base.in_windows:
        return limits
    nuisances = orthonormal(baseline.base.jacobian)
    try:
        changes = other_numerics(baseline.problem, best)
    except (InputError, SimulationError):
        return limits
    changed = float(max((np.sum((row - nuisances @ (nuisances.T @ row)) ** 2) for row in changes), default=0.0))
    small = (1.0 - baseline.problem.settings.decision.min_explained_share) * (baseline.base.chi2 - best.chi2)
    gain, omnibus = max(limits.max_gain_threshold, min(changed, small)), limits.omnibus
    if limits.max_gain_threshold < changed <= small:
        omnibus += changed / best.residual.size
    return replace(limits, max_gain_threshold=gain, omnibus=omnibus)


def second_effect_gain(problem: Problem, fits: Sequence[Fit], second: Thresholds) -> float:
    """What a second effect has to gain [BIC] by thresholds from `two_effect_thresholds`: where a single one is
    sufficient, more than fits gain by ending on either side of a jump (`nonlinearity`)."""
    best = _best_alone(fits)
    is_sufficient = best is not None and reduced_chi2(best) <= second.omnibus
    return max(second.max_gain_threshold, nonlinearity(problem, best) if is_sufficient else 0.0)


def _best_alone(fits: Sequence[Fit]) -> Fit | None:
    alone = [fit for fit in fits if fit.status != FAILED and len(fit.hypothesis) == 1]
    return min(alone, key=lambda fit: fit.chi2, default=None)


def nonlinearity(problem: Problem, fit: Fit) -> float:
    """How far chi2, one standard error off, is from what residuals as far to the other side predict; the largest.

    Where an impact comes or does not come, chi2 jumps by more than parameters change it otherwise, and a fit ends on
    either side of the jump: smaller differences between fits say nothing. 0 where residuals depend on parameters
    linearly. Parameters at a bound, and those of single runs, are left out.

    In units of chi2; `fit` is one to the `problem`.
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
    """The `fit` to the problem of the `baseline`, with its Jacobian made anew at the end; as it is with its draws."""
    if fit.status == FAILED or fit.draws is not None or fit.in_windows:
        return fit
    problem, differences = baseline.problem, baseline.differences
    return fit_hypothesis(problem, fit.hypothesis, fit.mapping, differences=differences, refresh=True)


def refit_and_decide(baseline: Baseline, signatures: Signatures, fits: Sequence[Fit], limits: Thresholds) -> Decision:
    """The verdict of the fits (`jointgap.identification.verdict`), the best of each hypothesis.

    A hypothesis must not win by having found a deeper valley of parameters that all share. So no fit stays above that
    of a part of it, and the base is fitted again from the nuisances of what beats it by more than its effects account
    for. Where the motion never repeats, base and leading fits are regressed over ensembles.

    Arguments as in `select_hypothesis`.
    """
    problem, base = baseline.problem, baseline.base
    settings = problem.settings.decision
    second = two_effect_thresholds(baseline, fits, limits)
    limits = replace(second, max_gain_threshold=limits.max_gain_threshold)
    lowest = lowest_of_each(fits)
    needed = max(settings.min_delta_bic, limits.max_gain_threshold)
    base = _where_effects_are(baseline, sorted(lowest, key=lambda fit: fit.bic), needed)
    if problem.has_statistics:
        base, lowest = leading_over_ensembles(problem, base, lowest)
    best = none_above_its_parts(baseline, [base, *lowest], limits)
    subspaces = SignatureSubspaces(signatures, problem.settings.screening)
    best = without_repetitions(best, subspaces.is_special_case, settings.min_delta_bic)
    bounds = {p.name: (p.nominal, p.low, p.high) for p in problem.nuisances}
    order_in_words = orders_of_cranks(problem.parts, problem.settings.screening)
    rows = []
    for fit in best.values():
        similarity = 0.0 if fit.status == FAILED else subspaces.nearest(fit.hypothesis)[1]
        rows.append(row_of(fit, bounds, settings, order_in_words, similarity))

    def is_special_case(special: Row, general: Row) -> bool:
        return subspaces.is_special_case(special.fit.hypothesis, general.fit.hypothesis)

    evidence = Evidence(row_of(base), row_of(baseline.nominal), rows, limits, is_special_case=is_special_case)
    said = verdict(replace(evidence, second_effect_gain=second.max_gain_threshold), settings)
    if said.proposed is None or len(said.proposed.hypothesis) < 2:
        return said
    return verdict(replace(evidence, second_effect_gain=second_effect_gain(problem, fits, second)), settings)


def swap_one_effect(baseline: Baseline, signatures: Signatures, fits: Sequence[Fit]) -> list[Fit]:
    """Fits of the pairs that differ from the best one in one effect, as far as they are not among `fits`.

    One of two effects may stand for another as long as the second is not beside it, and lead to the wrong pair. Others
    are sought in the valley of the pair: a fit of the effect that is kept alone may end in another one, and from there
    none leads back.
    Arguments as in `select_hypothesis`.
    """
    best = _best(fits)
    if best is None or len(best.hypothesis) < 2 or best.in_windows:
        return []
    problem, differences = baseline.problem, baseline.differences
    done, swapped = {labels_of(fit.hypothesis) for fit in fits}, []
    for kept in best.hypothesis:
        rest = without_other_effects(problem, best, (kept,))
        partners = SignatureRegression(signatures.about(rest), rest.hypothesis).singles()
        for pair in shortlist(partners, problem.settings.selection.partners):
            if labels_of(pair.hypothesis) not in done:
                done.add(labels_of(pair.hypothesis))
                start = rest.mapping | pair.start
                swapped.append(fit_hypothesis(problem, pair.hypothesis, start, differences=differences))
    return swapped


def fit_look_alikes(baseline: Baseline, signatures: Signatures, best: Fit) -> list[Fit]:
    """Fits of all that could stand for one effect of the best explanation, from its nuisances: of candidates whose
    signature beside the nuisances is like that of the effect.

    A fit from the base's nuisances may have ended early, or in another valley, and the search ends at the first
    explanation that is sufficient: it need not be the true one.
    Arguments as in `select_hypothesis`; `best` is what it would name.
    """
    problem, found = baseline.problem, []
    subspaces = SignatureSubspaces(signatures, problem.settings.screening)
    for out in best.hypothesis:
        if out.label not in subspaces.of or best.in_windows:
            continue
        rest = without_other_effects(problem, best, tuple(one for one in best.hypothesis if one is not out))
        space, regression = subspaces.span([out.label]), SignatureRegression(signatures.about(rest), rest.hypothesis)
        for other in regression.singles():
            label = other.hypothesis[-1].label
            if label == out.label or subspaces.cosine(space, label) <= problem.settings.selection.alike_cosine:
                continue
            known = signatures.derivatives(other.signatures) | derivatives_of(best)
            start = rest.mapping | other.start
            found.append(fit_hypothesis(problem, other.hypothesis, start, known, baseline.differences))
    return found


def fits_beyond_bounds(baseline: Baseline, fits: Sequence[Fit]) -> list[Fit]:
    """Where the best explanation has a nuisance at its bound: fits of the effect that takes it beyond, in place of each
    of two effects or of the only one, as far as they are not among `fits`; as many as the settings have `partners`.

    A nuisance that wants to go further tells of what derivatives about another valley do not: with loose joints a pair
    with the gain of a sensor was best, and the slider's mass at its bound; hidden was an added mass.
    Arguments as in `select_hypothesis`.
    """
    best = _best(fits)
    if best is None or not best.hypothesis or best.in_windows or best.bic >= baseline.base.bic:
        return []
    problem, done = baseline.problem, {labels_of(fit.hypothesis) for fit in fits}
    beyond = {labels_of(each): each for each in _beyond_bounds(problem, best) if labels_of(each) not in done}
    return [
        fitted(problem, each, with_effects_absent(problem, each, best), differences=baseline.differences)
        for each in list(beyond.values())[: problem.settings.selection.partners]
    ]


def _best(fits: Sequence[Fit]) -> Fit | None:
    return min((fit for fit in fits if fit.status != FAILED), key=lambda fit: fit.bic, default=None)


def _beyond_bounds(problem: Problem, best: Fit) -> Iterator[Hypothesis]:
    """The hypothesis of a fit, each effect in turn replaced by one that takes a nuisance at its bound beyond that."""
    ends = {p.name: (p, value) for p, value in zip(best.parameters, best.values, strict=True) if p.run is None}
    ends = {name: value - p.nominal for name, (p, value) in ends.items() if not p.low < value < p.high}
    for name, candidate in product(ends, problem.model.candidates):
        if name not in candidate.replaces:
            continue
        amplitude = next(each for each in candidate.coordinates if each.key == candidate.replaces[name])
        if amplitude.low < ends[name] < amplitude.high:  # else it ends there too
            for out in best.hypothesis:
                kept = tuple(one for one in best.hypothesis if one is not out)
                if not any({*candidate.replaces} & {*one.replaces} for one in kept):
                    yield (*kept, candidate)


def none_above_its_parts(baseline: Baseline, fits: Sequence[Fit], limits: Thresholds) -> dict[frozenset[str], Fit]:
    """Those of the `fits` that have effects, by their labels.

    Where a part of a hypothesis ended lower, it is fitted on to the problem of the `baseline` from there; not for long
    where it is far behind one that is sufficient by the `limits`.
    """
    done: list[Fit] = []
    sufficient = min((fit.chi2 for fit in fits if reduced_chi2(fit) <= limits.omnibus), default=np.inf)
    for fit in sorted(fits, key=lambda fit: len(fit.hypothesis)):
        done.append(not_above_its_parts(baseline.problem, baseline.differences, fit, done, sufficient))
    return {labels_of(fit.hypothesis): fit for fit in done if fit.hypothesis}


def without_repetitions(
    best: Mapping[frozenset[str], Fit], is_special_case: Callable[[Hypothesis, Hypothesis], bool], apart: float
) -> dict[frozenset[str], Fit]:
    """The fits but those that predict what a simpler one does that is a limit of theirs: both are one explanation.

    A spring so soft that its force hardly changes is a constant force.
    """
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
    """The base, fitted from the nuisances of the best `ranked` fits as long as their effects account for too little.

    That is less than is `needed` for a name [BIC], or than a good share of what they gain over the base: they owe the
    rest to their nuisances, which the base has too.
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


def select_hypothesis(baseline: Baseline, signatures: Signatures, fits: Sequence[Fit], limits: Thresholds) -> Decision:
    """Choose among the fits; what is chosen is fitted once more to its end, for its intervals.

    What leaving out one of two effects costs is the fit of the other alone, at its best: before two effects are named
    each is fitted alone once more, from the nuisances of the pair and from other starts, and is open to choice like all
    others. So it is of the best pair where that is not admissible: one of its effects may be there without the other.
    Before anything is named, all that looks like it is fitted from its nuisances (`fit_look_alikes`).

    Where more than noise is left, errors of what is stated hold another end of its fits that is as good: chi2 has
    valleys, and the deepest one that was found need not be that of the truth.
    """
    fits, given = [*fits, *fits_beyond_bounds(baseline, fits)], baseline.base
    found = fits = [*fits, *swap_one_effect(baseline, signatures, fits)]
    decision, done = refit_and_decide(baseline, signatures, fits, limits), set()
    while further := _needed(baseline, signatures, decision, done):
        baseline = replace(baseline, base=decision.base)
        fits, found = [*(row.fit for row in decision.ranking), *further], [*found, *further]
        decision = refit_and_decide(baseline, signatures, fits, limits)

    def stated(fit: Fit) -> Fit:
        fit = with_intervals(baseline.problem, refit_jacobian(baseline, fit))
        return with_other_ends(fit, found)

    base = decision.base if decision.base is given else refit_jacobian(baseline, decision.base)
    if decision.verdict == PARAMETERS_ONLY:  # else something is missing, and its parameters are not to be believed
        base = with_intervals(baseline.problem, base)
    chosen = base if decision.chosen is decision.base else decision.chosen
    chosen = stated(chosen) if chosen.hypothesis else chosen
    equivalent = [stated(fit) for fit in decision.equivalent]
    best_known = stated(decision.best_known) if decision.best_known else None
    return replace(decision, chosen=chosen, base=base, equivalent=equivalent, best_known=best_known)


def _needed(baseline: Baseline, signatures: Signatures, decision: Decision, done: set[tuple[str, str]]) -> list[Fit]:
    """Fits of what a decision needs that is not `done` yet; then it is."""
    fits = []
    for kind, label, fit in decision.needs:
        if (kind, label) not in done:
            done.add((kind, label))
            fits += _fit_alone(baseline, fit, label) if kind == ALONE else fit_look_alikes(baseline, signatures, fit)
    return fits


def _fit_alone(baseline: Baseline, pair: Fit, label: str) -> list[Fit]:
    """Fits of one effect of a pair alone, from its nuisances and from nominal ones that all runs share."""
    kept = tuple(candidate for candidate in pair.hypothesis if candidate.label == label)
    own = {key: value for key, value in pair.mapping.items() if "." not in key or key.startswith(f"{label}.")}
    shared = {p.key: p.nominal for p in baseline.problem.nuisances if p.run is None and p.key in own}
    starts = own, own | shared
    starts = starts[:1] if pair.in_windows else starts
    return [fitted(baseline.problem, kept, start, differences=baseline.differences) for start in starts]


def with_other_ends(fit: Fit, others: Sequence[Fit]) -> Fit:
    """The `fit`; where it leaves more than noise, with the farthest end of those `others` of the same hypothesis that
    leave hardly more as a shift of its values."""
    settings, noise = fit.settings.decision, fit.residual.size - len(fit.parameters)
    if fit.status == FAILED or reduced_chi2(fit) <= settings.noise_gap**2:
        return fit
    labels, most = labels_of(fit.hypothesis), noise + (fit.chi2 - noise) / settings.max_share_of_wrong_misfit
    as_good = (other for other in others if labels_of(other.hypothesis) == labels and other.chi2 <= most)
    ends = [np.array([other.mapping[p.key] for p in fit.parameters]) - fit.values for other in as_good]
    if not ends:
        return fit
    errors = np.sqrt(np.diag(fit.covariance()))
    farthest = max(ends, key=lambda end: np.max(np.abs(end[errors > 0.0]) / errors[errors > 0.0], initial=0.0))
    return replace(fit, shifts=np.vstack([*([] if fit.shifts is None else [fit.shifts]), farthest]))
