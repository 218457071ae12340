"""State of a campaign: results of the stages so far."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from jointgap.campaign import campaign_files as files
from jointgap.campaign import fits_on_disk as disk
from jointgap.config.load import load_campaign
from jointgap.core.candidates import Candidate, Model
from jointgap.core.errors import InputError
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import TABLES
from jointgap.identification.baseline import Baseline, probed_differences
from jointgap.identification.fit import Fit
from jointgap.identification.noise import NoiseEstimate
from jointgap.identification.problem import Problem
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from jointgap.identification.thresholds import Screening
from jointgap.identification.verdict import NO_DISAGREEMENT, UNEXPLAINED, Thresholds
from jointgap.rig.recording import Contradiction, from_frame, sentences

if TYPE_CHECKING:
    from jointgap.config import Effect
    from jointgap.rig.recording import Measurements

Noise = dict[tuple[str, str], NoiseEstimate]
"""Noise of every series, by run and channel."""

FALSE_ALARM_RATE = 0.01
"""Share of campaigns without a missing effect in which one is named."""


class CampaignState:
    """A campaign and its results folder; results of stages are set in this process or read from
    their tables."""

    false_alarm_rate = FALSE_ALARM_RATE
    seed = 0

    def __init__(
        self,
        campaign: Path,
        folder: Path | None = None,
        settings: IdentificationSettings = DEFAULT_SETTINGS,
    ):
        self.settings = settings
        self.file, self.campaign = campaign, load_campaign(campaign)
        self.folder = ResultsFolder(folder or Path("results/campaigns") / self.campaign.name)
        results = [table.path for table in TABLES.values() if table.path and "{" not in table.path]
        inputs = (*files.plan(campaign), *self.campaign.load_files, *self.campaign.data_files)
        self.folder.check_apart(
            inputs, (*results, files.MECHANISM, files.VERDICT, files.ORIGIN, *files.SUMMARIES)
        )
        self.clockwise = disk.clockwise(self.campaign)

    @cached_property
    def measurements(self) -> "Measurements":
        read = self.folder.read
        files.check_unchanged(self.campaign, read("config_snapshot"))
        found = tuple(Contradiction(**row) for row in read("contradictions").to_dict("records"))
        return from_frame(read("measured"), self.campaign, tuple(read("remarks")["remark"]), found)

    @cached_property
    def inconsistent_channels(self) -> tuple[str, ...]:
        """Inconsistent channels found by the stage measure."""
        return tuple(
            dict.fromkeys(
                found.channel for found in self.measurements.contradictions if found.doubtful
            )
        )

    def check_agreement(self) -> None:
        """InputError if channels are inconsistent."""
        if found := [one for one in self.measurements.contradictions if one.stops]:
            raise InputError(
                f"campaign {self.campaign.name}: channels are inconsistent, so nothing was"
                " analysed; correct the campaign file or the data, or continue with --anyway"
                " (Python: anyway=True, configuration: anyway: true)",
                *sentences(found),
            )

    def remaining_inconsistencies(self, explanations: Sequence[Fit]) -> tuple[str, ...]:
        """Channels that are inconsistent even without the sensor faults of `explanations`."""
        from jointgap.rig.model import remaining_inconsistencies

        return (
            remaining_inconsistencies(self.model, self.measurements, explanations)
            if self.inconsistent_channels
            else ()
        )

    @cached_property
    def model(self) -> Model:
        from jointgap.rig.model import build_model

        return build_model(self.campaign, self.measurements)

    @property
    def own_loads(self) -> dict[str, tuple["Effect", ...]]:
        """Known loads of each run besides those of the mechanism, for a crank that turns
        counter-clockwise."""
        return (
            {run: plan.loads for run, plan in self.model.plans.items()}
            if self.campaign.own_loads
            else {}
        )

    @cached_property
    def library(self) -> list[Candidate]:
        """Candidate terms of a force law."""
        from jointgap.rig.model import library

        return list(library(self.model))

    @cached_property
    def noise(self) -> Noise:
        """Noise of every series without solver error."""
        return self._noise("noise")

    @cached_property
    def noise_with_numerics(self) -> Noise:
        """Noise of every series with solver error."""
        return self._noise("recalibrate")

    def _noise(self, stage: str) -> Noise:
        noise = disk.noise_from_frames(self.folder.read_all(files.NOISE_TABLES, stage))
        for series in self.model.series:
            if series.key not in noise or noise[series.key].sd.shape != series.value.shape:
                run, channel = series.key
                raise InputError(
                    f"campaign {self.campaign.name}: {self.folder.place('noise', stage)} does not"
                    f" match the data of channel {channel} of run '{run}'; repeat `jointgap"
                    f" {stage}` and the later stages"
                )
        return noise

    @cached_property
    def baseline(self) -> Baseline:
        """The model with re-fitted nuisances, the reference of all explanations."""
        problem = Problem(self.model, self.noise_with_numerics, settings=self.settings)
        (nominal,), (base,) = (
            self._read_fits(f"recalibrate/{which}", problem) for which in ("nominal", "base")
        )
        return Baseline(problem, probed_differences(problem, base.mapping), nominal, base)

    @cached_property
    def verdict_baseline(self) -> Baseline:
        """The same with the base of the verdict, which may be better."""
        (base,) = self._read_fits("decide/base", self.baseline.problem)
        return replace(self.baseline, base=base)

    @cached_property
    def screening(self) -> Screening:
        """Sensitivities of all candidates, and thresholds."""
        limits = Thresholds(**self.folder.read("thresholds").to_dict("records")[0])
        frames = self.folder.read_all(("signatures", "signature_shapes", "screened"))
        return Screening(disk.sensitivities_from_frames(frames, self.baseline), limits)

    def fits(self, stage: str, parts: int) -> tuple[list[Fit], dict[str, float]]:
        """Fits of all `parts` of the `stage` fit or pair, and the duration of each [s] by label."""
        fits, seconds = [], {}
        for part in range(parts):
            fits += self._read_fits(f"{stage}/{part}", self.baseline.problem)
            seconds |= (
                self.folder.read("fits", f"{stage}/{part}")
                .set_index("explanation")["seconds"]
                .to_dict()
            )
        return fits, seconds

    def _read_fits(self, stage: str, problem: Problem, more: Sequence[Candidate] = ()) -> list[Fit]:
        return disk.fits_from_frames(self.folder.read_all(files.FIT_TABLES, stage), problem, more)

    def write_fits(
        self, fits: Sequence[Fit], stage: str, seconds: Sequence[float] | None = None
    ) -> None:
        """Write `fits` with full Jacobians as those of `stage`, with their durations in
        `seconds`."""
        self.folder.write_all(disk.fits_to_frames(fits, seconds, whole_jacobian=True), stage)

    def outcome(self, stage: str) -> disk.Outcome:
        """The outcome of the `stage` decide, regress or verdict (final)."""
        row = self.folder.read("decision", stage).iloc[0]
        verdict, base = row["verdict"], self.verdict_baseline.base
        # terms of a law are in the library, which is slow to make
        formula = (self.folder.read("fits", stage)["kind"] == "formula").any()
        fits = self._read_fits(stage, self.baseline.problem, self.library if formula else ())
        chosen = self.baseline.nominal if row["nuisances"] == "nominal" else base
        told = {name: tuple(json.loads(row[name])) for name in ("certain", "not_searched")}
        ranking = self.folder.read("ranking", stage)
        found = disk.Outcome(verdict, chosen, base, because=row["because"], ranking=ranking, **told)
        if verdict.startswith("named"):
            return replace(found, chosen=fits[0], twins=fits[1:])
        if verdict == UNEXPLAINED:
            return replace(found, best_known=next(iter(fits), None))
        return replace(found, equivalent=fits)

    def write_outcome(self, outcome: disk.Outcome, stage: str) -> None:
        """Write the outcome of the `stage` decide, regress or verdict (final)."""
        nuisances = "nominal" if outcome.verdict == NO_DISAGREEMENT else "base"
        decision = {
            "verdict": [outcome.verdict],
            "because": [outcome.because],
            "nuisances": [nuisances],
        }
        decision |= {
            name: [json.dumps(getattr(outcome, name))] for name in ("certain", "not_searched")
        }
        plain = [] if outcome.named else [outcome.chosen]
        frames = disk.fits_to_frames(outcome.explanations) | {
            "fit_parameters": disk.parameter_frame([*plain, *outcome.explanations], self.clockwise),
            "ranking": outcome.placed_ranking,
            "decision": pd.DataFrame(decision),
        }
        self.folder.write_all(frames, stage)
