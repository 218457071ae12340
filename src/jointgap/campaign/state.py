"""One campaign on its way to a verdict: what its stages have handed on so far."""

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from jointgap.campaign.campaign_files import plan
from jointgap.campaign.folder import OF_FITS, OF_NOISE, Folder
from jointgap.config.campaign_file import Campaign
from jointgap.config.load import load_campaign
from jointgap.errors import InputError

if TYPE_CHECKING:  # what a stage does not ask for is not imported: the compiled dynamics take seconds to load
    from jointgap.campaign.tables_of_identification import Outcome
    from jointgap.identification.baseline import Baseline
    from jointgap.identification.fit import Fit
    from jointgap.identification.noise_model import NoiseEstimate
    from jointgap.identification.protocol import Candidate, Model
    from jointgap.identification.thresholds import Screening
    from jointgap.recordings import Measurements


class Case:
    """A campaign and its results folder.

    What a stage hands on is read from its tables when it is first asked for; a stage that runs in this process sets it.

    Parameters
    ----------
    campaign : Path
        A campaign file.
    folder : Path, optional
        ``results/campaigns/{campaign}`` by default.

    Raises
    ------
    InputError
        The campaign file is not one, or a result would be written over a file that it reads.
    """

    def __init__(self, campaign: Path, folder: Path | None = None):
        self.campaign: Campaign = load_campaign(campaign)
        self.folder = Folder(folder or Path("results/campaigns") / self.campaign.name)
        self.folder.check_apart(*plan(campaign), *(self.campaign.folder / run.file for run in self.campaign.runs))

    @cached_property
    def measurements(self) -> "Measurements":
        """What the stage measure read."""
        from jointgap.campaign.config_snapshot import check_unchanged
        from jointgap.recordings import from_frame

        check_unchanged(self.campaign, self.folder.read("stated"))
        remarks = tuple(self.folder.read("remarks")["remark"])
        return from_frame(self.folder.read("measured"), self.campaign, remarks)

    @cached_property
    def model(self) -> "Model":
        """The rig's model with the measured data."""
        from jointgap.slider_crank import build_model

        return build_model(self.campaign, self.measurements)

    @cached_property
    def library(self) -> "list[Candidate]":
        """Terms that a law for a missing force may have."""
        from jointgap.slider_crank.force_law_terms import library

        return list(library(self.model))

    @cached_property
    def noise(self) -> "dict[tuple[str, str], NoiseEstimate]":
        """Noise of every series, without that of the numerics."""
        return self._noise("noise")

    @cached_property
    def whole_noise(self) -> "dict[tuple[str, str], NoiseEstimate]":
        """Noise of every series, with that of the numerics."""
        return self._noise("recalibrate")

    def _noise(self, stage: str) -> "dict[tuple[str, str], NoiseEstimate]":
        from jointgap.campaign.tables_of_identification import noise_from_frames

        found = noise_from_frames(self.folder.read_all(OF_NOISE, stage))
        for series in self.model.series:
            if series.key not in found or found[series.key].sd.shape != series.value.shape:
                run, channel = series.key
                raise InputError(
                    f"campaign {self.campaign.name}: {self.folder.place(OF_NOISE[0], stage)} is of other data than channel {channel} "
                    f"of run '{run}' now holds; run `jointgap {stage}` on it again, and the stages after it"
                )
        return found

    @cached_property
    def recalibrated(self) -> "Baseline":
        """The base that every explanation is compared with."""
        from jointgap.campaign.tables_of_identification import fits_from_frames
        from jointgap.identification.baseline import Baseline, probed_differences
        from jointgap.identification.problem import Problem

        problem = Problem(self.model, self.whole_noise)
        (nominal,), (base,) = (
            fits_from_frames(self.folder.read_all(OF_FITS, f"recalibrate/{which}"), problem)
            for which in ("nominal", "base")
        )
        return Baseline(problem, probed_differences(problem, base.mapping), nominal, base)

    @cached_property
    def settled(self) -> "Baseline":
        """The same with the base that the verdict rests on: a better one may have been found on the way to it."""
        from jointgap.campaign.tables_of_identification import fits_from_frames

        (base,) = fits_from_frames(self.folder.read_all(OF_FITS, "decide/base"), self.recalibrated.problem)
        return replace(self.recalibrated, base=base)

    @cached_property
    def screening(self) -> "Screening":
        """Signatures of all candidates, and thresholds."""
        from jointgap.campaign.tables_of_identification import signatures_from_frames
        from jointgap.identification.thresholds import Screening, Thresholds

        limits = Thresholds(**self.folder.read("thresholds").to_dict("records")[0])
        frames = self.folder.read_all(("signatures", "signature_shapes", "screened"), "screen")
        return Screening(signatures_from_frames(frames, self.recalibrated), limits)

    def fits(self, stage: str, parts: int) -> "tuple[list[Fit], dict[str, float]]":
        """What the parts of the stage fit or pair found, and how long each took [s]."""
        from jointgap.campaign.tables_of_identification import fits_from_frames

        found, seconds = [], {}
        for part in range(parts):
            frames = self.folder.read_all(OF_FITS, f"{stage}/{part}")
            found += fits_from_frames(frames, self.recalibrated.problem)
            seconds |= dict(zip(frames["fits"]["explanation"], frames["fits"]["seconds"], strict=True))
        return found, seconds

    def outcome(self, stage: str) -> "Outcome":
        """What the stage decide or regress settled."""
        from jointgap.campaign.tables_of_identification import Outcome, fits_from_frames

        row = self.folder.read("decision", stage).iloc[0]
        problem = self.recalibrated.problem
        # terms of a law are no candidates of the model, but the library is made only where they are needed
        frames = self.folder.read_all(OF_FITS, stage)
        more = self.library if (frames["fits"]["kind"] == "formula").any() else ()
        found = fits_from_frames(frames, problem, more)
        base = self.settled.base
        plain = self.recalibrated.nominal if row["nuisances"] == "nominal" else base
        named = row["verdict"].startswith("named")
        chosen, equivalent = (found[0], []) if named else (plain, found)
        return Outcome(row["verdict"], row["because"], chosen, base, equivalent, self.folder.read("ranking", stage))
