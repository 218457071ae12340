"""What the sensors of a rig would read without noise: the motion by other numerics, and faults of sensors."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from jointgap.config import Mechanism, Simulate
from jointgap.config.load import validate
from jointgap.dynamics.model.compile_parameters import parameters
from jointgap.dynamics.model.parameters import Parameters
from jointgap.trials.independent_integrator import integrate
from jointgap.trials.injected_effects import Hidden

SETTLING = 4
"""Revolutions between the start and the first sample: a rig has run for a while before it is measured."""

_GRID = 2880  # samples per revolution on which a lag is applied
_BEFORE = 5.0  # lags that are simulated before the first sample


@dataclass(frozen=True)
class Numerics:
    """What an integrator may choose.

    Attributes
    ----------
    tolerance : float
        Local error of a step [m].
    friction_law : str
        ``coulomb`` (a hyperbolic tangent) or ``threlfall`` (an exponential).
    friction_speed : float
        Over which friction in loose pins is regularised [m/s].
    sign_factor : float
        By how much the width of the slider's and the crank's sign functions is multiplied.
    """

    tolerance: float = 1e-11
    friction_law: str = "coulomb"
    friction_speed: float = 1e-3
    sign_factor: float = 1.0


@dataclass(frozen=True)
class Turn:
    """How the crank turns in one run: mean speed [rad/s], angle [rad] at time 0, times of the samples [s]."""

    speed: float
    phase: float
    times: np.ndarray


def numbers(content: Mapping, speed: float, numerics: Numerics) -> Parameters:
    """The numbers of the equations for a mechanism file's `content`."""
    steel = content["contacts"]["steel"] | {
        "friction_law": numerics.friction_law,
        "friction_speed": numerics.friction_speed,
    }
    mechanism = validate(Mechanism, {**content, "contacts": {"steel": steel}}, "a rig that was drawn")
    wave = mechanism.effect("speed_fluctuation")
    mean = speed / math.sqrt(1 - wave.ratio**2) if wave else speed  # the law's w0 is the mean over the angle
    p = parameters(mechanism, Simulate(speed=mean, tolerance=1e-12))
    effects = p.effects.copy()
    effects.slider_sign_speed *= numerics.sign_factor
    effects.crank_sign_speed *= numerics.sign_factor
    return p._replace(effects=effects)


def moved(
    content: Mapping, turn: Turn, numerics: Numerics, perturbation=None, settling: int = SETTLING
) -> dict[str, np.ndarray]:
    """Everything that `jointgap.dynamics.solver.sampling` sees at the samples; the crank angle is that since time 0, and the phase."""
    p = numbers(content, turn.speed, numerics)
    begin = -(turn.phase + 2 * math.pi * settling) / turn.speed
    seen = integrate(p, turn.times - begin, numerics.tolerance, perturbation)
    return seen | {"crank_angle": seen["crank_angle"] - 2 * math.pi * settling}


def with_effects(content: Mapping, hidden: Sequence[tuple[Hidden, float]]) -> dict:
    """`content` with what acts on the motion, each at its size."""
    return {
        **content,
        "effects": [*content["effects"], *(entry for one, size in hidden for entry in one.in_file(size))],
    }


def read(
    content: Mapping,
    turn: Turn,
    numerics: Numerics,
    channels: Sequence[str],
    hidden: Sequence[tuple[Hidden, float]] = (),
) -> dict[str, np.ndarray]:
    """Noise-free readings of `channels` and of ``crank_angle`` with `hidden` in mechanism and sensors, SI."""
    content = with_effects(content, hidden)
    seen = moved(content, turn, numerics)
    found = {channel: seen[channel].copy() for channel in {*channels, "crank_angle"}}
    for one, size in hidden:
        if one.sensor:
            values = one.parameters(size)
            if one.name == "sensor_lag":
                found[one.sensor] = _lagged(content, turn, numerics, one.sensor, values["lag_s"])
            else:
                found[one.sensor] = faulty(one.name, values, found[one.sensor], turn.times)
    return found


def faulty(name: str, values: Mapping[str, float], true: np.ndarray, times: np.ndarray) -> np.ndarray:
    """What a sensor reads whose fault has no memory."""
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
    return true + values["cubic_sensor"] * (true - middle) ** 3 / half**2


def _lagged(content: Mapping, turn: Turn, numerics: Numerics, channel: str, lag: float) -> np.ndarray:
    """A first-order lag, exact for a signal that is linear between the points of a fine grid."""
    step = 2 * math.pi / turn.speed / _GRID
    grid = np.arange(turn.times[0] - _BEFORE * lag - step, turn.times[-1] + 2 * step, step)
    true = moved(content, Turn(turn.speed, turn.phase, grid), numerics)[channel]
    decay = math.exp(-step / lag)
    share = (1 - decay) * lag / step  # of y' = (u - y) / lag with u linear over a step
    start = true[0]
    filtered = lfilter([1 - share, share - decay], [1, -decay], true - start) + start
    return np.interp(turn.times, grid, filtered)
