"""A force law for what no known effect explains: the sum of one or two terms of a library that fits best when simulated.

The library is the model's: one candidate for each term, called ``effect[term]`` and with its coefficient as the only
coordinate, such as ``discovered_slider_force[v^3]``. Nothing is differentiated: the terms are told apart by what they do to the
simulated measurements, like every other effect.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from jointgap.identification.decision import Ranked, reduced_chi2, weigh
from jointgap.identification.finite_differences import FiniteDifferences
from jointgap.identification.fit import FAILED, Fit, fit_hypothesis
from jointgap.identification.initial_fit import fit_screened
from jointgap.identification.problem import Hypothesis, Problem
from jointgap.identification.protocol import Candidate
from jointgap.identification.screening import Screen, Screened, simulate_signatures
from jointgap.identification.thresholds import Thresholds

COEFFICIENTS = ("c1", "c2")
"""Names of the coefficients in a formula, as many as a law may have terms."""

_SHARE = 0.99  # of the misfit that a law has to explain where it leaves more than noise: it is then within 10 % (rms)
_SAME = 0.1  # laws of one effect whose share in the measurements differs by less are one law in two forms

_FITTED = 6  # of the sums of one size that would explain most if all were linear, so many are simulated
_OF_EACH = 3  # single terms of each effect, and pairs that add to the best one: where joints are loose, the linear order misleads


@dataclass(frozen=True)
class Law:
    """A sum of terms of a library.

    Attributes
    ----------
    effect, site : str
        Such as ``discovered_slider_force`` and ``slider``.
    terms : mapping of str to str
        Of each coefficient its term in the syntax of `jointgap.formula`, SI.
    coefficients : mapping of str to float
        Their values.
    keys : mapping of str to str
        Key of each coefficient among the parameters of a fit.
    """

    effect: str
    site: str
    terms: Mapping[str, str]
    coefficients: Mapping[str, float]
    keys: Mapping[str, str]

    @property
    def formula(self) -> str:
        """``c1*v^3 + c2*x``."""
        return " + ".join(_product(name, term) for name, term in self.terms.items())

    @property
    def words(self) -> str:
        """``slider force = -3.21*v^3 + 40*x``, SI."""
        text = " + ".join(_product(f"{self.coefficients[name]:.4g}", term) for name, term in self.terms.items())
        return f"{self.effect.removeprefix('discovered_').replace('_', ' ')} = {text.replace('+ -', '- ')}"


@dataclass(frozen=True)
class Regressed:
    """What the regression proposes.

    Attributes
    ----------
    fit : Fit or None
        The best sum, simulated and fitted together with the nuisances; None where no sum could be simulated.
    accepted : bool
        Whether it may be reported: it passes the gate of the effects on the list, with a larger share asked of it.
    because : str
        The reason in a sentence.
    rivals : list of Fit
        Other laws that the data cannot tell from it, best first; the same force in another form is none.
    others : list of Fit
        The rest that was simulated, best first, the failed ones last.
    failed : mapping of label to reason
        Terms that could not be simulated.
    ranking : list of Ranked
        All laws that were simulated beside the base: the best one, its rivals, the others.
    """

    fit: Fit | None
    accepted: bool
    because: str
    rivals: list[Fit] = field(default_factory=list)
    others: list[Fit] = field(default_factory=list)
    failed: Mapping[str, str] = field(default_factory=dict)
    ranking: list[Ranked] = field(default_factory=list)

    @property
    def named(self) -> bool:
        """Whether one law is named: it is accepted, and no other explains the data equally well."""
        return self.accepted and not self.rivals

    @property
    def verdict(self) -> str:
        """``named``, ``named_with_remaining_misfit`` or ``unexplained``."""
        if not self.named:
            return "unexplained"
        return "named" if self.ranking[0].passes else "named_with_remaining_misfit"

    @property
    def reason(self) -> str:
        """The reason of the verdict, in a sentence."""
        if not self.accepted:
            return self.because
        if self.rivals:
            equal = ", ".join(fit.label for fit in (self.fit, *self.rivals))
            return f"several laws explain it equally well: {equal}"
        return f"no effect of the list explains it, but {self.law.words} does: {self.because}"

    @property
    def law(self) -> Law | None:
        """The best sum as a formula."""
        return None if self.fit is None else law_of(self.fit.hypothesis, self.fit.mapping)


def regress(
    problem: Problem,
    base: Fit,
    library: Sequence[Candidate],
    limits: Thresholds,
    differences: FiniteDifferences | None = None,
) -> Regressed:
    """Find the law, of at most two terms of one effect, that takes the place of what is missing.

    All sums are ranked by what they would explain if the motion answered linearly. The best are fitted by forward simulation, from
    the multiple of the linear answer that fits best (a loose joint answers to a little force more than in proportion). They are
    compared by BIC with the number of sums that were open to choice counted in (the extended criterion of Chen and Chen,
    Biometrika 95 (2008) 759-771); a second term must improve it by as much as tells two explanations apart.

    Parameters
    ----------
    problem : Problem
    base : Fit
        The model as it stands, nuisances fitted.
    library : sequence of Candidate
        See the module.
    limits : Thresholds
        Of the campaign: the law passes where it leaves no more than they allow, or explains 99 % of the misfit.
    differences : Differences, optional
        Shared with other fits of the problem.

    Returns
    -------
    Regressed
    """
    differences = differences or FiniteDifferences(problem)
    min_delta_bic = problem.settings.decision.min_delta_bic
    known = simulate_signatures(problem, base, differences, library)
    screen = Screen(known)
    sums = [screen.explained(chosen) for chosen in _subsets(known.found)]
    if not sums:
        return Regressed(None, False, "no term of the library could be simulated", failed=known.failed)
    counts = {size: sum(len(one.signatures) == size for one in sums) for size in range(1, len(COEFFICIENTS) + 1)}

    def price(hypothesis: Hypothesis) -> float:
        """What the choice among all sums of so many terms is worth, beside the BIC's own k ln n."""
        return 2.0 * math.log(counts[len(hypothesis)])

    sums.sort(key=lambda one: one.bic)

    def fitted(chosen: Sequence[Screened]) -> list[Fit]:
        return [fit_screened(problem, differences, known, one) for one in chosen]

    fits = fitted(_singles(sums))
    alone = min(fits, key=lambda one: one.bic)
    fits += fitted(_pairs(sums, alone, reduced_chi2(alone) <= limits.omnibus))
    cost = {one.label: one.bic + price(one.hypothesis) for one in fits}
    fits.sort(key=lambda one: cost[one.label])
    best = fits[0]
    if best.status == FAILED:
        return Regressed(None, False, best.reason, [], fits, known.failed, [weigh(base, one, limits) for one in fits])
    best = next(
        (one for one in fits if len(one.hypothesis) == 1 and cost[one.label] - cost[best.label] < min_delta_bic), best
    )
    rest = [one for one in fits if one is not best]
    rivals = [one for one in rest if cost[one.label] - cost[best.label] < min_delta_bic and _differs(one, best, base)]
    accepted, because = _gate(base, best, cost[best.label], limits, min_delta_bic)
    others = [one for one in rest if one not in rivals]
    best = fit_hypothesis(
        problem, best.hypothesis, best.mapping, differences=differences, refresh=True
    )  # for its intervals
    ranking = [weigh(base, one, limits) for one in (best, *rivals, *others)]
    return Regressed(best, accepted, because, rivals, others, known.failed, ranking)


