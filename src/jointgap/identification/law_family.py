"""Profile likelihood over the shape of a law family.

An effect such as quadratic drag is one shape of a family, here drag with any exponent
(`jointgap.core.candidates.LawFamily`). Once it is found, chi2 is profiled over the shape to see
which shapes fit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.stats import chi2 as chi_squared

from jointgap.core.candidates import Candidate, LawFamily
from jointgap.core.errors import InputError, SimulationError
from jointgap.identification.baseline import Baseline, with_intervals
from jointgap.identification.evidence import weigh_fit
from jointgap.identification.fit import (
    CONVERGED,
    FAILED,
    FiniteDifferences,
    Fit,
    coordinate_estimate,
)
from jointgap.identification.likelihood import fitted
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.screening import orthonormal
from jointgap.identification.verdict import (
    AMBIGUOUS,
    NAMED,
    NAMED_WITH_REMAINING_MISFIT,
    UNEXPLAINED,
    Decision,
    Row,
    Thresholds,
)


@dataclass(frozen=True)
class ShapeProfile:
    """Profile of chi2 over the shape of a law."""

    shapes: np.ndarray  # [1] Increasing
    chi2: np.ndarray  # Of the fits, over the inflation of the variance

    def interval(self, rise: float) -> tuple[float, float]:
        """The interval [1] of shapes within which chi2 rises by less than `rise`, by linear
        interpolation of the root of the rise; at most the whole profile."""
        root = np.sqrt(self.chi2 - self.chi2.min())
        lowest = int(np.argmin(root))
        ends = []
        for side in (slice(lowest, None, -1), slice(lowest, None)):
            shapes, roots = self.shapes[side], root[side]
            outside = np.flatnonzero(roots > np.sqrt(rise))
            if not outside.size:
                ends.append(float(shapes[-1]))
                continue
            j = int(outside[0])
            share = (np.sqrt(rise) - roots[j - 1]) / (roots[j] - roots[j - 1])
            ends.append(float(shapes[j - 1] + share * (shapes[j] - shapes[j - 1])))
        return ends[0], ends[1]


def fit_shape(
    problem: Problem,
    found: Fit,
    member: Candidate,
    family: LawFamily,
    differences: FiniteDifferences | None = None,
) -> Fit:
    """Fit the law of a family including its shape, in place of the `member` in the fit `found`.

    Starts are tried until a fit converges: the member's shape, then the next ones in use. If
    parameters are inactive at the member's shape, the others in use with each initial guess of the
    law, the most promising first, at most `tried_starts`.
    """
    hypothesis, at = _with_law(found, member, family)
    keys = {
        name: f"{family.law.label}.{name}"
        for name in (family.shape, *(family.law.initial_guesses or ({},))[0])
    }
    if found.in_windows and not family.inactive_at_default:
        # at the member's shape the law is the found effect: only the end of the fit is repeated
        start = at | {keys[family.shape]: family.effect_shape}
        return fitted(problem, hypothesis, start, near=found, vary=problem.parameters(hypothesis))
    shapes = sorted(family.known_shapes, key=lambda shape: abs(shape - family.effect_shape))
    guesses = [
        {**guess, family.shape: shape}
        for shape in shapes
        for guess in family.law.initial_guesses or ({},)
    ]
    starts = [at | {keys[name]: value for name, value in guess.items()} for guess in guesses]
    if family.inactive_at_default:
        starts = [start for start in starts if start[keys[family.shape]] != family.effect_shape]
        starts.sort(key=lambda start: _chi2_at(problem, hypothesis, start))
        starts = starts[: problem.settings.family.tried_starts]
    fits: list[Fit] = []
    for start in starts:
        fits.append(
            fitted(problem, hypothesis, start, differences=differences, refresh=True, near=found)
        )
        if fits[-1].status == CONVERGED:
            break
    return min(fits, key=lambda fit: fit.chi2)


def _chi2_at(problem: Problem, hypothesis: Hypothesis, values: Mapping[str, float]) -> float:
    try:
        residual = problem.residual(values, hypothesis)
    except (InputError, SimulationError):
        return np.inf
    return float(residual @ residual)


def profile_shape(
    problem: Problem, free: Fit, family: LawFamily, differences: FiniteDifferences | None = None
) -> ShapeProfile | None:
    """Profile chi2 over the shape, outward from the best value until the interval or the range
    ends.

    The first step is half the interval of the linear model, further ones extrapolate the root of
    the rise. In windows, where fits are expensive, chi2 is approximated by a parabola.
    """
    settings, place = problem.settings.family, _place(free, family)
    shape = free.parameters[place]
    centre, variance = float(free.values[place]), free.covariance(released=(place,))[place, place]
    vary = tuple(p for p in free.parameters if p.key != shape.key)
    chi2, rise = {centre: free.chi2}, rise_to_exclude(family, settings.level)
    if free.in_windows:
        away = np.sqrt(rise * variance) * np.array([-1.1, 0.0, 1.1])
        shapes = np.clip(centre + away, shape.low, shape.high)
        return ShapeProfile(shapes, free.chi2 / free.inflation + (shapes - centre) ** 2 / variance)
    for sign, end in ((-1.0, shape.low), (1.0, shape.high)):
        before, value, largest = free, centre, settings.largest_step
        step = settings.overshoot * float(np.sqrt(rise * variance))
        while value != end and chi2[value] <= min(chi2.values()) + rise * free.inflation:
            step = float(np.clip(step, settings.least_step, largest))
            value = float(np.clip(value + sign * step, shape.low, shape.high))
            known = {
                p.key: column
                for p, column in zip(before.parameters, before.jacobian.T, strict=True)
            }
            start = before.mapping | {shape.key: value}
            fit = fitted(
                problem, free.hypothesis, start, known, differences, vary=vary, near=before
            )
            if fit.status == FAILED:
                return None
            chi2[value], before, largest = fit.chi2, fit, 2.0 * largest
            risen = max(fit.chi2 - min(chi2.values()), 1e-3 * rise * free.inflation)
            step = abs(value - centre) * (
                settings.overshoot * np.sqrt(rise * free.inflation / risen) - 1.0
            )
    shapes = np.array(sorted(chi2))
    return ShapeProfile(shapes, np.array([chi2[value] for value in shapes]) / free.inflation)


def shape_interval(profile: ShapeProfile, family: LawFamily, level: float) -> tuple[float, float]:
    """The interval of the shape [1]; it contains the member's shape unless the data exclude that.

    Parameters that are inactive at the member's shape add degrees of freedom there (R. B. Davies,
    Biometrika 74 (1987) 33-43, has the exact law).
    """
    low, high = profile.interval(float(chi_squared.ppf(level, 1)))
    least, most = profile.interval(rise_to_exclude(family, level))
    if least <= family.effect_shape <= most:
        low, high = min(low, family.effect_shape), max(high, family.effect_shape)
    return low, high


def rise_to_exclude(family: LawFamily, level: float) -> float:
    """Rise of chi2 at the member's shape that excludes it at a `level` [1]."""
    return float(chi_squared.ppf(level, 1 + family.inactive_at_default))


