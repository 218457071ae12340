"""The slider-crank as a model for identification."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import tau
from types import MappingProxyType

import numpy as np

from jointgap.config import Mechanism
from jointgap.config.campaign_file import Campaign, CampaignRun
from jointgap.config.channels import CHANNELS
from jointgap.config.load import validate
from jointgap.config.nuisance_bounds import NUISANCES, RUN_NUISANCES
from jointgap.core.candidates import Candidate, Effects, Parameter, Series
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.joints import PINS
from jointgap.effects import EFFECTS
from jointgap.effects.base import GROUPS, SLIDER_SIGN_SPEED, FitContext, MotionScale
from jointgap.identification.fit import Fit
from jointgap.identification.problem import values_in_run
from jointgap.rig.contradictions import OF_SAMPLES, contradictions
from jointgap.rig.drives import MeasuredDrive, measured_drive, starts_with_record
from jointgap.rig.read_files import check_runs_left
from jointgap.rig.recording import Measurements, noise_of
from jointgap.rig.sampling import SampleGrid, own_rows, planned_grid, sample_grid, speed_from_periodicity
from jointgap.rig.sensors import Faults, sensor_candidates
from jointgap.rig.settings import DEFAULT_SETTINGS, NuisanceSettings, SliderCrankSettings
from jointgap.rig.simulate_run import (
    RunPlan,
    augmented_mechanism,
    channels_read,
    friction_speed,
    lasting_damping,
    numerics_for,
    unknown_starts,
    with_nuisances,
)
from jointgap.rig.statistics import chaotic_channels, chaotic_run, measured_statistics, simulated_statistics


def physical_candidates(context: FitContext) -> list[Candidate]:
    """Effects that could be missing in a mechanism, by what they act on; those that it has, or that cannot act in it,
    are left out.
    """
    placed = [
        (GROUPS.index(effect.GROUP), effect.sites().index(candidate.site) if candidate.has_site else 0, candidate)
        for effect in EFFECTS.values()
        for candidate in effect.candidates(context)
        if context.mechanism.effect(candidate.name, candidate.site if candidate.has_site else None) is None
        and _is_possible(context, candidate)
    ]
    return [candidate for _, _, candidate in sorted(placed, key=lambda entry: entry[:2])]


def _is_possible(context: FitContext, candidate: Candidate) -> bool:
    """Whether a mechanism file may hold the effect at a small size: what it refuses would be named in vain."""
    small = {
        f"{candidate.label}.{p.key}": min(max(p.step, p.low), p.high) if p.key in candidate.amplitudes else p.nominal
        for p in candidate.coordinates
    }
    try:
        augmented_mechanism(context.mechanism, (candidate,), small)
    except InputError:
        return False
    return True


def shared_nuisances(
    campaign: Campaign, settings: NuisanceSettings = DEFAULT_SETTINGS.nuisances
) -> tuple[Parameter, ...]:
    """Those of the mechanism and its sensors that all runs share."""
    nuisances = []
    for key in campaign.nuisance:
        if key not in RUN_NUISANCES and key not in campaign.idle_nuisances:
            nominal = campaign.nominals(key)[0]
            low, high = campaign.bounds(key, nominal)
            nuisances.append(_parameter(settings, key, nominal, low, high, NUISANCES[key] or "1"))
    if (width := friction_speed(campaign.mechanism)) is not None:
        low, high = width / settings.friction_speed_factor, width * settings.friction_speed_factor
        nuisances.append(_parameter(settings, "friction_speed", width, low, high, "m/s"))
    reach = math.log(settings.lasting_damping_factor)
    for name in lasting_damping(campaign.mechanism).values():
        nuisances.append(_parameter(settings, name, 0.0, -reach, reach, "1"))
    return tuple(nuisances)


def check_bounds(campaign: Campaign) -> None:
    """Make sure that the mechanism is possible at the ends of its nuisances' bounds.

    One at a time, the others at nominal; and where lengths and clearances together leave the crank least room to turn.
    """
    bounds = {p.name: (p.low, p.high) for p in shared_nuisances(campaign) if p.name in campaign.nuisance}
    tightest = {"crank_length": 1, "rod_length": 0} | {f"{pin}_clearance": 1 for pin in PINS}
    together = {key: bounds[key][end] for key, end in tightest.items() if key in bounds}
    alone = [{key: end} for key, ends in bounds.items() for end in ends]
    for values in [*alone, together] if len(together) > 1 else alone:
        _check_possible(campaign, values)


def _check_possible(campaign: Campaign, values: Mapping[str, float]) -> None:
    at = ", ".join(f"{key} = {value:g} {NUISANCES[key]}".rstrip() for key, value in values.items())
    source = f"campaign {campaign.name}, nuisance, at the bound {at}"
    try:
        validate(Mechanism, with_nuisances(campaign.mechanism, values).model_dump(), source)
    except InputError as error:
        raise InputError(f"{error}; or give narrower bounds") from error


def run_nuisances(
    campaign: Campaign,
    run: CampaignRun,
    samples: SampleGrid,
    first_angle_searched: bool,
    settings: NuisanceSettings = DEFAULT_SETTINGS.nuisances,
) -> tuple[Parameter, ...]:
    """What a run has for itself, as far as it is not exact: zeros of its sensors, speed, first angle, motor's line.

    Where the measured angle drives the crank, its speed and first angle are in the drive, and are no nuisances.
    """
    nuisances = []
    for key in RUN_NUISANCES:
        if key != "speed" and key in campaign.nuisance and key not in campaign.idle_nuisances:
            (nominal,) = campaign.nominals(key)
            low, high = campaign.bounds(key, nominal)
            nuisances.append(_parameter(settings, key, nominal, low, high, NUISANCES[key], run.id))
    if campaign.drive == "measured_angle":
        return tuple(nuisances)
    if samples.encoded and samples.speed_reach > 0:
        low, high = samples.speed - samples.speed_reach, samples.speed + samples.speed_reach
        nuisances.append(_parameter(settings, "speed", samples.speed, low, high, "rad/s", run.id))
    elif not samples.encoded and "speed" in campaign.nuisance:
        low, high = campaign.bounds("speed", run.speed)
        nuisances.append(_parameter(settings, "speed", min(max(samples.speed, low), high), low, high, "rad/s", run.id))
    reach = settings.first_angle_reach_rad if first_angle_searched else samples.first_reach
    if reach > 0:
        first = samples.first_angle
        nuisances.append(_parameter(settings, "first_angle", first, first - reach, first + reach, "rad", run.id))
    return tuple(nuisances)


def _parameter(
    settings: NuisanceSettings, name: str, nominal: float, low: float, high: float, unit: str, run: str | None = None
) -> Parameter:
    return Parameter(name, nominal, low, high, settings.step_share_of_bounds * (high - low), unit, run)


POSITIONS = ("crank_angle", "slider_position", "rod_angle")
"""Channels smooth enough for what grows with their rate to be the time stamps' doing."""


