"""From evidence to a verdict: is something missing, what is it, and can the data tell.

The first row of `OF_FITS` that holds is the verdict of the fits. What that names or calls equivalent is put to the
held-out data by `OF_HELD_OUT`. Nothing is simulated or fitted here: the table of evidence is made of fits by
`jointgap.identification.evidence`. The numbers are those of `settings.DecisionSettings`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from jointgap.identification.settings import DEFAULT_SETTINGS, DecisionSettings

NO_DISAGREEMENT, PARAMETERS_ONLY = "no_disagreement", "parameters_only"
NAMED, NAMED_WITH_REMAINING_MISFIT = "named", "named_with_remaining_misfit"
AMBIGUOUS, UNEXPLAINED = "ambiguous", "unexplained"
AS_THE_FITS_SAY = ""

FALLS, STAYS, RISES = "falls", "stays", "rises"
CANNOT_TELL, NOT_SIMULATED, NOTHING_HELD_OUT = "cannot_tell", "not_simulated", "nothing_held_out"

ALONE, ALIKE = "alone", "alike"


@dataclass(frozen=True)
class Thresholds:
    """What null campaigns, in which nothing is hidden, exceed with the stated rate."""

    rate: float  # [1] Share of null campaigns that exceed each threshold
    omnibus: float  # [1] Of the base's chi2 over its degrees of freedom
    max_gain_threshold: float  # [BIC] Of the gain of the best candidate
    numerical_noise: float = 0.0  # [chi2] What a fit may gain by numerical noise alone


@dataclass(frozen=True)
class Row:
    """An explanation, or the model without effects, in the table of evidence."""

    fit: Any  # Handed on; no rule looks into it
    effects: tuple[str, ...]  # Labels
    chi2: float  # Infinite where the fit failed
    samples: int
    parameters: int  # How many were fitted
    bic: float
    objection: str = ""  # Why it is not admissible: the fit failed, or an effect is not there or is none
    reason: str = ""  # What the fit says of itself
    similarity: float = 0.0  # [1] Squared cosine with the effect that is most like it
    at_bounds: tuple[str, ...] = ()  # Shared nuisances at an end of their range
    is_rough: bool = False  # Whether motion depends roughly on an effect, so that no slope leads to it
    # By `weigh`, beside the base:
    delta_bic: float = 0.0  # BIC of the base less its own: larger is better
    share: float = np.nan  # [1] Of what exceeds the noise in the base; NaN where that may be noise itself
    passes: bool = False  # Whether it leaves noise alone

    @property
    def label(self) -> str:
        """The explanation in words."""
        return " + ".join(self.effects)

    @property
    def misfit(self) -> float:
        """chi2 over its degrees of freedom [1]."""
        return self.chi2 / max(self.samples - self.parameters, 1)

    @property
    def admissible(self) -> bool:
        """Whether it may be named: all its effects are there, and none is a nuisance within its range."""
        return not self.objection

    @property
    def remark(self) -> str:
        """Why it is not admissible, or what the fit says."""
        return self.objection or self.reason


@dataclass(frozen=True)
class HeldOutTest:
    """What becomes of the gap of the held-out data once the effects of a verdict are in the model."""

    outcome: str  # ``falls``, ``rises``, ``stays`` though it should fall, or why that is not known
    before: float = np.nan  # Gap [1] of the runs that could be simulated; NaN where none could
    after: float = np.nan
    after_low: float = np.nan  # Lower end [1] of the 90 % interval of the gap after

    @property
    def words(self) -> str:
        """``falls from 3.00 to 1.02``, ``stays at 1.18``; more digits where two show no difference."""
        digits = next((n for n in (2, 3, 4) if f"{self.before:.{n}f}" != f"{self.after:.{n}f}"), 2)
        before, after = (f"{gap:.{digits if gap < 100 else 0}f}" for gap in (self.before, self.after))
        if self.outcome in (FALLS, RISES):
            return f"it {self.outcome} from {before} to {after}"
        if f"{self.before:.2f}" == f"{self.after:.2f}":
            return f"it stays at {self.after:.2f}"
        return f"it stays within what noise leaves open, {self.before:.2f} before and {self.after:.2f} after"


@dataclass(frozen=True)
class HeldOut:
    """What all runs show, predicted with the effects of a verdict."""

    test: HeldOutTest
    gap: float = np.nan  # [1] Of all held-out data together
    fitted: tuple[float, str] = (0.0, "")  # The largest gap [1] of a channel of the data used for fitting, and which
    held_out: tuple[float, str] = (0.0, "")  # The same of held-out data
    noise: tuple[float, str] = (0.0, "")  # The largest part [1] that noise is of what a channel varies by, and which


class Need(NamedTuple):
    """A fit to be made before a name is given."""

    kind: str  # ``alone``: an effect of a pair; ``alike``: all that looks like an effect of the explanation
    label: str  # Of that effect, or of the explanation
    fit: Any  # The explanation, from whose nuisances it starts


@dataclass(frozen=True)
class Decision:
    """A verdict, and the fits that it rests on."""

    verdict: str
    chosen: Any  # The explanation named; the base where none is, or the nominal model where that is enough
    base: Any  # The model as it stands, nuisances fitted, that explanations were compared with
    equivalent: list = field(default_factory=list)  # Explanations that the data cannot tell apart, best first
    ranking: Sequence[Row] = ()  # All explanations, best first, the failed ones last
    because: str = ""  # The reason in a sentence
    best_known: Any = None  # The best explanation, where the verdict is ``unexplained`` and one gains enough
    needs: tuple[Need, ...] = ()  # What is to be fitted before this counts

    @property
    def proposed(self) -> Any:
        """What the held-out data are asked about: the explanation named, else the first of those that are as good, else
        the best known; None where nothing is proposed."""
        return self.chosen if self.verdict in _NAMES else next(iter(self.equivalent), self.best_known)


_NAMES = NAMED, NAMED_WITH_REMAINING_MISFIT


@dataclass(frozen=True)
class Evidence:
    """All that a verdict rests on."""

    base: Row  # The model as it stands, nuisances fitted
    nominal: Row  # The same at nominal values
    rows: Sequence[Row]
    limits: Thresholds
    second_effect_gain: float = 0.0  # [BIC] What a pair has to gain over the best single effect at least
    is_special_case: Callable[[Row, Row], bool] = lambda special, general: False  # The second can do all of the first
    by_fits: Decision | None = None  # What the fits say, if that is settled
    held_out: HeldOut | None = None
    doubted: Sequence[str] = ()  # Channels that contradict others


class Case:
    """What the rules ask of evidence."""

    def __init__(self, evidence: Evidence, settings: DecisionSettings, said: Decision | None = None):
        self.evidence, self.settings, self.said = evidence, settings, said
        self.base, self.nominal, self.limits = evidence.base, evidence.nominal, evidence.limits
        rows = [weigh(self.base, row, self.limits, settings) for row in evidence.rows]
        self.ranking = sorted(rows, key=lambda row: -row.delta_bic)
        # The base is a rival too, and the best of many explanations gains something by chance alone.
        self.needed = max(settings.min_delta_bic, self.limits.max_gain_threshold)
        self.apart = settings.min_delta_bic + self.limits.numerical_noise
        # A share of what hardly shows says nothing; what is left of it would not be called missing either.
        self.hardly_shows = self.base.misfit <= settings.noise_gap**2
        if said:
            self.held_out, self.test = evidence.held_out, evidence.held_out.test
            self.leaves_more = self.test.after_low > settings.noise_gap
            self.leaves_rest = self.leaves_more or said.verdict != NAMED
            self.closed, self.ends = share_closed(self.test.before, self.test.after), ", ".join(self.best.at_bounds)

    @cached_property
    def best(self) -> Row | None:
        """The best explanation, if it gains enough; one of more effects only where it gains enough over the best one of
        fewer: the more effects, the more explanations there are to choose the luckiest from."""
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
        """Other explanations of no more effects: no more and no less of the best one, nor one that it is a limit of."""
        own = {*self.best.effects}
        found = [row for row in self.ranking if row.admissible and len(row.effects) <= len(own)]
        found = [row for row in found if not own <= {*row.effects} and not own > {*row.effects}]
        return [row for row in found if not self.evidence.is_special_case(self.best, row)]

    @property
    def rivals(self) -> list[Row]:
        """Those that are as good as the best one."""
        return [row for row in self.others if row.bic - self.best.bic < self.apart]

    @property
    def explains(self) -> bool:
        """Whether the best one explains nearly all."""
        return self.best.share >= self.settings.min_explained_share

    @property
    def is_good(self) -> bool:
        """Whether nearly all is explained, or little is left."""
        return self.best.passes or self.explains or self.hardly_shows

    @property
    def similar(self) -> Row | None:
        """Another one that explains nearly all and leaves hardly more: of a rest that is no noise BIC says little."""
        nearly_all = (row for row in self.others if row.share >= self.settings.min_explained_share)
        return next((row for row in nearly_all if not self.leaves_less(1.0 - row.share)), None)

    def leaves_less(self, wrong: float) -> bool:
        """Whether the best one leaves clearly less than a wrong one [1, of the misfit]."""
        return 1.0 - self.best.share < self.settings.max_share_of_wrong_misfit * wrong

    @property
    def counts_held_out(self) -> bool:
        """Whether sizes of held-out gaps count: at another speed impacts ring in another phase, whatever is true, so
        that it is enough there if the gap falls."""
        return not (self.held_out.test.outcome == FALLS and self.best.is_rough)

    @property
    def doubted(self) -> str:
        """``torque reads``, ``angle and torque read``."""
        names = [channel.replace("_", " ") for channel in self.evidence.doubted]
        return f"{' and '.join(names)} {'reads' if len(names) == 1 else 'read'}"

    def decided(self, rule: "Rule") -> Decision:
        """What a rule decides."""
        because, best, said = rule.because.format(c=self), self.best, self.said
        if said and rule.verdict == UNEXPLAINED:
            said = replace(said, chosen=said.base, equivalent=[], best_known=best.fit)
        if said:
            return replace(said, verdict=rule.verdict, because=because) if rule.verdict else said
        equal = [best, *self.rivals] if rule.verdict == AMBIGUOUS else []
        known = best if rule.verdict == UNEXPLAINED else None
        chosen = best if rule.verdict in _NAMES else self.nominal if rule.verdict == NO_DISAGREEMENT else self.base
        fits = {"chosen": chosen.fit, "base": self.base.fit, "equivalent": [row.fit for row in equal]}
        fits["best_known"] = known.fit if known else None
        # One of two effects may be there without the other; what looks like the best was not fitted from its nuisances.
        first = (row for row in self.ranking[:1] if row.delta_bic > 0.0)
        pairs = [row for row in (chosen, *equal, *first) if len(row.effects) > 1]
        needs = [Need(ALONE, effect, row.fit) for row in pairs for effect in row.effects]
        if best and (not known or known.misfit <= self.limits.omnibus):
            needs.append(Need(ALIKE, best.label, best.fit))
        return Decision(rule.verdict, ranking=self.ranking, because=because, needs=tuple(needs), **fits)


class Rule(NamedTuple):
    """A row of the table of rules."""

    verdict: str
    because: str  # The reason in plain words, which names the rule; {c} is the case
    holds: Callable[[Case], Any]


OF_FITS = (
    # Nothing gains enough
    Rule(
        UNEXPLAINED,
        "no candidate explains the disagreement",
        lambda c: not c.best and not c.hardly_shows and c.base.misfit > c.limits.omnibus,
    ),
    Rule(
        NO_DISAGREEMENT,
        "the model as it stands leaves noise alone",
        lambda c: not c.best and c.nominal.misfit <= c.limits.omnibus and c.nominal.bic - c.base.bic < c.apart,
    ),
    Rule(PARAMETERS_ONLY, "with parameters within their ranges the model leaves noise alone", lambda c: not c.best),
    # Something is missing, but the data do not say what
    Rule(AMBIGUOUS, "several explanations fit the data equally well", lambda c: c.rivals and c.is_good),
    Rule(UNEXPLAINED, "several explanations are equally poor", lambda c: c.rivals),
    # One explanation is the best
    Rule(NAMED, "with it the model leaves noise alone", lambda c: c.best.passes),
    Rule(
        UNEXPLAINED,
        "the best, {c.best.label}, explains {c.best.share:.1%} only",
        lambda c: not c.is_good and np.isfinite(c.best.share),
    ),
    Rule(UNEXPLAINED, "the best, {c.best.label}, leaves as much", lambda c: not c.is_good),
    Rule(
        UNEXPLAINED,
        "{c.best.label} leaves more than noise, and {c.similar.label} hardly more than that",
        lambda c: c.similar,
    ),
    Rule(
        NAMED_WITH_REMAINING_MISFIT,
        "it is far ahead of all others, of a disagreement that hardly shows",
        lambda c: not c.explains,
    ),
    Rule(
        NAMED_WITH_REMAINING_MISFIT,
        "it explains all but a small rest, and no other explanation does",
        lambda c: c.best.share >= c.settings.sure_explained_share,
    ),
    # Were the effect most like it the cause, it would still explain `similarity` of the misfit.
    Rule(
        NAMED_WITH_REMAINING_MISFIT,
        "it explains nearly all, and more than it could if the nearest other effect were the cause",
        lambda c: c.leaves_less(1.0 - c.best.similarity),
    ),
    Rule(
        UNEXPLAINED,
        "{c.best.label} explains {c.best.share:.1%}, as it also would if a similar effect were the cause",
        lambda c: True,
    ),
)
"""What the fits say by themselves."""

OF_HELD_OUT = (
    Rule(
        UNEXPLAINED,
        "what {c.doubted} contradicts other channels, so no effect can be told from it",
        lambda c: c.evidence.doubted,
    ),
    # Nuisances make up for what the model lacks, and the noise is none.
    Rule(
        UNEXPLAINED,
        "{c.ends} end at their bounds, and the noise of {c.held_out.noise[1]} is {c.held_out.noise[0]:.0%} of what it "
        "varies by: the model is wrong in more than one effect",
        lambda c: (
            len(c.best.at_bounds) >= c.settings.many_at_bounds and c.held_out.noise[0] > c.settings.max_noise_share
        ),
    ),
    Rule(
        UNEXPLAINED,
        "the best, {c.best.label}, leaves a gap of {c.held_out.fitted[0]:.3g} in {c.held_out.fitted[1]} on the "
        "data used for fitting: no small rest",
        lambda c: c.held_out.fitted[0] > c.settings.max_gap_left,
    ),
    Rule(
        UNEXPLAINED,
        "the best, {c.best.label}, leaves a gap of {c.held_out.held_out[0]:.3g} in {c.held_out.held_out[1]} on "
        "the held-out data: no small rest",
        lambda c: c.counts_held_out and c.held_out.held_out[0] > c.settings.max_gap_left,
    ),
    Rule(
        UNEXPLAINED,
        "the best, {c.best.label}, leaves a gap of {c.held_out.gap:.3g} on the held-out data: no small rest",
        lambda c: c.counts_held_out and c.held_out.gap > c.settings.max_gap_held_out,
    ),
    Rule(AS_THE_FITS_SAY, "several explanations are equally good", lambda c: c.said.verdict == AMBIGUOUS),
    # Of what the effects change in the held-out data the share a is there: the squared gap falls by (2 a - 1) times
    # that change's mean square. Where it falls at all, more of the change is there than not.
    Rule(
        UNEXPLAINED,
        "with {c.best.label} the gap on the held-out data does not fall: {c.test.words}",
        lambda c: c.test.outcome == RISES or (c.test.outcome == STAYS and not c.test.after < c.test.before),
    ),
    Rule(
        UNEXPLAINED,
        "the best, {c.best.label}, is far ahead of all others, but of a disagreement that hardly shows, and no "
        "held-out data confirm it",
        lambda c: c.leaves_rest and c.test.outcome != FALLS and (c.hardly_shows or not c.explains),
    ),
    Rule(
        UNEXPLAINED,
        "{c.best.label} explains less than half of the gap on the held-out data: {c.test.words}",
        lambda c: c.counts_held_out and c.leaves_more and 1.0 - c.closed > c.settings.max_share_of_wrong_misfit,
    ),
    Rule(AS_THE_FITS_SAY, "the fits leave a rest", lambda c: c.said.verdict == NAMED_WITH_REMAINING_MISFIT),
    Rule(
        NAMED_WITH_REMAINING_MISFIT,
        "it leaves noise alone on the data used for fitting, but more on the held-out data",
        lambda c: c.leaves_more,
    ),
    Rule(
        NAMED_WITH_REMAINING_MISFIT,
        "the gap on the held-out data falls by less than noise leaves open: {c.test.words}",
        lambda c: c.test.outcome == STAYS,
    ),
    Rule(AS_THE_FITS_SAY, "noise alone is left of all data", lambda c: True),
)
"""What is left of that once the held-out data are heard."""


def verdict(evidence: Evidence, settings: DecisionSettings = DEFAULT_SETTINGS.decision) -> Decision:
    """The decision by the first rule that holds, of the fits and, with held-out evidence, of that."""
    said = evidence.by_fits
    for rules, asked in ((OF_FITS, not said), (OF_HELD_OUT, bool(evidence.held_out))):
        if asked and (said is None or said.verdict in (*_NAMES, AMBIGUOUS)):
            case = Case(evidence, settings, said)
            said = case.decided(next(rule for rule in rules if rule.holds(case)))
    return said


def weigh(base: Row, row: Row, limits: Thresholds, settings: DecisionSettings = DEFAULT_SETTINGS.decision) -> Row:
    """An explanation beside the base: gain, explained share, and whether it leaves noise alone."""
    excess = base.chi2 - (base.samples - base.parameters)
    # within a standard deviation of chi2 it may be noise
    share = (base.chi2 - row.chi2) / excess if excess > np.sqrt(2 * base.samples) else np.nan
    # null campaigns leave much where the noise is known poorly: that says little of what is explained
    explains = row.misfit <= settings.noise_gap**2 or not share < settings.min_explained_share
    passes = bool(row.misfit <= limits.omnibus and explains)
    return replace(row, delta_bic=base.bic - row.bic, share=share, passes=passes)


def share_closed(before: float, after: float) -> float:
    """Share of what exceeds the noise that is gone, in squares; NaN where nothing exceeded it."""
    return 1.0 - (after**2 - 1.0) / (before**2 - 1.0) if before > 1.0 else np.nan
