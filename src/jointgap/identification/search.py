"""Search for the effects that explain a misfit: one queue of proposals.

A proposal is a hypothesis with start values and the BIC that linear regression about a fit predicts
for it. The most promising proposals are fitted, and their fits propose again. A proposal is worth a
fit as long as its prediction could change the verdict; the search ends if none is.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, Protocol

from jointgap.core.progress import report_progress
from jointgap.identification.baseline import Baseline
from jointgap.identification.evidence import reduced_chi2
from jointgap.identification.fit import FAILED, NEEDS_DERIVATIVES, Fit, fit_hypothesis
from jointgap.identification.initial_fit import fit_screened, labels_of, without_other_effects
from jointgap.identification.likelihood import fitted
from jointgap.identification.problem import Hypothesis
from jointgap.identification.screening import (
    LinearizedFit,
    Sensitivities,
    SensitivityRegression,
    is_slow_effect,
    shortlist,
    simulate_sensitivities,
)
from jointgap.identification.verdict import Thresholds
from jointgap.identification.window_search import fit_clearances, likely_clearances

MOST_EFFECTS = 3
"""Effects of an explanation, at most."""

Labels = frozenset[str]
"""The effects of a hypothesis in any order."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A hypothesis that may be worth a fit."""

    step: str  # Of the search, in words
    hypothesis: Hypothesis
    chi2: float  # Predicted
    bic: float  # Predicted
    fit: Callable[[float], Sequence[Fit]]  # Fits it, given the chi2 of a sufficient hypothesis
    explores: bool = False  # Worth a fit as long as nothing is sufficient, whatever is predicted
    is_slow: bool = False  # Its simulations take long, so it comes last
    alike: Fit | None = None  # The fit with one of its effects exchanged for a similar one

    @property
    def labels(self) -> Labels:
        return labels_of(self.hypothesis)


class Step(Protocol):
    """A source of proposals."""

    name: str
    """In words, for the verdict if the search ends before."""

    def propose(self, search: "Search") -> Iterable[Proposal]:
        """New proposals from the fits of a search, each once."""


