"""The mechanism of a campaign as a model for identification."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import tau
from typing import NamedTuple

import numpy as np

from jointgap.config.campaign import Campaign, CampaignRun
from jointgap.config.channels import PRESSURES, joints_of
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.load import validate
from jointgap.core.candidates import Candidate, Effects, Parameter, Series, Variation
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.words import joined
from jointgap.effects.base import (
    DETECTABLE_SHARE,
    FitContext,
)
from jointgap.identification.fit import Fit
from jointgap.identification.problem import values_in_run
from jointgap.motion.of_file import check_linkage
from jointgap.rig.checks import is_computed
from jointgap.rig.consistency_checks import consistency_checks
from jointgap.rig.cylinder_pressure import loads_of_run, perturbed
from jointgap.rig.drives import (
    SETTLING_REVOLUTIONS,
    RunPlan,
    Values,
    measured_drive,
    starts_with_record,
)
from jointgap.rig.linearised import linearised_changes
from jointgap.rig.missing_effects import (
    bounded,
    law_candidates,
    motion_scales,
    physical_candidates,
)
from jointgap.rig.read_files import check_runs_left
from jointgap.rig.recording import OF_SAMPLES, Measurements, Recording, noise_of
from jointgap.rig.sampling import (
    SampleGrid,
    channel_rows,
    planned_grid,
    sample_grid,
    speed_from_periodicity,
    with_start,
)
from jointgap.rig.sensors import (
    ENCODER_COUPLING,
    ENCODER_ECCENTRICITY,
    ENCODER_LAG,
    ENCODER_OFFSET,
    ENCODER_ZEROS,
    Faults,
    sensor_candidates,
)
from jointgap.rig.simulate_run import (
    channels_read,
    friction_speed,
    numerics_for,
    steady_contact_damping,
    with_nuisances,
)
from jointgap.rig.statistics import (
    BINS,
    chaotic_channels,
    chaotic_run,
    measured_statistics,
    simulated_statistics,
)
from jointgap.rig.windows import RunInWindows, run_in_windows

# [1] Half width of the bounds of `friction_speed`, which is not measured
FRICTION_SPEED_FACTOR = 4.0
# [1] Half width of the bounds of steady-contact damping: the last impacts before steady contact,
# whose damping the published laws keep, have 0.02 to 0.22 m/s (default: 0.05 m/s)
STEADY_CONTACT_DAMPING_FACTOR = 4.0
# [rad] Bounds of a searched first angle, as the current model may lack an effect
FIRST_ANGLE_REACH = math.pi / 6
# Per revolution, if the first angle or clock offset is unknown; start of the fit
FIRST_ANGLES_TRIED = 720
SEARCHED_TURNS = 10  # For the offset of a second clock
# Of a planned chaotic run: for longer ones the simulated cycles limit the accuracy
MAX_PLANNED_REVOLUTIONS = 60
# [1, of the crank speed] Start value of the frequency of a harmonic force without data: near no
# harmonic
PLANNED_FORCE_ORDER = 1.37


def _listed(campaign: Campaign, keys: Iterable[str], run: str | None = None) -> list[Parameter]:
    """The nuisances `keys` that a campaign lists and that have an effect."""
    return [
        bounded(
            key,
            nominal,
            *campaign.bounds(key, nominal),
            campaign.nuisance_kinds[key].unit or "1",
            run,
        )
        for key in keys
        if key in campaign.nuisance and key not in campaign.idle_nuisances
        for nominal in campaign.nominals(key)[:1]
    ]


def shared_nuisances(campaign: Campaign) -> tuple[Parameter, ...]:
    """Nuisances shared by all runs."""
    nuisances = _listed(
        campaign, (key for key in campaign.nuisance if key not in campaign.run_nuisances)
    )
    if (width := friction_speed(campaign.mechanism)) is not None:
        low = width / FRICTION_SPEED_FACTOR
        high = width * FRICTION_SPEED_FACTOR
        nuisances.append(bounded("friction_speed", width, low, high, "m/s"))
    reach = math.log(STEADY_CONTACT_DAMPING_FACTOR)
    names = steady_contact_damping(campaign.mechanism).values()
    return (*nuisances, *(bounded(name, 0.0, -reach, reach, "1") for name in names))


def check_bounds(campaign: Campaign) -> None:
    """InputError if the mechanism is impossible at a bound of its nuisances.

    Each alone, the others nominal, and the most unfavourable combination of lengths and clearances.
    """
    bounds = {
        p.name: (p.low, p.high) for p in shared_nuisances(campaign) if p.name in campaign.nuisance
    }
    sites = campaign.mechanism.sites
    tightest = {f"{link}_length": 1 if link == sites.crank else 0 for link in sites.links}
    tightest |= {f"{joint}_clearance": 1 for joint in joints_of(sites)}
    together = {key: bounds[key][end] for key, end in tightest.items() if key in bounds}
    alone = [{key: end} for key, ends in bounds.items() for end in ends]
    for values in [*alone, together] if len(together) > 1 else alone:
        at = ", ".join(
            f"{key} = {value:g} {campaign.nuisance_kinds[key].unit}".rstrip()
            for key, value in values.items()
        )
        source = f"campaign {campaign.name}, nuisance, at the bound {at}"
        try:
            changed = with_nuisances(campaign.mechanism, values)
            validate(type(changed), changed.model_dump(), source)
            check_linkage(changed, source)
        except InputError as error:
            raise InputError(f"{error}; or narrow the bounds") from error


def run_nuisances(campaign: Campaign, plan: RunPlan, searched: bool) -> tuple[Parameter, ...]:
    """Nuisances of a run: sensor zeros, offset of a second clock, speed, first angle (`searched`:
    found by a search), motor line.

    If the measured angle drives the crank, speed and first angle are no nuisances.
    """
    run, samples = plan.run, plan.samples
    nuisances = _listed(campaign, (key for key in campaign.run_nuisances if key != "speed"), run.id)
    if plan.second_clock:
        offset = plan.clock_offset
        reach = FIRST_ANGLE_REACH / samples.speed
        nuisances.append(
            bounded("clock_offset", offset, offset - reach, offset + reach, "s", run.id)
        )
    if campaign.drive == "measured_angle":
        return tuple(nuisances)
    speed, first_angle, reach = samples.speed, samples.first_angle, samples.speed_reach
    is_free = campaign.drive == "free"
    if is_free:
        speed, reach = samples.start_speed, samples.start_reach
    if (samples.encoded or is_free) and reach > 0:
        nuisances.append(bounded("speed", speed, speed - reach, speed + reach, "rad/s", run.id))
    elif not (samples.encoded or is_free) and "speed" in campaign.nuisance:
        low, high = campaign.bounds("speed", run.speed)
        nuisances.append(bounded("speed", min(max(speed, low), high), low, high, "rad/s", run.id))
    reach = FIRST_ANGLE_REACH if searched else samples.first_reach
    if reach > 0:
        nuisances.append(
            bounded(
                "first_angle", first_angle, first_angle - reach, first_angle + reach, "rad", run.id
            )
        )
    return tuple(nuisances)


class RunData(NamedTuple):
    """Simulation plan and measured data of one run."""

    plan: RunPlan
    values: dict[str, np.ndarray]  # By channel [SI]; NaN for a planned run
    held_out: np.ndarray  # Samples not used for fitting and selection
    searched: bool = False  # Whether the first angle was found by a search


class LinkageModel:
    """A `jointgap.core.candidates.Model` of a linkage; `left_out`: the reason for each run
    that is not used."""

    def __init__(
        self,
        campaign: Campaign,
        runs: Mapping[str, RunData],
        left_out: Mapping[str, str],
        estimated_encoder_offset=None,
    ):
        self.campaign, self.name, self.left_out = campaign, campaign.name, left_out
        self.plans = {run: data.plan for run, data in runs.items()}
        self._estimated_encoder_offset = estimated_encoder_offset
        of_runs = [run_nuisances(campaign, data.plan, data.searched) for data in runs.values()]
        self.nuisances: tuple[Parameter, ...] = sum(of_runs, shared_nuisances(campaign))
        self.numerics = numerics_for(campaign)
        self._rows = {
            (run, channel): channel_rows(data.plan.samples.elapsed, data.values[channel])
            for run, data in runs.items()
            for channel in data.plan.channels
        }
        self._chaotic, series = {}, []
        for run, data in runs.items():
            values = self.nominal(run)
            noise = noise_of(campaign, run)
            if channels := chaotic_channels(campaign, data.plan, values, noise):
                fitted = _fitted(data.values, data.held_out)
                self._chaotic[run] = chaotic_run(
                    campaign, data.plan, channels, values, fitted, noise
                )
            series += [
                self._samples(data, channel, noise.get(channel)) for channel in self._sampled(run)
            ]
            if run in self._chaotic:
                series += self._statistics(run, data)
        self.series = tuple(series)

    def nominal(self, run: str) -> dict[str, float]:
        """Nominal values [SI] of the nuisances of a run, by name."""
        return {p.name: p.nominal for p in self.nuisances if p.run in (None, run)}

    def chaotic(self, run: str) -> tuple[str, ...]:
        """Channels of a run that are compared by statistics over cycles."""
        return self._chaotic[run].statistics.channels if run in self._chaotic else ()

    def _sampled(self, run: str) -> tuple[str, ...]:
        return tuple(
            channel for channel in self.plans[run].channels if channel not in self.chaotic(run)
        )

    def _samples(self, data: RunData, channel: str, noise: float | None) -> Series:
        samples = data.plan.samples
        run = data.plan.run.id
        jitter, kind = self.campaign.jitter, self.campaign.channel_kinds[channel]
        rows = self._rows[run, channel]
        if jitter is None and not (samples.timed and kind.speed_power == 0):
            # cycle-to-cycle variation of velocities and accelerations is due to impacts
            jitter = 0.0
        resolution = _resolution(self.campaign, channel)
        sd = None if noise is None else np.full(np.count_nonzero(rows), noise)
        columns = [
            column[rows]
            for column in (data.values[channel], samples.time, samples.angle, data.held_out)
        ]
        return Series(run, channel, kind.unit, *columns, sd, resolution=resolution, jitter=jitter)

    def _statistics(self, run: str, data: RunData) -> Iterator[Series]:
        """Series of the chaotic channels: statistics of the fitted, then of the held-out
        samples."""
        chaotic = self._chaotic[run]
        angle = data.plan.samples.angle
        held_out = data.held_out
        groups = [part for part in (False, True) if (held_out == part).any()]
        parts = []
        for part in groups:
            measured = {channel: value[held_out == part] for channel, value in data.values.items()}
            parts.append(measured_statistics(chaotic, angle[held_out == part], measured))
        middles = np.tile((np.arange(BINS) + 0.5) * (tau / BINS), len(groups))
        unknown = np.full(middles.size, np.nan)
        for name in parts[0]:
            value, error = (np.concatenate([part[name][i] for part in parts]) for i in (0, 1))
            unit = self.campaign.unit(name.partition(" ")[0])
            yield Series(
                run,
                name,
                unit,
                value,
                unknown,
                middles,
                np.repeat(groups, BINS),
                error,
                statistic=True,
            )

    def drive_errors(self, run: str, values: Values) -> dict[str, np.ndarray]:
        """Parameters as of `jointgap.core.candidates.Driven.drive_errors`."""
        plan = replace(self.plans[run], channels=self._sampled(run))
        plans = [replace(plan, loads=loads) for loads in perturbed(plan.loads)]
        if plan.measured:
            drives = plan.measured.perturbed
            plans = [*(replace(plan, measured=drive) for drive in drives), *plans]
        if not plans or not plan.channels:
            return {}
        nominal = self._read(plan, values)
        readings = [self._read(changed, values) for changed in plans]
        return {
            channel: np.array([read[channel] - nominal[channel] for read in readings]).T
            for channel in nominal
        }

    @cached_property
    def context(self) -> FitContext:
        """What the candidates of effects depend on: the motion at the mean speed of the runs."""
        campaign, runs = self.campaign, tuple(self.plans)
        turning = float(np.mean([plan.samples.speed for plan in self.plans.values()]))
        scale, scales = motion_scales(campaign.mechanism, turning)
        shared = {p.name: p for p in self.nuisances if p.run is None}
        constant = campaign.drive == "constant_speed"
        frequency = PLANNED_FORCE_ORDER * turning / tau
        middles = {run: float(np.mean(plan.samples.time)) for run, plan in self.plans.items()}
        return FitContext(
            campaign.mechanism, scale, shared, constant, frequency, runs, middles, scales
        )

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """All possible missing effects and sensor faults."""
        campaign, context = self.campaign, self.context
        runs, scale = context.runs, context.scale
        read = channels_read(campaign, self.plans[runs[0]], self.nominal(runs[0]))
        spreads = {
            name: float(np.ptp(v) and np.std(v))
            for name, v in read.items()
            if name != "crank_angle"
        }
        # with a single fitted run its zero is the common offset
        several = sum(plan.run.role != "confirm" for plan in self.plans.values()) > 1
        encoder = [ENCODER_OFFSET] if "crank_angle" in campaign.channels else []
        listed = {p.name for p in self.nuisances}
        if encoder and several and "encoder_zero" not in listed:
            encoder.append(ENCODER_ZEROS)
        if encoder and campaign.drive == "measured_angle":
            encoder += [ENCODER_LAG, ENCODER_ECCENTRICITY]
        # of the angle alone a fluctuating speed explains as much; the torque of a chaotic run does
        # not repeat
        if any({"crank_angle"} < {*plan.channels} for plan in self.plans.values()):
            encoder += [*(() if self._chaotic else ENCODER_COUPLING), ENCODER_ECCENTRICITY]
        torque = scale.force / DETECTABLE_SHARE * scale.stroke
        start = self._estimated_encoder_offset
        units = {name: campaign.unit(name) for name in spreads}
        sensors = sensor_candidates(
            spreads, encoder, scale.turning, torque, listed, runs, units, start
        )
        return (*physical_candidates(context), *law_candidates(campaign, context), *sensors)

    def simulate(
        self, run: str, values: Values, effects: Effects = (), numerics: int = 0
    ) -> dict[str, np.ndarray]:
        """Parameters as of `jointgap.core.candidates.Model.simulate`."""
        plan = replace(self.plans[run], channels=self._sampled(run))
        chaotic = self._chaotic.get(run)
        read = self._read(plan, values, effects, numerics) if plan.channels else {}
        if chaotic is not None:
            statistics = simulated_statistics(self.campaign, chaotic, values, effects, numerics)
            sizes = {
                series.channel: series.value.size for series in self.series if series.run == run
            }
            # the same for fitted and held-out samples
            read |= {
                name: np.tile(bins, sizes[name] // bins.size) for name, bins in statistics.items()
            }
        return read

    def changes(
        self, run: str, values: Values, effects: Effects, variations: Sequence[Variation]
    ) -> list[dict[str, np.ndarray] | None] | None:
        """Parameters as of `jointgap.core.candidates.Linearised.changes`; None for a run with
        chaotic channels, and where `linearised_changes` gives None."""
        plan = self.plans[run]
        if run in self._chaotic:
            return None
        found = linearised_changes(self.campaign, plan, values, effects, variations)
        return found and [change and self._at_rows(plan, change) for change in found]

    def windows(self, run: str, values: Values, effects: Effects = ()) -> RunInWindows | None:
        """Parameters as of `jointgap.core.candidates.Windowed.windows`."""
        plan = replace(self.plans[run], channels=self._sampled(run))
        rows = {channel: self._rows[run, channel] for channel in plan.channels}
        return run_in_windows(self.campaign, plan, values, effects, rows)

    def _read(
        self, plan: RunPlan, values: Values, effects: Effects = (), numerics: int = 0
    ) -> dict[str, np.ndarray]:
        """Sensor readings at the rows of each channel."""
        return self._at_rows(plan, channels_read(self.campaign, plan, values, effects, numerics))

    def _at_rows(self, plan: RunPlan, read: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {channel: value[self._rows[plan.run.id, channel]] for channel, value in read.items()}


def remaining_inconsistencies(
    model: LinkageModel, measurements: Measurements, explanations: Sequence[Fit]
) -> tuple[str, ...]:
    """Channels that are inconsistent with at least one of the explanations."""
    return tuple(
        dict.fromkeys(
            channel
            for fit in explanations
            for channel in _inconsistent_channels(model, measurements, fit)
        )
    )


def _inconsistent_channels(model: LinkageModel, measurements: Measurements, fit: Fit) -> list[str]:
    """Channels that are inconsistent after removing the sensor faults of a fit; without runs whose
    own fault is not fitted, such as the encoder zero of a held-out run.
    """
    corrected, erring = {}, False
    sensors = tuple(candidate for candidate in fit.hypothesis if candidate.sensor)
    for run, plan in model.plans.items():
        keys = [p.key for p in model.nuisances if p.run == run and Faults.has(p.name)]
        keys += [
            f"{candidate.label}.{p.key}"
            for candidate in sensors
            for p in candidate.coordinates
            if p.run == run
        ]
        if all(key in fit.mapping for key in keys):
            nuisances, effects = values_in_run(model, run, fit.mapping, sensors)
            faults = Faults(effects, plan.run.side, nuisances, plan.second_clock)
            corrected[run] = faults.corrected(measurements.runs[run])
            erring |= bool(faults)
    contradictions = measurements.contradictions
    if erring:
        # clipped or stuck samples cannot be corrected: any fault of that sensor explains them
        sites = {candidate.site for candidate in sensors}
        unusable = [
            item for item in contradictions if item.kind in OF_SAMPLES and item.channel not in sites
        ]
        contradictions = unusable + consistency_checks(model.campaign, corrected)
    return [item.channel for item in contradictions if item.doubtful]


def build_model(
    campaign: Campaign,
    measurements: Measurements | None = None,
    revolutions: Mapping[str, float] | None = None,
) -> LinkageModel:
    """The model of a campaign; without measurements of the planned runs (chaotic ones with
    `revolutions`).

    Measured runs that cannot be simulated are not used.
    """
    check_bounds(campaign)
    runs = {}
    left_out = dict(measurements.left_out) if measurements else {}
    for run in (run.mirrored() for run in campaign.runs):
        if measurements is None:
            runs[run.id] = _planned(campaign, run, (revolutions or {}).get(run.id))
        elif run.id not in left_out:
            try:
                runs[run.id] = _recorded(campaign, run, measurements.runs[run.id])
            except (InputError, SimulationError) as error:
                left_out[run.id] = str(error)
    check_runs_left(campaign, left_out)
    campaign = campaign.model_copy(
        update={"runs": tuple(run for run in campaign.runs if run.id in runs)}
    )
    contradictions = measurements.contradictions if measurements else ()
    phases = [item.phase for item in contradictions if item.is_encoder_zero]
    return LinkageModel(campaign, runs, left_out, phases[0] if phases else None)


def _plan(campaign: Campaign, run: CampaignRun, samples: SampleGrid) -> RunPlan:
    drives = campaign.drive == "measured_angle"
    encoder = "crank_angle" in campaign.channels
    channels = [
        name for name in campaign.channels if name not in ("time", "crank_angle", *PRESSURES)
    ]
    if encoder and samples.encoded and not (drives or samples.computed):
        channels.append("crank_angle")
    drive = None
    if drives:
        back = 0 if starts_with_record(run) else SETTLING_REVOLUTIONS
        noise = noise_of(campaign, run.id)["crank_angle"]
        drive = measured_drive(samples, _resolution(campaign, "crank_angle"), noise, back)
    return RunPlan(run, samples, tuple(channels), drive, loads=loads_of_run(campaign, run))


def _planned(campaign: Campaign, run: CampaignRun, revolutions: float | None) -> RunData:
    planned = run.speed, run.first_angle or 0.0, "crank_angle" in campaign.channels
    plan = _plan(campaign, run, planned_grid(*planned))
    if len(run.files) == 2:  # which channels are in which file is not known yet
        plan = replace(
            plan, second_clock=tuple(name for name in plan.channels if name != "crank_angle")
        )
    noise = noise_of(campaign, run.id)
    if revolutions is not None and chaotic_channels(
        campaign, plan, _nominal(campaign, plan), noise
    ):
        longer = min(max(round(revolutions), 1), MAX_PLANNED_REVOLUTIONS)
        plan = replace(
            _plan(campaign, run, planned_grid(*planned, longer)), second_clock=plan.second_clock
        )
    count = plan.samples.time.size
    held_out = math.ceil({"confirm": 1.0, "split": 1.0 / 3.0}.get(run.role, 0.0) * count)
    return RunData(
        plan,
        dict.fromkeys(plan.channels, np.full(count, np.nan)),
        np.arange(count) >= count - held_out,
    )


def _recorded(campaign: Campaign, run: CampaignRun, recording: Recording) -> RunData:
    constant = campaign.drive == "constant_speed"
    searched = False
    step = _resolution(campaign, "crank_angle") if "crank_angle" in campaign.channels else 0.0
    samples = sample_grid(
        recording.time, recording.crank_angle, run.speed, run.first_angle, step, constant
    )
    if samples.encoded and is_computed(campaign, run.id, recording.time, recording.crank_angle):
        samples = replace(samples, computed=True, first_reach=0.0, speed_reach=0.0)
    if campaign.drive == "free":
        speeds = recording.channels.get("crank_speed")
        samples = with_start(samples, None if speeds is None else run.side * speeds, step)
    plan = replace(_plan(campaign, run, samples), second_clock=recording.second_clock)
    measured = {**recording.channels, "crank_angle": recording.crank_angle}
    values = {channel: measured[channel] for channel in plan.channels}
    # held-out samples of a split run must not influence its speed and first angle
    fitted = _fitted(values, recording.held_out)
    if not any(np.isfinite(value).any() for value in fitted.values()):
        raise InputError(
            f"{campaign.folder / run.files[0]}: the first two thirds of run '{run.id}', which are"
            f" for fitting, have no value of {joined(values)}; give a record with such values, or"
            " another run for fitting"
        )
    if constant and "crank_angle" not in campaign.channels:
        if "speed" in campaign.nuisance:
            grid = plan.samples
            bounds = campaign.bounds("speed", run.speed)
            speed = speed_from_periodicity(grid.elapsed, list(fitted.values()), *bounds)
            grid = replace(grid, speed=speed, angle=grid.first_angle + speed * grid.elapsed)
            plan = replace(plan, samples=grid)
        if searched := run.first_angle is None:
            by_channel = {
                name: value for name, value in fitted.items() if name not in plan.second_clock
            }
            plan = _with_first_angle(campaign, plan, by_channel)
    plan = replace(plan, loads=loads_of_run(campaign, run, plan.samples.angle, recording.channels))
    if plan.second_clock:
        plan = _with_clock_offset(campaign, plan, fitted)
    for channel, read in channels_read(campaign, plan, _nominal(campaign, plan)).items():
        if not np.isfinite(read).all():
            raise SimulationError(f"the simulated {channel} is not finite")
        is_angle = campaign.channel_kinds[channel].part and campaign.unit(channel) == "rad"
        if is_angle and isinstance(campaign.mechanism, LinkageFile):  # it may turn fully
            values[channel] = values[channel] - tau * np.round((values[channel] - read) / tau)
    return RunData(plan, values, recording.held_out, searched)


def _resolution(campaign: Campaign, channel: str) -> float:
    """Step [SI] of a channel; 0 if it is unknown."""
    return (campaign.channels[channel].resolution or 0.0) * campaign.factor(channel)


def _fitted(values: Mapping[str, np.ndarray], held_out: np.ndarray) -> dict[str, np.ndarray]:
    """Channels of a run, NaN at held-out samples, except those of a run that is wholly held out."""
    hidden = held_out & (not held_out.all())
    return {channel: np.where(hidden, np.nan, value) for channel, value in values.items()}


def _nominal(campaign: Campaign, plan: RunPlan) -> dict[str, float]:
    nuisances = (*shared_nuisances(campaign), *run_nuisances(campaign, plan, False))
    return {p.name: p.nominal for p in nuisances}


def _with_first_angle(
    campaign: Campaign, plan: RunPlan, measured: dict[str, np.ndarray]
) -> RunPlan:
    """The plan with the first angle at which the current model agrees best with the measurement."""
    grid, count = plan.samples, FIRST_ANGLES_TRIED
    turn = np.arange(count) / count
    dense = replace(
        grid,
        time=turn * (tau / grid.speed),
        read=np.full(count, np.nan),
        angle=tau * turn,
        first_angle=0.0,
    )
    simulated = channels_read(campaign, replace(plan, samples=dense), {})
    misfit = np.zeros(count)
    phase = np.round(grid.elapsed * grid.speed / tau * count).astype(int)
    for channel, value in measured.items():
        finite = np.isfinite(value)
        spread = max(np.std(simulated[channel]), np.std(value[finite]), 1e-300)
        for shift in range(count):
            away = value[finite] - simulated[channel][(phase[finite] + shift) % count]
            # the median tolerates shifted impact spikes
            misfit[shift] += np.median(np.abs(away)) / spread
    first_angle = float(np.argmin(misfit)) * tau / count
    angle = grid.angle - grid.first_angle + first_angle
    return replace(plan, samples=replace(grid, first_angle=first_angle, angle=angle))


def _with_clock_offset(
    campaign: Campaign, plan: RunPlan, measured: dict[str, np.ndarray]
) -> RunPlan:
    """The plan with the offset of the second clock, within half a revolution, at which the current
    model agrees best with the measurement.
    """
    grid = plan.samples.first(SEARCHED_TURNS * tau)
    turn = tau / plan.samples.speed
    time = np.arange(grid.time[0], grid.time[-1], turn / FIRST_ANGLES_TRIED)
    read = np.isfinite(grid.read)
    reading = np.interp(time, grid.time[read], grid.read[read]) if read.any() else time * np.nan
    dense = replace(grid, time=time, read=reading, angle=np.interp(time, grid.time, grid.angle))
    names = tuple(name for name in plan.channels if name in plan.second_clock)
    simulated = channels_read(
        campaign, replace(plan, samples=dense, channels=names), _nominal(campaign, plan)
    )
    offsets = np.linspace(-0.5, 0.5, FIRST_ANGLES_TRIED, endpoint=False) * turn
    misfit = np.zeros(offsets.size)
    for name in names:
        value = measured[name][: grid.time.size]
        is_read = np.isfinite(value)
        spread = max(np.std(simulated[name]), np.std(value[is_read]), 1e-300)
        for place, offset in enumerate(offsets):
            at = np.interp(grid.time[is_read] - offset, time, simulated[name], np.nan, np.nan)
            away = value[is_read] - at
            # friction changes the mean
            misfit[place] += np.nanmedian(np.abs(away - np.nanmedian(away))) / spread
    return replace(plan, clock_offset=float(offsets[np.argmin(misfit)]))
