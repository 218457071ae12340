"""From fits to a verdict: is something missing, what is it, and can the data tell.

`decide` is the one place where this is decided. It asks in this order, and the first line that holds is the verdict:

===  ==========================================================================  ===============================
     what holds                                                                  verdict
===  ==========================================================================  ===============================
  1  no admissible hypothesis gains enough over the base, and the base            ``unexplained``
     leaves more than noise
  2  no admissible hypothesis gains enough, the model leaves noise alone with     ``no_disagreement``
     all parameters at nominal, and fitting them hardly gains
  3  no admissible hypothesis gains enough                                        ``parameters_only``
  4  others fit as well as the best, which is good                                ``ambiguous``
  5  others fit as well as the best, which is poor                                ``unexplained``
  6  the best leaves noise alone                                                  ``named``
  7  the best explains nearly all, and more than it would if the effect most      ``named_with_remaining_misfit``
     like it were the cause
  8  otherwise                                                                    ``unexplained``
===  ==========================================================================  ===============================

"Gains" are differences of the Bayesian information criterion (BIC); "leaves noise alone" means that chi2 stays below
what campaigns with nothing hidden leave (`Thresholds.omnibus`); the numbers stand in `settings.DecisionSettings`.
A hypothesis is admissible if its fit did not fail and every one of its effects is there and is more than a nuisance
within its range.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from jointgap.identification.fit import FAILED, Fit
from jointgap.identification.problem import Hypothesis
from jointgap.identification.settings import DEFAULT_SETTINGS, DecisionSettings
from jointgap.identification.thresholds import Thresholds

NO_DISAGREEMENT, PARAMETERS_ONLY = "no_disagreement", "parameters_only"
NAMED, NAMED_WITH_REMAINING_MISFIT = "named", "named_with_remaining_misfit"
AMBIGUOUS, UNEXPLAINED = "ambiguous", "unexplained"


@dataclass(frozen=True)
class Ranked:
    """One explanation beside the others.

    Attributes
    ----------
    fit : Fit
    delta_bic : float
        BIC of the base less its own: larger is better.
    share : float
        [1] Explained share, (chi2_base - chi2) / (chi2_base - n); NaN where the base leaves no more than noise.
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
        As in the table of the module.
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
    similarity: Mapping[str, float],
    nuisance_bounds: Mapping[str, tuple[float, float, float]],
    is_special_case: Callable[[Hypothesis, Hypothesis], bool],
    second_effect_gain: float = 0.0,
    settings: DecisionSettings = DEFAULT_SETTINGS.decision,
) -> Decision:
    """Choose among fitted explanations, by the table of the module.

    Parameters
    ----------
    base, nominal : Fit
        The model as it stands, nuisances fitted and at nominal.
    fits : sequence of Fit
        Explanations of one, two ... effects.
    limits : Thresholds
    similarity : mapping of label to float
        [1] Squared cosine of each explanation's signature with that of the candidate most like it.
    nuisance_bounds : mapping of name to (nominal, low, high)
        Ranges [SI] of the nuisances that effects may replace.
    is_special_case : function
        Whether an explanation is a special case of another, which is then no rival but an addition.
    second_effect_gain : float
        [BIC] What a second effect has to gain over the best single one, where that is more than
        `limits.max_gain_threshold`.
    settings : DecisionSettings
    """
    ranking = rank(base, fits, limits, nuisance_bounds)
    # The base is a rival too, and the best of many candidates gains something by chance alone.
    needed = max(settings.min_delta_bic, limits.max_gain_threshold)
    best = _best(ranking, max(needed, second_effect_gain))

    def decided(verdict: str, because: str, chosen: Fit = base, equivalent: Sequence[Fit] = ()) -> Decision:
        return Decision(verdict, chosen, base, list(equivalent), ranking, limits, because)

    # 1 to 3: nothing is called missing
    if best is None or best.delta_bic <= needed:
        if reduced_chi2(base) > max(limits.omnibus, settings.tolerated_reduced_chi2):
            return decided(UNEXPLAINED, "no candidate explains the disagreement")
        # Numerical noise alone lets one of two fits gain: parameters off nominal have to gain more.
        fitting_gain = nominal.bic - base.bic
        if reduced_chi2(nominal) <= limits.omnibus and fitting_gain < settings.min_delta_bic + limits.numerical_noise:
            return decided(NO_DISAGREEMENT, "the model as it stands leaves noise alone", nominal)
        return decided(PARAMETERS_ONLY, "with parameters within their ranges the model leaves noise alone")

    # 4 and 5: something is missing, but the data do not say what
    explains_nearly_all = best.share >= settings.min_explained_share
    apart = settings.min_delta_bic + limits.numerical_noise
    rivals = [
        ranked.fit
        for ranked in ranking
        if ranked.admissible
        and _is_rival(ranked.fit, best.fit, apart)
        and not is_special_case(best.fit.hypothesis, ranked.fit.hypothesis)
    ]
    if rivals and (best.passes or explains_nearly_all):
        because = "several explanations fit the data equally well"
        return decided(AMBIGUOUS, because, equivalent=[best.fit, *rivals])
    if rivals:
        return decided(UNEXPLAINED, "several explanations are equally poor")

    # 6 to 8: one explanation is the best
    if best.passes:
        return decided(NAMED, "with it the model leaves noise alone", best.fit)
    label = best.fit.label
    if not explains_nearly_all:
        explains = f"explains {best.share:.1%} only" if np.isfinite(best.share) else "leaves as much"
        return decided(UNEXPLAINED, f"the best, {label}, {explains}")
    # Were the effect most like it the cause, it would still explain `similarity` of the misfit: then its name would be
    # wrong.
    left_if_wrong = 1.0 - similarity.get(label, 0.0)
    if 1.0 - best.share < settings.max_share_of_wrong_misfit * left_if_wrong:
        because = "it explains nearly all, and more than it could if the nearest other effect were the cause"
        return decided(NAMED_WITH_REMAINING_MISFIT, because, best.fit)
    return decided(
        UNEXPLAINED, f"{label} explains {best.share:.1%}, as it also would if a similar effect were the cause"
    )


