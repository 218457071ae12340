"""From a campaign and its recordings to the model."""

import math
from collections.abc import Mapping
from dataclasses import replace
from math import tau

import numpy as np

from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.errors import InputError, SimulationError
from jointgap.recordings import Measurements
from jointgap.recordings.read_campaign import check_runs_left
from jointgap.recordings.recording import noise_of
from jointgap.slider_crank.chaotic_channels import chaotic_channels
from jointgap.slider_crank.driven_run import MeasuredDrive, measured_drive, starts_with_record
from jointgap.slider_crank.model import SliderCrankModel
from jointgap.slider_crank.nuisances import check_bounds, run_nuisances, shared_nuisances
from jointgap.slider_crank.run_simulation import RunPlan, channels_read
from jointgap.slider_crank.sample_grid import SampleGrid, planned_grid, sample_grid, speed_from_periodicity
from jointgap.slider_crank.settings import DEFAULT_SETTINGS, SliderCrankSettings


def build_model(
    campaign: Campaign,
    measurements: Measurements | None = None,
    revolutions: Mapping[str, float] | None = None,
    settings: SliderCrankSettings = DEFAULT_SETTINGS,
) -> SliderCrankModel:
    """The model of a campaign.

    A measured run that cannot be simulated is left out: `SliderCrankModel.left_out` says why.
    """
    check_bounds(campaign)
    plans, measured, noise, held_out, searched = {}, {}, {}, {}, set()
    left_out = dict(measurements.left_out) if measurements else {}
    for run in campaign.runs:
        if run.id in left_out:
            continue
        try:
            plan, values = _plan(campaign, run, measurements, revolutions or {}, settings)
            if measurements is not None:
                _check_simulated(campaign, plan)
        except (InputError, SimulationError) as error:
            if measurements is None:
                raise
            left_out[run.id] = str(error)
            continue
        plans[run.id] = plan
        measured[run.id] = {channel: values[channel] for channel in plan.channels}
        noise[run.id] = noise_of(campaign, run.id)
        held_out[run.id] = _held_out(run, plan.samples.time.size, measurements)
        if _is_searched(campaign, run, measurements):
            searched.add(run.id)
    check_runs_left(campaign, left_out)
    campaign = campaign.model_copy(update={"runs": tuple(run for run in campaign.runs if run.id in plans)})
    doubts = measurements.contradictions if measurements else ()
    told = next((doubt.phase for doubt in doubts if (doubt.channel, doubt.kind) == ("crank_angle", "phase")), None)
    return SliderCrankModel(campaign, plans, measured, noise, held_out, frozenset(searched), settings, told, left_out)


def _is_searched(campaign: Campaign, run: CampaignRun, measurements: Measurements | None) -> bool:
    """Whether the first angle of a run is found by a search."""
    unread = "crank_angle" not in campaign.channels and campaign.drive == "constant_speed"
    return measurements is not None and unread and run.first_angle is None


def _plan(
    campaign: Campaign,
    run: CampaignRun,
    measurements: Measurements | None,
    revolutions: Mapping[str, float],
    settings: SliderCrankSettings,
) -> tuple[RunPlan, dict[str, np.ndarray]]:
    """The plan of one run, and what was measured by channel [SI]."""
    if measurements is None:
        samples, values = _planned(campaign, run, revolutions.get(run.id), settings)
    else:
        samples, values = _recorded(campaign, run, measurements, settings)
    compared = samples.encoded and campaign.drive != "measured_angle"
    channels = [name for name in campaign.channels if name not in ("time", "crank_angle")]
    channels += ["crank_angle"] if "crank_angle" in campaign.channels and compared else []
    plan = RunPlan(run, samples, tuple(channels), _measured(campaign, run, samples, settings), settings)
    if "crank_angle" not in campaign.channels and measurements is not None and campaign.drive == "constant_speed":
        # what is held out of a run that is split may not tell how its beginning turned
        held_out = measurements.runs[run.id].held_out
        hidden = held_out & (not held_out.all())
        fitted = {channel: np.where(hidden, np.nan, values[channel]) for channel in channels}
        if "speed" in campaign.nuisance:
            plan = _with_speed(campaign, plan, fitted)
        if _is_searched(campaign, run, measurements):
            plan = _with_first_angle(campaign, plan, fitted)
    return plan, values


def _check_simulated(campaign: Campaign, plan: RunPlan) -> None:
    """SimulationError where the model as it stands cannot be simulated along a run."""
    for channel, read in channels_read(campaign, plan, _nominal(campaign, plan)).items():
        if not np.isfinite(read).all():
            raise SimulationError(f"{channel} as simulated is not finite")


def _resolution(campaign: Campaign) -> float:
    encoder = campaign.channels.get("crank_angle")
    return encoder.resolution * campaign.factor("crank_angle") if encoder and encoder.resolution else 0.0