def law_of(hypothesis: Hypothesis, values: Mapping[str, float]) -> Law:
    """Terms of a library as one formula.

    Parameters
    ----------
    hypothesis : tuple of Candidate
        Of one effect.
    values : mapping of str to float
        By key, as in `Fit.mapping`.
    """
    named = dict(zip(COEFFICIENTS, hypothesis, strict=False))
    keys = {name: f"{candidate.label}.{candidate.amplitudes[0]}" for name, candidate in named.items()}
    terms = {name: term_of(candidate) for name, candidate in named.items()}
    coefficients = {name: values[key] for name, key in keys.items()}
    return Law(effect_of(hypothesis[0]), hypothesis[0].site, terms, coefficients, keys)


def effect_of(candidate: Candidate) -> str:
    """The effect that a term of a library belongs to."""
    return candidate.name.partition("[")[0]


def term_of(candidate: Candidate) -> str:
    """The term itself."""
    return candidate.name.partition("[")[2].removesuffix("]")


def _product(coefficient: str, term: str) -> str:
    return coefficient if term == "1" else f"{coefficient}*{term}"


def _subsets(found):
    """All sets of terms of one effect that a law may have."""
    for size in range(1, len(COEFFICIENTS) + 1):
        for chosen in itertools.combinations(found, size):
            if len({effect_of(one.candidate) for one in chosen}) == 1:
                yield chosen


def _singles(sums: Sequence[Screened]) -> list[Screened]:
    """The single terms that explain most, among them some of each effect; `sums` is best first."""
    singles = [one for one in sums if len(one.signatures) == 1]
    chosen = singles[:_FITTED]
    for effect in dict.fromkeys(effect_of(one.hypothesis[0]) for one in singles):
        of_effect = [one for one in singles if effect_of(one.hypothesis[0]) == effect]
        chosen += [one for one in of_effect[:_OF_EACH] if one not in chosen]
    return chosen


def _pairs(sums: Sequence[Screened], alone: Fit, enough: bool) -> list[Screened]:
    """The pairs that add to the best single term, and the best others where it is not enough; `sums` is best first."""
    pairs = [one for one in sums if len(one.signatures) > 1]
    adding = [one for one in pairs if {c.label for c in alone.hypothesis} < {c.label for c in one.hypothesis}]
    chosen = adding[:_OF_EACH]
    return chosen if enough else chosen + [one for one in pairs[:_FITTED] if one not in chosen]


def _differs(one: Fit, best: Fit, base: Fit) -> bool:
    """Whether a sum says something else than the best one: not the same force in another form, nor with a term added."""
    if {c.label for c in one.hypothesis} > {c.label for c in best.hypothesis}:
        return False
    another = effect_of(one.hypothesis[0]) != effect_of(best.hypothesis[0])
    apart = np.linalg.norm(one.residual - best.residual)
    return another or bool(apart > _SAME * np.linalg.norm(base.residual - best.residual))


def _gate(base: Fit, best: Fit, cost: float, limits: Thresholds, min_delta_bic: float) -> tuple[bool, str]:
    ranked = weigh(base, best, limits)
    if base.bic - cost < max(min_delta_bic, limits.max_gain_threshold):
        return False, f"the best sum, {best.label}, is not better than chance"
    if ranked.passes:
        return True, "with it the model leaves noise alone"
    if ranked.share >= _SHARE:
        return True, f"it explains {ranked.share:.1%} of the misfit"
    return False, f"the best sum, {best.label}, explains {ranked.share:.1%} of the misfit only"