@dataclass
class Search:
    """The fits of a search and its queue.

    Attributes
    ----------
    baseline, sensitivities, limits
        The base, the sensitivities of all candidates about it, and the thresholds.
    steps : sequence of Step
        Sources of proposals.
    has_clearances : bool
        False on inconsistent data, where clearances are not searched.
    fits : dict
        The best fit of each hypothesis, by its effects; the base is that of none.
    made : list of Fit
        All fits in the order in which they were made.
    seconds : dict
        Durations [s] of the fits, by effects.
    not_searched : list of str
        Steps whose proposals were left at the limit of simulated runs.
    """

    baseline: Baseline
    sensitivities: Sensitivities
    limits: Thresholds
    steps: Sequence[Step]
    has_clearances: bool = True
    fits: dict[Labels, Fit] = field(default_factory=dict)
    made: list[Fit] = field(default_factory=list)
    seconds: dict[Labels, float] = field(default_factory=dict)
    not_searched: list[str] = field(default_factory=list)
    _proposals: list[Proposal] = field(default_factory=list)
    _seen: set[tuple] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.problem = self.baseline.problem
        self.settings = self.problem.settings.selection
        self.fits[frozenset()] = self.baseline.base
        self.min_gain = max(
            self.problem.settings.decision.min_delta_bic, self.limits.max_gain_threshold
        )

    def run(self) -> "Search":
        """Fit proposals in rounds until none is worth a fit, or at the limit of simulated runs."""
        settings = self.settings
        most = self.problem.simulations + (
            settings.max_simulations_of_statistics
            if self.problem.has_statistics
            else settings.max_simulations
        )
        while queue := self._queue():
            if self.problem.simulations > most:
                self.not_searched = list(dict.fromkeys(proposal.step for proposal in queue))
                break
            for proposal in islice(_different(queue), settings.fits_per_round):
                if self._is_worth(proposal, self.best):
                    self._fit(proposal)
                    self._proposals.remove(proposal)
        return self

    def _queue(self) -> list[Proposal]:
        """The proposals that are worth a fit, the most promising first; with loose joints single
        effects first, as predictions about the poor fit of another effect mislead."""
        for step in self.steps:
            self._proposals += step.propose(self)

        def place(proposal: Proposal) -> tuple[bool, bool, float]:
            is_later = self.problem.is_rough and len(proposal.hypothesis) > 1
            return proposal.is_slow, is_later, proposal.bic

        return sorted(self.worth(), key=place)

    def worth(self) -> list[Proposal]:
        """The proposals so far that are worth a fit."""
        best = self.best
        return [proposal for proposal in self._proposals if self._is_worth(proposal, best)]

    def is_new(self, *key: Any) -> bool:
        """Whether a step asks with this key for the first time."""
        is_new = key not in self._seen
        self._seen.add(key)
        return is_new

    @property
    def base(self) -> Fit:
        """The fit without effects."""
        return self.fits[frozenset()]

    @property
    def best(self) -> Fit:
        """The fit that would be named: with more effects only if they gain the required BIC."""
        by_size: dict[int, Fit] = {}
        for fit in self.fits.values():
            size = len(fit.hypothesis)
            if fit.status != FAILED and fit.bic < by_size.get(size, self.base).bic:
                by_size[size] = fit
        best = self.base
        for _, fit in sorted(by_size.items()):
            best = fit if best.bic - fit.bic > self.min_gain else best
        return best

    def is_sufficient(self, fit: Fit) -> bool:
        """Whether the residual of a fit is noise."""
        return fit.status != FAILED and reduced_chi2(fit) <= self.limits.omnibus

    @property
    def sufficient_chi2(self) -> float:
        """The least chi2 of a sufficient fit; infinite without one."""
        fits = self.fits.values()
        return min((fit.chi2 for fit in fits if self.is_sufficient(fit)), default=math.inf)

    @property
    def share_left(self) -> float:
        """Share of the misfit that the best fit of all leaves."""
        least = min(fit.chi2 for fit in self.fits.values())
        return (least - self.problem.size) / max(self.base.chi2 - self.problem.size, 1e-300)

    def leading(self, size: int) -> list[Fit]:
        """The best fits with `size` effects, one of alternatives; not those in windows, which have
        partners already."""
        groups: dict[frozenset[str], Fit] = {}
        for fit in sorted(self.fits.values(), key=lambda fit: fit.bic):
            if len(fit.hypothesis) == size and fit.status != FAILED and not fit.in_windows:
                groups.setdefault(frozenset(c.exclusion_group for c in fit.hypothesis), fit)
        return list(groups.values())[: self.settings.partners]

    def about(self, fit: Fit) -> Sensitivities:
        """Sensitivities of one effect more about a fit.

        They are simulated if the fit leaves more than noise, as it is then far from the base; not
        for statistics, whose simulations take long.
        """
        about = self.sensitivities.about(fit)
        if self.is_sufficient(fit) or self.problem.has_statistics:
            return about
        ranked = SensitivityRegression(about, fit.hypothesis).singles()
        leading = shortlist(ranked, self.settings.linearised_partners)
        effects = [regression.hypothesis[-1] for regression in leading]
        labels = {label for effect in effects for label in (effect.label, effect.carrier)}
        candidates = [one for one in self.problem.model.candidates if one.label in labels]
        return simulate_sensitivities(self.problem, fit, self.baseline.differences, candidates)

    def proposals(
        self,
        step: str,
        regressions: Iterable[LinearizedFit],
        about: Sensitivities,
        explores: bool = False,
        alike: Fit | None = None,
    ) -> list[Proposal]:
        """Proposals from `regressions` of the sensitivities `about` a fit."""
        problem, differences = self.problem, self.baseline.differences

        def fit_of(regression: LinearizedFit) -> Callable[[float], Sequence[Fit]]:
            return lambda sufficient_chi2: [
                fit_screened(
                    problem, differences, about, regression, sufficient_chi2, problem.is_rough
                )
            ]

        return [
            Proposal(
                step,
                regression.hypothesis,
                regression.chi2,
                regression.bic,
                fit_of(regression),
                explores,
                problem.is_rough and any(map(is_slow_effect, regression.hypothesis)),
                alike,
            )
            for regression in regressions
        ]

    def _is_worth(self, proposal: Proposal, best: Fit) -> bool:
        """Whether a fit could change the verdict, if half of the predicted change is real.

        With more effects than the best fit it must gain the required BIC; with as many or fewer it
        must come near, or be similar to a sufficient one. A hypothesis is fitted again only if a
        better minimum is predicted.
        """
        share, known = self.settings.linear_share, self.fits.get(proposal.labels)
        if known is not None and not known.chi2 - proposal.chi2 > self.min_gain:
            return False
        if not proposal.labels:  # a better base counts for every explanation
            return True
        if self._cannot_be_simulated(proposal):
            return False
        if not self._is_on_course(proposal):
            return False
        is_first = known is None
        if is_first and proposal.explores and math.isinf(self.sufficient_chi2):
            return True
        if is_first and proposal.alike is best and self.is_sufficient(best):
            return True
        rise = proposal.bic - best.bic
        further = len(proposal.hypothesis) - len(best.hypothesis)
        if further > 0:
            return -rise > share * self.min_gain
        apart = self.problem.settings.decision.min_delta_bic + self.limits.numerical_noise
        return share * rise < (apart if further == 0 else max(apart, self.min_gain))

    def _is_on_course(self, proposal: Proposal) -> bool:
        """Whether it is predicted to explain its part of the misfit: with two effects of at most
        three a third, with three two thirds."""
        misfit = self.base.chi2 - self.problem.size
        part = (len(proposal.hypothesis) - 1) / MOST_EFFECTS
        return self.base.chi2 - proposal.chi2 >= part * misfit

    def _cannot_be_simulated(self, proposal: Proposal) -> bool:
        """Whether a fit of one of the effects alone failed."""
        alone = (self.fits.get(frozenset([label])) for label in proposal.labels)
        return any(fit is not None and fit.status == FAILED for fit in alone)

    def _fit(self, proposal: Proposal) -> None:
        """Fit a proposal, and keep the best fit of each hypothesis."""
        begin = time.monotonic()
        fits = proposal.fit(self.sufficient_chi2)
        self.made += fits
        for fit in fits:
            if fit.reason == NEEDS_DERIVATIVES:
                self._proposals.append(self.completed(proposal, fit))
            labels = labels_of(fit.hypothesis)
            known = self.fits.get(labels)
            if known is None or fit.chi2 < known.chi2:
                self.fits[labels] = fit
        seconds = time.monotonic() - begin
        self.seconds[proposal.labels] = self.seconds.get(proposal.labels, 0.0) + seconds
        report_progress("fits of effects", len(self.seconds))

    def completed(self, proposal: Proposal, fit: Fit) -> Proposal:
        """A `proposal` whose `fit` is provisional, to be continued with new derivatives."""

        def again(sufficient_chi2: float) -> Sequence[Fit]:
            return [
                fit_hypothesis(
                    self.problem,
                    fit.hypothesis,
                    fit.mapping,
                    differences=self.baseline.differences,
                    sufficient_chi2=sufficient_chi2,
                )
            ]

        bic = fit.bic - fit.chi2 + fit.predicted_chi2
        return replace(proposal, chi2=fit.predicted_chi2, bic=bic, fit=again, explores=False)


