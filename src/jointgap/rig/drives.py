"""Drives: simulations with the crank motion of the record and the nuisances of a run."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import tau

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.sparse import eye_array
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from jointgap.config import Effect, FreeDrive, Mechanism, MotorDrive, Simulate
from jointgap.config.campaign import MOTOR_LINE, CampaignRun, Start
from jointgap.config.linkage_file import LinkageFile
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.records import record
from jointgap.identification.noise import scatter_between_samples
from jointgap.identification.settings import DEFAULT_SETTINGS as IDENTIFICATION
from jointgap.linkage.drive import (
    LONG_TURNS,
    AngleErrors,
    SlowRotation,
    crank_times,
    prescribed_angles,
    smooth_angle,
    standstill_time,
)
from jointgap.linkage.parameters import MEASURED, MOST_KNOTS, DriveParameters, knots_record
from jointgap.motion.model import Model, beginning
from jointgap.motion.of_file import model_of, start_state
from jointgap.motion.simulation import integrate_on, integrate_to_angles
from jointgap.rig.sampling import SampleGrid

Values = Mapping[str, float]  # Of nuisances, by name

# [m] Local error of a step. The numerical noise of whitened channels is then some hundredths over
# all samples; with 1e-9 it is ten to thirty times as large, so that fits do not converge, and only
# a sixth of the time is saved
TOLERANCE = 1e-10
SETTLING_REVOLUTIONS = 2  # Simulated before the first sample, for the start transient of contacts
MAX_SETTLING_REVOLUTIONS = 30  # For slow transients (a bending rod, a motor)
MOST_PASSES = 4  # Of the longest settling, for a motor or an engine with a heavy flywheel
SETTLING_TIME_CONSTANTS = 7.0  # [1] Length of a slow transient: exp(-7) is a thousandth
MOTOR_SAMPLES_PER_REVOLUTION = 60  # Knots of a motor's angle over time
FREE_PASSES = 3  # Of the motion before a coast-down, for its speed
FREE_STEPS = 10  # Knots that a coast-down is continued by until the record's end
# [rad/s] Start at rest: equations over the crank angle cannot start at zero speed
REST_SPEED = 1e-3
# [mean piece of a measured angle] Shorter ones make a spline through their ends inaccurate
NEAR_PIECES = 1e-2
# [1, of the rounding scatter] With a larger scatter of the readings, a spline within the encoder's
# step would follow noise
HARDLY_NOISY = 1.15


def options_of(speed: float, start_angle: float, tolerance: float, **drive) -> Simulate:
    """Options of a simulation; not validated, as that is slower than some simulations."""
    return Simulate.model_construct(
        speed=speed, start_angle=start_angle, tolerance=tolerance, **drive
    )


@dataclass(frozen=True)
class RunPlan:
    """Samples and channels of a run."""

    run: CampaignRun
    samples: SampleGrid
    channels: tuple[str, ...]  # Compared channels
    measured: "MeasuredDrive | None" = None  # A measured angle that drives the crank
    loads: tuple[Effect, ...] = ()  # Known loads of this run besides those of the mechanism
    tolerance: float = TOLERANCE  # [m] Local error of a step
    second_clock: tuple[str, ...] = ()  # Channels of a second logger
    clock_offset: float = 0.0  # [s] Start value of the offset of its clock


@dataclass(frozen=True)
class DrivenRun:
    """A simulation, and the positions of a run's samples in it."""

    model: Model
    angles: np.ndarray  # Crank angles of the samples [rad]
    begin: float  # Time [s] of the simulation at the run's first sample
    at: Callable[
        [np.ndarray], np.ndarray
    ]  # Crank angles (m,) [rad] at times (m,) [s] since the first sample


def _prescribed(model: Model, begin: float, samples: SampleGrid) -> DrivenRun:

    def at(elapsed: np.ndarray) -> np.ndarray:
        return prescribed_angles(model.p, begin + elapsed)

    return DrivenRun(model, at(samples.elapsed) if samples.timed else samples.angle, begin, at)


def starts_with_record(run: CampaignRun) -> bool:
    """Whether the motion starts at the first sample."""
    return run.start in ("at_rest", "dead_centre")


def has_unknown_start(run: CampaignRun) -> bool:
    """Whether the start of the motion is unknown; it is simulated from a settling time before the
    first sample."""
    return run.start in ("settled", "unknown")


