"""From fits to a verdict: is something missing, what is it, and can the data tell.

This table is the one place where that is decided. `decide` asks lines 1 to 8 of the fits alone, in this order, and the
first line that holds is the verdict of the fits:

===  ==========================================================================  ===============================
     what holds                                                                  verdict
===  ==========================================================================  ===============================
  1  no admissible hypothesis gains enough over the base, and the base            ``unexplained``
     leaves more than noise
  2  no admissible hypothesis gains enough, the model leaves noise alone with     ``no_disagreement``
     all parameters at nominal, and fitting them hardly gains
  3  no admissible hypothesis gains enough                                        ``parameters_only``
  4  others are as good as the best, and good                                     ``ambiguous``
  5  others are as good as the best, and poor                                     ``unexplained``
  6  the best leaves noise alone                                                  ``named``
  7  the best explains all but a percent; or nearly all, and more than it would   ``named_with_remaining_misfit``
     if the effect most like it were the cause; or the base itself hardly shows;
     and of what remains no other explanation leaves hardly more
  8  otherwise                                                                    ``unexplained``
===  ==========================================================================  ===============================

`final_verdict` puts what lines 4, 6 and 7 name, or a force law that was found after line 8, to the data that took no
part, and to what is known of the channels. Again the first line that holds counts:

===  ==========================================================================  ===============================
     what holds                                                                  verdict
===  ==========================================================================  ===============================
  9  a channel contradicts others, even once the faults of sensors that are       ``unexplained``
     named are taken out of what was read
 10  three nuisances end at bounds, and the noise of a channel is a large part    ``unexplained``
     of what it varies by
 11  what is left is large: in a channel, on the data used for fitting or on      ``unexplained``
     those held out; or in all channels of those held out together. Of effects
     on which motion depends roughly held-out data are not asked, as long as
     their gap falls: at another speed impacts ring in another phase
 12  the gap of the held-out data rises, or does not fall at all though the       ``unexplained``
     effects would show there
 13  of a base that hardly shows, or of its excess not nearly all is explained,   ``unexplained``
     more than noise is left, and no fall of the held-out gap confirms the name
 14  of held-out data more than noise is left, and less than half of what was     ``unexplained``
     there is gone
 15  the fits leave noise alone, the held-out data more; or the held-out gap      ``named_with_remaining_misfit``
     falls by less than noise leaves open, though the effects would show there
 16  otherwise                                                                    as the fits say
===  ==========================================================================  ===============================

Lines 12 to 15 are not asked of ``ambiguous``. Wherever the verdict is ``unexplained`` and one hypothesis gains enough,
`Decision.best_known` holds the best one: what is missing is partly explained by it, and nothing is named.

"Gains" are differences of the Bayesian information criterion (BIC). "Leaves noise alone" means that chi2 stays below
what campaigns with nothing hidden leave (`Thresholds.omnibus`), and that nearly all of the excess is explained or what
is left would not be called missing either: where the noise is known poorly such campaigns leave much. Of held-out data
more than noise is left if the interval of the gap begins above it. The numbers stand in `settings.DecisionSettings`.
A hypothesis is admissible if its fit did not fail, every one of its effects is there (its size is significant, and at
no bound but that at which the effect is absent or nothing is left of what it changes), is more than a nuisance within
its range, and if none swings at a frequency of its own that is an order of the crank. Others are as good as the best
where their BIC is not far behind.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from jointgap.core.candidates import Candidate, Parameter
from jointgap.identification.confirmation import FALLS, RISES, STAYS, Confirmed, Rest, share_closed
from jointgap.identification.fit import FAILED, Fit, chance
from jointgap.identification.problem import Hypothesis
from jointgap.identification.settings import DEFAULT_SETTINGS, DecisionSettings
from jointgap.identification.thresholds import Thresholds

NO_DISAGREEMENT, PARAMETERS_ONLY = "no_disagreement", "parameters_only"
NAMED, NAMED_WITH_REMAINING_MISFIT = "named", "named_with_remaining_misfit"
AMBIGUOUS, UNEXPLAINED = "ambiguous", "unexplained"


@dataclass(frozen=True)
class Ranked:
    """One explanation beside the others."""

    fit: Fit
    delta_bic: float  # BIC of the base less its own: larger is better
    share: float  # [1] Explained share, (chi2_base - chi2) / (chi2_base - n)
    passes: bool  # Whether it leaves noise alone, as the table of the module has it
    admissible: bool  # Whether all its effects are there and none is a nuisance within its range
    remark: str = ""  # Why it is not admissible, or what the fit says


@dataclass(frozen=True)
class Decision:
    """The verdict as far as the fits carry it."""

    verdict: str  # As in the table of the module
    chosen: Fit  # The explanation named; the base where none is, or the nominal model where that is enough
    base: Fit  # The model as it stands, nuisances fitted, that explanations were compared with
    equivalent: list[Fit] = field(default_factory=list)  # Explanations that the data cannot tell apart, best first
    ranking: list[Ranked] = field(default_factory=list)  # All explanations, best first
    thresholds: Thresholds | None = None
    because: str = ""  # The reason in a sentence
    best_known: Fit | None = None  # Where the verdict is ``unexplained``

    @property
    def proposed(self) -> Fit | None:
        """What the held-out data are asked about: the explanation named, else the first of those that are as good, else
        the best known; None where nothing is proposed."""
        return proposal(self.chosen, self.equivalent, self.best_known)


def proposal(chosen: Fit, equivalent: Sequence[Fit], best_known: Fit | None) -> Fit | None:
    """The explanation that a verdict puts to the held-out data: `chosen` where that has effects, else the first that is
    `equivalent`, else the `best_known`; the attributes of `Decision`.
    """
    return chosen if chosen.hypothesis else next(iter(equivalent), best_known)


def certain_effects(equivalent: Sequence[Fit], close: Collection[Collection[str]] = ()) -> list[Candidate]:
    """Effects that all of several explanations hold, in the order of the first: what is certain though the rest is
    not.
    """
    if not equivalent:
        return []
    explanations = [{candidate.label for candidate in fit.hypothesis} for fit in equivalent]
    shared = set.intersection(*explanations, *map(set, close))
    return [candidate for candidate in equivalent[0].hypothesis if candidate.label in shared]


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
    order_in_words: Callable[[float], str] = lambda _: "",
) -> Decision:
    """Choose among fitted explanations, by lines 1 to 8 of the table of the module."""
    ranking = rank(base, fits, limits, nuisance_bounds, settings, order_in_words)
    # The base is a rival too, and the best of many candidates gains something by chance alone.
    needed = max(settings.min_delta_bic, limits.max_gain_threshold)
    best = _best(ranking, max(needed, second_effect_gain))

    def decided(
        verdict: str, because: str, chosen: Fit = base, equivalent: Sequence[Fit] = (), best_known: Fit | None = None
    ) -> Decision:
        return Decision(verdict, chosen, base, list(equivalent), ranking, limits, because, best_known)

    # 1 to 3: nothing is called missing
    slight = max(limits.omnibus, settings.tolerated_reduced_chi2)
    if best is None or best.delta_bic <= needed:
        if reduced_chi2(base) > slight:
            return decided(UNEXPLAINED, "no candidate explains the disagreement")
        # Numerical noise alone lets one of two fits gain: parameters off nominal have to gain more.
        fitting_gain = nominal.bic - base.bic
        if reduced_chi2(nominal) <= limits.omnibus and fitting_gain < settings.min_delta_bic + limits.numerical_noise:
            return decided(NO_DISAGREEMENT, "the model as it stands leaves noise alone", nominal)
        return decided(PARAMETERS_ONLY, "with parameters within their ranges the model leaves noise alone")

    # 4 and 5: something is missing, but the data do not say what
    label = best.fit.label
    explains_nearly_all = best.share >= settings.min_explained_share
    # A share of what hardly shows says nothing; what is left of it would not be called missing either.
    hardly_shows = reduced_chi2(base) <= settings.tolerated_reduced_chi2
    good = best.passes or explains_nearly_all or hardly_shows
    apart = settings.min_delta_bic + limits.numerical_noise
    others = [
        ranked
        for ranked in ranking
        if ranked.admissible
        and _is_other(ranked.fit, best.fit)
        and not is_special_case(best.fit.hypothesis, ranked.fit.hypothesis)
    ]
    rivals = [ranked.fit for ranked in others if ranked.fit.bic - best.fit.bic < apart]
    if rivals and good:
        return decided(AMBIGUOUS, "several explanations fit the data equally well", equivalent=[best.fit, *rivals])
    if rivals:
        return decided(UNEXPLAINED, "several explanations are equally poor", best_known=best.fit)

    # 6 to 8: one explanation is the best
    if best.passes:
        return decided(NAMED, "with it the model leaves noise alone", best.fit)
    if not good:
        explains = f"explains {best.share:.1%} only" if np.isfinite(best.share) else "leaves as much"
        return decided(UNEXPLAINED, f"the best, {label}, {explains}", best_known=best.fit)
    # a rest that is no noise says little of BIC
    if similar := next((ranked for ranked in others if _leaves_as_little(ranked, best, settings)), None):
        because = f"{label} leaves more than noise, and {similar.fit.label} hardly more than that"
        return decided(UNEXPLAINED, because, best_known=best.fit)
    if not explains_nearly_all:
        because = "it is far ahead of all others, of a disagreement that hardly shows"
        return decided(NAMED_WITH_REMAINING_MISFIT, because, best.fit)
    if best.share >= settings.sure_explained_share:
        because = "it explains all but a small rest, and no other explanation does"
        return decided(NAMED_WITH_REMAINING_MISFIT, because, best.fit)
    # Were the effect most like it the cause, it would still explain `similarity` of the misfit: then its name would be
    # wrong.
    left_if_wrong = 1.0 - similarity.get(label, 0.0)
    if 1.0 - best.share < settings.max_share_of_wrong_misfit * left_if_wrong:
        because = "it explains nearly all, and more than it could if the nearest other effect were the cause"
        return decided(NAMED_WITH_REMAINING_MISFIT, because, best.fit)
    because = f"{label} explains {best.share:.1%}, as it also would if a similar effect were the cause"
    return decided(UNEXPLAINED, because, best_known=best.fit)


_Decided = TypeVar("_Decided")


def final_verdict(
    decision: _Decided,
    confirmed: Confirmed,
    doubted_channels: Collection[str] = (),
    settings: DecisionSettings = DEFAULT_SETTINGS.decision,
) -> _Decided:
    """The verdict with the held-out data heard, by lines 9 to 16 of the table of the module; its fits know the gap that
    they leave there (`Fit.gap_left`).
    """
    return _with_gap_left(_heard(decision, confirmed, doubted_channels, settings), confirmed.gap("confirm"))


def _with_gap_left(decision: _Decided, gap: float) -> _Decided:
    """The decision, all that it proposes with the `gap` that is left of held-out data."""
    if not gap > 1.0:
        return decision

    def known(fit: Fit) -> Fit:
        return replace(fit, gap_left=gap)

    best, equivalent = decision.best_known, [known(fit) for fit in decision.equivalent]
    chosen = known(decision.chosen) if decision.chosen.hypothesis or not (best or equivalent) else decision.chosen
    return replace(decision, chosen=chosen, equivalent=equivalent, best_known=best and known(best))


def _heard(
    decision: _Decided, confirmed: Confirmed, doubted_channels: Collection[str], settings: DecisionSettings
) -> _Decided:
    """The verdict by lines 9 to 16."""
    if decision.verdict not in (NAMED, NAMED_WITH_REMAINING_MISFIT, AMBIGUOUS):
        return decision
    proposed = proposal(decision.chosen, decision.equivalent, decision.best_known)

    def withheld(because: str) -> _Decided:
        return replace(
            decision,
            verdict=UNEXPLAINED,
            because=because,
            chosen=decision.base,
            equivalent=[],
            best_known=proposed,
        )

    # 9
    if doubted_channels:
        names = " and ".join(channel.replace("_", " ") for channel in doubted_channels)
        verb = "reads contradicts" if len(doubted_channels) == 1 else "read contradicts"
        return withheld(f"what {names} {verb} other channels, so no effect can be told from it")
    # 10
    ends, (channel, share) = _nuisances_at_bounds(proposed), confirmed.largest_noise
    if len(ends) >= settings.many_at_bounds and share > settings.max_noise_share:
        return withheld(
            f"{', '.join(ends)} end at their bounds, and the noise of {channel} is {share:.0%} of what it varies by: "
            "the model is wrong in more than one effect"
        )
    # 11
    test, places = confirmed.test, {"identify": "the data used for fitting", "confirm": "the held-out data"}
    if test.outcome == FALLS and any(map(_is_rough, proposed.hypothesis)):
        del places["confirm"]  # there impacts ring in another phase, whatever is true
    for role, where in places.items():
        worst = max(confirmed.rests(role), key=lambda rest: rest.gap, default=Rest("", 0.0))
        if worst.gap > settings.max_gap_left:
            channel = worst.channel.replace("_", " ")
            return withheld(
                f"the best, {proposed.label}, leaves a gap of {worst.gap:.3g} in {channel} on {where}: no small rest"
            )
    if "confirm" in places and (gap := confirmed.gap("confirm")) > settings.max_gap_held_out:
        return withheld(f"the best, {proposed.label}, leaves a gap of {gap:.3g} on the held-out data: no small rest")
    if decision.verdict == AMBIGUOUS:
        return decision
    # 12 to 14
    # Of what the effects change in the held-out data the share a is there: the squared gap falls by (2 a - 1) times
    # that change's mean square. Where it falls at all, more of the change is there than not.
    if test.outcome == RISES or (test.outcome == STAYS and not test.after < test.before):
        return withheld(f"with {proposed.label} the gap on the held-out data does not fall: {test.words}")
    hardly_shows = reduced_chi2(decision.base) <= settings.tolerated_reduced_chi2
    doubtful = hardly_shows or not explained_share(decision.base, proposed) >= settings.min_explained_share
    leaves_more = test.after_low > settings.max_low_end_of_gap
    is_plain = decision.verdict == NAMED and not leaves_more
    if not is_plain and doubtful and test.outcome != FALLS:
        return withheld(
            f"the best, {proposed.label}, is far ahead of all others, but of a disagreement that hardly shows, and no "
            "held-out data confirm it"
        )
    if "confirm" in places and leaves_more and share_closed(test.before, test.after) < settings.least_closed:
        return withheld(f"{proposed.label} explains less than half of the gap on the held-out data: {test.words}")
    # 15
    if decision.verdict != NAMED:
        return decision
    if leaves_more:
        because = "it leaves noise alone on the data used for fitting, but more on the held-out data"
        return replace(decision, verdict=NAMED_WITH_REMAINING_MISFIT, because=because)
    if test.outcome == STAYS:
        because = f"the gap on the held-out data falls by less than noise leaves open: {test.words}"
        return replace(decision, verdict=NAMED_WITH_REMAINING_MISFIT, because=because)
    return decision


def _nuisances_at_bounds(fit: Fit) -> list[str]:
    """Names of the parameters that runs share, and that no effect has, that a fit drew to an end of their range."""
    at_bounds = zip(fit.parameters, fit.values, fit.active, strict=True)
    return [p.name for p, value, active in at_bounds if active and _is_shared(p) and not p.low < value < p.high]


def _is_shared(parameter: Parameter) -> bool:
    return parameter.run is None and "." not in parameter.name


def _is_rough(candidate: Candidate) -> bool:
    """Whether motion depends roughly on an effect, so that no slope leads to it."""
    return bool(candidate.search_range) and not candidate.is_perturbation


def rank(
    base: Fit,
    fits: Sequence[Fit],
    limits: Thresholds,
    nuisance_bounds: Mapping[str, tuple[float, float, float]],
    settings: DecisionSettings = DEFAULT_SETTINGS.decision,
    order_in_words: Callable[[float], str] = lambda _: "",
) -> list[Ranked]:
    """All explanations, best BIC first, the failed ones last."""

    def objection(fit: Fit) -> str:
        if fit.status == FAILED:
            return ""
        return _swings_with_a_crank(fit, order_in_words) or _objection(fit, nuisance_bounds, settings)

    ranking = [weigh(base, fit, limits, objection(fit), settings) for fit in fits]
    return sorted(ranking, key=lambda ranked: (ranked.fit.status == FAILED, -ranked.delta_bic))


def weigh(
    base: Fit,
    fit: Fit,
    limits: Thresholds,
    objection: str = "",
    settings: DecisionSettings = DEFAULT_SETTINGS.decision,
) -> Ranked:
    """One explanation beside the base."""
    left, share = reduced_chi2(fit), explained_share(base, fit)
    # null campaigns leave much where the noise is known poorly: that says little of what is explained
    explains = left <= settings.tolerated_reduced_chi2 or not share < settings.min_explained_share
    passes = bool(left <= limits.omnibus and explains)
    admissible = fit.status != FAILED and not objection
    return Ranked(fit, base.bic - fit.bic, share, passes, admissible, objection or fit.reason)


def explained_share(base: Fit, fit: Fit) -> float:
    """Share [1] that an explanation takes of what exceeds the noise in the base; NaN where that may be noise itself."""
    excess = base.chi2 - (base.residual.size - len(base.parameters))
    # within a standard deviation of chi2 it may be noise
    return (base.chi2 - fit.chi2) / excess if excess > np.sqrt(2 * base.residual.size) else np.nan


def reduced_chi2(fit: Fit) -> float:
    """chi2 over its degrees of freedom; infinite where the fit failed."""
    return fit.chi2 / max(fit.residual.size - len(fit.parameters), 1)


def _objection(fit: Fit, nuisance_bounds: Mapping[str, tuple[float, float, float]], settings: DecisionSettings) -> str:
    """Why an explanation claims an effect that is not there; empty where it does not.

    An effect that replaces a nuisance (a mass other than nominal) is none as long as the nuisance stays within its
    stated range.
    """
    values = fit.mapping
    for candidate in fit.hypothesis:
        amplitudes = {
            key: values[f"{candidate.label}.{key}"]
            for key in candidate.amplitudes
            if f"{candidate.label}.{key}" in values
        }
        if not any(amplitudes.values()):
            return f"{candidate.label} is fitted with no size"
        if key := _drawn_to_a_bound(fit, candidate):
            return f"{candidate.label} is drawn to the bound of {key}: what it explains is something else"
        if is_within_range(fit, candidate, nuisance_bounds):
            return f"{candidate.label} is {' and '.join(candidate.replaces)} within its range: a parameter, no effect"
    for candidate in fit.hypothesis:
        if chance(fit, candidate) > settings.max_chance_of_size:
            return f"{candidate.label} may as well be absent: the interval of its size holds 0"
    return ""


def _swings_with_a_crank(fit: Fit, order_in_words: Callable[[float], str]) -> str:
    """Why an effect has no frequency of its own: it is an order of a crank; empty where it is not."""
    for candidate in (one for one in fit.hypothesis if one.steady_counterpart):
        frequency = fit.mapping.get(f"{candidate.label}.frequency_Hz")
        if frequency is not None and (order := order_in_words(frequency)):
            return f"{candidate.label} swings at {frequency:.4g} Hz, which is {order}"
    return ""


def is_within_range(fit: Fit, candidate: Candidate, nuisance_bounds: Mapping[str, tuple[float, float, float]]) -> bool:
    """Whether an effect is no more than nuisances that it replaces, within their ranges."""
    # Where it leaves the rest of a shared nuisance to be fitted, the effect is that the two differ.
    if not candidate.replaces or candidate.replaces.keys() & {p.name for p in candidate.coordinates}:
        return False
    values = fit.mapping
    replaced = {amplitude: nuisance_bounds[name] for name, amplitude in candidate.replaces.items()}

    def error(key: str) -> float:
        place = [p.key for p in fit.parameters].index(key)
        return float(np.sqrt(fit.covariance()[place, place]))

    amplitudes = {
        key: f"{candidate.label}.{key}" for key in candidate.amplitudes if f"{candidate.label}.{key}" in values
    }
    return all(
        _is_within(values[key], replaced[amplitude])
        if amplitude in replaced
        else abs(values[key]) <= 2.0 * error(key)  # 95 %: no sign of it
        for amplitude, key in amplitudes.items()
    )


def _drawn_to_a_bound(fit: Fit, candidate: Candidate) -> str:
    """The amplitude of an effect that ended at a bound at which the effect is there; empty where none did.

    At the lower bound of a change of something known nothing is left of that, which is a size like others. Shapes may
    end at bounds: an exponent that is 1, an order that is the first.
    """
    for p, value in zip(fit.parameters, fit.values, strict=True):
        key = p.key.removeprefix(f"{candidate.label}.")
        if key == p.key or key not in candidate.amplitudes or value == 0.0:
            continue
        if value >= p.high or (value <= p.low and not candidate.is_perturbation):
            return key
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


def _is_other(fit: Fit, best: Fit) -> bool:
    """Whether `fit` is another explanation than `best`, and of no more effects.

    One that merely adds to the best, or leaves something out of it, is no other.
    """
    labels, best_labels = ({candidate.label for candidate in each.hypothesis} for each in (fit, best))
    return not labels >= best_labels and not labels < best_labels and len(labels) <= len(best_labels)


def _leaves_as_little(ranked: Ranked, best: Ranked, settings: DecisionSettings) -> bool:
    """Whether another explanation explains nearly all too, and the best one leaves no clearly smaller rest."""
    if not ranked.share >= settings.min_explained_share:
        return False
    return 1.0 - best.share >= settings.max_share_of_wrong_misfit * (1.0 - ranked.share)