def _place(free: Fit, family: LawFamily) -> int:
    """Index of the shape among the parameters of a fit."""
    key = f"{family.law.label}.{family.shape}"
    return [p.key for p in free.parameters].index(key)


@dataclass(frozen=True)
class FamilyInterval:
    """Interval of the shape of a family."""

    effect: str  # Label of the found effect
    law: str  # Label of the family's law
    shape: str  # Name of the shape parameter
    value: float  # [1] The fitted shape
    low: float  # [1] 99 % interval
    high: float  # [1] 99 % interval
    fits: bool  # Whether it contains the shape of the effect
    alone: (
        bool  # Whether it contains no other common shape: then the effect is named, not the family
    )


def with_families(
    baseline: Baseline, decision: Decision, limits: Thresholds
) -> tuple[Decision, tuple[FamilyInterval, ...]]:
    """The decision with the shapes of its law families tested, and their intervals.

    - If the interval excludes the found effect, the best family law replaces it.
    - If nothing is named, or with a remaining misfit, or a pair, or several explanations are
      equivalent, the laws of these explanations and of the best single effect of each family are
      tried. The best one that is better and consistent with noise is named; equivalent ones are
      ambiguous.
    - Other effects are removed if they no longer gain significantly.
    - If all equivalent explanations are members of one family, the family is named.
    - Two members of one family in an explanation are not changed.
    """
    problem = baseline.problem
    equal = decision.equivalent if _is_one_family(problem, decision.equivalent) else []
    is_pair = decision.verdict == NAMED and len(decision.chosen.hypothesis) > 1
    if not equal and (
        is_pair or decision.verdict in (UNEXPLAINED, NAMED_WITH_REMAINING_MISFIT, AMBIGUOUS)
    ):
        settings = baseline.problem.settings
        best = (
            min(fit.bic for fit in (decision.chosen, *decision.equivalent))
            - settings.decision.min_delta_bic
        )
        laws, limit = [], problem.limit("shapes of law families")
        for found, member, family in _unproven(problem, decision, settings.family.least_share):
            if limit.reached():
                break
            fit = fit_shape(baseline.problem, found, member, family, baseline.differences)
            if fit.bic > best or not _weighed(baseline, decision, fit, limits).passes:
                continue
            fit, interval = _asked(baseline, member, family, fit, limits)
            is_named = _weighed(baseline, decision, fit, limits).admissible
            if is_named and interval is not None and not interval.fits:
                laws.append((fit, interval))
        laws.sort(key=lambda law: law[0].bic)
        laws = [
            law for law in laws if law[0].bic < laws[0][0].bic + settings.decision.min_delta_bic
        ]
        if len({fit.label for fit, _ in laws}) > 1:
            because, equivalent = (
                "several explanations fit the data equally well",
                [fit for fit, _ in laws],
            )
            others = {"best_known": None, "twins": [], "certain": ()}
            decision = replace(
                decision, verdict=AMBIGUOUS, because=because, equivalent=equivalent, **others
            )
            return decision, tuple(interval for _, interval in laws)
        if laws:
            fit, interval = laws[0]
            return _named(baseline, decision, fit, limits), (interval,)
    if decision.verdict == UNEXPLAINED:
        return decision, ()
    found, intervals = equal[0] if equal else decision.chosen, []
    for member in found.hypothesis:
        asked = []
        for family in (family for each, family in _of_families(problem, found) if each is member):
            if not equal and (interval := _plain_interval(baseline, found, member, family)):
                intervals.append(interval)
                continue
            fit = fit_shape(baseline.problem, found, member, family, baseline.differences)
            if fit.chi2 > found.chi2:
                continue  # another minimum: the law with the member's shape leaves less
            rivals = [
                other.effect_shape
                for fit in equal
                for other in _families(fit)
                if other.law.label == family.law.label
            ]
            asked.append(_asked(baseline, member, family, fit, limits, rivals))
        known = [(fit, interval) for fit, interval in asked if interval is not None]
        if better := [(fit, interval) for fit, interval in known if not interval.fits]:
            found, interval = min(better, key=lambda each: each[0].bic)
            known = [(found, interval)]
        intervals += [interval for _, interval in known]
    if (equal and intervals) or (not equal and found is not decision.chosen):
        decision = _named(baseline, decision, found, limits)
    return decision, tuple(intervals) if decision.verdict != UNEXPLAINED else ()


