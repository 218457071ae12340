"""An axis with its data as a model for identification."""

import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from jointgap.axis.axis import MOTION, Axis, Equations
from jointgap.axis.data import RunData
from jointgap.axis.model_file import DRIVE, POSITION, ModelFile, unit_of_channel
from jointgap.axis.motion import (
    accelerations,
    behind_play,
    fastest_rate,
    law_forces,
    laws,
    march,
)
from jointgap.core.candidates import Candidate, Effects, Parameter, Series
from jointgap.core.errors import InputError, SimulationError, did_you_mean
from jointgap.effects.axis_laws import (
    AXIS_LAWS,
    BACKLASH,
    axis_candidates,
    backlash_candidate,
    law_numbers,
)
from jointgap.effects.base import DETECTABLE_SHARE, MotionScale
from jointgap.identification.noise import scatter_between_samples
from jointgap.identification.settings import DEFAULT_SETTINGS
from jointgap.rig.checks import MIN_SAMPLES
from jointgap.rig.sensors import Faults, Reading, channel_faults

SIGN_SHARE = 0.01
"""Width of the sign of a given velocity in dry friction [1, of the root mean square velocity]."""

# [1] The same of a simulated velocity, whose dry friction is exact; and the velocity to either side
# of rest at which it is evaluated
_EXACT_SIGN, _LEAST_SPEED = 1e-9, 1e-6
_STEP_SHARE = 0.05  # [1] Step over the shortest time constant
_SHORTEST_STEP = 1e-6  # [s]
_RATES_AT = (-1.0, -0.5, 0.0, 0.5, 1.0)  # Positions [half strokes] at which rates are compared
_FINER = 0.5  # [1] Step or width of the sign of the solver variant
# [1] Half width of the bounds of an unknown start, of the range of positions or velocities
_START_REACH = 0.1
_MOST_ERRORS = 100  # independent errors of the drive in a run