def _different(queue: Sequence[Proposal]) -> Iterator[Proposal]:
    """The first of each set of alternatives, as their sensitivities are equal."""
    groups = set()
    for proposal in queue:
        group = frozenset(candidate.exclusion_group for candidate in proposal.hypothesis)
        if group not in groups:
            groups.add(group)
            yield proposal


@dataclass(frozen=True)
class SingleEffects:
    """One effect, by linear regression about the base.

    With loose joints predictions mislead: as long as none suffices, every effect that changes
    the motion is fitted if it is predicted to explain a hundredth of the misfit.
    """

    name: str = "single effects"

    def propose(self, search: Search) -> Iterable[Proposal]:
        if not search.is_new(self.name):
            return []
        about, settings = search.sensitivities, search.settings
        regression = SensitivityRegression(about)
        singles = regression.singles()
        if search.is_sufficient(search.base):
            return search.proposals(self.name, singles, about)
        tried = shortlist(singles, settings.max_singles)
        if search.problem.is_rough:
            without = regression.explained(()).chi2
            most = without - settings.least_explained_share * (without - search.problem.size)
            moving = [one for one in singles if not one.hypothesis[0].sensor and one.chi2 < most]
            tried += [one for one in moving if one not in tried]
        others = [one for one in singles if one not in tried]
        return [
            *search.proposals(self.name, tried, about, explores=True),
            *search.proposals(self.name, others, about),
        ]


