"""Search for a force law: the sum of one or two library terms that fits best in the simulation.

The model's library has one candidate for each term, with its coefficient as the only coordinate,
such as ``discovered_slider_force[v^3]``. Measurements are not differentiated.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jointgap.core.candidates import Candidate
from jointgap.identification.baseline import with_intervals
from jointgap.identification.evidence import reduced_chi2, weigh_fit
from jointgap.identification.fit import FAILED, FiniteDifferences, Fit, fit_hypothesis
from jointgap.identification.initial_fit import fit_screened, without_other_effects
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.screening import (
    LinearizedFit,
    Sensitivity,
    SensitivityRegression,
    shortlist,
    simulate_sensitivities,
)
from jointgap.identification.settings import IdentificationSettings, ModelSelectionSettings
from jointgap.identification.verdict import Decision, Row, Thresholds

COEFFICIENTS = ("c1", "c2")
"""Names of the coefficients in a formula."""


@dataclass(frozen=True)
class Law:
    """A sum of terms of a library."""

    effect: str  # Such as ``discovered_slider_force``
    site: str  # Such as ``slider``
    terms: Mapping[str, str]  # By coefficient, in the syntax of `jointgap.core.formula`, SI
    coefficients: Mapping[str, float]
    keys: Mapping[str, str]  # Parameter keys of a fit by coefficient

    @property
    def formula(self) -> str:
        """``c1*v^3 + c2*x``."""
        return " + ".join(_product(name, term) for name, term in self.terms.items())

    @property
    def words(self) -> str:
        """``slider force = -3.21*v^3 + 40*x``, SI."""
        text = " + ".join(
            _product(f"{self.coefficients[name]:.4g}", term) for name, term in self.terms.items()
        )
        return (
            f"{self.effect.removeprefix('discovered_').replace('_', ' ')} ="
            f" {text.replace('+ -', '- ')}"
        )


@dataclass(frozen=True)
class ForceLawResult:
    """Result of the search."""

    fit: (
        Fit | None
    )  # The best sum, or listed effects that explain as much, fitted together with the nuisances
    accepted: bool
    because: str  # The reason
    rivals: list[Fit] = field(default_factory=list)  # Equivalent laws, best first
    others: list[Fit] = field(
        default_factory=list
    )  # Other simulated laws, best first, the failed ones last
    failed: Mapping[str, str] = field(
        default_factory=dict
    )  # Reasons of terms that could not be simulated
    ranking: list[Row] = field(default_factory=list)  # All simulated laws

    @property
    def named(self) -> bool:
        """Whether the law is accepted and has no equivalent."""
        return self.accepted and not self.rivals

    @property
    def verdict(self) -> str:
        """``named``, ``named_with_remaining_misfit`` or ``unexplained``."""
        if not self.named:
            return "unexplained"
        return "named" if self.ranking[0].passes else "named_with_remaining_misfit"

    @property
    def reason(self) -> str:
        """The reason of the verdict."""
        if not self.accepted:
            return self.because
        if self.rivals:
            equal = ", ".join(fit.label for fit in (self.fit, *self.rivals))
            return f"several laws fit the data equally well: {equal}"
        if self.law is None:
            return f"{self.fit.label} was found by a formula: {self.because}"
        return f"no listed effect explains the residual, but {self.law.words} does: {self.because}"

    @property
    def law(self) -> Law | None:
        """The best sum as a formula; None for a listed effect."""
        is_sum = self.fit is not None and all(
            "[" in candidate.name for candidate in self.fit.hypothesis
        )
        return law_of(self.fit.hypothesis, self.fit.mapping) if is_sum else None


def find_force_law(
    problem: Problem,
    base: Fit,
    library: Sequence[Candidate],
    limits: Thresholds,
    differences: FiniteDifferences | None = None,
) -> ForceLawResult:
    """Find the best law with at most two terms of one effect.

    All sums are ranked by linear regression. The best are fitted by forward simulation, from the
    best multiple of the linear estimate, and compared by the extended BIC, which counts the number
    of possible sums (Chen and Chen, Biometrika 95 (2008) 759-771). A second term must improve it by
    `min_delta_bic`. Listed effects that explain as much within the minimum of an accepted sum take
    its place: the search over them may have missed that minimum.
    """
    differences = differences or FiniteDifferences(problem)
    min_delta_bic = problem.settings.decision.min_delta_bic
    sensitivities = simulate_sensitivities(problem, base, differences, library)
    limit = problem.limit("sums of two terms of a force law")
    screen, settings = SensitivityRegression(sensitivities), problem.settings.selection
    sums = [screen.explained(chosen) for chosen in _subsets(sensitivities.entries)]
    if not sums:
        because = "no term of the library could be simulated or changes what was measured"
        return ForceLawResult(None, False, because, failed=sensitivities.failed)
    counts = {
        size: sum(len(candidate.sensitivities) == size for candidate in sums)
        for size in range(1, len(COEFFICIENTS) + 1)
    }

    def choice_cost(hypothesis: Hypothesis) -> float:
        """[BIC] Penalty for the number of sums with as many terms."""
        return 2.0 * math.log(counts[len(hypothesis)])

    sums.sort(key=lambda screened: screened.bic)

    def each(chosen: Sequence[LinearizedFit]) -> list[Fit]:
        return [fit_screened(problem, differences, sensitivities, screened) for screened in chosen]

    fits = each(_singles(sums, settings))
    if not fits:
        return ForceLawResult(None, False, "no law could be simulated", failed=sensitivities.failed)
    alone = min(fits, key=lambda fit: fit.bic)
    if not limit.reached():
        fits += each(_pairs(sums, alone, reduced_chi2(alone) <= limits.omnibus, settings))
    cost = {fit.label: fit.bic + choice_cost(fit.hypothesis) for fit in fits}
    fits.sort(key=lambda fit: cost[fit.label])
    best = fits[0]
    if best.status == FAILED:
        return ForceLawResult(
            None,
            False,
            best.reason,
            [],
            fits,
            sensitivities.failed,
            [weigh_fit(base, fit, limits) for fit in fits],
        )
    best = next(
        (
            fit
            for fit in fits
            if len(fit.hypothesis) == 1 and cost[fit.label] - cost[best.label] < min_delta_bic
        ),
        best,
    )
    rest = [fit for fit in fits if fit is not best]
    rivals = [
        fit
        for fit in rest
        if cost[fit.label] - cost[best.label] < min_delta_bic and _differs(fit, best, base)
    ]
    accepted, because = _gate(base, best, cost[best.label], limits, problem.settings)
    others = [fit for fit in rest if fit not in rivals]
    if accepted and (listed := _listed(problem, base, best, limits, differences)):
        others = [best, *rivals, *others]
        best, rivals = (
            listed[0],
            [fit for fit in listed[1:] if fit.bic < listed[0].bic + min_delta_bic],
        )
        _, because = _gate(base, best, best.bic, limits, problem.settings)
    best = fit_hypothesis(
        problem, best.hypothesis, best.mapping, differences=differences, refresh=True
    )
    best = with_intervals(problem, best)
    ranking = [weigh_fit(base, fit, limits) for fit in (best, *rivals, *others)]
    return ForceLawResult(best, accepted, because, rivals, others, sensitivities.failed, ranking)


def with_force_law(decision: Decision, result: ForceLawResult) -> Decision:
    """The decision after the search for a force law.

    The law is named if it is accepted and has no rival; else it is the best known explanation if it
    is better. A listed effect that the search fits again replaces its earlier fit in the ranking.
    """
    labels, law = {row.label for row in result.ranking}, result.fit
    ranking = [row for row in decision.ranking if row.label not in labels] + result.ranking
    if result.named:
        return replace(
            decision,
            verdict=result.verdict,
            because=result.reason,
            chosen=law,
            best_known=None,
            equivalent=[],
            certain=(),
            ranking=ranking,
        )
    best = decision.best_known
    min_delta_bic = decision.base.settings.decision.min_delta_bic
    limit = best.bic if best else decision.base.bic - min_delta_bic
    if law is not None and law.bic < limit:
        best = law
    because = f"{decision.because}; {result.reason}"
    return replace(decision, because=because, ranking=ranking, best_known=best)


def law_of(hypothesis: Hypothesis, values: Mapping[str, float]) -> Law:
    """Terms of a library as one formula."""
    named = dict(zip(COEFFICIENTS, hypothesis, strict=False))
    keys = {
        name: f"{candidate.label}.{candidate.amplitudes[0]}" for name, candidate in named.items()
    }
    terms = {name: term_of(candidate) for name, candidate in named.items()}
    coefficients = {name: values[key] for name, key in keys.items()}
    return Law(effect_of(hypothesis[0]), hypothesis[0].site, terms, coefficients, keys)


def effect_of(candidate: Candidate) -> str:
    """The effect of a library term."""
    return candidate.name.partition("[")[0]


def term_of(candidate: Candidate) -> str:
    return candidate.name.partition("[")[2].removesuffix("]")


def _product(coefficient: str, term: str) -> str:
    return coefficient if term == "1" else f"{coefficient}*{term}"


def _subsets(sensitivities: Sequence[Sensitivity]) -> Iterator[tuple[Sensitivity, ...]]:
    """All possible sets of terms of one effect."""
    for size in range(1, len(COEFFICIENTS) + 1):
        for chosen in itertools.combinations(sensitivities, size):
            if len({effect_of(sensitivity.candidate) for sensitivity in chosen}) == 1:
                yield chosen


def _singles(
    sums: Sequence[LinearizedFit], settings: ModelSelectionSettings
) -> list[LinearizedFit]:
    """The best single terms, including some of each effect; `sums` is best first."""
    singles = [screened for screened in sums if len(screened.sensitivities) == 1]
    chosen = singles[: settings.max_singles]
    for effect in dict.fromkeys(effect_of(screened.hypothesis[0]) for screened in singles):
        of_effect = [
            screened for screened in singles if effect_of(screened.hypothesis[0]) == effect
        ]
        chosen += [
            screened for screened in of_effect[: settings.partners] if screened not in chosen
        ]
    return chosen


def _pairs(
    sums: Sequence[LinearizedFit], alone: Fit, sufficient: bool, settings: ModelSelectionSettings
) -> list[LinearizedFit]:
    """The best pairs with the best single term, and the best others unless it is sufficient; `sums`
    is best first."""
    pairs = [screened for screened in sums if len(screened.sensitivities) > 1]
    adding = [
        screened
        for screened in pairs
        if {c.label for c in alone.hypothesis} < {c.label for c in screened.hypothesis}
    ]
    chosen = adding[: settings.partners]
    return (
        chosen
        if sufficient
        else chosen + [pair for pair in pairs[: settings.max_singles] if pair not in chosen]
    )


def _listed(
    problem: Problem, base: Fit, formula: Fit, limits: Thresholds, differences: FiniteDifferences
) -> list[Fit]:
    """Fits of listed effects, as many as the formula has terms, that explain as much from its
    nuisances and are accepted, best first."""
    without = without_other_effects(problem, formula, ())
    without = replace(without, residual=problem.residual(without.mapping))
    about = simulate_sensitivities(problem, without, differences)
    regression = SensitivityRegression(about)
    ranked = regression.singles() if len(formula.hypothesis) == 1 else regression.pairs()
    chosen = shortlist(ranked, problem.settings.selection.partners)
    fits = [
        fit_screened(problem, differences, about, screened, formula.chi2) for screened in chosen
    ]
    bounds = {p.name: (p.nominal, p.low, p.high) for p in problem.nuisances}
    most = formula.bic + problem.settings.decision.min_delta_bic
    equal = [
        fit for fit in fits if fit.bic < most and weigh_fit(base, fit, limits, bounds).admissible
    ]
    accepted = [fit for fit in equal if _gate(base, fit, fit.bic, limits, problem.settings)[0]]
    return sorted(accepted, key=lambda fit: fit.bic)


def _differs(fit: Fit, best: Fit, base: Fit) -> bool:
    """Whether a sum is another law than the best one, not an equivalent form or an extension."""
    if {c.label for c in fit.hypothesis} > {c.label for c in best.hypothesis}:
        return False
    another = effect_of(fit.hypothesis[0]) != effect_of(best.hypothesis[0])
    apart, change = (np.sum((one.residual - best.residual) ** 2) for one in (fit, base))
    return another or bool(apart > (1.0 - base.settings.decision.sure_explained_share) * change)


def _gate(
    base: Fit, best: Fit, cost: float, limits: Thresholds, settings: IdentificationSettings
) -> tuple[bool, str]:
    """Whether a law is accepted, and why."""
    ranked = weigh_fit(base, best, limits)
    if base.bic - cost < max(settings.decision.min_delta_bic, limits.max_gain_threshold):
        return False, f"the best sum, {best.label}, is not significant"
    if ranked.passes:
        return True, "with it the residual is consistent with noise"
    if ranked.share >= settings.decision.sure_explained_share:
        return True, f"it explains {ranked.share:.1%} of the misfit"
    return False, f"the best sum, {best.label}, explains only {ranked.share:.1%} of the misfit"