class AxisModel:
    """A `jointgap.core.candidates.Model` of an axis whose motion is given."""

    left_out: Mapping[str, str] = {}

    def __init__(self, model: ModelFile, kind: type[Axis], runs: Mapping[str, RunData]):
        self.file, self.name, self.runs = model, model.name, runs
        self.is_simulated = model.given == DRIVE
        methods = kind.methods()
        of_motion = (POSITION, "velocity", "acceleration") if self.is_simulated else (DRIVE,)
        self.compared = tuple(
            name for name in model.compared if name in of_motion or name in methods
        )
        inputs = [name for name in model.channels if name not in ("time", *MOTION, DRIVE)]
        self.inputs = [name for name in inputs if name not in self.compared]
        source = inspect.getfile(kind)
        self.equations = Equations(kind, self.inputs, source)
        if not self.compared:
            raise InputError(
                f"{source}: no measured channel can be compared; measure the motion or the drive,"
                f" or write a method with the name of a channel: {', '.join(inputs)}"
            )
        if "mass" not in methods and self.is_simulated:
            raise InputError(f"{source}: given: {DRIVE} requires the method mass; add it")
        for name in ("mass", "force", "load") if self.is_simulated else ():
            if "acceleration" in self.equations.arguments.get(name, ()):
                raise InputError(
                    f"{source}: the method {name} has the argument acceleration, which is the"
                    f" result of a simulation (given: {DRIVE}); write it into mass"
                )
        finer = "steps of half the length" if self.is_simulated else "friction changes sign faster"
        self.numerics = (finer,)
        self.nuisances = (*kind.parameters(list(runs)), *self._starts())
        self.effects = {candidate.name: candidate for candidate in kind.candidates()}
        self.series = tuple(
            self._series(data, channel) for data in runs.values() for channel in self.compared
        )
        self.candidates = self._chosen(self._candidates())

    # ---- data

    def _series(self, data: RunData, channel: str) -> Series:
        column = self.file.channels[channel]
        unit, factor = unit_of_channel(channel, column)
        value = data.reduce(data.filtered(data.channels[channel]))
        time = data.reduce(data.time)
        if data.edge:
            value[(time < data.edge) | (time > data.time[-1] - data.edge)] = np.nan
        if (count := np.count_nonzero(np.isfinite(value))) < MIN_SAMPLES:
            raise InputError(
                f"{self.file.folder / data.run.file}: run {data.run.id} has {count} samples of"
                f" {channel} to compare, fewer than {MIN_SAMPLES}; give a longer run, a smaller"
                " mean_of or a higher bandwidth"
            )
        angle = np.full(time.size, np.nan)
        if data.run.period is not None:
            angle = math.tau * time / data.run.period
        noise, step = column.noise_of(data.run.id), column.resolution or 0.0
        gain = data.noise_gain
        stated = None if noise is None else np.full(time.size, factor * noise * gain)
        return Series(
            data.run.id,
            channel,
            unit,
            value,
            time,
            angle,
            data.held_out,
            stated,
            resolution=factor * step * gain,
        )

    def _starts(self) -> list[Parameter]:
        """Position at the first sample of each simulated run, and velocity unless it starts at
        rest."""
        parameters = []
        for run, data in self.runs.items() if self.is_simulated else ():
            unit = "rad" if self.file.turns else "m"
            starts = [("start_position", data.channels.get(POSITION), unit)]
            if data.run.start != "at_rest":
                starts.append(("start_velocity", self._measured_velocity(data), f"{unit}/s"))
            for name, values, its_unit in starts:
                if values is None:
                    raise InputError(
                        f"run {run}: its start is unknown without the channel {POSITION}; add it"
                    )
                reach = _START_REACH * float(np.nanmax(values) - np.nanmin(values))
                first = float(np.nanmedian(values[:3]))
                parameters.append(
                    Parameter(
                        name, first, first - reach, first + reach, 0.02 * reach, its_unit, run
                    )
                )
        return parameters

    def _measured_velocity(self, data: RunData) -> np.ndarray | None:
        if "velocity" in data.channels:
            return data.filtered(data.channels["velocity"])
        if POSITION not in data.channels:
            return None
        return np.gradient(data.filtered(data.channels[POSITION]), data.time)

    # ---- candidates

    @property
    def _has_drive(self) -> bool:
        return DRIVE in self.file.channels

    @cached_property
    def scale(self) -> MotionScale:
        """Magnitudes of the motion and of the drive in all runs."""
        fitted = [data for data in self.runs.values() if data.run.role != "confirm"]
        positions = [data.channels[POSITION] for data in fitted if POSITION in data.channels]
        velocities = [self._measured_velocity(data) for data in fitted]
        velocities = [values for values in velocities if values is not None]
        if not velocities:
            raise InputError(
                f"model {self.name}: the motion is not measured; add the channel {POSITION} or"
                " velocity"
            )
        speed = _rms(np.concatenate(velocities))
        if positions:
            low = min(float(np.nanmin(values)) for values in positions)
            high = max(float(np.nanmax(values)) for values in positions)
        else:
            times = max(float(data.time[-1]) for data in fitted)
            low, high = -0.5 * speed * times, 0.5 * speed * times
        stroke = 0.5 * (high - low)
        turning = math.sqrt(2.0) * speed / stroke
        force = DETECTABLE_SHARE * self._usual_drive(fitted, speed * turning)
        return MotionScale(stroke, speed, turning, force, force, 0.5 * (low + high))

    def _usual_drive(self, runs: Sequence[RunData], acceleration: float) -> float:
        """Root mean square of the measured drive; without one the inertia at an
        `acceleration`."""
        if DRIVE in self.file.channels:
            return _rms(np.concatenate([data.channels[DRIVE] for data in runs]))
        values = self._values({p.name: p.nominal for p in self.nuisances})
        motion = tuple(np.zeros(1) for _ in MOTION)
        inputs = self._inputs(runs[0])[:, :1]
        return float(self.equations.evaluate("mass", values, motion, inputs, 1.0)[0]) * acceleration

    def _candidates(self) -> list[Candidate]:
        model, candidates = self.file, []
        has_load = "load" in self.equations or (self.is_simulated and self._has_drive)
        if self.is_simulated or self._has_drive:
            scale = self.scale
            if "load" in self.equations:
                scale = replace(scale, guide=self._usual_load())
            else:
                scale = replace(scale, guide=scale.force / DETECTABLE_SHARE)
            middles = {run: float(np.mean(data.time)) for run, data in self.runs.items()}
            for candidate in axis_candidates(scale, middles, model.turns):
                if has_load or candidate.name != "load_friction":
                    candidates.append(candidate)
        if not self.is_simulated:
            candidates.append(backlash_candidate(self.scale, model.turns))
        readings = {}
        driving = (
            [POSITION] if not self.is_simulated else [DRIVE] if self._has_drive else self.inputs
        )
        for name in dict.fromkeys((*self.compared, *driving)):
            unit = unit_of_channel(name, model.channels[name])[0]
            values = np.concatenate([data.channels[name] for data in self.runs.values()])
            readings[name] = Reading(float(np.nanstd(values)), unit, self.scale.turning)
        return [*self.effects.values(), *candidates, *channel_faults(readings)]

    def _usual_load(self) -> float:
        """Root mean square of the load in all runs, with the start values of the parameters."""
        loads = []
        for run, data in self.runs.items():
            values = self._values(
                {p.name: p.nominal for p in self.nuisances if p.run in (None, run)}
            )
            motion = self._given_motion(data, data.channels.get(POSITION), 0.0)
            loads.append(self.equations.evaluate("load", values, motion, self._inputs(data)))
        return max(_rms(np.concatenate(loads)), 1e-300)

    def _chosen(self, candidates: list[Candidate]) -> tuple[Candidate, ...]:
        names = self.file.candidates
        if names is None:
            return tuple(candidates)
        by_label = {candidate.label: candidate for candidate in candidates}
        for name in names:
            if name not in by_label:
                raise InputError(
                    f"{self.name}: candidates: '{name}' cannot act in this model;"
                    f" {did_you_mean(name, by_label)}"
                )
        return tuple(by_label[name] for name in dict.fromkeys(names))

    # ---- simulation

    def simulate(
        self, run: str, values: Mapping[str, float], effects: Effects = (), numerics: int = 0
    ) -> dict[str, np.ndarray]:
        """The compared readings (m,) of a run by channel [SI]; see
        `jointgap.core.candidates.Model`."""
        return self._read(self.runs[run], values, effects, numerics)

    def _read(
        self,
        data: RunData,
        values: Mapping[str, float],
        effects: Effects,
        numerics: int = 0,
        error: np.ndarray | float = 0.0,
    ) -> dict[str, np.ndarray]:
        """The compared readings with an `error` (n,) [N or N m] of the drive's reading."""
        faults = Faults(effects, 1.0, {})
        parameters = self._values(values, effects)
        force_laws, play = self._laws(effects, numerics)
        if self.is_simulated:
            exact = self._simulated(data, values, parameters, force_laws, faults, error, numerics)
        else:
            exact = self._computed(data, parameters, force_laws, play, faults)
        readings = {}
        for channel in self.compared:
            reading = faults.act("before_filter", channel, exact[channel])
            period = data.run.period or 0.0
            reading = faults.act("over_time", channel, reading, data.interval, period)
            reading = data.filtered(reading)
            if delay := faults.delay(channel):
                reading = np.interp(data.time - delay, data.time, reading)
            readings[channel] = data.reduce(faults.act("after_filter", channel, reading))
        return readings

    def _values(self, values: Mapping[str, float], effects: Effects = ()) -> tuple:
        """What the methods of the class get as ``self``."""
        own = {
            part: value
            for candidate, coordinates in effects
            for part, value in coordinates.items()
            if candidate.name in self.effects
        }
        return self.equations.values({**values, **own})

    def _drive(self, data: RunData) -> np.ndarray:
        """The measured drive (n,); 0 if other channels drive the axis."""
        return data.channels.get(DRIVE, np.zeros(data.time.size))

    def _inputs(self, data: RunData, faults: Faults | None = None) -> np.ndarray:
        """Measured inputs (k, n) of the methods, without their `faults`."""
        rows = [np.empty((0, data.time.size))]
        for name in self.inputs:
            values = data.channels[name]
            rows.append(values if faults is None else faults.undo(name, values, data.time))
        return np.vstack(rows)

    def _laws(self, effects: Effects, numerics: int) -> tuple:
        """The force laws and the play of `effects`."""
        numbers, play = {}, 0.0
        share = _EXACT_SIGN if self.is_simulated else SIGN_SHARE * (_FINER if numerics else 1.0)
        numbers["sign_speed"] = share * self.scale.speed
        for candidate, coordinates in effects:
            if candidate.name == BACKLASH:
                play = coordinates[candidate.amplitudes[0]]
            elif candidate.name in AXIS_LAWS:
                numbers |= law_numbers(candidate.name, candidate.parameters(coordinates))
        return laws(numbers), play

    def _given_motion(
        self, data: RunData, position: np.ndarray | None, play: float
    ) -> tuple[np.ndarray, ...]:
        """Position, velocity, acceleration and time (n,) of a given motion behind a play."""
        if position is None:  # only speeds are measured
            velocity = self._measured_velocity(data)
            position = np.concatenate(
                [[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(data.time))]
            )
        smooth, time = data.filtered(position), data.time
        velocity = data.channels.get("velocity")
        velocity = np.gradient(smooth, time) if velocity is None else data.filtered(velocity)
        acceleration = data.channels.get("acceleration")
        if acceleration is None:
            acceleration = np.gradient(velocity, time)
        else:
            acceleration = data.filtered(acceleration)
        if play:
            smooth, is_open = behind_play(smooth, play)
            velocity, acceleration = (
                np.where(is_open, 0.0, rate) for rate in (velocity, acceleration)
            )
        return smooth, velocity, acceleration, time

    def _computed(
        self, data: RunData, parameters: tuple, force_laws: tuple, play: float, faults: Faults
    ) -> dict[str, np.ndarray]:
        """Channels (n,) over a given motion."""
        position = faults.undo(POSITION, data.channels[POSITION], data.time)
        motion, inputs = self._given_motion(data, position, play), self._inputs(data)
        evaluate, readings = self.equations.evaluate, {}
        for channel in self.compared:
            if channel in self.equations:
                readings[channel] = evaluate(channel, parameters, motion, inputs)
                continue
            load = np.ascontiguousarray(evaluate("load", parameters, motion, inputs))
            forces = law_forces(force_laws, load, motion[0], motion[1], data.time)
            forces = forces + evaluate("force", parameters, motion, inputs)
            inertia = evaluate("mass", parameters, motion, inputs) * motion[2]
            readings[channel] = inertia - forces
            if play:  # nothing touches
                is_open = behind_play(data.filtered(position), play)[1]
                readings[channel] = np.where(is_open, 0.0, readings[channel])
        self._check_finite(readings, data)
        return readings

    def _simulated(
        self,
        data: RunData,
        values: Mapping[str, float],
        parameters: tuple,
        force_laws: tuple,
        faults: Faults,
        error: np.ndarray | float,
        numerics: int,
    ) -> dict[str, np.ndarray]:
        """Channels (n,) of the motion under the measured drive."""
        drive = faults.undo(DRIVE, self._drive(data) + error, data.time)
        inputs = self._inputs(data, faults)
        start = values["start_position"], values.get("start_velocity", 0.0)
        methods, own_load = self._compiled, "load" in self.equations
        strongest = int(np.argmax(np.abs(drive)))
        arguments = *methods, parameters, force_laws, own_load
        rate, scale = 0.0, self.scale
        for share in _RATES_AT:
            position = scale.middle + share * scale.stroke
            state = position, start[1], 0.0, inputs[:, strongest], drive[strongest]
            rate = max(rate, fastest_rate(*arguments, *state, 2.0 * scale.stroke, scale.speed))
        if not math.isfinite(rate):
            raise SimulationError("the acceleration is not a number; is the mass 0?")
        step = max(_STEP_SHARE / max(rate, 1e-300), _SHORTEST_STEP) * (_FINER if numerics else 1.0)
        if numerics:
            step = min(step, _FINER * data.interval)
        arguments = *arguments, data.time, drive, inputs
        least = _LEAST_SPEED * self.scale.speed
        motion = march(*arguments, start, least, step)
        if not np.isfinite(motion).all():
            raise SimulationError(f"run {data.run.id}: the motion grows without limit")
        readings = {POSITION: motion[0], "velocity": motion[1]}
        readings["acceleration"] = accelerations(*arguments, motion, least)
        every = motion[0], motion[1], readings["acceleration"], data.time
        for channel in self.compared:
            if channel in self.equations:
                readings[channel] = self.equations.evaluate(channel, parameters, every, inputs)
        self._check_finite(readings, data)
        return readings

    @cached_property
    def _compiled(self) -> tuple:
        """Mass, force and load as compiled functions."""
        data = next(iter(self.runs.values()))
        values = self._values({p.name: p.nominal for p in self.nuisances})
        first = float(data.channels[POSITION][0]), float(self._measured_velocity(data)[0])
        example = values, *first, 0.0, 0.0, self._inputs(data)[:, 0].copy()
        compiled = self.equations.compiled
        return (
            compiled("mass", 1.0, example),
            compiled("force", 0.0, example),
            compiled("load", 0.0, example),
        )

    def _check_finite(self, readings: Mapping[str, np.ndarray], data: RunData) -> None:
        for channel, values in readings.items():
            if not np.isfinite(values).all():
                raise SimulationError(f"run {data.run.id}: {channel} is not a number")