def _planned(
    campaign: Campaign, run: CampaignRun, revolutions: float | None, settings: SliderCrankSettings
) -> tuple[SampleGrid, dict[str, np.ndarray]]:
    def grid(count: int | None = None) -> SampleGrid:
        first = _first_angle(run) or 0.0
        return planned_grid(run.speed, first, "crank_angle" in campaign.channels, count, settings.sample_grid)

    samples = grid()
    if revolutions is not None and _is_chaotic(campaign, run, samples, settings):
        samples = grid(min(max(round(revolutions), 1), settings.sample_grid.max_planned_revolutions))
    return samples, {channel: np.full(samples.time.size, np.nan) for channel in campaign.channels}


def _is_chaotic(campaign: Campaign, run: CampaignRun, samples: SampleGrid, settings: SliderCrankSettings) -> bool:
    channels = tuple(name for name in campaign.channels if name != "time")
    plan = RunPlan(run, samples, channels, _measured(campaign, run, samples, settings), settings)
    return bool(chaotic_channels(campaign, plan, _nominal(campaign, plan), noise_of(campaign, run.id)))


def _nominal(campaign: Campaign, plan: RunPlan) -> dict[str, float]:
    nuisances = (*shared_nuisances(campaign), *run_nuisances(campaign, plan.run, plan.samples, False))
    return {p.name: p.nominal for p in nuisances}


def _measured(
    campaign: Campaign, run: CampaignRun, samples: SampleGrid, settings: SliderCrankSettings
) -> MeasuredDrive | None:
    """A measured angle that drives the crank."""
    if campaign.drive != "measured_angle":
        return None
    back = 0 if starts_with_record(run) else settings.simulation.settling_revolutions
    noise = noise_of(campaign, run.id).get("crank_angle")
    return measured_drive(samples, _resolution(campaign), noise, back, settings.sample_grid)


def _first_angle(run: CampaignRun) -> float | None:
    """As stated [rad]; of a clockwise crank the mirror image turns, as its angles are read."""
    return -run.first_angle if run.first_angle is not None and run.direction == "clockwise" else run.first_angle


def _recorded(
    campaign: Campaign, run: CampaignRun, measurements: Measurements, settings: SliderCrankSettings
) -> tuple[SampleGrid, dict[str, np.ndarray]]:
    recording, constant = measurements.runs[run.id], campaign.drive == "constant_speed"
    time, angle, step = recording.time, recording.crank_angle, _resolution(campaign)
    samples = sample_grid(time, angle, run.speed, _first_angle(run), step, constant, settings.sample_grid)
    return samples, {**recording.channels, "crank_angle": recording.crank_angle}


def _held_out(run: CampaignRun, count: int, measurements: Measurements | None) -> np.ndarray:
    if measurements is not None:
        return measurements.runs[run.id].held_out
    share = {"confirm": 1.0, "split": 1.0 / 3.0}.get(run.role, 0.0)
    return np.arange(count) >= count - math.ceil(share * count)


def _with_speed(campaign: Campaign, plan: RunPlan, measured: dict[str, np.ndarray]) -> RunPlan:
    """The plan with the speed, within its bounds, at which what was measured repeats best."""
    own, (low, high) = plan.samples, campaign.bounds("speed", plan.run.speed)
    speed = speed_from_periodicity(own.elapsed, list(measured.values()), low, high, plan.settings.sample_grid)
    return replace(plan, samples=replace(own, speed=speed, angle=own.first_angle + speed * own.elapsed))


def _with_first_angle(campaign: Campaign, plan: RunPlan, measured: dict[str, np.ndarray]) -> RunPlan:
    """The plan with the first angle at which the model as it stands agrees best with what was measured."""
    own, count = plan.samples, plan.settings.sample_grid.first_angles_tried
    turn = np.arange(count) / count
    dense = replace(own, time=turn * (tau / own.speed), read=np.full(count, np.nan), angle=tau * turn, first_angle=0.0)
    simulated = channels_read(campaign, replace(plan, samples=dense), {})
    misfit = np.zeros(count)
    phase = np.round(own.elapsed * own.speed / tau * count).astype(int)
    for channel, value in measured.items():
        finite = np.isfinite(value)
        spread = max(float(np.std(simulated[channel])), float(np.std(value[finite])), 1e-300)
        for shift in range(count):
            away = value[finite] - simulated[channel][(phase[finite] + shift) % count]
            misfit[shift] += np.median(np.abs(away)) / spread  # a median: spikes of impacts lie a little aside
    first = float(np.argmin(misfit)) * tau / count
    return replace(plan, samples=replace(own, first_angle=first, angle=own.angle - own.first_angle + first))