def _turned_before(start: Start, first_angle: float, speed: float) -> float:
    """Angle turned [rad] from a stated start to the `first` angle [rad], at `speed` [rad/s]."""
    turned = start.turned or (start.ran or 0.0) * speed
    if start.angle is None:
        return turned
    part = float(np.mod(first_angle - start.angle, tau))
    return part + tau * max(round((turned - part) / tau), 0)


def _settling(time_constant: float, speed: float) -> float:
    """Angle [rad] turned before the first sample, for the decay of a transient with `time_constant`
    [s]."""
    revolutions = math.ceil(SETTLING_TIME_CONSTANTS * time_constant * speed / tau)
    return tau * min(max(SETTLING_REVOLUTIONS, revolutions), MAX_SETTLING_REVOLUTIONS)


def constant_speed_run(
    mechanism: Mechanism,
    plan: RunPlan,
    values: Values,
    error: np.ndarray | float,
    tolerance: float,
    earlier: float = 0.0,
) -> DrivenRun:
    """A crank with prescribed speed, constant or fluctuating; `error` [rad] of the encoder at the
    samples."""
    run, samples, back = plan.run, plan.samples, earlier
    offset, drift = samples.line(error) if np.ndim(error) else (error, 0.0)
    first_angle = values.get("first_angle", samples.first_angle) - offset
    speed = values.get("speed", samples.speed) - drift
    if isinstance(run.start, Start):
        back += _turned_before(run.start, first_angle, speed)
    elif not starts_with_record(run):
        bending = mechanism.effect("rod_flexibility")
        decay = (
            max(bending.damping_ratio * tau * bending.frequency_Hz, 1e-6) if bending else math.inf
        )
        back += _settling(1.0 / decay, speed)
    if not samples.timed:
        samples = replace(samples, angle=samples.angle + (first_angle - samples.first_angle))
        model = model_of(mechanism, options_of(speed, samples.angle.min() - back, tolerance))
        angles = np.array([model.drive.start_angle, samples.angle[0]])
        begin = float(crank_times(model.p, angles)[1])
        return _prescribed(model, begin, samples)
    fluctuation = mechanism.effect("speed_fluctuation")
    slowed = math.sqrt(1.0 - fluctuation.ratio**2) if fluctuation else 1.0  # mean speed over w0
    w0 = speed / slowed if samples.encoded else speed
    model = model_of(mechanism, options_of(w0, first_angle - back, tolerance))
    begin = back / (w0 * slowed)
    if fluctuation and samples.encoded:
        for _ in range(4):  # until the line through the angles is the measured one
            line_first, slope = samples.line(prescribed_angles(model.p, begin + samples.elapsed))
            model.drive.speed *= speed / slope
            begin = back / (model.drive.speed * slowed)
            model.drive.start_angle += first_angle - line_first
    return _prescribed(model, begin, samples)


def _led_in_and_out(
    time: np.ndarray, angle: np.ndarray, back: int
) -> tuple[np.ndarray, np.ndarray, LinearOperator, float, float]:
    """A record (times [s] from 0, angles [rad]) extended at both ends, its errors from those of the
    record, and the duration of its first cycle and of a revolution in it [s].

    Copies of its first cycle precede it for `back` + 1/2 revolutions; half a revolution, from a
    cycle before the end, follows (for a lagging encoder). A cycle has two revolutions (four-stroke
    engines), in records of up to 2.1 revolutions one. Where the speed drifts, the copies are
    stretched in time so that it has no jump.
    """
    turns = 2 if angle[-1] - angle[0] > LONG_TURNS * tau else 1
    cycle = float(np.interp(angle[0] + turns * tau, angle, time))
    turn = cycle / turns
    begin, end = (SlowRotation(time, angle, turns * tau, side) for side in (0, -1))
    apart = (
        0.5 * (angle[-1] - angle[0]) / (time.size - 1)
    )  # nearer samples are duplicates at a joint of two cycles
    lead_rows = np.flatnonzero(begin.turned < turns * tau - apart)
    end_rows = np.flatnonzero(np.abs(end.turned + turns * tau - 0.25 * tau) < 0.25 * tau - apart)
    copies = [(begin, lead_rows, -k * turns) for k in range(math.ceil((back + 1) / turns), 0, -1)]
    weights = np.vstack([begin.weights, end.weights])
    split = len(begin.weights)
    parts = []
    for rotation, rows, moved in [*copies, (None, np.arange(time.size), 0), (end, end_rows, turns)]:
        at = time[rows]
        shifts = np.zeros((rows.size, len(weights)))
        if rotation is not None:  # a copy is shifted by the errors of the rotation
            at = rotation.time_at(rotation.turned[rows] + moved * tau)
            columns = slice(split) if rotation is begin else slice(split, None)
            shifts[:, columns] = rotation.errors(at) - rotation.errors(time[rows])
        parts.append((at, angle[rows] + moved * tau, rows, shifts))
    at, angle, rows, shifts = (np.concatenate(column) for column in zip(*parts, strict=True))
    is_used = (
        at > -(back + 0.5) * turn
    )  # half a revolution more than simulated, as the smooth angle is poor at its ends
    copied = eye_array(time.size, format="csr")[rows[is_used]]
    errors = aslinearoperator(copied) + aslinearoperator(shifts[is_used]) @ aslinearoperator(
        weights
    )
    return at[is_used], angle[is_used], errors, cycle, turn


