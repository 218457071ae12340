"""Rules that turn evidence into a verdict.

The first rule of `OF_FITS` that holds gives the verdict of the fits. `OF_HELD_OUT` then tests the
named or equivalent explanations on held-out data. `jointgap.identification.evidence` makes the
evidence; the limits are those of `settings.DecisionSettings`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from jointgap.core.words import rounded_gap
from jointgap.identification.settings import DEFAULT_SETTINGS, DecisionSettings

NO_DISAGREEMENT, PARAMETERS_ONLY = "no_disagreement", "parameters_only"
NAMED, NAMED_WITH_REMAINING_MISFIT = "named", "named_with_remaining_misfit"
AMBIGUOUS, UNEXPLAINED = "ambiguous", "unexplained"
AS_THE_FITS_SAY = ""

FALLS, STAYS, RISES = "falls", "stays", "rises"
CANNOT_TELL, NOT_SIMULATED, NOTHING_HELD_OUT = "cannot_tell", "not_simulated", "nothing_held_out"


@dataclass(frozen=True)
class Thresholds:
    """Limits that null campaigns (without a hidden effect) exceed with the stated rate."""

    rate: float  # [1] Share of null campaigns that exceed each threshold
    omnibus: float  # [1] Reduced chi2 of the base
    max_gain_threshold: float  # [BIC] Gain of the best candidate
    numerical_noise: float = 0.0  # [chi2] Possible gain of a fit by numerical noise


@dataclass(frozen=True)
class Row:
    """An explanation, or the model without effects, in the table of evidence."""

    fit: Any  # Not used by the rules
    effects: tuple[str, ...]  # Labels
    chi2: float  # Infinite if the fit failed
    samples: int
    parameters: int  # Number of fitted parameters
    bic: float
    objection: str = (
        ""  # Why it is not admissible: the fit failed, or an effect is zero or a nuisance
    )
    reason: str = ""  # Remark of the fit
    similarity: float = 0.0  # [1] Squared cosine with the most similar effect
    at_bounds: tuple[str, ...] = ()  # Shared nuisances at a bound
    is_nonsmooth: bool = (
        False  # Whether motion is a nonsmooth function of an effect, without useful derivatives
    )
    # From `weigh`, relative to the base:
    delta_bic: float = 0.0  # BIC of the base minus its own: larger is better
    share: float = np.nan  # [1] Of the misfit beyond noise of the base; NaN if that may be noise
    passes: bool = False  # Whether the residual is consistent with noise

    @property
    def label(self) -> str:
        return " + ".join(self.effects)

    @property
    def misfit(self) -> float:
        """Reduced chi2 [1]."""
        return self.chi2 / max(self.samples - self.parameters, 1)

    @property
    def admissible(self) -> bool:
        """Whether it may be named."""
        return not self.objection

    @property
    def remark(self) -> str:
        return self.objection or self.reason


@dataclass(frozen=True)
class HeldOutTest:
    """Change of the gap on held-out data by the effects of a verdict."""

    outcome: str  # ``falls``, ``rises``, ``stays`` although it should fall, or why that is unknown
    before: float = np.nan  # Gap [1] of the runs that could be simulated; NaN if none could
    after: float = np.nan
    after_low: float = np.nan  # Lower end [1] of the 90 % interval of `after`

    @property
    def summary(self) -> str:
        """``falls from 3.00 to 1.02``, ``stays at 1.18``; more digits if two show no difference."""
        before, after = (rounded_gap(gap) for gap in (self.before, self.after))
        if self.outcome in (FALLS, RISES) or before == after:
            return gap_change(self.before, self.after, 4 if self.outcome in (FALLS, RISES) else 2)
        return f"does not change significantly ({before} before, {after} after)"


@dataclass(frozen=True)
class HeldOut:
    """Gaps of all runs with the effects of a verdict."""

    test: HeldOutTest
    gap: float = np.nan  # [1] Of all held-out data together
    fitted: tuple[float, str] = (0.0, "")  # The channel with the largest gap [1] on the fitted data
    held_out: tuple[float, str] = (0.0, "")  # The same on held-out data
    noise: tuple[float, str] = (
        0.0,
        "",
    )  # The channel with the largest share [1] of noise in its variation


@dataclass(frozen=True)
class Decision:
    """A verdict and its fits."""

    verdict: str
    chosen: (
        Any  # The explanation named, the base if none is, or the nominal model if that is enough
    )
    base: Any  # The current model, nuisances fitted
    equivalent: list = field(default_factory=list)  # Indistinguishable explanations, best first
    ranking: Sequence[Row] = ()  # All explanations, best first, the failed ones last
    because: str = ""  # The reason
    best_known: Any = (
        None  # The best explanation, if the verdict is ``unexplained`` and one gains enough
    )
    certain: tuple[
        str, ...
    ] = ()  # Labels of the effects that all fitted explanations near the best one share
    not_searched: tuple[str, ...] = ()  # Steps of the search that the limit of simulations left out
    twins: list = field(
        default_factory=list
    )  # Explanations by other sensor faults that predict the same as `chosen`

    @property
    def proposed(self) -> Any:
        """The explanation to test on held-out data: the one named, else the first equivalent one,
        else the best known; None if there is none."""
        return (
            self.chosen if self.verdict in _NAMES else next(iter(self.equivalent), self.best_known)
        )


_NAMES = NAMED, NAMED_WITH_REMAINING_MISFIT


@dataclass(frozen=True)
class Evidence:
    """Input of the rules."""

    base: Row  # The current model, nuisances fitted
    nominal: Row  # The same at nominal values
    rows: Sequence[Row]
    limits: Thresholds
    second_effect_gain: float = 0.0  # [BIC] Least gain of a pair over the best single effect
    is_special_case: Callable[[Row, Row], bool] = lambda special, general: (
        False
    )  # The second contains the first
    predicts_same: Callable[[Row, Row], bool] = lambda row, other: (
        False
    )  # They differ in names of sensor faults only
    by_fits: Decision | None = None  # The verdict of the fits, once there is one
    held_out: HeldOut | None = None
    inconsistent: Sequence[str] = ()  # Channels


class Case:
    """Quantities that the rules use."""

    def __init__(
        self, evidence: Evidence, settings: DecisionSettings, said: Decision | None = None
    ):
        self.evidence, self.settings, self.said = evidence, settings, said
        self.base, self.nominal, self.limits = evidence.base, evidence.nominal, evidence.limits
        rows = [weigh(self.base, row, self.limits, settings) for row in evidence.rows]
        self.ranking = sorted(rows, key=lambda row: -row.delta_bic)
        # The base is a rival too, and the best of many explanations gains something by chance.
        self.needed = max(settings.min_delta_bic, self.limits.max_gain_threshold)
        self.apart = settings.min_delta_bic + self.limits.numerical_noise
        # The explained share of a small misfit is meaningless.
        self.is_small = self.base.misfit <= settings.noise_gap**2
        if said:
            self.held_out, self.test = evidence.held_out, evidence.held_out.test
            self.exceeds_noise = self.test.after_low > settings.noise_gap
            self.has_misfit = self.exceeds_noise or said.verdict != NAMED
            self.closed, self.ends = (
                share_closed(self.test.before, self.test.after),
                ", ".join(self.best.at_bounds),
            )

    @cached_property
    def best(self) -> Row | None:
        """The best explanation, if it gains enough; one of more effects only if it gains enough
        over the best one of fewer, as the best of many explanations gains by chance."""
        if self.said:
            return next(row for row in self.ranking if row.fit is self.said.proposed)
        good = [row for row in self.ranking if row.admissible and row.delta_bic > 0.0]
        firsts = {len(row.effects): row for row in reversed(good)}
        best, needed = None, max(self.needed, self.evidence.second_effect_gain)
        for _, first in sorted(firsts.items()):
            best = first if best is None or first.delta_bic - best.delta_bic > needed else best
        return best if best and best.delta_bic > self.needed else None

    @cached_property
    def others(self) -> list[Row]:
        """Other explanations of no more effects; not parts, extensions or limits of the best
        one."""
        own = {*self.best.effects}
        found = [row for row in self.ranking if row.admissible and len(row.effects) <= len(own)]
        found = [row for row in found if not own <= {*row.effects} and not own > {*row.effects}]
        found = [row for row in found if not self.evidence.predicts_same(self.best, row)]
        return [row for row in found if not self.evidence.is_special_case(self.best, row)]

    @property
    def twins(self) -> list[Row]:
        """Explanations that differ from the best one only in the name of a sensor fault, as they
        predict the same."""
        near = [
            row for row in self.ranking if row.admissible and row.bic - self.best.bic < self.apart
        ]
        return [
            row
            for row in near
            if row.fit is not self.best.fit and self.evidence.predicts_same(self.best, row)
        ]

    @property
    def certain(self) -> tuple[str, ...]:
        """Effects of the best explanation that every fitted explanation has which is not clearly
        worse: by its BIC over the misfit that the best one leaves and, if that is more than noise,
        by the misfit too.

        None if the best one explains too little, or is the only one.
        """
        if not self.best or not self.is_good:
            return ()
        apart = self.apart * max(self.best.misfit, 1.0)
        fitted = [
            self.base,
            *(row for row in self.ranking if np.isfinite(row.chi2) and row is not self.best),
        ]
        near = [row for row in fitted if row.bic - self.best.bic < apart]
        if not self.best.passes and not self.is_small:
            shares = {id(row): 0.0 if row is self.base else row.share for row in fitted}
            near = [
                row for row in fitted if row in near or not self.leaves_less(1.0 - shares[id(row)])
            ]
        shared = {*self.best.effects}.intersection(*(row.effects for row in near))
        return tuple(label for label in self.best.effects if label in shared) if near else ()

    @property
    def rivals(self) -> list[Row]:
        """Explanations equivalent to the best one."""
        return [row for row in self.others if row.bic - self.best.bic < self.apart]

    @property
    def explains(self) -> bool:
        """Whether the best one explains nearly all."""
        return self.best.share >= self.settings.min_explained_share

    @property
    def is_good(self) -> bool:
        return self.best.passes or self.explains or self.is_small

    @property
    def similar(self) -> Row | None:
        """Another explanation of nearly all with a similar misfit: BIC is no measure of a misfit
        that is not noise."""
        nearly_all = (row for row in self.others if row.share >= self.settings.min_explained_share)
        return next((row for row in nearly_all if not self.leaves_less(1.0 - row.share)), None)

    def leaves_less(self, wrong: float) -> bool:
        """Whether the best one leaves clearly less misfit than a wrong one (`wrong`: share [1])."""
        return 1.0 - self.best.share < self.settings.max_share_of_wrong_misfit * wrong

    @property
    def counts_held_out(self) -> bool:
        """Whether sizes of held-out gaps count. At another speed impacts have another phase even in
        a true model, so that a falling gap is enough."""
        return not (self.held_out.test.outcome == FALLS and self.best.is_nonsmooth)

    @property
    def inconsistent(self) -> str:
        """``torque is``, ``angle and torque are``."""
        names = [channel.replace("_", " ") for channel in self.evidence.inconsistent]
        return f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'}"

    def decided(self, rule: "Rule") -> Decision:
        """The decision by a rule."""
        because, best, said = rule.because.format(c=self), self.best, self.said
        if said and rule.verdict == UNEXPLAINED:
            said = replace(said, chosen=said.base, equivalent=[], twins=[], best_known=best.fit)
        if said:
            return replace(said, verdict=rule.verdict, because=because) if rule.verdict else said
        equal = [best, *self.rivals] if rule.verdict == AMBIGUOUS else []
        known = best if rule.verdict == UNEXPLAINED else None
        chosen = (
            best
            if rule.verdict in _NAMES
            else self.nominal
            if rule.verdict == NO_DISAGREEMENT
            else self.base
        )
        fits = {
            "chosen": chosen.fit,
            "base": self.base.fit,
            "equivalent": [row.fit for row in equal],
        }
        fits["best_known"] = known.fit if known else None
        fits["twins"] = [row.fit for row in self.twins] if rule.verdict in _NAMES else []
        # held-out data may leave a name with a remaining misfit unexplained
        certain = (
            self.certain
            if rule.verdict in (AMBIGUOUS, UNEXPLAINED, NAMED_WITH_REMAINING_MISFIT)
            else ()
        )
        return Decision(
            rule.verdict,
            ranking=self.ranking,
            because=because,
            certain=certain,
            **fits,
        )


class Rule(NamedTuple):
    """A row of the table of rules."""

    verdict: str
    because: str  # The reason, unique in the table; {c} is the case
    holds: Callable[[Case], Any]


OF_FITS = (
    # Nothing gains enough
    Rule(
        UNEXPLAINED,
        "no candidate explains the residual",
        lambda c: not c.best and not c.is_small and c.base.misfit > c.limits.omnibus,
    ),
    Rule(
        NO_DISAGREEMENT,
        "the current model's residual is consistent with noise",
        lambda c: (
            not c.best
            and c.nominal.misfit <= c.limits.omnibus
            and c.nominal.bic - c.base.bic < c.apart
        ),
    ),
    Rule(
        PARAMETERS_ONLY,
        "with re-fitted parameters the residual is consistent with noise",
        lambda c: not c.best,
    ),
    # Several explanations
    Rule(
        AMBIGUOUS,
        "several explanations fit the data equally well",
        lambda c: c.rivals and c.is_good,
    ),
    Rule(UNEXPLAINED, "several explanations are equally poor", lambda c: c.rivals),
    # One explanation is the best
    Rule(NAMED, "with it the residual is consistent with noise", lambda c: c.best.passes),
    Rule(
        UNEXPLAINED,
        "the best candidate, {c.best.label}, explains only {c.best.share:.1%} of the misfit",
        lambda c: not c.is_good and np.isfinite(c.best.share),
    ),
    Rule(
        UNEXPLAINED,
        "the best candidate, {c.best.label}, does not reduce the misfit",
        lambda c: not c.is_good,
    ),
    Rule(
        UNEXPLAINED,
        "the residual with {c.best.label} exceeds noise, and that with {c.similar.label} is hardly"
        " larger",
        lambda c: c.similar,
    ),
    Rule(
        NAMED_WITH_REMAINING_MISFIT,
        "the misfit is small, but it explains it far better than any alternative",
        lambda c: not c.explains,
    ),
    Rule(
        NAMED_WITH_REMAINING_MISFIT,
        "it explains nearly everything; no alternative does",
        lambda c: c.best.share >= c.settings.sure_explained_share,
    ),
    # If the most similar effect were the cause, this one would still explain `similarity` of the
    # misfit.
    Rule(
        NAMED_WITH_REMAINING_MISFIT,
        "it explains most of the misfit, and more than it could if the most similar effect were the"
        " cause",
        lambda c: c.leaves_less(1.0 - c.best.similarity),
    ),
    Rule(
        UNEXPLAINED,
        "{c.best.label} explains {c.best.share:.1%}, as it would if a similar effect were the"
        " cause",
        lambda c: True,
    ),
)
"""Rules for the fits."""

OF_HELD_OUT = (
    Rule(
        UNEXPLAINED,
        "{c.inconsistent} inconsistent with other channels, so no effect can be identified",
        lambda c: c.evidence.inconsistent,
    ),
    # Nuisances compensate for missing effects, and the noise estimate contains model error.
    Rule(
        UNEXPLAINED,
        "{c.ends} end at their bounds, and the noise of {c.held_out.noise[1]} is"
        " {c.held_out.noise[0]:.0%} of its variation: more than one effect is missing",
        lambda c: (
            len(c.best.at_bounds) >= c.settings.many_at_bounds
            and c.held_out.noise[0] > c.settings.max_noise_share
        ),
    ),
    Rule(
        UNEXPLAINED,
        "with the best candidate, {c.best.label}, the gap of {c.held_out.fitted[1]} on the fitted"
        " data is still {c.held_out.fitted[0]:.3g}",
        lambda c: c.held_out.fitted[0] > c.settings.max_gap_left,
    ),
    Rule(
        UNEXPLAINED,
        "with the best candidate, {c.best.label}, the gap of {c.held_out.held_out[1]} on the"
        " held-out data is still {c.held_out.held_out[0]:.3g}",
        lambda c: c.counts_held_out and c.held_out.held_out[0] > c.settings.max_gap_left,
    ),
    Rule(
        UNEXPLAINED,
        "with the best candidate, {c.best.label}, the gap on the held-out data is still"
        " {c.held_out.gap:.3g}",
        lambda c: c.counts_held_out and c.held_out.gap > c.settings.max_gap_held_out,
    ),
    Rule(
        AS_THE_FITS_SAY,
        "several explanations are equally good",
        lambda c: c.said.verdict == AMBIGUOUS,
    ),
    # If the held-out data contain the share a of the change due to the effects, the squared gap
    # falls by (2 a - 1) times the mean square of that change. If it falls at all, a exceeds one
    # half.
    Rule(
        UNEXPLAINED,
        "with {c.best.label} the gap on the held-out data {c.test.summary}, although it should"
        " fall",
        lambda c: (
            c.test.outcome == RISES
            or (c.test.outcome == STAYS and not c.test.after < c.test.before)
        ),
    ),
    Rule(
        UNEXPLAINED,
        "the misfit is small, and no held-out data confirm the best candidate, {c.best.label}",
        lambda c: c.has_misfit and c.test.outcome != FALLS and (c.is_small or not c.explains),
    ),
    Rule(
        UNEXPLAINED,
        "{c.best.label} explains less than half of the gap on the held-out data, which"
        " {c.test.summary}",
        lambda c: (
            c.counts_held_out
            and c.exceeds_noise
            and 1.0 - c.closed > c.settings.max_share_of_wrong_misfit
        ),
    ),
    Rule(
        AS_THE_FITS_SAY,
        "the fits have a remaining misfit",
        lambda c: c.said.verdict == NAMED_WITH_REMAINING_MISFIT,
    ),
    Rule(
        NAMED_WITH_REMAINING_MISFIT,
        "the residual is consistent with noise on the fitted data, but exceeds it on the held-out"
        " data",
        lambda c: c.exceeds_noise,
    ),
    Rule(
        NAMED_WITH_REMAINING_MISFIT,
        "the gap on the held-out data {c.test.summary}",
        lambda c: c.test.outcome == STAYS,
    ),
    Rule(AS_THE_FITS_SAY, "the residual of all data is consistent with noise", lambda c: True),
)
"""Rules for the verdict of the fits on held-out data."""


def verdict(evidence: Evidence, settings: DecisionSettings = DEFAULT_SETTINGS.decision) -> Decision:
    """The decision by the first rule of `OF_FITS` that holds and, with held-out evidence, of
    `OF_HELD_OUT`."""
    said = evidence.by_fits
    for rules, asked in ((OF_FITS, not said), (OF_HELD_OUT, bool(evidence.held_out))):
        if asked and (said is None or said.verdict in (*_NAMES, AMBIGUOUS)):
            case = Case(evidence, settings, said)
            said = case.decided(next(rule for rule in rules if rule.holds(case)))
    if evidence.inconsistent or (evidence.held_out and evidence.held_out.test.outcome == RISES):
        said = replace(said, certain=())
    return said


def weigh(
    base: Row, row: Row, limits: Thresholds, settings: DecisionSettings = DEFAULT_SETTINGS.decision
) -> Row:
    """An explanation relative to the base: gain, explained share, and whether its residual is
    noise."""
    excess = base.chi2 - (base.samples - base.parameters)
    # within one standard deviation of chi2 the excess may be noise
    share = (base.chi2 - row.chi2) / excess if excess > np.sqrt(2 * base.samples) else np.nan
    # if the noise is poorly known the omnibus threshold is high: then require an explained share
    explains = row.misfit <= settings.noise_gap**2 or not share < settings.min_explained_share
    passes = bool(row.misfit <= limits.omnibus and explains)
    return replace(row, delta_bic=base.bic - row.bic, share=share, passes=passes)


def gap_change(before: float, after: float, most_digits: int = 2) -> str:
    """``falls from 3.00 to 1.02``, ``rises from 1.10 to 1.15``, ``stays at 1.18``: a gap [1] as its
    numbers say."""
    for digits in range(2, most_digits + 1):
        shown = [f"{gap:.{digits if gap < 100 else digits - 2}f}" for gap in (before, after)]
        if shown[0] != shown[1]:
            return f"{FALLS if after < before else RISES} from {shown[0]} to {shown[1]}"
    return f"stays at {rounded_gap(after)}"


def share_closed(before: float, after: float) -> float:
    """Explained share [1] of the squared gap beyond noise; NaN if the gap did not exceed noise."""
    return 1.0 - (after**2 - 1.0) / (before**2 - 1.0) if before > 1.0 else np.nan