def _plain_interval(
    baseline: Baseline, found: Fit, member: Candidate, family: LawFamily
) -> FamilyInterval | None:
    """The interval of the shape by linearisation about the fit `found`; None unless twice this
    interval contains the member's shape and no other common one."""
    problem = baseline.problem
    if problem.has_statistics or found.in_windows or found.jacobian.shape[0] != found.residual.size:
        return None
    hypothesis, at = _with_law(found, member, family)
    shape = next(
        p for p in problem.parameters(hypothesis) if p.key == f"{family.law.label}.{family.shape}"
    )
    nuisances, level, ends = orthonormal(found.jacobian), problem.settings.family.level, []
    for guess in family.law.initial_guesses or ({},):
        own = {
            f"{family.law.label}.{name}": value
            for name, value in {**guess, family.shape: family.effect_shape}.items()
        }
        try:
            column = baseline.differences.column(
                shape, at | own, found.residual, hypothesis, fine=True
            )
        except (InputError, SimulationError):
            return None
        column = column - nuisances @ (nuisances.T @ column)
        if not (square := float(column @ column)) > 0.0:
            return None
        value = family.effect_shape - float(column @ found.residual) / square
        half = float(np.sqrt(rise_to_exclude(family, level) * found.inflation / square))
        ends.append((half, value))
    half, value = max(ends)
    low, high = min(value - half for half, value in ends), max(value + half for half, value in ends)
    wide = low - half, high + half
    if not wide[0] <= family.effect_shape <= wide[1] or any(
        wide[0] <= s <= wide[1] for s in family.known_shapes if s != family.effect_shape
    ):
        return None
    low, high = (
        max(shape.low, min(low, family.effect_shape)),
        min(shape.high, max(high, family.effect_shape)),
    )
    return FamilyInterval(
        member.label, family.law.label, family.shape, value, low, high, fits=True, alone=True
    )


