"""The files of a campaign, read whole, converted to SI and checked."""

from pathlib import Path

import numpy as np

from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.config.channels import CHANNELS
from jointgap.errors import InputError
from jointgap.quantities import unit_factor
from jointgap.recordings.encoder_angle import TURN
from jointgap.recordings.plausibility import angle_outliers, clipped, inconsistent, outliers
from jointgap.recordings.recording import Measurements, Recording, noise_of
from jointgap.recordings.rotation import LEAST_TURNS, checked_rotation
from jointgap.recordings.sample_file import Columns, read_columns

LEAST_SAMPLES = 12
_IDLE = {"speed": "follows from time and crank_angle"}
LARGEST = 1e12
"""No channel has a value beyond it in SI units: what is larger stands for something else, such as 'no data'."""


def read_measurements(campaign: Campaign) -> Measurements:
    """All samples of a campaign.

    A sample without a time stamp, where times are measured, is no datum; nor is one without a crank angle where times are
    not. They are left out, and a remark says how many.

    Raises
    ------
    InputError
        What cannot be read, is no number, has no time that rises, holds less than a revolution, or does not change; with file,
        column, row and what to do.
    """
    remarks = [
        f"nuisance {key} {_IDLE.get(key, 'has nothing to act on in this mechanism')} and is left out"
        for key in campaign.idle_nuisances
    ]
    runs = {run.id: _recording(campaign, run, remarks) for run in campaign.runs}
    return Measurements(runs, tuple(remarks))


def _recording(campaign: Campaign, run: CampaignRun, remarks: list[str]) -> Recording:
    path = campaign.folder / run.file
    columns = read_columns(path, [channel.column for channel in campaign.channels.values()], campaign.csv)
    _check_units(path, campaign, columns, remarks)
    values, rows = _placed(path, campaign, columns, remarks)
    if rows.size < LEAST_SAMPLES:
        raise InputError(f"{path}: {rows.size} samples are too few; give {LEAST_SAMPLES} at least")
    time, angle, turned = checked_rotation(path, campaign, run, values, rows)
    channels = {name: found for name, found in values.items() if name not in ("time", "crank_angle")}
    for name, found in channels.items():
        _check_varies(path, campaign.channels[name].column, found)
        if (remark := clipped(found)) is not None:
            remarks.append(f"{path}, column {campaign.channels[name].column}: {name} {remark}")
        if (places := outliers(found)).size:
            remarks.append(
                f"{path}, column {campaign.channels[name].column}, row {rows[places[0]]}: {found[places[0]]:g} {CHANNELS[name]} is far from "
                f"all else (so {_are(places.size)}); leave the cell empty if it stands for 'no data'"
            )
    if "time" in values and "crank_angle" in values and (places := angle_outliers(time, angle)).size:
        column = campaign.channels["crank_angle"].column
        remarks.append(
            f"{path}, column {column}, row {rows[places[0]]}: the angle is far off its neighbours' (so {_are(places.size)}); "
            "leave the cell empty if the encoder misread it"
        )
    held_out = np.full(rows.size, run.role == "confirm")
    if run.role == "split":
        total = turned[-1] - turned[0]
        if total < 1.5 * TURN * LEAST_TURNS:
            raise InputError(
                f"{path}: {total / TURN:.4g} revolutions leave less than one for fitting when the last third of the run '{run.id}' is "
                "held out; give a longer record, or another role than split"
            )
        held_out = turned > turned[0] + 2.0 / 3.0 * total
    recording = Recording(run.id, time, angle, channels, noise_of(campaign, run.id), held_out)
    remarks += [f"{path}: {remark}" for remark in inconsistent(campaign, run, recording, turned)]
    return recording


def _check_units(path: Path, campaign: Campaign, columns: Columns, remarks: list[str]) -> None:
    """Whether a row of units in the file says what the campaign says."""
    for name, channel in campaign.channels.items():
        said = columns.units.get(channel.column)
        try:
            factor = unit_factor(said, CHANNELS[name]) if said else None
        except Exception:  # no unit that pint knows, such as Nm: the campaign's is taken
            continue
        if factor is not None and not np.isclose(factor, campaign.factor(name), rtol=1e-6):
            raise InputError(
                f"{path}, column {channel.column}: the row below the headings says '{said}', but channels.{name}.unit is "
                f"'{channel.unit}'; correct one of them"
            )
    if columns.units:
        row = ", ".join(columns.units.values())
        remarks.append(f"{path}: the row below the headings ({row}) is taken as units and skipped")


def _placed(
    path: Path, campaign: Campaign, columns: Columns, remarks: list[str]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Channels in SI without the samples that have no place in time (or angle), and the rows of the file that remain."""
    values = {}
    for name, channel in campaign.channels.items():
        written = columns.values[channel.column]
        with np.errstate(over="ignore"):  # found below
            values[name] = written * campaign.factor(name)
        if (huge := np.flatnonzero(np.abs(values[name]) > LARGEST)).size:
            raise InputError(
                f"{path}, column {channel.column}, row {columns.rows[huge[0]]}: {written[huge[0]]:g} {channel.unit} is more than any "
                "sensor reads; correct it, or leave the cell empty where nothing was measured"
            )
    place = "time" if "time" in values else "crank_angle"
    kept = np.isfinite(values[place])
    if not kept.all():
        count = int(np.count_nonzero(~kept))
        lack = "1 sample has" if count == 1 else f"{count} samples have"
        column = campaign.channels[place].column
        remarks.append(f"{path}, column {column}: {lack} no {place.replace('_', ' ')}, left out")
    return {name: found[kept] for name, found in values.items()}, columns.rows[kept]


def _are(count: int) -> str:
    return "is 1 sample" if count == 1 else f"are {count} samples"


def _check_varies(path: Path, column: str, values: np.ndarray) -> None:
    known = values[np.isfinite(values)]
    if known.size < LEAST_SAMPLES:
        raise InputError(
            f"{path}, column {column}: has {known.size} values, too few of {LEAST_SAMPLES}; "
            "give the measurement, or take the channel out of the campaign"
        )
    if np.ptp(known) == 0.0:
        raise InputError(
            f"{path}, column {column}: is constant, so the sensor told nothing; mend it, or take the channel out of the campaign"
        )
