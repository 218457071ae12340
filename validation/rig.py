"""Virtual test rigs, drawn at random: mechanism, parameters not known exactly, runs, sensors, noise-free readings.

The motion is by an independent integrator (`validation.integrator`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from jointgap.config import Mechanism, Simulate
from jointgap.config.load import validate
from jointgap.core.joints import JOINTS, PINS, REFERENCE_APPROACH_SPEED
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.effects.clearance import FRICTIONS, RESTITUTIONS, STIFFNESS_FACTOR
from jointgap.rig.sensors import FAULTS
from validation.effects import InjectedEffect, RigScales
from validation.integrator import integrate

KINEMATIC = ("slider_position", "slider_velocity", "rod_angle", "rod_angular_velocity")
FORCES = ("crank_torque", "guide_force", "frame_force_x", "frame_force_y")
ACCELERATIONS = ("slider_acceleration", "rod_acceleration_x", "rod_acceleration_y")

SETTLING_REVOLUTIONS = 12
"""Revolutions between start and first sample, unless others are drawn; with a loose crank pivot up to ten settle."""

_LAG_GRID = 2880  # samples per revolution on which a lag is applied: between them the signal is linear enough
_LAGS_BEFORE = 5.0  # lags that are simulated before the first sample: what was before has decayed to 1 %

BASES = ("ideal", "loose", "chaotic")
"""The motion without an effect: of ideal joints, of loose joints that settle to a cycle, or never repeating."""

_JOURNALS = {"crank_pivot": "crank", "crank_pin": "crank", "piston_pin": "slider"}
_LOOSE_CHOICES = (PINS, PINS, PINS, ("piston_pin",), ("piston_pin",), ("crank_pin",))

_REPEATS_BELOW = 3e-3
"""Share of a channel's standard deviation by which settled revolutions may differ: far below any sensor noise."""

_CHAOTIC_ABOVE = 0.05
"""The same share above which samples cannot be compared, so that only statistics can."""

_LEAST_SETTLING, _MOST_SETTLING = 12, 16
"""Whole revolutions that a rig has run before it is measured: enough for a motion that repeats to have settled."""

_DAMPING_FACTOR = 3.5
"""A contact that lasts is damped less or more than the analyst's file says by at most this factor: the last impacts
before pins stay in contact come at 0.02 to 0.22 m/s, the default counts them at 0.05 m/s."""

_MOST_DRAWS = 200  # rigs, until one moves as its base asks at all three speeds


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


@dataclass(frozen=True)
class Sensor:
    """How one channel is measured."""

    noise_share: float  # Standard deviation of the noise over that of the signal
    correlation: float  # Of the noise of neighbouring samples
    gaps: bool  # Whether samples are lost


@dataclass(frozen=True)
class VirtualRig:
    """One rig with its true, hidden values; angles in rad, speeds in rad/s."""

    base: str  # One of `BASES`
    nominal: dict  # Contents of mechanism files: the analyst's, and with the true values of the nuisances
    true: dict  # Contents of mechanism files: the analyst's, and with the true values of the nuisances
    nuisance_bounds: dict[str, tuple[float, float]]  # By key of the campaign file, SI; those of ``speed`` are a share
    nuisance_values: dict[str, float]  # True values, SI, ``speed@run`` for a run's
    runs: dict[str, CrankRun]  # By id, in the order of the campaign file
    nominal_speeds: dict[str, float]  # By run
    confirm_run: str  # The held-out run
    sensors: dict[str, Sensor]  # By channel
    angle_noise: float  # Standard deviation of the crank angle's reading; 0 where there is no encoder
    noise_is_stated: bool  # Whether the campaign file says how noisy the channels are
    numerics: Numerics  # By which the data are simulated
    angle_step: float = 0.0  # Of the encoder, where the campaign file states that in place of its noise; else 0
    drive: str = "constant_speed"  # Of the campaign file

    @property
    def loose(self) -> tuple[str, ...]:
        """Names of the loose joints."""
        return tuple(name for name, joint in self.nominal["joints"].items() if joint["loose"])

    @property
    def identify_runs(self) -> list[str]:
        """Ids of the runs that are not held out."""
        return [run for run in self.runs if run != self.confirm_run]

    def scales(self, spread: dict[str, float]) -> RigScales:
        """What the sizes of effects go by; `spread` is the standard deviation by channel [SI]."""
        return RigScales(self.true, max(self.nominal_speeds.values()), self.loose, tuple(self.sensors), spread)


InjectedEffects = Sequence[tuple[InjectedEffect, float]]
"""Effects, each with its size."""