@dataclass(frozen=True)
class MeasuredDrive:
    """A smoothed measured angle."""

    table: np.ndarray  # Pieces: see `jointgap.linkage.parameters.knots_record`
    begin: float  # Time [s] of the record's first sample
    made_tables: Callable[[], np.ndarray]

    @cached_property
    def perturbed(self) -> list["MeasuredDrive"]:
        """The drive with each independent error of its angle, of one standard deviation."""
        return [replace(self, table=table) for table in self.made_tables()]


def measured_drive(
    samples: SampleGrid, resolution: float, noise: float | None, back: int
) -> MeasuredDrive:
    """Smooth a measured angle and estimate its errors.

    The record is extended as by `_led_in_and_out`; time 0 is the begin of the extension.
    """
    finite = np.isfinite(samples.read)
    begins = float(samples.elapsed[finite][0])
    readings = samples.read[finite]
    time, angle, copies, cycle, turn = _led_in_and_out(
        samples.elapsed[finite] - begins, readings, back
    )
    time += begins
    rounding = resolution / math.sqrt(12.0)
    scatter = _scatter(readings, rounding, noise)
    stepped = 0.0 < scatter < HARDLY_NOISY * rounding
    in_record = (time >= begins) & (time <= samples.elapsed[finite][-1])
    smooth = smooth_angle(
        time - time[0], angle, math.sqrt(12.0) * scatter if stepped else None, in_record
    )
    begin = -time[0] - back * turn
    if (still := standstill_time(smooth, begin, samples.elapsed[-1] - time[0])) is not None:
        still += time[0]
        if still < begins:  # in a copy of the first cycle
            still = begins + (still - begins) % cycle
        raise InputError(
            f"the smoothed crank angle stands still or falls at {samples.time[0] + still:.6g} s;"
            " cut the record there, or give crank_angle its resolution, so that noise is smoothed"
        )
    pieces = np.unique(np.append(smooth.x[smooth.x > begin], begin))[:-1]
    if len(pieces) > MOST_KNOTS:
        raise InputError(
            f"channels: the smoothed crank angle has {len(pieces)} pieces, more than {MOST_KNOTS}; "
            "give crank_angle its resolution, or shorter runs"
        )
    table = np.zeros((len(pieces), 7))
    table[:, 0] = pieces - begin
    for power in range(6):
        table[:, 6 - power] = smooth(pieces, power) / math.factorial(power)

    def moved() -> np.ndarray:
        sd, common = noise, None
        if resolution:
            white = math.sqrt(max(scatter**2 - rounding**2, 0.0))
            common, share = _rounding(smooth(samples.elapsed[finite] - time[0]), resolution, white)
            sd = math.hypot(white, math.sqrt(share) * rounding)
        errors = AngleErrors(
            time - time[0], angle, smooth, copies, sd, common, scatter if stepped else 0.0
        )
        changes = [errors(table[:, 0] + begin, power) / math.factorial(power) for power in range(6)]
        tables = np.repeat(table[None], errors.count, axis=0)
        tables[:, :, 6:0:-1] += np.stack(changes).transpose(2, 1, 0)
        return tables

    return MeasuredDrive(table, float(back * turn), moved)