class SliderCrankModel:
    """A `jointgap.core.candidates.Model` of a slider-crank."""

    def __init__(
        self,
        campaign: Campaign,
        plans: Mapping[str, RunPlan],
        measured: Mapping[str, Mapping[str, np.ndarray]],
        noise: Mapping[str, Mapping[str, float | None]],
        held_out: Mapping[str, np.ndarray],
        searched: frozenset[str] = frozenset(),
        settings: SliderCrankSettings = DEFAULT_SETTINGS,
        told_encoder_offset: float | None = None,
        left_out: Mapping[str, str] = MappingProxyType({}),
    ):
        self.left_out = left_out
        self.told_encoder_offset = told_encoder_offset
        self.campaign, self.plans, self.name, self.settings = campaign, plans, campaign.name, settings
        own = [
            p
            for run, plan in plans.items()
            for p in run_nuisances(campaign, plan.run, plan.samples, run in searched, settings.nuisances)
        ]
        self.nuisances: tuple[Parameter, ...] = (*shared_nuisances(campaign, settings.nuisances), *own)
        self.numerics = numerics_for(campaign)
        self._chaotic = {}
        for run, plan in plans.items():
            values = self.nominal(run)
            if channels := chaotic_channels(campaign, plan, values, noise[run]):
                kept = ~held_out[run] | held_out[run].all()
                fitted = {channel: np.where(kept, measured[run][channel], np.nan) for channel in channels}
                self._chaotic[run] = chaotic_run(campaign, plan, channels, values, fitted, noise[run])
        self._rows = {
            (run, channel): own_rows(plan.samples.elapsed, measured[run][channel])
            for run, plan in plans.items()
            for channel in plan.channels
        }
        self.series = tuple(
            series for run in plans for series in self._all_series(run, measured[run], noise[run], held_out[run])
        )

    def nominal(self, run: str) -> dict[str, float]:
        """Nominal values [SI] of every nuisance that a run has, by name."""
        return {p.name: p.nominal for p in self.nuisances if p.run in (None, run)}

    def chaotic(self, run: str) -> tuple[str, ...]:
        """Channels of a run that are compared by statistics over cycles."""
        return self._chaotic[run].statistics.channels if run in self._chaotic else ()

    def _all_series(self, run: str, measured, noise, held_out) -> list[Series]:
        samples, series = self.plans[run].samples, []
        for channel in self.plans[run].channels:
            if channel not in self.chaotic(run):
                rows = self._rows[run, channel]
                value, sd = measured[channel][rows], noise.get(channel)
                stated = None if sd is None else np.full(value.size, sd)
                unit = CHANNELS[channel]
                step = (self.campaign.channels[channel].resolution or 0.0) * self.campaign.factor(channel)
                jitter = self.campaign.jitter
                if jitter is None and not (samples.timed and channel in POSITIONS):
                    jitter = 0.0  # what impacts do not repeat in velocities and accelerations is a motion
                series.append(
                    Series(
                        run,
                        channel,
                        unit,
                        value,
                        samples.time[rows],
                        samples.angle[rows],
                        held_out[rows],
                        stated,
                        resolution=step,
                        jitter=jitter,
                    )
                )
        return series + (self._statistics(run, measured, held_out) if run in self._chaotic else [])

    def _statistics(self, run: str, measured, held_out) -> list[Series]:
        """Series of the chaotic channels: statistics of the samples for fitting, then of those held out."""
        chaotic, angle, bins = self._chaotic[run], self.plans[run].samples.angle, self.settings.statistics.bins
        groups = [part for part in (False, True) if (held_out == part).any()]
        parts = [
            measured_statistics(chaotic, angle[held_out == part], {c: v[held_out == part] for c, v in measured.items()})
            for part in groups
        ]
        middles = np.tile((np.arange(bins) + 0.5) * (tau / bins), len(groups))
        return [
            Series(
                run,
                name,
                CHANNELS[name.partition(" ")[0]],
                np.concatenate([part[name][0] for part in parts]),
                np.full(middles.size, np.nan),
                middles,
                np.repeat(groups, bins),
                np.concatenate([part[name][1] for part in parts]),
                statistic=True,
            )
            for name in parts[0]
        ]

    def drive_errors(self, run: str, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Parameters as of `jointgap.core.candidates.Driven.drive_errors`."""
        plan = self.plans[run]
        plan = replace(plan, channels=tuple(channel for channel in plan.channels if channel not in self.chaotic(run)))
        if plan.measured is None or not plan.channels:
            return {}
        usual = self._read(plan, values)
        moved = [self._read(replace(plan, measured=each), values) for each in plan.measured.moved]
        return {
            channel: np.array([each[channel] - usual[channel] for each in moved]).reshape(-1, usual[channel].size).T
            for channel in usual
        }

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """Every effect and every fault of a sensor that could be missing."""
        run, plan = next(iter(self.plans.items()))
        speed = float(np.mean([plan.samples.speed for plan in self.plans.values()]))
        read = channels_read(self.campaign, plan, self.nominal(run))
        spreads = {
            name: (float(np.ptp(values) and np.std(values)), CHANNELS[name])
            for name, values in read.items()
            if name != "crank_angle"
        }
        context = FitContext(
            self.campaign.mechanism,
            MotionScale.of(self.campaign.mechanism, speed),
            {p.name: p for p in self.nuisances if p.run is None},
            self.campaign.drive == "constant_speed",
            self.settings.sample_grid.planned_force_order * speed / tau,
            tuple(self.plans),
            unknown_starts(self.campaign, self.settings.simulation),
        )
        encoder = "crank_angle" in self.campaign.channels
        # in a single run for fitting a zero of its own is the offset that all runs have
        several = sum(plan.run.role != "confirm" for plan in self.plans.values()) > 1
        drives = self.campaign.drive == "measured_angle"
        return (
            *physical_candidates(context),
            *sensor_candidates(
                spreads,
                encoder,
                speed,
                drives,
                {p.name for p in self.nuisances},
                tuple(self.plans) if several else (),
                self.told_encoder_offset,
            ),
        )

    def simulate(
        self, run: str, values: Mapping[str, float], effects: Effects = (), numerics: int = 0
    ) -> dict[str, np.ndarray]:
        """Parameters as of `jointgap.core.candidates.Model.simulate`."""
        plan, chaotic = self.plans[run], self._chaotic.get(run)
        sampled = tuple(channel for channel in plan.channels if channel not in self.chaotic(run))
        read = {}
        if sampled:
            read = self._read(replace(plan, channels=sampled), values, effects, numerics)
        if chaotic is not None:
            statistics = simulated_statistics(self.campaign, chaotic, values, effects, numerics)
            sizes = {series.channel: series.value.size for series in self.series if series.run == run}
            # the same for the samples for fitting and for those held out
            read |= {name: np.tile(bins, sizes[name] // bins.size) for name, bins in statistics.items()}
        return read

    def _read(
        self, plan: RunPlan, values: Mapping[str, float], effects: Effects = (), numerics: int = 0
    ) -> dict[str, np.ndarray]:
        """What the sensors read, each at its own rows."""
        read = channels_read(self.campaign, plan, values, effects, numerics)
        return {channel: value[self._rows[plan.run.id, channel]] for channel, value in read.items()}


def library(model: SliderCrankModel) -> tuple[Candidate, ...]:
    """One candidate for each term of a force on the slider and of a torque on the crank."""
    mean_speed = float(np.mean([plan.samples.speed for plan in model.plans.values()]))
    scale = MotionScale.of(model.campaign.mechanism, mean_speed)
    stroke, speed, turning = scale.stroke, scale.speed, scale.turning
    y = f"(x - {scale.middle!r})"
    sign = f"tanh(v/{SLIDER_SIGN_SPEED!r})"
    slider = {
        "1": 1.0,
        "v": speed,
        "|v|": speed,
        sign: 1.0,
        "v*|v|": speed**2,
        "v^3": speed**3,
        y: stroke,
        f"{y}^3": stroke**3,
        f"|{y}|": stroke,
        "cos(theta)": 1.0,
        "sin(theta)": 1.0,
        f"{y}*v": stroke * speed,
        f"{y}*|v|": stroke * speed,
        f"{y}*{sign}": stroke,
        "v*cos(theta)": speed,
        "v*sin(theta)": speed,
    }
    crank = {
        "1": 1.0,
        "w": turning,
        "w*|w|": turning**2,
        "cos(theta)": 1.0,
        "sin(theta)": 1.0,
        "cos(2*theta)": 1.0,
        "sin(2*theta)": 1.0,
    }
    torque = scale.force * stroke
    return (
        *(_term("discovered_slider_force", "slider", text, scale.force / size) for text, size in slider.items()),
        *(_term("discovered_crank_torque", "crank", text, torque / size) for text, size in crank.items()),
    )


def _term(effect: str, site: str, text: str, step: float) -> Candidate:
    coefficient = Parameter("coefficient", 0.0, step=step)
    return Candidate(f"{effect}[{text}]", site, (coefficient,), ("coefficient",))


def remaining_doubts(
    model: SliderCrankModel, measurements: Measurements, explanations: Sequence[Fit]
) -> tuple[str, ...]:
    """Channels whose readings contradict others' with at least one of several explanations."""
    return tuple(dict.fromkeys(channel for fit in explanations for channel in _left(model, measurements, fit)))


def _left(model: SliderCrankModel, measurements: Measurements, fit: Fit) -> list[str]:
    """Channels in doubt once the faults of a fit are taken out; a run with a fault of its own that is not fitted, such
    as the zero of an encoder in a held-out run, is left out.
    """
    corrected, erring = {}, False
    sensors = tuple(candidate for candidate in fit.hypothesis if candidate.sensor)
    for run in model.plans:
        recording = measurements.runs[run]
        own = [p.key for p in model.nuisances if p.run == run and p.name in Faults.NUISANCES]
        own += [f"{candidate.label}.{p.key}" for candidate in sensors for p in candidate.coordinates if p.run == run]
        if any(key not in fit.mapping for key in own):
            continue
        nuisances, effects = values_in_run(model, run, fit.mapping, sensors)
        faults = Faults(effects, model.plans[run].run.direction == "clockwise", nuisances)
        corrected[run] = faults.taken_out(recording)
        erring |= bool(faults)
    if not erring:
        return [found.channel for found in measurements.contradictions if found.doubtful]
    # what is clipped or stuck cannot be undone: there any fault of that sensor counts
    sites = {candidate.site for candidate in sensors}
    lost = [one for one in measurements.contradictions if one.kind in OF_SAMPLES and one.channel not in sites]
    left = contradictions(model.campaign, corrected, model.settings.recordings)
    return [one.channel for one in (*lost, *left) if one.doubtful]


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