def _with_law(
    found: Fit, member: Candidate, family: LawFamily
) -> tuple[Hypothesis, dict[str, float]]:
    """The hypothesis of a fit with the law of a family in place of its `member`, and the same
    values of the law."""
    prefix = f"{member.label}."
    hypothesis = tuple(
        family.law if candidate is member else candidate for candidate in found.hypothesis
    )
    own = {
        name.removeprefix(prefix): value
        for name, value in found.mapping.items()
        if name.startswith(prefix)
    }
    start = {name: value for name, value in found.mapping.items() if not name.startswith(prefix)}
    return hypothesis, start | {
        f"{family.law.label}.{name}": value for name, value in family.values(own).items()
    }


def _unproven(
    problem: Problem, decision: Decision, least_share: float
) -> list[tuple[Fit, Candidate, LawFamily]]:
    """Fits in which a family law is tried, with member and family: the best known or equivalent
    explanations, and of each family the best single effect that explains the `least_share` of the
    misfit.
    """
    single = [
        ranked
        for ranked in decision.ranking
        if len(ranked.fit.hypothesis) == 1 and ranked.admissible
    ]
    alone = [
        ranked.fit
        for ranked in single
        if ranked.share >= least_share and ranked.fit is not decision.best_known
    ]
    known = decision.equivalent if decision.best_known is None else [decision.best_known]
    alone.sort(key=lambda fit: fit.bic, reverse=True)  # the best of each family is the last
    best = {
        family.law.label: (fit, each, family)
        for fit in alone
        for each, family in _of_families(problem, fit)
    }
    return [
        *((fit, each, family) for fit in known for each, family in _of_families(problem, fit)),
        *best.values(),
    ]


def _families(found: Fit) -> list[LawFamily]:
    """The families of all effects of an explanation, with repetitions."""
    return [family for candidate in found.hypothesis for family in candidate.families]


def _of_families(problem: Problem, found: Fit) -> list[tuple[Candidate, LawFamily]]:
    """The effects of an explanation with each family of which they are the only member; none if an
    effect is nonsmooth, as fits cannot follow the profile.
    """
    if not problem.has_statistics and any(candidate.is_nonsmooth for candidate in found.hypothesis):
        return []
    laws = [family.law.label for family in _families(found)]
    pairs = ((candidate, family) for candidate in found.hypothesis for family in candidate.families)
    return [(candidate, family) for candidate, family in pairs if laws.count(family.law.label) == 1]