def _scatter(readings: np.ndarray, rounding: float, noise: float | None) -> float:
    """Standard deviation [rad] of angle readings with noise and rounding.

    Noise that is not stated is estimated from fourth differences at one, two and three samples
    distance: the least estimate, as rough motion and alternating rounding only increase them.
    """
    if noise is not None:
        return math.hypot(noise, rounding)
    estimates = [
        scatter_between_samples(readings[::apart], IDENTIFICATION.noise) for apart in (1, 2, 3)
    ]
    return max(rounding, min((estimate.sd for estimate in estimates if estimate), default=0.0))


def _rounding(angle: np.ndarray, step: float, noise: float) -> tuple[np.ndarray, float]:
    """Correlated rounding errors (n, m) [rad] of angles (n,) [rad], and the uncorrelated share [1].

    Roundings correlate if angles are full steps apart (the zero of the steps is unknown): Fourier
    series of the sawtooth, damped by `noise` [rad] before the rounding.
    """
    orders = np.arange(1, 6)
    shares = 6.0 / (math.pi * orders) ** 2 * np.exp(-((tau * orders * noise / step) ** 2))
    phases = tau / step * orders * angle[:, None]
    sizes = step / math.sqrt(12.0) * np.sqrt(shares)
    return np.hstack([sizes * np.cos(phases), sizes * np.sin(phases)]), max(
        1.0 - float(shares.sum()), 0.0
    )


def measured_angle_run(
    mechanism: Mechanism,
    plan: RunPlan,
    error_of: Callable[[np.ndarray], np.ndarray | float],
    lag: float,
    tolerance: float,
) -> DrivenRun:
    """A crank that follows the measured angle; `error_of` the encoder [rad] at the angles (n,)
    [rad] that it reads."""
    table = plan.measured.table.copy()
    begin = max(plan.measured.begin + lag, 0.0)
    error = error_of(table[:, 6])
    table[:, 6] -= error
    if np.ndim(error):
        time = table[:, 0]
        apart = np.append(True, np.diff(time) > NEAR_PIECES * time[-1] / time.size)
        rates = make_interp_spline(time[apart], error[apart], k=5)
        for power in range(1, 6):
            table[:, 6 - power] -= rates(time, power) / math.factorial(power)
    speed = plan.samples.speed
    first_angle = float(table[0, 6])
    model = model_of(mechanism, options_of(speed, first_angle, tolerance))
    drive = DriveParameters(kind=MEASURED, speed=speed, start_angle=first_angle)
    p = model.p._replace(drive=record(drive), knots=knots_record(table))
    return _prescribed(replace(model, p=p), begin, plan.samples)


def motor_run(
    mechanism: Mechanism,
    motor: MotorDrive,
    plan: RunPlan,
    values: Values,
    error: np.ndarray | float,
    tolerance: float,
    earlier: float,
) -> DrivenRun:
    """A crank driven by a motor; measured angles, with the `error` [rad] of the encoder, agree with
    the simulated ones in the mean.
    """
    run, samples = plan.run, plan.samples
    line = {key: values[key] for key in MOTOR_LINE if key in values}
    motor = motor.model_copy(update=line)
    speed = values.get("speed", run.speed)
    finite = np.isfinite(samples.read)
    offset = float(np.mean(error[finite])) if np.ndim(error) else error
    first_angle = values.get("first_angle", samples.first_angle) - offset
    start_speed = REST_SPEED if run.start == "at_rest" else speed
    back = 0.0
    passes = 1
    if isinstance(run.start, Start):
        back = _turned_before(run.start, first_angle, speed)
    elif not starts_with_record(run):
        inertia = motor.inertia + _largest_inertia(mechanism)
        falling = motor.stall_torque / motor.no_load_speed  # of the torque with the speed
        if brake := mechanism.effect("crank_brake"):
            slope = brake.exponent * brake.torque_N_m / brake.reference_speed_rad_s
            falling += slope * (speed / brake.reference_speed_rad_s) ** (brake.exponent - 1.0)
        decay = inertia / falling if falling else 0.0
        back = _settling(decay, speed) + earlier
        passes = min(max(math.ceil(SETTLING_TIME_CONSTANTS * decay * speed / back), 1), MOST_PASSES)
    # a little more than at no-load speed
    reach = 1.05 * max(samples.elapsed[-1] * max(motor.no_load_speed, speed), tau)
    count = math.ceil((back + reach) / tau * MOTOR_SAMPLES_PER_REVOLUTION)
    coarse = first_angle - back + np.arange(count + 1) * (tau / MOTOR_SAMPLES_PER_REVOLUTION)
    for _ in range(
        passes
    ):  # a slow transient continues with the speed that it reached whole cycles later
        model = model_of(
            mechanism, options_of(start_speed, first_angle - back, tolerance, drive=motor)
        )
        angle_over_time = CubicSpline(
            integrate_to_angles(model, start_state(model), coarse, tolerance).times, coarse
        )
        later = int(back / (2.0 * tau)) * 2 * MOTOR_SAMPLES_PER_REVOLUTION
        start_speed = float(angle_over_time(angle_over_time.x[later], 1))
    begin = float(np.interp(first_angle, coarse, angle_over_time.x))
    if samples.encoded and back:
        shift = samples.first_angle - values.get("first_angle", samples.first_angle) + offset
        for _ in range(4):
            away = angle_over_time(begin + samples.elapsed[finite]) + shift - samples.read[finite]
            begin = max(begin - float(np.mean(away)) / speed, 0.0)

    def at(elapsed: np.ndarray) -> np.ndarray:
        return angle_over_time(begin + elapsed)

    return DrivenRun(model, at(samples.elapsed), begin, at)