def simulate_signals(
    content: Mapping, run: CrankRun, numerics: Numerics, perturbation: Sequence[float] | None = None
) -> dict[str, np.ndarray]:
    """All signals [SI] at the samples of a run of a mechanism file's `content`, without sensors."""
    friction = {"friction_law": numerics.friction_law, "friction_speed": numerics.friction_speed}
    contacts = {name: law | friction for name, law in content["contacts"].items()}
    mechanism = validate(Mechanism, {**content, "contacts": contacts}, "a rig that was drawn")
    wave = mechanism.effect("speed_fluctuation")
    mean = run.speed / math.sqrt(1 - wave.ratio**2) if wave else run.speed  # the law's w0 is the mean over the angle
    p = parameters(mechanism, Simulate(speed=mean, start_angle=run.start_angle, tolerance=1e-12))
    effects = p.effects.copy()
    effects.slider_sign_speed *= numerics.sign_factor
    effects.crank_sign_speed *= numerics.sign_factor
    turned = 2 * math.pi * run.settling
    begin = -(run.phase - run.start_angle + turned) / run.speed
    signals = integrate(p._replace(effects=effects), run.times - begin, numerics.tolerance, perturbation)
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


def _draw_mechanism(rng: np.random.Generator, base: str, needed: str) -> dict:
    """Content of a mechanism file, around the paper's slider-crank; the joint `needed` is loose."""
    scale, heavier = rng.uniform(0.7, 1.2), rng.uniform(0.8, 1.3, 3)
    crank, rod = 0.15 * scale * rng.uniform(0.85, 1.1), 0.564 * scale
    choices = [joints for joints in _LOOSE_CHOICES if not needed or needed in joints]
    loose = () if base == "ideal" else choices[rng.integers(len(choices))]
    radius = float(rng.uniform(0.006, 0.010))
    friction = {"ideal": rng.uniform(0.03, 0.1), "loose": rng.uniform(0.05, 0.2), "chaotic": 0.0}[base]
    joints = {
        name: {
            "loose": name in loose,
            "journal": journal,
            "journal_radius": round(radius, 5),
            "bearing_radius": round(round(radius, 5) + 10 ** rng.uniform(-4, -3), 6),
            "contact": "steel",
        }
        for name, journal in _JOURNALS.items()
    }
    steel = {
        "law": "lankarani_nikravesh",
        "youngs_modulus": 207e9,
        "poisson_ratio": 0.3,
        "restitution": round(float(rng.uniform(0.4, 0.75)), 3),
        "friction": round(float(friction), 3),
    }
    number = lambda value: float(f"{value:.5g}")  # noqa: E731
    masses = [0.3704, 0.773, 0.4482] * heavier * scale
    return {
        "crank": {
            "length": number(crank),
            "mass": number(masses[0]),
            "inertia": number(masses[0] * crank**2 * 0.175),
            "mass_centre": number(crank * rng.uniform(0.3, 0.5)),
        },
        "rod": {
            "length": number(rod),
            "mass": number(masses[1]),
            "inertia": number(masses[1] * rod**2 * 0.101),
            "mass_centre": number(rod * rng.uniform(0.42, 0.5)),
        },
        "slider": {"mass": number(masses[2]), "offset": number(rng.choice([0.0, 0.0, rng.uniform(-0.03, 0.03)]))},
        "joints": joints,
        "contacts": {"steel": steel},
        "gravity_direction": -math.pi / 2,
        "effects": [],
    }


def revolution_spread(content: dict, speed: float) -> float:
    """RMS difference of settled revolutions that began differently or are some apart, over the standard deviation."""
    times = np.arange(90) / 90 * 2 * math.pi / speed
    nudge = [1e-7 if content["joints"][joint]["loose"] else 0.0 for joint in PINS]  # [m]
    settled = SETTLING_REVOLUTIONS
    starts = (None, settled), ([nudge[0], 0.0, 0.0, nudge[1]], settled), (None, 2), (None, settled + 3)
    first, *others = (
        simulate_signals(content, CrankRun(speed, 0.3, times, settling=settling), Numerics(1e-10), start)
        for start, settling in starts
    )
    return max(
        float(np.sqrt(np.mean((first[channel] - other[channel]) ** 2)) / first[channel].std())
        for other in others
        for channel in ("slider_acceleration", "crank_torque")
    )


