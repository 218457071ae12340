"""The identification of missing effects, from data to verdict."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointgap.core.candidates import Candidate, Model
from jointgap.identification.baseline import Baseline, recalibrate
from jointgap.identification.confirmation import Confirmed, confirm
from jointgap.identification.decide import decide
from jointgap.identification.evidence import final_verdict
from jointgap.identification.fit import Fit
from jointgap.identification.force_law import ForceLawResult, find_force_law, with_force_law
from jointgap.identification.law_family import FamilyInterval, with_families
from jointgap.identification.noise import (
    NoiseEstimate,
    degrees_of_freedom,
    estimate_noise,
    first_values,
    noise_of_model,
)
from jointgap.identification.search import STEPS, Earlier, Search, Step
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from jointgap.identification.thresholds import Screening, screen_candidates
from jointgap.identification.verdict import UNEXPLAINED, Decision

Noises = Mapping[tuple[str, str], NoiseEstimate]
"""Noise of every series, by run and channel."""


@dataclass(frozen=True)
class Identified:
    """What an identification finds."""

    noise: Noises  # With solver error
    baseline: Baseline  # The model without effects, fitted
    screening: Screening  # Sensitivities of all candidates, and thresholds
    search: Search  # All fits
    decision: Decision  # The verdict
    families: Sequence[FamilyInterval]  # Shapes of the laws of the named effects
    prediction: Confirmed  # Of all runs, without and with the effects


class Identification:
    """Find the effects that a model lacks.

    Parameters
    ----------
    model : Model
        Simulation and measured data (`jointgap.core.candidates`).
    settings : IdentificationSettings
        All limits.
    steps : sequence of Step
        Sources of hypotheses; those left out are not searched.
    library : sequence of Candidate
        Terms of a force law, searched if no effect explains the residual.
    false_alarm_rate : float
        [1] Share of campaigns without a missing effect in which one is found nevertheless.
    seed : int
        Of simulated null campaigns and of the bootstrap.
    has_clearances : bool
        False on inconsistent data: clearances are not searched.
    inconsistent_channels : callable, optional
        From explanations, channels that contradict others even with these: then nothing is named.
    """

    def __init__(
        self,
        model: Model,
        settings: IdentificationSettings = DEFAULT_SETTINGS,
        steps: Sequence[Step] = STEPS,
        *,
        library: Sequence[Candidate] = (),
        false_alarm_rate: float = 0.01,
        seed: int = 0,
        has_clearances: bool = True,
        inconsistent_channels: Callable[[Sequence[Fit]], Collection[str]] = lambda _: (),
    ):
        self.model, self.settings, self.steps, self.library = model, settings, steps, library
        self.false_alarm_rate, self.seed = false_alarm_rate, seed
        self.has_clearances, self.inconsistent_channels = has_clearances, inconsistent_channels

    def fit(self) -> Identified:
        """Fit the model, search for missing effects, and decide on the held-out data.

        The noise that is not stated is estimated from the repetition of cycles; once more, and all
        repeated with it, if the model with the effects leaves far less.

        Raises
        ------
        InputError, SimulationError
            The model cannot be simulated; the message gives the reason.
        """
        values = first_values(self.model, self.settings)
        noise = noise_of_model(self.model, values, self.settings)
        identified = self._fit_with(noise, values, self.steps)
        if (lower := self._lower_noise(identified)) is not None:
            steps = (Earlier(identified.search), *self.steps)
            identified = self._fit_with(lower, identified.baseline.base.mapping, steps)
        return identified

    def _fit_with(
        self, noise: Noises, values: Mapping[str, float], steps: Sequence[Step]
    ) -> Identified:
        """The identification with a known noise, from `values` of the nuisances by key [SI]."""
        model, settings, seed = self.model, self.settings, self.seed
        baseline = recalibrate(model, noise, values, settings)
        screening = screen_candidates(
            baseline, self.false_alarm_rate, degrees_of_freedom(noise), seed
        )
        search = Search(baseline, *screening, steps, self.has_clearances).run()
        decision, families = with_families(baseline, decide(search), screening.limits)
        if decision.verdict == UNEXPLAINED:
            decision = self._with_force_law(baseline, decision, screening)
        not_searched = dict.fromkeys([*decision.not_searched, *baseline.problem.not_searched])
        decision = replace(decision, not_searched=tuple(not_searched))
        # nominal values are kept if these suffice
        plain = decision.base if decision.proposed else decision.chosen
        noise = baseline.problem.noise
        prediction = confirm(model, noise, plain, decision.proposed, seed, settings)
        inconsistent = self.inconsistent_channels(decision.equivalent or [decision.chosen])
        decision = final_verdict(decision, prediction, inconsistent, settings.decision)
        return Identified(noise, baseline, screening, search, decision, families, prediction)

    def _with_force_law(
        self, baseline: Baseline, decision: Decision, screening: Screening
    ) -> Decision:
        """The decision after the search for a formula."""
        law: ForceLawResult = find_force_law(
            baseline.problem, decision.base, self.library, screening.limits, baseline.differences
        )
        return with_force_law(decision, law)

    def _lower_noise(self, identified: Identified) -> Noises | None:
        """The noise of the residual with the effects; None unless that of a series which is not
        stated is far below its first estimate.

        With a clearance, differences between cycles contain impacts that come at other phases. The
        root mean square of the residual counts where it differs little from that of the cycles.
        """
        if identified.decision.verdict == UNEXPLAINED:
            return None
        column = "augmented" if identified.decision.proposed else "base"
        table = identified.prediction.residuals
        by_series = dict(list(table.groupby(["run", "channel"], sort=False)))
        residuals = {}
        for series in self.model.series:
            rows = by_series[series.key]
            residuals[series.key] = np.full(series.value.shape, np.nan)
            residuals[series.key][rows["sample"]] = rows["measured"] - rows[column]
        again, falls = estimate_noise(self.model, residuals, self.settings.noise), False
        for key, noise in again.items():
            if noise.source != "stated":
                spread = float(np.sqrt(np.nanmean(np.square(residuals[key]))))
                ratio = spread / float(np.sqrt(np.mean(np.square(noise.sd))))
                factor = self.settings.noise.reported_mismatch
                if 1.0 < ratio < factor:
                    again[key] = replace(noise, sd=ratio * noise.sd)
                first = identified.noise[key].sd
                falls |= bool(np.mean(again[key].sd) * factor < np.mean(first))
        return again if falls else None
