"""What the sensors of a virtual rig read without noise: the motion by independent numerics, and faults of sensors."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from jointgap.config import Mechanism, Simulate
from jointgap.config.load import validate
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.parameters import Parameters
from jointgap.rig.sensors import FAULTS
from jointgap.trials.independent_integrator import integrate
from jointgap.trials.injected_effects import InjectedEffect

InjectedEffects = Sequence[tuple[InjectedEffect, float]]
"""Effects, each with its size."""

SETTLING_REVOLUTIONS = 12
"""Revolutions between the start and the first sample, unless others are drawn: a rig has run for a while before it is
measured, and with a loose crank pivot a motion takes up to ten to settle."""

_LAG_GRID = 2880  # samples per revolution on which a lag is applied: between them the signal is linear enough
_LAGS_BEFORE = 5.0  # lags that are simulated before the first sample: what was before has decayed to 1 %


@dataclass(frozen=True)
class Numerics:
    """What an integrator may choose."""

    tolerance: float = 1e-11  # Local error of a step [m]
    friction_law: str = "coulomb"  # ``coulomb`` (a hyperbolic tangent) or ``threlfall`` (an exponential)
    friction_speed: float = 1e-3  # Sliding speed over which friction in loose pins is regularised [m/s]
    sign_factor: float = 1.0  # Factor on the width of the slider's and the crank's sign functions


@dataclass(frozen=True)
class CrankRun:
    """How the crank turns in one run, and when it is sampled."""

    speed: float  # Mean speed [rad/s]
    phase: float  # Angle at time 0 [rad]
    times: np.ndarray  # Of the samples [s]
    start_angle: float = 0.0  # Crank angle at which the motion begins [rad], within a turn
    settling: int = SETTLING_REVOLUTIONS  # Whole revolutions between the start and time 0


def _compile(content: Mapping, run: CrankRun, numerics: Numerics) -> Parameters:
    """The numbers of the equations of motion for a mechanism file's `content`, turned as in a run."""
    friction = {"friction_law": numerics.friction_law, "friction_speed": numerics.friction_speed}
    contacts = {name: law | friction for name, law in content["contacts"].items()}
    mechanism = validate(Mechanism, {**content, "contacts": contacts}, "a rig that was drawn")
    wave = mechanism.effect("speed_fluctuation")
    mean = run.speed / math.sqrt(1 - wave.ratio**2) if wave else run.speed  # the law's w0 is the mean over the angle
    p = parameters(mechanism, Simulate(speed=mean, start_angle=run.start_angle, tolerance=1e-12))
    effects = p.effects.copy()
    effects.slider_sign_speed *= numerics.sign_factor
    effects.crank_sign_speed *= numerics.sign_factor
    return p._replace(effects=effects)


def simulate_signals(
    content: Mapping,
    run: CrankRun,
    numerics: Numerics,
    perturbation: Sequence[float] | None = None,
) -> dict[str, np.ndarray]:
    """The motion at the samples of a run, without sensors."""
    turned = 2 * math.pi * run.settling
    begin = -(run.phase - run.start_angle + turned) / run.speed
    signals = integrate(_compile(content, run, numerics), run.times - begin, numerics.tolerance, perturbation)
    return signals | {"crank_angle": signals["crank_angle"] - turned}


def with_injected_effects(content: Mapping, effects: InjectedEffects) -> dict:
    """A mechanism file's `content` with those of `effects` that act on the motion, each at its size."""
    entries = [entry for effect, size in effects for entry in effect.in_file(size)]
    return {**content, "effects": [*content["effects"], *entries]}


def noise_free_readings(
    content: Mapping, run: CrankRun, numerics: Numerics, channels: Sequence[str], effects: InjectedEffects = ()
) -> dict[str, np.ndarray]:
    """What the sensors would read without noise."""
    content = with_injected_effects(content, effects)
    signals = simulate_signals(content, run, numerics)
    readings = {channel: signals[channel].copy() for channel in {*channels, "crank_angle"}}
    for effect, size in effects:
        if effect.sensor:
            values = effect.parameters(size)
            if effect.name == "sensor_lag":
                readings[effect.sensor] = _lagged(content, run, numerics, effect.sensor, values["lag_s"])
            elif effect.name == "sensor_delay":
                earlier = replace(run, times=run.times - values["delay_s"])
                readings[effect.sensor] = simulate_signals(content, earlier, numerics)[effect.sensor]
            else:
                readings[effect.sensor] = faulty_reading(effect.name, values, readings[effect.sensor], run.times)
    return readings


def faulty_reading(name: str, values: Mapping[str, float], true: np.ndarray, times: np.ndarray) -> np.ndarray:
    """What a sensor reads whose fault has no memory, (n,)."""
    if name == "encoder_offset":
        return true + values["offset_rad"]
    if name == "sensor_bias":
        return true + values["bias"]
    if name == "sensor_gain":
        return true * (1 + values["gain_error"])
    if name == "drift":
        span = times[-1] - times[0]
        return true + values["drift"] * (times - times[0]) / span
    if name == "quantisation":
        step = values["quantisation"]
        return step * np.floor(true / step) + 0.5 * step
    middle, half = 0.5 * (true.max() + true.min()), 0.5 * np.ptp(true)
    if name == "saturation":
        return np.clip(true, -np.inf, middle + half * (1 - 2 * values["saturation"]))
    if name == "cubic_sensor":
        return true + values["cubic_sensor"] * (true - middle) ** 3 / half**2
    fault = FAULTS[name]  # a fault of the list for which there is no formula of the trials' own
    return (fault.before_filter or fault.after_filter)(true, values[fault.parameter])


def _lagged(content: Mapping, run: CrankRun, numerics: Numerics, channel: str, lag: float) -> np.ndarray:
    """A signal through a first-order `lag` [s], exact where it is linear between the points of a fine grid."""
    step = 2 * math.pi / run.speed / _LAG_GRID
    grid = np.arange(run.times[0] - _LAGS_BEFORE * lag - step, run.times[-1] + 2 * step, step)
    true = simulate_signals(content, replace(run, times=grid), numerics)[channel]
    decay = math.exp(-step / lag)
    share = (1 - decay) * lag / step  # of y' = (u - y) / lag with u linear over a step
    start = true[0]
    filtered = lfilter([1 - share, share - decay], [1, -decay], true - start) + start
    return np.interp(run.times, grid, filtered)