def _draw_nuisances(rng: np.random.Generator, nominal: dict, encoder: bool) -> dict[str, tuple[float, float]]:
    def within(value: float, share: float) -> tuple[float, float]:
        return value * (1 - share), value * (1 + share)

    crank, rod, slider = nominal["crank"], nominal["rod"], nominal["slider"]
    bounds = {
        "slider_mass": within(slider["mass"], round(rng.uniform(0.02, 0.06), 2)),
        "rod_mass": within(rod["mass"], round(rng.uniform(0.02, 0.06), 2)),
        "rod_inertia": within(rod["inertia"], round(rng.uniform(0.03, 0.08), 2)),
    }
    for key, link in (("crank_length", crank), ("rod_length", rod)):
        if rng.random() < 0.3:
            bounds[key] = within(link["length"], 0.001)
    loose = [name for name, joint in nominal["joints"].items() if joint["loose"]]
    steel = nominal["contacts"]["steel"]
    if loose:
        bounds["restitution"] = (0.3, 0.9)
        if steel["friction"]:
            bounds["joint_friction"] = (round(0.5 * steel["friction"], 3), round(min(1.6 * steel["friction"], 0.5), 3))
        for name in loose:
            clearance = nominal["joints"][name]["bearing_radius"] - nominal["joints"][name]["journal_radius"]
            bounds[f"{name}_clearance"] = within(clearance, 0.1)
    if rng.random() < 0.5 or not encoder:
        bounds["speed"] = (-0.003, 0.003)
    keep = {"slider_mass", "restitution", "joint_friction", "speed"}
    return {key: own for key, own in bounds.items() if key in keep or rng.random() < 0.8}


def with_nuisances(content: dict, values: dict[str, float]) -> dict:
    """A mechanism file's `content` with true `values` [SI] of nuisances, by their keys."""
    changed = {key: dict(value) if isinstance(value, dict) else value for key, value in content.items()}
    joints = changed["joints"] = {name: dict(joint) for name, joint in content["joints"].items()}
    contacts = changed["contacts"] = {name: dict(law) for name, law in content["contacts"].items()}
    for key, value in values.items():
        if key in ("restitution", "joint_friction"):
            for law in contacts.values():
                law[key.removeprefix("joint_")] = value
        elif key.startswith("lasting_damping_"):
            joint = key.removeprefix("lasting_damping_")
            own = f"steel of {joint}"
            law = contacts[joints[joint]["contact"]]
            contacts[own] = law | {"reference_approach_speed": REFERENCE_APPROACH_SPEED * math.exp(-value)}
            joints[joint]["contact"] = own
        elif key.endswith("_clearance"):
            joint = joints[key.removesuffix("_clearance")]
            joint["bearing_radius"] = joint["journal_radius"] + value
        elif not key.startswith(("speed", "first_angle")):
            body, attribute = key.split("_")
            if attribute == "length" and "mass_centre" in changed[body]:  # keeps its share
                changed[body]["mass_centre"] *= value / changed[body]["length"]
            changed[body][attribute] = value
    return changed


def draw_rig(rng: np.random.Generator, base: str, needed: str = "", encoder: bool = False) -> VirtualRig:
    """Draw a rig whose settled motion is as `base` says: the same in each revolution, or not."""
    for _ in range(_MOST_DRAWS):
        nominal = _draw_mechanism(rng, base, needed)
        slowest = rng.uniform(150, 330)
        steps = np.cumprod([1.0, *rng.uniform(1.25, 1.5, 2)])
        speeds = np.round(rng.permutation(np.minimum(slowest * steps, 600))) * math.pi / 30
        if base == "ideal":
            break
        spreads = (revolution_spread(nominal, speed) for speed in speeds)
        if all(spread < _REPEATS_BELOW if base == "loose" else spread > _CHAOTIC_ABOVE for spread in spreads):
            break
    else:
        raise RuntimeError(f"no rig with a {base} motion in {_MOST_DRAWS} draws")
    encoder = bool(rng.random() < 0.85) or encoder
    bounds = _draw_nuisances(rng, nominal, encoder)
    values = {
        key: float(rng.uniform(*(0.5 * (low + high) + np.array([-0.45, 0.45]) * (high - low))))
        for key, (low, high) in bounds.items()
        if key != "speed"
    }
    names = [f"run{number}" for number in range(1, 4)]
    runs = {}
    for name, speed in zip(names, speeds, strict=True):
        share = rng.uniform(-0.003, 0.003) if encoder or "speed" in bounds else 0.0
        values[f"speed@{name}"] = float(speed * (1 + 0.9 * share))
        runs[name] = _draw_run(rng, values[f"speed@{name}"], 30 if base == "chaotic" else rng.uniform(3, 6))
    sensors = {
        channel: Sensor(
            noise_share=float(rng.uniform(0.01, 0.05)),
            correlation=float(rng.uniform(0.3, 0.8)) if rng.random() < 0.25 else 0.0,
            gaps=bool(rng.random() < 0.15),
        )
        for channel in _draw_channels(rng, base)
    }
    law = str(rng.choice(["coulomb", "coulomb", "threlfall"]))
    width = float(rng.choice([0.5, 1.5])) if law == "coulomb" else 1.5
    return VirtualRig(
        base=base,
        nominal=nominal,
        true=with_nuisances(nominal, values),
        nuisance_bounds=bounds,
        nuisance_values=values,
        runs=runs,
        nominal_speeds=dict(zip(names, map(float, speeds), strict=True)),
        confirm_run=names[int(rng.integers(3))],
        sensors=sensors,
        angle_noise=float(np.radians(rng.uniform(0.05, 0.3))) if encoder else 0.0,
        noise_is_stated=bool(rng.random() < 0.8),
        numerics=Numerics(float(10 ** rng.uniform(-12, -11)), law, 1e-3 * width, float(rng.choice([0.5, 1.0, 1.5]))),
    )


