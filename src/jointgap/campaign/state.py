"""State of a campaign: its file, its results folder, its measured data and its model."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from jointgap.campaign import campaign_files as files
from jointgap.campaign.tables import clockwise
from jointgap.config.load import load_campaign
from jointgap.core import schema
from jointgap.core.candidates import Candidate, Model
from jointgap.core.errors import InputError
from jointgap.core.results_folder import ResultsFolder
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings

if TYPE_CHECKING:
    from jointgap.config import Effect
    from jointgap.identification.fit import Fit
    from jointgap.identification.search import Step
    from jointgap.rig.recording import Measurements

FALSE_ALARM_RATE = 0.01
"""Share of campaigns without a missing effect in which an effect is named."""


class CampaignState:
    """A campaign and its results folder; measured data are set by the stage measure in this process
    or read from its tables."""

    false_alarm_rate = FALSE_ALARM_RATE
    seed = 0

    def __init__(
        self,
        campaign: Path,
        folder: Path | None = None,
        settings: IdentificationSettings = DEFAULT_SETTINGS,
        steps: "Sequence[Step] | None" = None,
    ):
        self.settings, self.steps = settings, steps
        self.file, self.campaign = campaign, load_campaign(campaign)
        self.folder = ResultsFolder(folder or Path("results/campaigns") / self.campaign.name)
        paths = (table.path for table in schema.TABLES.values())
        results = [path for path in paths if path and "{" not in path]
        inputs = (*files.plan(campaign), *self.campaign.load_files, *self.campaign.data_files)
        self.folder.check_apart(
            inputs, (*results, files.MECHANISM, files.VERDICT, files.ORIGIN, *files.SUMMARIES)
        )
        self.clockwise = clockwise(self.campaign)

    @cached_property
    def measurements(self) -> "Measurements":
        from jointgap.rig.recording import Contradiction, from_frame

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
        from jointgap.rig.recording import sentences

        contradictions = [entry for entry in self.measurements.contradictions if entry.stops]
        if contradictions:
            raise InputError(
                f"campaign {self.campaign.name}: channels are inconsistent, so nothing was"
                " analysed; correct the campaign file or the data, or continue with --anyway"
                " (Python: anyway=True, configuration: anyway: true)",
                *sentences(contradictions),
            )

    def remaining_inconsistencies(self, explanations: Sequence["Fit"]) -> tuple[str, ...]:
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
        from jointgap.rig.missing_effects import library

        return list(library(self.campaign.mechanism, self.model.context))