@dataclass(frozen=True)
class Clearances:
    """Clearances of joints that are ideal in the file: sizes by a filter, fits in windows.

    They are due if no single effect suffices, or if two are the best, as a clearance can resemble
    two effects. With loose joints, where this takes long, they are due if nothing else is left
    and all else leaves more than half of the misfit.
    """

    name: str = "likely clearances"
    share: float = 0.5  # Of the simulated runs of a search
    least_left: float = 0.5  # Of the misfit, with loose joints

    def propose(self, search: Search) -> Iterable[Proposal]:
        alone = [fit for fit in search.fits.values() if len(fit.hypothesis) == 1]
        suffices = any(map(search.is_sufficient, [search.base, *alone]))
        is_due = (bool(alone) and not suffices) or len(search.best.hypothesis) > 1
        if search.problem.is_rough:
            is_due = bool(alone) and search.share_left > self.least_left and not search.worth()
        if not (search.has_clearances and is_due and search.is_new(self.name)):
            return []
        starts = likely_clearances(search.baseline)

        def fit(_: float) -> Sequence[Fit]:
            limit = search.problem.limit(self.name, self.share)
            return fit_clearances(search.baseline, starts, search.limits, alone, limit)

        return [Proposal(self.name, starts[0][0], -math.inf, -math.inf, fit)] if starts else []


@dataclass(frozen=True)
class MaskedPairs:
    """Pairs that explain nearly everything by linear regression where no single effect does, as
    they mask each other."""

    name: str = "effects that mask each other"

    def propose(self, search: Search) -> Iterable[Proposal]:
        if len(search.fits) == 1 or not math.isinf(search.sufficient_chi2):
            return []
        if not search.is_new(self.name):
            return []
        base, problem, about = search.baseline.base, search.problem, search.sensitivities
        regression = SensitivityRegression(about)
        noise = search.limits.omnibus * problem.size
        if any(single.chi2 <= noise for single in regression.singles()):
            return []
        misfit = base.chi2 - problem.size
        most = base.chi2 - problem.settings.decision.min_explained_share * misfit
        pairs = shortlist(regression.pairs(most), search.settings.partners)
        return search.proposals(self.name, pairs, about)


@dataclass(frozen=True)
class OneMore:
    """One effect more than the best fit, or than the leading fits of each size if none suffices, by
    linear regression about them."""

    name: str = "one effect more"

    def propose(self, search: Search) -> Iterable[Proposal]:
        best, proposals = search.best, []
        if search.problem.is_rough and any(len(one.hypothesis) == 1 for one in search.worth()):
            return []  # they come first, and sensitivities about each fit are simulated
        fits = [fit for size in range(1, MOST_EFFECTS) for fit in search.leading(size)]
        if search.is_sufficient(best):
            fits = [best]
        for fit in fits:
            extends = 0 < len(fit.hypothesis) < MOST_EFFECTS and not fit.in_windows
            if extends and search.is_new(self.name, id(fit)):
                about, settings = search.about(fit), search.settings
                singles = SensitivityRegression(about, fit.hypothesis).singles()
                explores = fit is search.leading(len(fit.hypothesis))[0]
                count = settings.max_singles if explores else settings.partners
                partners = shortlist(singles, count)
                proposals += search.proposals(self.name, partners, about, explores)
        return proposals