def _is_one_family(problem: Problem, equivalent: Sequence[Fit]) -> bool:
    """Whether equivalent explanations differ only in the shape of a law."""
    if any(len(_of_families(problem, fit)) < len(_families(fit)) for fit in equivalent):
        return False
    laws = [
        [[f.law.label for f in c.families] or [c.label] for c in fit.hypothesis]
        for fit in equivalent
    ]
    readings = [{tuple(sorted(reading)) for reading in product(*each)} for each in laws]
    return bool(readings) and bool(set.intersection(*readings))


def _asked(
    baseline: Baseline,
    member: Candidate,
    family: LawFamily,
    fit: Fit,
    limits: Thresholds,
    rivals: Sequence[float] = (),
) -> tuple[Fit, FamilyInterval | None]:
    """A fit with the law of a family and its shape interval (None if the profile failed); without
    effects that the law makes redundant, if it excludes the member.

    The interval includes the changes between solver variants, the shapes of `rivals`, and the 99 %
    interval that is stated of the shape as a parameter, so that it holds all its intervals.
    """
    problem = baseline.problem
    profile = fit.status != FAILED and profile_shape(problem, fit, family, baseline.differences)
    if not profile:
        return fit, None
    fit, place = with_intervals(problem, fit), _place(fit, family)
    low, high = shape_interval(profile, family, problem.settings.family.level)
    shift = 0.0 if fit.shifts is None else float(np.abs(fit.shifts[:, place]).max(initial=0.0))
    own = coordinate_estimate(fit, place)["interval_99"]
    rivals = (*rivals, *(end for end in own if end is not None))
    p = fit.parameters[place]
    low, high = (
        max(p.low, min(low - shift, *rivals, low)),
        min(p.high, max(high + shift, *rivals, high)),
    )
    fits = low <= family.effect_shape <= high
    if not fits and (lean := _without_inactive(baseline, fit, family, limits)) is not fit:
        return _asked(baseline, member, family, lean, limits, rivals)
    others = any(
        low <= shape <= high for shape in family.known_shapes if shape != family.effect_shape
    )
    names = member.label, family.law.label, family.shape
    return fit, FamilyInterval(
        *names, float(fit.values[place]), low, high, fits, fits and not others
    )


def _weighed(baseline: Baseline, decision: Decision, fit: Fit, limits: Thresholds) -> Row:
    bounds = {p.name: (p.nominal, p.low, p.high) for p in baseline.problem.nuisances}
    return weigh_fit(decision.base, fit, limits, bounds)


def _named(baseline: Baseline, decision: Decision, found: Fit, limits: Thresholds) -> Decision:
    """The decision that names `found`, or leaves the misfit unexplained if that may not be
    named."""
    ranked = _weighed(baseline, decision, found, limits)
    decision = replace(decision, twins=[], certain=())  # of the earlier explanations
    if not ranked.admissible:
        base, because = decision.base, ranked.objection
        return replace(
            decision,
            verdict=UNEXPLAINED,
            because=because,
            chosen=base,
            equivalent=[],
            best_known=found,
        )
    verdict = NAMED if ranked.passes else NAMED_WITH_REMAINING_MISFIT
    because = (
        "with it the residual is consistent with noise"
        if ranked.passes
        else "it is the best of its family"
    )
    ranking = [ranked, *(each for each in decision.ranking if each.fit.label != found.label)]
    return replace(
        decision,
        verdict=verdict,
        because=because,
        chosen=found,
        equivalent=[],
        best_known=None,
        ranking=ranking,
    )


def _without_inactive(baseline: Baseline, found: Fit, family: LawFamily, limits: Thresholds) -> Fit:
    """The explanation without effects that do not gain significantly with the law of a `family`."""
    problem, differences = baseline.problem, baseline.differences
    needed = max(problem.settings.decision.min_delta_bic, limits.max_gain_threshold)
    for candidate in found.hypothesis:
        rest = tuple(each for each in found.hypothesis if each is not candidate)
        if not rest or candidate is family.law:
            continue
        start = {
            key: value
            for key, value in found.mapping.items()
            if not key.startswith(f"{candidate.label}.")
        }
        fit = fitted(problem, rest, start, differences=differences, refresh=True, near=found)
        if fit.bic - found.bic < needed:
            found = fit
    return found
