"""From a campaign and its recordings to the model."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.recordings import Measurements
from jointgap.recordings.recording import noise_of
from jointgap.slider_crank.channel_kinematics import DROPPED
from jointgap.slider_crank.chaotic_channels import chaotic_channels
from jointgap.slider_crank.driven_run import measured_pieces
from jointgap.slider_crank.model import SliderCrankModel
from jointgap.slider_crank.nuisances import check_ends, of_run, shared
from jointgap.slider_crank.run_simulation import RunPlan, channels_read
from jointgap.slider_crank.sample_grid import MOST_PLANNED, TURN, SampleGrid, planned_grid, sample_grid
from jointgap.slider_crank.speed_from_periodicity import speed_from_periodicity

_SEARCHED = 720  # crank angles per revolution at which a first angle is looked for


def build_model(
    campaign: Campaign, measurements: Measurements | None = None, revolutions: Mapping[str, float] | None = None
) -> SliderCrankModel:
    """The model of a campaign.

    Parameters
    ----------
    campaign : Campaign
    measurements : Measurements, optional
        None for a campaign that is yet to be measured: some revolutions of each run are planned.
    revolutions : mapping of str to float, optional
        Of a campaign that is planned: how many a run is known to have. One whose motion is chaotic is planned as long, as each
        cycle tells something new; one that repeats is not, as simulated cycles are alike.

    Raises
    ------
    InputError
        A recording that does not go with the drive; bounds of nuisances at which the mechanism cannot be simulated.
    """
    check_ends(campaign)
    plans, measured, noise, held_out, searched = {}, {}, {}, {}, set()
    for run in campaign.runs:
        if measurements is None:
            samples, values = _planned(campaign, run, (revolutions or {}).get(run.id))
        else:
            samples, values = _recorded(campaign, run, measurements)
        encoder = campaign.channels.get("crank_angle")
        compared = samples.encoded and campaign.drive != "measured_angle"
        channels = [name for name in campaign.channels if name not in ("time", "crank_angle")]
        channels += ["crank_angle"] if encoder and compared else []
        plans[run.id] = RunPlan(run, samples, tuple(channels), _pieces(campaign, run, samples))
        held_out[run.id] = (
            _held_out(run, samples.time.size) if measurements is None else measurements.runs[run.id].held_out
        )
        measured[run.id] = {channel: values[channel] for channel in channels}
        noise[run.id] = noise_of(campaign, run.id)
        if encoder is not None or measurements is None or campaign.drive != "constant_speed":
            continue
        # what is held out of a run that is split may not tell how its beginning turned
        told = {c: np.where(held_out[run.id], np.nan, v) for c, v in measured[run.id].items()}
        told = measured[run.id] if held_out[run.id].all() else told
        if "speed" in campaign.nuisance:
            plans[run.id] = _with_speed(campaign, plans[run.id], told)
        if run.first_angle is None:
            searched.add(run.id)
            plans[run.id] = _with_first_angle(campaign, plans[run.id], told)
    return SliderCrankModel(campaign, plans, measured, noise, held_out, frozenset(searched))


def _resolution(campaign: Campaign) -> float:
    encoder = campaign.channels.get("crank_angle")
    return encoder.resolution * campaign.factor("crank_angle") if encoder and encoder.resolution else 0.0


def _planned(
    campaign: Campaign, run: CampaignRun, revolutions: float | None
) -> tuple[SampleGrid, dict[str, np.ndarray]]:
    encoded = "crank_angle" in campaign.channels
    first = _first_angle(run) or 0.0
    found = planned_grid(run.speed, first, encoded)
    if revolutions is not None and _is_chaotic(campaign, run, found):
        found = planned_grid(run.speed, first, encoded, min(max(round(revolutions), 1), MOST_PLANNED))
    return found, {channel: np.full(found.time.size, np.nan) for channel in campaign.channels}


def _is_chaotic(campaign: Campaign, run: CampaignRun, samples: SampleGrid) -> bool:
    channels = tuple(name for name in campaign.channels if name != "time")
    nominal = {p.name: p.nominal for p in (*shared(campaign), *of_run(campaign, run, samples, False))}
    plan = RunPlan(run, samples, channels, _pieces(campaign, run, samples))
    return bool(chaotic_channels(campaign, plan, nominal, noise_of(campaign, run.id)))


def _pieces(campaign: Campaign, run: CampaignRun, samples: SampleGrid) -> tuple[np.ndarray, float] | None:
    """Of a measured angle that drives the crank."""
    if campaign.drive != "measured_angle":
        return None
    back = 0 if run.start in ("at_rest", "dead_centre") else DROPPED
    return measured_pieces(samples, _resolution(campaign) or None, back)


def _first_angle(run: CampaignRun) -> float | None:
    """As stated; of a clockwise crank the mirror image turns, as its angles are read."""
    return -run.first_angle if run.first_angle is not None and run.direction == "clockwise" else run.first_angle


def _recorded(
    campaign: Campaign, run: CampaignRun, measurements: Measurements
) -> tuple[SampleGrid, dict[str, np.ndarray]]:
    recording = measurements.runs[run.id]
    constant = campaign.drive == "constant_speed"
    first, step = _first_angle(run), _resolution(campaign)
    found = sample_grid(recording.time, recording.crank_angle, run.speed, first, step, constant)
    return found, {**recording.channels, "crank_angle": recording.crank_angle}


def _held_out(run: CampaignRun, count: int) -> np.ndarray:
    share = {"confirm": 1.0, "split": 1.0 / 3.0}.get(run.role, 0.0)
    return np.arange(count) >= count - math.ceil(share * count)


def _with_speed(campaign: Campaign, plan: RunPlan, measured: dict[str, np.ndarray]) -> RunPlan:
    """The plan with the speed, within its bounds, at which what was measured repeats best."""
    own, bounds = plan.samples, campaign.bounds("speed", plan.run.speed)
    speed = speed_from_periodicity(own.elapsed, list(measured.values()), *bounds)
    return replace(plan, samples=replace(own, speed=speed, angle=own.first_angle + speed * own.elapsed))


def _with_first_angle(campaign: Campaign, plan: RunPlan, measured: dict[str, np.ndarray]) -> RunPlan:
    """The plan with the first angle at which the model as it stands agrees best with what was measured."""
    turn = np.arange(_SEARCHED) / _SEARCHED
    own = plan.samples
    dense = replace(
        own, time=turn * (TURN / own.speed), read=np.full(_SEARCHED, np.nan), angle=TURN * turn, first_angle=0.0
    )
    course = channels_read(campaign, replace(plan, samples=dense), {})
    misfit = np.zeros(_SEARCHED)
    phase = np.round(own.elapsed * own.speed / TURN * _SEARCHED).astype(int)
    for channel, value in measured.items():
        known = np.isfinite(value)
        spread = max(float(np.std(course[channel])), float(np.std(value[known])), 1e-300)
        for shift in range(_SEARCHED):
            away = value[known] - course[channel][(phase[known] + shift) % _SEARCHED]
            misfit[shift] += np.median(np.abs(away)) / spread
    first = float(np.argmin(misfit)) * TURN / _SEARCHED
    return replace(plan, samples=replace(own, first_angle=first, angle=own.angle - own.first_angle + first))