@dataclass(frozen=True)
class Completion:
    """The best fit with new derivatives, if it is provisional and nothing else is left."""

    name: str = "completion of the best fit"

    def propose(self, search: Search) -> Iterable[Proposal]:
        best = search.best
        if best.reason != NEEDS_DERIVATIVES or search.worth():
            return []
        if not search.is_new(self.name, id(best)):
            return []
        proposal = Proposal(self.name, best.hypothesis, -math.inf, -math.inf, lambda _: [best])
        return [replace(search.completed(proposal, best), chi2=-math.inf, bic=-math.inf)]


@dataclass(frozen=True)
class Exchanges:
    """The best fit without one or all of its effects, or with one exchanged, from its nuisances.

    Without its partner an effect may be confused with another one, and the base may have missed a
    better minimum of its nuisances. Another effect is similar if it explains at least half of what
    the exchanged one does.
    """

    name: str = "exchanges of one effect"

    def propose(self, search: Search) -> Iterable[Proposal]:
        best, proposals = search.best, []
        if not best.hypothesis or best.in_windows or best.reason == NEEDS_DERIVATIVES:
            return []
        if not search.is_new(self.name, id(best)):
            return []
        sensitivities = search.sensitivities
        if search.problem.is_rough and search.is_sufficient(best):
            # those about the base say little about a fit far from it
            differences = search.baseline.differences
            sensitivities = simulate_sensitivities(search.problem, best, differences)
        smaller = [tuple(c for c in best.hypothesis if c is not out) for out in best.hypothesis]
        for hypothesis in smaller if len(best.hypothesis) == 1 else [*smaller, ()]:
            about = sensitivities.about(without_other_effects(search.problem, best, hypothesis))
            regression = SensitivityRegression(about, hypothesis)
            without = regression.explained(())
            proposals += search.proposals(self.name, [without], about)
            if hypothesis in smaller:
                half = best.chi2 + search.settings.linear_share * (without.chi2 - best.chi2)
                singles = regression.singles()
                similar = [single for single in singles if single.chi2 < half]
                others = [single for single in singles if not single.chi2 < half]
                proposals += search.proposals(self.name, similar, about, alike=best)
                proposals += search.proposals(self.name, others, about)
        return proposals


@dataclass(frozen=True)
class SlowEffects:
    """With loose joints, single effects whose simulations take long, if nothing else is left and
    nothing explains nearly all."""

    name: str = "effects with slow simulations"

    def propose(self, search: Search) -> Iterable[Proposal]:
        problem = search.problem
        is_due = problem.is_rough and math.isinf(search.sufficient_chi2) and len(search.fits) > 1
        is_due &= search.share_left > 1.0 - problem.settings.decision.min_explained_share
        if not is_due or search.worth() or not search.is_new(self.name):
            return []
        candidates = [one for one in problem.model.candidates if is_slow_effect(one)]
        labels = {one.carrier for one in candidates}
        candidates += [one for one in problem.model.candidates if one.label in labels]
        about = simulate_sensitivities(
            problem, search.base, search.baseline.differences, candidates
        )
        singles = SensitivityRegression(about).singles()
        slow = [single for single in singles if is_slow_effect(single.hypothesis[0])]
        slow = shortlist(slow, search.settings.partners)
        return search.proposals(self.name, slow, about, explores=True)


@dataclass(frozen=True)
class Earlier:
    """The sufficient explanations of an earlier search with another noise, from their values."""

    search: Search
    name: str = "earlier explanations"

    def propose(self, search: Search) -> Iterable[Proposal]:
        if not search.is_new(self.name):
            return []
        sufficient = filter(self.search.is_sufficient, self.search.fits.values())
        problem, differences = search.problem, search.baseline.differences

        def fit_again(fit: Fit) -> Callable[[float], Sequence[Fit]]:
            return lambda _: [
                fitted(problem, fit.hypothesis, fit.mapping, differences=differences, near=fit)
            ]

        return [
            Proposal(self.name, fit.hypothesis, -math.inf, -math.inf, fit_again(fit))
            for fit in sufficient
            if fit.hypothesis
        ]


STEPS: tuple[Step, ...] = (
    SingleEffects(),
    MaskedPairs(),
    OneMore(),
    Completion(),
    Exchanges(),
    Clearances(),
    SlowEffects(),
)
"""The steps of the search."""