def _largest_inertia(mechanism: Mechanism | LinkageFile) -> float:
    """Moment of inertia [kg m^2] about the crank's axis: of the crank, and an upper bound for the
    other bodies."""
    sites = mechanism.sites
    crank = mechanism.body(sites.crank)
    if isinstance(mechanism, LinkageFile):
        centre = crank.mass_centre_from(sites.drive)
        moving = sum(body.mass for body in mechanism.bodies.values()) - crank.mass
        reach = crank.reach
    else:
        centre = crank.mass_centre, crank.mass_centre_across
        moving, reach = mechanism.slider.mass + mechanism.rod.mass, crank.length
    return crank.inertia + crank.mass * (centre[0] ** 2 + centre[1] ** 2) + moving * reach**2


def free_run(
    mechanism: Mechanism | LinkageFile,
    plan: RunPlan,
    values: Values,
    error: np.ndarray | float,
    tolerance: float,
    earlier: float,
) -> DrivenRun:
    """A crank without torque that has the angle and speed of the record at the first sample;
    `error` [rad] of the encoder at the samples.

    An unknown motion in loose joints begins before it, with the speed from which it arrives so.
    """
    samples = plan.samples
    offset = float(error[0]) if np.ndim(error) else error
    first_angle = values.get("first_angle", samples.first_angle) - offset
    speed = values.get("speed", samples.start_speed)
    is_led_in = has_unknown_start(plan.run) and bool(mechanism.loose)
    back = earlier + SETTLING_REVOLUTIONS * tau if is_led_in else 0.0
    drive = FreeDrive(kind="free")
    model = model_of(mechanism, options_of(speed, first_angle - back, tolerance, drive=drive))
    step = tau / MOTOR_SAMPLES_PER_REVOLUTION
    lead = first_angle - np.append(np.arange(back, 0.0, -step), 0.0)
    for _ in range(FREE_PASSES if back else 1):
        workspace = beginning(model, start_state(model), 0.0)
        before, workspace = integrate_on(model, workspace, lead, tolerance)
        arrived = float(model.crank_state(before.states[-1])[1])
        # the next pass loses as much energy
        ahead = model.drive.speed**2 + speed**2 - arrived**2
        start_speed, model.drive.speed = model.drive.speed, math.sqrt(max(ahead, REST_SPEED**2))
    model.drive.speed = start_speed
    begin = float(before.times[-1])
    times, angles = [before.times], [lead]
    # a little more than the record, for filters, if the crank turns so far
    while times[-1][-1] < begin + 1.05 * samples.elapsed[-1]:
        further = angles[-1][-1] + step * np.arange(1, FREE_STEPS + 1)
        try:
            found, workspace = integrate_on(model, workspace, further, tolerance)
        except SimulationError:
            if times[-1][-1] < begin + samples.elapsed[-1]:
                raise
            break
        times.append(found.times)
        angles.append(further)
    angle_over_time = CubicSpline(np.concatenate(times), np.concatenate(angles))

    def at(elapsed: np.ndarray) -> np.ndarray:
        return angle_over_time(begin + elapsed)

    return DrivenRun(model, at(samples.elapsed), begin, at)