def with_unmeasured(rig: VirtualRig, rng: np.random.Generator) -> VirtualRig:
    """The rig with what nobody measures where joints are loose: starts, and damping of lasting contacts."""
    if not rig.loose:
        return rig
    runs = {
        run: replace(
            crank,
            start_angle=float(rng.uniform(0, 2 * math.pi)),
            settling=int(rng.integers(_LEAST_SETTLING, _MOST_SETTLING + 1)),
        )
        for run, crank in rig.runs.items()
    }
    reach = math.log(_DAMPING_FACTOR)
    values = {f"lasting_damping_{joint}": float(rng.uniform(-reach, reach)) for joint in rig.loose}
    true, values = with_nuisances(rig.true, values), rig.nuisance_values | values
    return replace(rig, runs=runs, true=true, nuisance_values=values)


def with_measured_angle(rig: VirtualRig, rng: np.random.Generator) -> VirtualRig:
    """The rig, whose analyst lets the crank follow what the encoder reads: noisy, or in half of the rigs in steps.

    A crank that turns as it was read needs an encoder that is good for that: 0.01 to 0.06 degrees, or 1000 to 10 000
    steps a turn with little noise between them. Its speed is no nuisance.
    """
    noise, step = math.radians(rng.uniform(0.01, 0.06)), 0.0
    if rng.random() < 0.5:
        step = 2 * math.pi / int(rng.choice([1000, 2000, 3600, 10_000]))
        noise = step * rng.uniform(0.02, 0.1)
    bounds = {key: own for key, own in rig.nuisance_bounds.items() if key != "speed"}
    changed = {"nuisance_bounds": bounds, "angle_noise": noise, "angle_step": step, "drive": "measured_angle"}
    return replace(rig, **changed)


def with_drawn_contact(rig: VirtualRig, effect: InjectedEffect, rng: np.random.Generator) -> InjectedEffect:
    """The effect; where it is the clearance of a joint that the analyst's model has as ideal, its contact is drawn too.

    Nobody measured that contact. Restitution, friction and stiffness are anywhere in the ranges that a fit allows them,
    and a contact that lasts is damped as those of the rig's other loose joints are.
    """
    if effect.site not in JOINTS or not effect.name.endswith("_clearance") or effect.site in rig.loose:
        return effect
    stiffer, damped = math.log(STIFFNESS_FACTOR), math.log(_DAMPING_FACTOR)
    contact = {
        "restitution": float(rng.uniform(*RESTITUTIONS)),
        "friction": float(rng.uniform(*FRICTIONS)),
        "stiffness_factor": math.exp(rng.uniform(-stiffer, stiffer)),
        "damping_factor": math.exp(rng.uniform(-damped, damped)),
    }
    return replace(effect, parameters=lambda size: effect.parameters(size) | contact)


def _draw_run(rng: np.random.Generator, speed: float, revolutions: float) -> CrankRun:
    samples = int(rng.integers(60, 201))
    if revolutions >= 30:
        samples = min(samples, 100)
    count = int(revolutions * samples)
    step = 2 * math.pi / speed / samples
    times = np.arange(count) * step
    if rng.random() < 0.25:
        times[1:] += rng.uniform(-0.3, 0.3, count - 1) * step
    return CrankRun(speed, float(rng.uniform(0, 2 * math.pi)), times)


def _draw_channels(rng: np.random.Generator, base: str) -> list[str]:
    """Two to four channels, at least one of which carries forces."""
    informative = FORCES if base == "ideal" else FORCES + ACCELERATIONS
    first = "crank_torque" if rng.random() < 0.5 else str(rng.choice(informative))
    others = [name for name in (*KINEMATIC, *FORCES, *ACCELERATIONS) if name != first]
    return [first, *(others[place] for place in rng.permutation(len(others))[: int(rng.integers(1, 4))])]
