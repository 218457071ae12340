"""From a campaign and its recordings to the model."""

import math
from dataclasses import replace

import numpy as np

from jointgap.config.campaign import Campaign, CampaignRun
from jointgap.measure import Measurements
from jointgap.measure.recording import noise_of
from jointgap.rig.clock import TURN, Clock, clock, planned_clock
from jointgap.rig.drives import DROPPED, measured_pieces
from jointgap.rig.folding import folded_speed
from jointgap.rig.model import RigModel
from jointgap.rig.simulation import RunPlan, channels_read

_SEARCHED = 720  # crank angles per revolution at which a first angle is looked for


def rig_model(campaign: Campaign, measurements: Measurements | None = None) -> RigModel:
    """The model of a campaign.

    Parameters
    ----------
    campaign : Campaign
    measurements : Measurements, optional
        None for a campaign that is yet to be measured: some revolutions of each run are planned.

    Raises
    ------
    InputError
        A recording that does not go with the drive.
    """
    plans, measured, noise, held_out, searched = {}, {}, {}, {}, set()
    for run in campaign.runs:
        clock_, values = _planned(campaign, run) if measurements is None else _recorded(campaign, run, measurements)
        encoder = campaign.channels.get("crank_angle")
        compared = clock_.encoded and campaign.drive != "measured_angle"
        channels = [name for name in campaign.channels if name not in ("time", "crank_angle")]
        channels += ["crank_angle"] if encoder and compared else []
        pieces = None
        if campaign.drive == "measured_angle":
            back = 0 if run.start in ("at_rest", "dead_centre") else DROPPED
            pieces = measured_pieces(clock_, _resolution(campaign) or None, back)
        plans[run.id] = RunPlan(run, clock_, tuple(channels), pieces)
        held_out[run.id] = (
            _held_out(run, clock_.time.size) if measurements is None else measurements.runs[run.id].held_out
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
    return RigModel(campaign, plans, measured, noise, held_out, frozenset(searched))


def _resolution(campaign: Campaign) -> float:
    encoder = campaign.channels.get("crank_angle")
    return encoder.resolution * campaign.factor("crank_angle") if encoder and encoder.resolution else 0.0


def _planned(campaign: Campaign, run: CampaignRun) -> tuple[Clock, dict[str, np.ndarray]]:
    encoded = "crank_angle" in campaign.channels
    found = planned_clock(run.speed, run.first_angle or 0.0, encoded)
    return found, {channel: np.full(found.time.size, np.nan) for channel in campaign.channels}


def _recorded(campaign: Campaign, run: CampaignRun, measurements: Measurements) -> tuple[Clock, dict[str, np.ndarray]]:
    recording = measurements.runs[run.id]
    constant = campaign.drive == "constant_speed"
    # of a clockwise crank the mirror image turns, as its angles are read
    first = -run.first_angle if run.first_angle is not None and run.direction == "clockwise" else run.first_angle
    found = clock(recording.time, recording.crank_angle, run.speed, first, _resolution(campaign), constant)
    return found, {**recording.channels, "crank_angle": recording.crank_angle}


def _held_out(run: CampaignRun, count: int) -> np.ndarray:
    share = {"confirm": 1.0, "split": 1.0 / 3.0}.get(run.role, 0.0)
    return np.arange(count) >= count - math.ceil(share * count)


def _with_speed(campaign: Campaign, plan: RunPlan, measured: dict[str, np.ndarray]) -> RunPlan:
    """The plan with the speed, within its bounds, at which what was measured repeats best."""
    own, bounds = plan.clock, campaign.bounds("speed", plan.run.speed)
    speed = folded_speed(own.elapsed, list(measured.values()), *bounds)
    return replace(plan, clock=replace(own, speed=speed, angle=own.first_angle + speed * own.elapsed))


def _with_first_angle(campaign: Campaign, plan: RunPlan, measured: dict[str, np.ndarray]) -> RunPlan:
    """The plan with the first angle at which the model as it stands agrees best with what was measured."""
    turn = np.arange(_SEARCHED) / _SEARCHED
    own = plan.clock
    dense = replace(
        own, time=turn * (TURN / own.speed), read=np.full(_SEARCHED, np.nan), angle=TURN * turn, first_angle=0.0
    )
    course = channels_read(campaign, replace(plan, clock=dense), {})
    misfit = np.zeros(_SEARCHED)
    phase = np.round(own.elapsed * own.speed / TURN * _SEARCHED).astype(int)
    for channel, value in measured.items():
        known = np.isfinite(value)
        spread = max(float(np.std(course[channel])), float(np.std(value[known])), 1e-300)
        for shift in range(_SEARCHED):
            away = value[known] - course[channel][(phase[known] + shift) % _SEARCHED]
            misfit[shift] += np.median(np.abs(away)) / spread
    first = float(np.argmin(misfit)) * TURN / _SEARCHED
    return replace(plan, clock=replace(own, first_angle=first, angle=own.angle - own.first_angle + first))
