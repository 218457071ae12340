"""From fits to a verdict: is something missing, what is it, and can the data tell."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from jointgap.identification.fit import FAILED, Fit
from jointgap.identification.problem import Hypothesis
from jointgap.identification.thresholds import Thresholds

RIVAL = 10.0
"""Two explanations whose BIC differ by less are not told apart: odds of 150 to 1 (Kass and Raftery 1995: very strong)."""

SHARE = 0.95
"""Share of the misfit that an explanation has to explain where it leaves more than noise."""

SLIGHT = 1.1
"""chi2 over its degrees of freedom up to which nothing is called missing unless an effect is found: a gap of 1.05."""

CLOSER = 0.5
"""Such an explanation must leave less than this part of what it would leave if its nearest rival were the truth."""


@dataclass(frozen=True)
class Ranked:
    """One explanation beside the others.

    Attributes
    ----------
    fit : Fit
    delta_bic : float
        BIC of the base less its own: larger is better.
    share : float
        Explained share, (chi2_base - chi2) / (chi2_base - n); NaN where the base leaves no more than noise.
    passes : bool
        Whether it leaves nothing that null campaigns do not leave.
    admissible : bool
        Whether all its effects are there and none is a nuisance within its range.
    remark : str
        Why it is not admissible, or what the fit says.
    """

    fit: Fit
    delta_bic: float
    share: float
    passes: bool
    admissible: bool
    remark: str = ""


@dataclass(frozen=True)
class Decision:
    """The verdict as far as the fits carry it.

    Attributes
    ----------
    verdict : str
        ``no_disagreement``, ``parameters_only``, ``named``, ``named_with_remaining_misfit``, ``ambiguous``, ``unexplained``.
    chosen : Fit
        The explanation named; the base where none is, or the nominal model where that is enough.
    base : Fit
        The model as it stands, nuisances fitted, that explanations were compared with.
    equivalent : list of Fit
        Explanations that the data cannot tell apart, best first; empty unless ``ambiguous``.
    ranking : list of Ranked
        All explanations, best first.
    thresholds : Thresholds
    because : str
        The reason in a sentence.
    """

    verdict: str
    chosen: Fit
    base: Fit
    equivalent: list[Fit] = field(default_factory=list)
    ranking: list[Ranked] = field(default_factory=list)
    thresholds: Thresholds | None = None
    because: str = ""


def decide(
    base: Fit,
    nominal: Fit,
    fits: Sequence[Fit],
    limits: Thresholds,
    alikeness: Mapping[str, float],
    nuisance_bounds: Mapping[str, tuple[float, float, float]],
    within: Callable[[Hypothesis, Hypothesis], bool],
    second: float = 0.0,
) -> Decision:
    """Choose among fitted explanations.

    Parameters
    ----------
    base, nominal : Fit
        The model as it stands, nuisances fitted and at nominal.
    fits : sequence of Fit
        Explanations of one, two ... effects.
    limits : Thresholds
    alikeness : mapping of label to float
        Squared cosine of each explanation's signature with that of its nearest rival.
    nuisance_bounds : mapping of name to (nominal, low, high)
        Ranges of the nuisances that effects may replace.
    within : function
        Whether an explanation is a special case of another, which is then no rival but an addition.
    second : float
        What a second effect has to gain in BIC over the best single one, where that is more than `limits.directed`.
    """
    ranking = rank(base, fits, limits, nuisance_bounds)
    good = [one for one in ranking if one.admissible and one.delta_bic > 0]
    base_passes = reduced(base) <= max(limits.omnibus, SLIGHT)
    best = _best(good, max(RIVAL, limits.directed, second))
    told = {"base": base, "ranking": ranking, "thresholds": limits}
    if best is None or best.delta_bic <= max(RIVAL, limits.directed):  # the base is a rival too
        if not base_passes:
            return Decision("unexplained", base, because="no candidate explains the disagreement", **told)
        if reduced(nominal) <= limits.omnibus and nominal.bic - base.bic < RIVAL + limits.rough:
            return Decision("no_disagreement", nominal, because="the model as it stands leaves noise alone", **told)
        return Decision(
            "parameters_only", base, because="with parameters within their ranges the model leaves noise alone", **told
        )
    equals = [
        one
        for one in ranking
        if one.admissible
        and _rivals(one.fit, best.fit, RIVAL + limits.rough)
        and not within(best.fit.hypothesis, one.fit.hypothesis)
    ]
    if equals:
        alike = [best.fit, *(one.fit for one in equals)]
        if best.passes or best.share >= SHARE:
            why = "several explanations fit the data equally well"
            return Decision("ambiguous", base, equivalent=alike, because=why, **told)
        return Decision("unexplained", base, because="several explanations are equally poor", **told)
    if best.passes:
        return Decision("named", best.fit, because="with it the model leaves noise alone", **told)
    lost = 1.0 - alikeness.get(best.fit.label, 0.0)
    if best.share >= SHARE and 1.0 - best.share < CLOSER * lost:
        why = "it explains nearly all, and more than it could if the nearest other effect were the cause"
        return Decision("named_with_remaining_misfit", best.fit, because=why, **told)
    if best.share >= SHARE:
        why = f"{best.fit.label} explains {best.share:.1%}, as it also would if a similar effect were the cause"
    else:
        told_share = f"explains {best.share:.1%} only" if np.isfinite(best.share) else "leaves as much"
        why = f"the best, {best.fit.label}, {told_share}"
    return Decision("unexplained", base, because=why, **told)


def rank(
    base: Fit, fits: Sequence[Fit], limits: Thresholds, nuisance_bounds: Mapping[str, tuple[float, float, float]]
) -> list[Ranked]:
    """All explanations, best BIC first, the failed ones last."""
    ranking = [
        weigh(base, fit, limits, "" if fit.status == FAILED else _objection(fit, nuisance_bounds)) for fit in fits
    ]
    return sorted(ranking, key=lambda ranked: (ranked.fit.status == FAILED, -ranked.delta_bic))


def weigh(base: Fit, fit: Fit, limits: Thresholds, objection: str = "") -> Ranked:
    """One explanation beside the base.

    Parameters
    ----------
    base, fit : Fit
    limits : Thresholds
    objection : str
        Why the explanation is not admissible; empty where it is.
    """
    excess = base.chi2 - (base.residual.size - len(base.parameters))
    # An excess within a standard deviation of chi2 may be noise: a share of it says nothing.
    share = (base.chi2 - fit.chi2) / excess if excess > np.sqrt(2 * base.residual.size) else np.nan
    passes = bool(reduced(fit) <= limits.omnibus)
    admissible = fit.status != FAILED and not objection
    return Ranked(fit, base.bic - fit.bic, share, passes, admissible, objection or fit.reason)


def reduced(one: Fit) -> float:
    """chi2 over its degrees of freedom; infinite where the fit failed."""
    return one.chi2 / max(one.residual.size - len(one.parameters), 1)


def _objection(one: Fit, nuisance_bounds) -> str:
    """Why an explanation claims an effect that is not there; empty where it does not."""
    values, errors = one.mapping, None
    for candidate in one.hypothesis:
        sizes = {
            key: values[f"{candidate.label}.{key}"]
            for key in candidate.amplitudes
            if f"{candidate.label}.{key}" in values
        }
        if not any(sizes.values()):
            return f"{candidate.label} is fitted with no size"
        if not candidate.replaces or candidate.replaces.keys() & {p.name for p in candidate.coordinates}:
            continue  # where it leaves the rest of a shared nuisance to be fitted, the effect is that the two differ
        errors = errors or dict(zip((p.key for p in one.parameters), np.sqrt(np.diag(one.covariance())), strict=True))
        within = {size: nuisance_bounds[name] for name, size in candidate.replaces.items()}
        if all(
            low <= nominal + value <= high
            if size in within
            else abs(value) <= 2.0 * errors[f"{candidate.label}.{size}"]
            for size, value in sizes.items()
            for nominal, low, high in (within.get(size, (0.0, 0.0, 0.0)),)
        ):
            return f"{candidate.label} is {' and '.join(candidate.replaces)} within its range: a parameter, no effect"
    return ""


def _best(good: Sequence[Ranked], needed: float) -> Ranked | None:
    """The best explanation; one of more effects only where it gains more than `needed` over the best one of fewer."""
    best = None
    for count in range(1, 1 + max((len(one.fit.hypothesis) for one in good), default=0)):
        of_count = [one for one in good if len(one.fit.hypothesis) == count]
        if not of_count:
            continue
        first = of_count[0]
        if best is None or first.delta_bic - best.delta_bic > needed:
            best = first
    return best


def _rivals(one: Fit, best: Fit, apart: float) -> bool:
    """Whether `one` is another explanation that is as good as `best`: not one that merely adds to it or leaves something out."""
    names, named = ({c.label for c in fit.hypothesis} for fit in (one, best))
    return one.bic - best.bic < apart and not names >= named and not names < named and len(names) <= len(named)