def rank(
    base: Fit, fits: Sequence[Fit], limits: Thresholds, nuisance_bounds: Mapping[str, tuple[float, float, float]]
) -> list[Ranked]:
    """All explanations, best BIC first, the failed ones last.

    Parameters
    ----------
    base : Fit
    fits : sequence of Fit
    limits : Thresholds
    nuisance_bounds : mapping of name to (nominal, low, high)
        Ranges [SI] of the nuisances that effects may replace.
    """
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
    passes = bool(reduced_chi2(fit) <= limits.omnibus)
    admissible = fit.status != FAILED and not objection
    return Ranked(fit, base.bic - fit.bic, share, passes, admissible, objection or fit.reason)


def reduced_chi2(fit: Fit) -> float:
    """chi2 over its degrees of freedom; infinite where the fit failed."""
    return fit.chi2 / max(fit.residual.size - len(fit.parameters), 1)


def _objection(fit: Fit, nuisance_bounds: Mapping[str, tuple[float, float, float]]) -> str:
    """Why an explanation claims an effect that is not there; empty where it does not.

    An effect that replaces a nuisance (a mass other than nominal) is none as long as the nuisance stays within its
    stated range.
    """
    values, errors = fit.mapping, None
    for candidate in fit.hypothesis:
        amplitudes = {
            key: values[f"{candidate.label}.{key}"]
            for key in candidate.amplitudes
            if f"{candidate.label}.{key}" in values
        }
        if not any(amplitudes.values()):
            return f"{candidate.label} is fitted with no size"
        # Where it leaves the rest of a shared nuisance to be fitted, the effect is that the two differ.
        if not candidate.replaces or candidate.replaces.keys() & {p.name for p in candidate.coordinates}:
            continue
        errors = errors or dict(zip((p.key for p in fit.parameters), np.sqrt(np.diag(fit.covariance())), strict=True))
        replaced = {amplitude: nuisance_bounds[name] for name, amplitude in candidate.replaces.items()}
        if all(
            _is_within(value, replaced[amplitude])
            if amplitude in replaced
            else abs(value) <= 2.0 * errors[f"{candidate.label}.{amplitude}"]  # 95 %: no sign of it
            for amplitude, value in amplitudes.items()
        ):
            return f"{candidate.label} is {' and '.join(candidate.replaces)} within its range: a parameter, no effect"
    return ""


def _is_within(departure: float, bounds: tuple[float, float, float]) -> bool:
    """Whether nominal plus `departure` lies within the bounds (nominal, low, high) of a nuisance."""
    nominal, low, high = bounds
    return low <= nominal + departure <= high


def _best(ranking: Sequence[Ranked], needed: float) -> Ranked | None:
    """The best explanation; one of more effects only where it gains more than `needed` over the best one of fewer.

    The more effects, the more explanations there are to choose the luckiest from.
    """
    good = [ranked for ranked in ranking if ranked.admissible and ranked.delta_bic > 0]
    best = None
    for count in range(1, 1 + max((len(ranked.fit.hypothesis) for ranked in good), default=0)):
        first = next((ranked for ranked in good if len(ranked.fit.hypothesis) == count), None)
        if first is not None and (best is None or first.delta_bic - best.delta_bic > needed):
            best = first
    return best


def _is_rival(fit: Fit, best: Fit, apart: float) -> bool:
    """Whether `fit` is another explanation as good as `best`: BIC less than `apart` behind, and of no more effects.

    One that merely adds to the best, or leaves something out of it, is no other.
    """
    labels, best_labels = ({candidate.label for candidate in each.hypothesis} for each in (fit, best))
    is_other = not labels >= best_labels and not labels < best_labels
    return fit.bic - best.bic < apart and is_other and len(labels) <= len(best_labels)
