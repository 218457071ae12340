"""State of a campaign: results of the stages so far."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from jointgap.campaign import campaign_files as files
from jointgap.campaign import fits_on_disk as disk
from jointgap.config.load import load_campaign
from jointgap.core import schema
from jointgap.core.candidates import Candidate, Model
from jointgap.core.errors import InputError
from jointgap.core.results_folder import ResultsFolder
from jointgap.identification.baseline import Baseline, probed_differences
from jointgap.identification.fit import Fit
from jointgap.identification.noise import NoiseEstimate, degrees_of_freedom
from jointgap.identification.problem import Problem
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings
from jointgap.identification.thresholds import Screening, screen_candidates
from jointgap.rig.recording import Contradiction, from_frame, sentences

if TYPE_CHECKING:
    from jointgap.config import Effect
    from jointgap.rig.recording import Measurements

FALSE_ALARM_RATE = 0.01
"""Share of campaigns without a missing effect in which an effect is named."""


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
        paths = (table.path for table in schema.TABLES.values())
        results = [path for path in paths if path and "{" not in path]
        inputs = (*files.plan(campaign), *self.campaign.load_files, *self.campaign.data_files)
        self.folder.check_apart(
            inputs, (*results, files.MECHANISM, files.VERDICT, files.ORIGIN, *files.SUMMARIES)
        )
        self.clockwise = disk.clockwise(self.campaign)

    @cached_property
    def measurements(self) -> "Measurements":
        read = self.folder.read
        files.check_unchanged(self.campaign, read(schema.CONFIG_SNAPSHOT))
        rows = read(schema.CONTRADICTIONS).to_dict("records")
        contradictions = tuple(Contradiction(**row) for row in rows)
        remarks = tuple(read(schema.REMARKS)["remark"])
        return from_frame(read(schema.MEASURED), self.campaign, remarks, contradictions)

    @cached_property
    def inconsistent_channels(self) -> tuple[str, ...]:
        """Inconsistent channels found by the stage measure."""
        doubtful = (entry for entry in self.measurements.contradictions if entry.doubtful)
        return tuple(dict.fromkeys(entry.channel for entry in doubtful))

    def check_agreement(self) -> None:
        """InputError if channels are inconsistent."""
        contradictions = [entry for entry in self.measurements.contradictions if entry.stops]
        if contradictions:
            raise InputError(
                f"campaign {self.campaign.name}: channels are inconsistent, so nothing was"
                " analysed; correct the campaign file or the data, or continue with --anyway"
                " (Python: anyway=True, configuration: anyway: true)",
                *sentences(contradictions),
            )

    def remaining_inconsistencies(self, explanations: Sequence[Fit]) -> tuple[str, ...]:
        """Channels that are inconsistent even without the sensor faults of `explanations`."""
        from jointgap.rig.model import remaining_inconsistencies

        if not self.inconsistent_channels:
            return ()
        return remaining_inconsistencies(self.model, self.measurements, explanations)

    @cached_property
    def model(self) -> Model:
        from jointgap.rig.model import build_model

        return build_model(self.campaign, self.measurements)

    @property
    def loads_of_runs(self) -> dict[str, tuple["Effect", ...]]:
        """Known loads of each run besides those of the mechanism, for a crank that turns
        counter-clockwise."""
        if not self.campaign.own_loads:
            return {}
        return {run: plan.loads for run, plan in self.model.plans.items()}

    @cached_property
    def library(self) -> list[Candidate]:
        """Candidate terms of a force law."""
        from jointgap.rig.model import library

        return list(library(self.model))

    @cached_property
    def noise(self) -> dict[tuple[str, str], NoiseEstimate]:
        """Noise of every series with solver error, by run and channel."""
        noise = disk.noise_from_frames(self.folder.read_all(files.NOISE_TABLES))
        for series in self.model.series:
            if series.key not in noise or noise[series.key].sd.shape != series.value.shape:
                run, channel = series.key
                raise InputError(
                    f"campaign {self.campaign.name}: {self.folder.place(schema.NOISE)} does not"
                    f" match the data of channel {channel} of run '{run}'; repeat `jointgap"
                    " recalibrate` and the later stages"
                )
        return noise

    @cached_property
    def baseline(self) -> Baseline:
        """The model with re-fitted nuisances, the reference of all explanations."""
        problem = Problem(self.model, self.noise, settings=self.settings)
        nominal, base = self._read_fits("recalibrate", problem)
        return Baseline(problem, probed_differences(problem, base.mapping), nominal, base)

    @cached_property
    def screening(self) -> Screening:
        """Sensitivities of all candidates, and thresholds."""
        baseline, dof = self.baseline, degrees_of_freedom(self.noise)
        differences = probed_differences(baseline.problem, baseline.base.mapping)
        baseline = replace(baseline, differences=differences)
        return screen_candidates(baseline, self.false_alarm_rate, dof, self.seed)

    def fits(self, stage: str, parts: int) -> tuple[list[Fit], dict[str, float]]:
        """Fits of all `parts` of the `stage` fit or pair, and their durations [s] by label."""
        fits, seconds = [], {}
        for part in range(parts):
            place = f"{stage}/{part}"
            fits += self._read_fits(place, self.baseline.problem)
            rows = self.folder.read(schema.FITS, place)
            seconds |= dict(zip(rows["explanation"], rows["seconds"], strict=True))
        return fits, seconds

    def _read_fits(self, stage: str, problem: Problem) -> list[Fit]:
        return disk.fits_from_frames(self.folder.read_all(files.FIT_TABLES, stage), problem)

    def write_fits(self, fits: Sequence[Fit], stage: str, seconds: Sequence[float] = ()) -> None:
        """Write `fits` with complete Jacobians as those of `stage`, with their durations [s]."""
        self.folder.write_all(disk.fits_to_frames(fits, seconds), stage)
