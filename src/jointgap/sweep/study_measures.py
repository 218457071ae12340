"""What one motion of the study comes to over its settled revolutions."""

import math

import numpy as np

from jointgap.config import Mechanism, Simulate, Study
from jointgap.dynamics.model.compile_parameters import joint_parameters
from jointgap.dynamics.parallel_runs import Outcome
from jointgap.dynamics.simulation import event_frame
from jointgap.mechanism import transmission_angle
from jointgap.sweep.contacts import contacts, time_shares
from jointgap.tables.study_tables import NOISE_ORDER, ORDERS

_PER_PERIOD = 12  # samples in a period of the contact's ringing
_FEWEST, _MOST = 720, 20_000  # samples per revolution


def samples_per_revolution(mechanism: Mechanism, speed: float) -> int:
    """Samples that resolve the ringing of the contacts under the load that the slider's inertia makes."""
    load = mechanism.slider.mass * mechanism.crank.length * speed**2
    mass = 1.0 / (1.0 / mechanism.slider.mass + 1.0 / mechanism.rod.mass)
    frequency = 0.0
    for name in mechanism.loose:
        joint = joint_parameters(mechanism, name)
        n = joint.exponent
        depth = (load / joint.stiffness) ** (1.0 / n)
        frequency = max(frequency, math.sqrt(n * load / depth / mass) / (2.0 * math.pi))
    wanted = _PER_PERIOD * frequency / (speed / (2.0 * math.pi))
    return int(min(max(wanted, _FEWEST), _MOST))


def sampled_angles(mechanism: Mechanism, options: Simulate, study: Study) -> np.ndarray:
    """The start, then samples of the settled revolutions, both of their ends included [rad]."""
    per_turn = samples_per_revolution(mechanism, options.speed)
    settled = np.arange(study.settled_revolutions * per_turn + 1) * (2.0 * math.pi / per_turn)
    begin = options.start_angle + 2.0 * math.pi * study.transient_revolutions
    return np.append(options.start_angle, begin + settled)


def measure(outcome: Outcome, study: Study) -> dict[str, float | np.ndarray]:
    """The numbers `jointgap.tables.study_tables.MEASURES` of one run, and amplitudes by order, ``orders``."""
    mechanism, march = outcome.run.mechanism, outcome.march
    seen = {name: values[1:] for name, values in march.observed(outcome.parameters).items()}
    angle, times = outcome.crank_angle[1:], march.times[1:]
    ideal = transmission_angle(mechanism.crank.length, mechanism.rod.length, angle, 0.0, mechanism.slider.offset)
    error = ideal - (math.pi / 2 + seen["rod_angle"])
    forces = [seen[f"{joint}_normal_force"].max() for joint in mechanism.loose]
    shares, events = [], event_frame(march.events)
    for joint in mechanism.loose:
        found = contacts(events, joint)
        shares.append(1.0 - time_shares(found, times[0], times[-1])["flight"])
        within = found[(found["begin"] >= times[0]) & (found["end"] <= times[-1])]
        forces += list(within["peak_force"])
    acceleration = seen["slider_acceleration"]
    spectrum = orders(acceleration[:-1], study.settled_revolutions)
    rms = math.sqrt(np.mean(acceleration[:-1] ** 2))
    return {
        "peak_force": max(forces),
        "angle_error_rms": math.sqrt(np.mean(error[:-1] ** 2)),
        "contact_share": float(np.mean(shares)),
        "acceleration_rms": rms,
        "noise_share": noise(acceleration[:-1], study.settled_revolutions) / rms,
        "jerk_rms": math.sqrt(np.mean((np.diff(acceleration) / np.diff(times)) ** 2)),
        "orders": spectrum,
    }


def orders(values: np.ndarray, revolutions: int) -> np.ndarray:
    """Amplitudes of a quantity at orders 0 to `ORDERS` of the crank's speed, shape (ORDERS + 1,).

    Parameters
    ----------
    values : (n,) array
        Samples of whole revolutions, uniform, the last one's end left out.
    revolutions : int
        How many.
    """
    amplitudes = 2.0 * np.abs(np.fft.rfft(values)) / len(values)
    amplitudes[0] /= 2.0
    return amplitudes[: ORDERS * revolutions + 1 : revolutions]


def noise(values: np.ndarray, revolutions: int) -> float:
    """RMS of what a quantity holds above order `NOISE_ORDER`; parameters as `orders`."""
    spectrum = np.fft.rfft(values)
    spectrum[: NOISE_ORDER * revolutions + 1] = 0.0
    return math.sqrt(np.mean(np.fft.irfft(spectrum, len(values)) ** 2))
