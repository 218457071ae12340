"""One campaign on its way to a verdict: what its stages have handed on so far."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from jointgap.campaign.campaign_files import FIT_TABLES, MECHANISM, NOISE_TABLES, SUMMARIES, VERDICT, plan
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import CONFIG_SNAPSHOT, CONTRADICTIONS, MEASURED, REMARKS, TABLES
from jointgap.identification.settings import DEFAULT_SETTINGS, IdentificationSettings

if TYPE_CHECKING:
    from jointgap.campaign.fits_on_disk import Outcome
    from jointgap.core.candidates import Candidate, Model
    from jointgap.identification.baseline import Baseline
    from jointgap.identification.fit import Fit
    from jointgap.identification.noise import NoiseEstimate
    from jointgap.identification.problem import Problem
    from jointgap.identification.thresholds import Screening
    from jointgap.rig.recording import Measurements

Noise = dict[tuple[str, str], "NoiseEstimate"]
"""Noise of every series, by run and channel."""

FALSE_ALARM_RATE = 0.01
"""Share of campaigns with nothing hidden in which something is found nevertheless."""


class CampaignState:
    """A campaign and its results folder.

    What a stage hands on is read from its tables when it is first asked for; a stage that runs in this process sets it.
    """

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
        inputs = (
            *plan(campaign),
            *self.campaign.mechanism.files,
            *(self.campaign.folder / run.file for run in self.campaign.runs),
        )
        results = (table.path for table in TABLES.values() if "{" not in table.path)
        self.folder.check_apart(inputs, (*filter(None, results), MECHANISM, VERDICT, *SUMMARIES))

    @cached_property
    def clockwise(self) -> frozenset[str]:
        """The runs whose crank turns clockwise."""
        return frozenset(run.id for run in self.campaign.runs if run.direction == "clockwise")

    @cached_property
    def measurements(self) -> "Measurements":
        """What the stage measure read."""
        from jointgap.campaign.campaign_files import check_unchanged
        from jointgap.rig.recording import Contradiction, from_frame

        check_unchanged(self.campaign, self.folder.read(CONFIG_SNAPSHOT))
        remarks = tuple(self.folder.read(REMARKS)["remark"])
        found = tuple(Contradiction(**row) for row in self.folder.read(CONTRADICTIONS).to_dict("records"))
        return from_frame(self.folder.read(MEASURED), self.campaign, remarks, found)

    @cached_property
    def doubted_channels(self) -> tuple[str, ...]:
        """Channels that contradict others, by what the stage measure found."""
        return tuple(dict.fromkeys(found.channel for found in self.measurements.contradictions if found.doubtful))

    def check_agreement(self) -> None:
        """Make sure that channels do not contradict each other before hours of work."""
        from jointgap.rig.recording import sentences

        if found := [one for one in self.measurements.contradictions if one.stops]:
            raise InputError(
                f"campaign {self.campaign.name}: channels are not what they are said to be, so nothing was analysed; "
                "mend the campaign file or the data, or go on all the same: --anyway (in Python anyway=True, in a "
                "configuration anyway: true)",
                *sentences(found),
            )

    def remaining_doubts(self, explanations: "Sequence[Fit]") -> tuple[str, ...]:
        """Channels that contradict others even once the faults of sensors that `explanations` hold are taken out."""
        if not self.doubted_channels:
            return ()
        from jointgap.rig.model import remaining_doubts

        return remaining_doubts(self.model, self.measurements, explanations)

    @cached_property
    def model(self) -> "Model":
        """The rig's model with the measured data."""
        from jointgap.rig.model import build_model

        return build_model(self.campaign, self.measurements)

    @cached_property
    def library(self) -> "list[Candidate]":
        """Terms that a law for a missing force may have."""
        from jointgap.rig.model import library

        return list(library(self.model))

    @cached_property
    def noise(self) -> Noise:
        """Noise of every series, without that of the numerics."""
        return self._noise("noise")

    @cached_property
    def noise_with_numerics(self) -> Noise:
        """Noise of every series, with that of the numerics."""
        return self._noise("recalibrate")

    def _noise(self, stage: str) -> Noise:
        from jointgap.campaign.fits_on_disk import noise_from_frames

        noise = noise_from_frames(self.folder.read_all(NOISE_TABLES, stage))
        for series in self.model.series:
            if series.key not in noise or noise[series.key].sd.shape != series.value.shape:
                run, channel = series.key
                raise InputError(
                    f"campaign {self.campaign.name}: {self.folder.place(NOISE_TABLES[0], stage)} is of other data than "
                    f"channel {channel} of run '{run}' now holds; run `jointgap {stage}` on it again, and the "
                    "stages after it"
                )
        return noise

    @cached_property
    def baseline(self) -> "Baseline":
        """The recalibrated model that every hypothesis is compared with."""
        from jointgap.identification.baseline import Baseline, probed_differences
        from jointgap.identification.problem import Problem

        problem = Problem(self.model, self.noise_with_numerics, settings=self.settings)
        (nominal,), (base,) = (self._read_fits(f"recalibrate/{which}", problem) for which in ("nominal", "base"))
        return Baseline(problem, probed_differences(problem, base.mapping), nominal, base)

    @cached_property
    def verdict_baseline(self) -> "Baseline":
        """The same with the base that the verdict rests on: a better one may have been found on the way to it."""
        (base,) = self._read_fits("decide/base", self.baseline.problem)
        return replace(self.baseline, base=base)

    def rest_on(self, base: "Fit") -> None:
        """Take `base` for the one that the verdict rests on."""
        self.verdict_baseline = replace(self.baseline, base=base)

    @cached_property
    def screening(self) -> "Screening":
        """Signatures of all candidates, and thresholds."""
        from jointgap.campaign.fits_on_disk import signatures_from_frames
        from jointgap.identification.thresholds import Screening, Thresholds

        limits = Thresholds(**self.folder.read("thresholds").to_dict("records")[0])
        frames = self.folder.read_all(("signatures", "signature_shapes", "screened"))
        return Screening(signatures_from_frames(frames, self.baseline), limits)

    def fits(self, stage: str, parts: int) -> "tuple[list[Fit], dict[str, float]]":
        """What the `parts` of the `stage` fit or pair found, and how long each fit took [s], by its label."""
        fits, seconds = [], {}
        for part in range(parts):
            frame = self.folder.read("fits", f"{stage}/{part}")
            fits += self._read_fits(f"{stage}/{part}", self.baseline.problem)
            seconds |= dict(zip(frame["explanation"], frame["seconds"], strict=True))
        return fits, seconds

    def outcome(self, stage: str) -> "Outcome":
        """The outcome that the stage decide or regress came to, or the final one: `stage` verdict."""
        from jointgap.campaign.fits_on_disk import Outcome
        from jointgap.identification.decide_verdict import UNEXPLAINED

        row = self.folder.read("decision", stage).iloc[0]
        # terms of a law are no candidates of the model, but the library is made only where they are needed
        formula = (self.folder.read("fits", stage)["kind"] == "formula").any()
        fits = self._read_fits(stage, self.baseline.problem, self.library if formula else ())
        base = self.verdict_baseline.base
        plain = self.baseline.nominal if row["nuisances"] == "nominal" else base
        chosen, equivalent, best_known = plain, [], None
        if row["verdict"].startswith("named"):
            chosen = fits[0]
        elif row["verdict"] == UNEXPLAINED:
            best_known = next(iter(fits), None)
        else:
            equivalent = fits
        ranking = self.folder.read("ranking", stage)
        return Outcome(row["verdict"], row["because"], chosen, base, equivalent, ranking, best_known)

    def _read_fits(self, stage: str, problem: "Problem", more: "Sequence[Candidate]" = ()) -> "list[Fit]":
        from jointgap.campaign.fits_on_disk import fits_from_frames

        return fits_from_frames(self.folder.read_all(FIT_TABLES, stage), problem, more)

    def write_fits(self, fits: "Sequence[Fit]", stage: str, seconds: Sequence[float] | None = None) -> None:
        """Write `fits` in full as those of `stage`, with the `seconds` that each took."""
        from jointgap.campaign.fits_on_disk import fits_to_frames

        self.folder.write_all(fits_to_frames(fits, seconds, whole_jacobian=True), stage)

    def write_noise(self, noise: Noise, stage: str) -> None:
        """Write the `noise` as that of `stage`."""
        from jointgap.campaign.fits_on_disk import noise_to_frames

        self.folder.write_all(noise_to_frames(noise), stage)

    def write_outcome(self, outcome: "Outcome", stage: str) -> None:
        """Write what the `stage` decide or regress came to, or the final one, for `outcome` to read."""
        from jointgap.campaign.fits_on_disk import fits_to_frames, parameter_frame

        self.folder.write_all(fits_to_frames(outcome.explanations), stage)
        plain = [] if outcome.named else [outcome.chosen]
        parameters = parameter_frame([*plain, *outcome.explanations], self.clockwise)
        self.folder.write("fit_parameters", parameters, stage)
        self.folder.write("ranking", outcome.ranking, stage)
        self.folder.write("decision", outcome.frame(), stage)