class DrivenAxisModel(AxisModel):
    """The same, whose motion is simulated under a measured drive: also a
    `jointgap.core.candidates.Driven`."""

    def drive_errors(self, run: str, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Changes of the readings by errors of the drive; see `jointgap.core.candidates.Driven`.

        Errors count as constant over the samples that are compared as one, or over a hundredth of
        the run.
        """
        data = self.runs[run]
        if not self._has_drive:
            return {}
        drive = data.channels[DRIVE]
        noise = self.file.channels[DRIVE].noise_of(run)
        if noise is None:
            scatter = scatter_between_samples(drive, DEFAULT_SETTINGS.noise)
            sd = 0.0 if scatter is None else scatter.sd
        else:
            sd = self.file.factor(DRIVE) * noise
        length = max(data.count, math.ceil(drive.size / _MOST_ERRORS))
        usual = self._read(data, values, ())
        changes: dict[str, list[np.ndarray]] = {channel: [] for channel in self.compared}
        for begin in range(0, drive.size, length):
            error = np.zeros(drive.size)
            error[begin : begin + length] = sd / math.sqrt(min(length, drive.size - begin))
            readings = self._read(data, values, (), error=error)
            for channel in self.compared:
                changes[channel].append(readings[channel] - usual[channel])
        return {channel: np.array(columns).T for channel, columns in changes.items()}


def build_axis_model(model: ModelFile, kind: type[Axis], runs: Mapping[str, RunData]) -> AxisModel:
    """The model for identification of a model file, its class and its runs."""
    return (DrivenAxisModel if model.given == DRIVE else AxisModel)(model, kind, runs)


def needed_channels(model: ModelFile, kind: type[Axis]) -> Sequence[str]:
    """Channels without which a motion cannot be computed at a sample."""
    methods = kind.methods()
    own = [name for name in model.channels if name not in ("time", *MOTION, DRIVE)]
    motion = (DRIVE,) if model.given == DRIVE else MOTION[:3]
    given = [name for name in motion if name in model.channels]
    return [*given, *(name for name in own if name not in methods)]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))
