"""Virtual test rigs, drawn at random with the effects hidden in them; and what their sensors read
without noise."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import tau
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import make_interp_spline
from scipy.optimize import brentq

from jointgap.config import EFFECTS, Mechanism, load_mechanism, read_yaml
from jointgap.config.campaign import NUISANCES
from jointgap.config.load import validate
from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.joints import PINS
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.parameters import MEASURED, DriveParameters, Parameters, knots_record, record
from jointgap.effects.base import FitContext, MotionScale
from jointgap.rig.drives import options_of, prescribed_angles
from jointgap.rig.model import physical_candidates
from jointgap.rig.sensors import (
    DELAY_SHARES,
    ENCODER_OFFSET,
    FAULTS,
    LAG_AND_DELAY,
    SENSOR_DELAY,
    SENSOR_LAG,
    Reading,
)
from jointgap.rig.simulate_run import channels_at, with_nuisances
from validation.exudyn import SliderCrank

RECIPE = read_yaml(Path(__file__).with_name("recipe.yaml"))

_FIRST, _MOST = (
    3.0,
    600.0,
)  # sizes [steps of a fit] with which a search begins, and at which it ends
_HIGHEST_ORDER = {"speed_fluctuation": 4, "crank_periodic_torque": 6}  # that is drawn
_VISCOSITIES = (0.03, 1.0)  # [Pa s] thinner ones are hardly films

# The shape [1] at which the law of a family is an effect, by the law and the effect
SHAPES = {
    law.NAME: dict(law.MEMBERS) | RECIPE["families"].get(law.NAME, {}) for law in EFFECTS.values()
}
SHAPES[LAG_AND_DELAY] = DELAY_SHARES


@dataclass(frozen=True)
class Hidden:
    """One effect that acts, at a size still open; 0 where it is absent."""

    name: str  # As in a verdict; of an effect that is not on the list, its own name
    site: str
    parameters: Callable[
        [float], dict[str, float]
    ]  # From the size to the parameters of a verdict [SI]
    first: float  # Size with which a search begins
    most: float
    least: float = 0.0
    sensor: str = ""  # Channel of a sensor's fault, else empty
    law: Mapping[str, Any] | None = (
        None  # Formula and coefficients of a force that is not on the list
    )

    def in_file(self, size: float) -> list[dict]:
        """Entries of a mechanism file's effects; none for a sensor's fault."""
        if self.sensor:
            return []
        if self.law:
            name = "discovered_crank_torque" if self.site == "crank" else "discovered_slider_force"
            coefficients = self.law["coefficients"] | self.parameters(size)
            return [{"name": name, "parameters": {**self.law, "coefficients": coefficients}}]
        site = {"site": self.site} if EFFECTS[self.name].sites() else {}
        return [{"name": self.name, **site, "parameters": self.parameters(size)}]


def candidates(
    mechanism: Mechanism, speed: float, nuisances: Mapping[str, Parameter]
) -> dict[str, Candidate]:
    """The physical effects that could be missing in a mechanism whose crank turns at `speed`
    [rad/s], by label."""
    scale = MotionScale.of(mechanism, speed)
    context = FitContext(mechanism, scale, nuisances, True, speed / tau, (None, None))
    return {candidate.label: candidate for candidate in physical_candidates(context)}


# Effects of the list by name, with the site where there is a choice
LISTED = (
    *candidates(load_mechanism("erkaya2009"), 30.0, {}),
    *(ENCODER_OFFSET, "sensor_bias", "sensor_gain", SENSOR_LAG, SENSOR_DELAY),
)

OFF_LIST = (*RECIPE["laws"], *RECIPE["faults"])

# Labels that can be right: effects, an encoder's fault among them; then faults of a sensor, each
# with its channel
CHANNELS = tuple(name for names in RECIPE["channels"].values() for name in names)
SENSOR_FAULTS = tuple(name for name in LISTED if name in FAULTS and name != ENCODER_OFFSET)
PLAIN = tuple(name for name in LISTED if name not in SENSOR_FAULTS)
LABELS = (*PLAIN, *(f"{fault}:{channel}" for channel in CHANNELS for fault in SENSOR_FAULTS))


def draw_effect(
    label: str, rig: Any, spread: Mapping[str, float], rng: np.random.Generator
) -> Hidden | None:
    """The effect `label` of a `rig` whose channels have the standard deviations `spread` [SI]; None
    where it cannot act."""
    channel = "crank_angle" if label == ENCODER_OFFSET else str(rng.choice(list(rig.sensors)))
    if label in RECIPE["faults"]:
        fault = RECIPE["faults"][label]
        unit = spread[channel] if fault["of_spread"] else 1.0
        return Hidden(
            label,
            channel,
            lambda size: {label: size * unit},
            fault["first"],
            fault["most"],
            0.0,
            channel,
        )
    if label in RECIPE["laws"]:
        return _law(label, rig, rng)
    if label in FAULTS:
        site = "sensor" if label == ENCODER_OFFSET else channel
        candidate = FAULTS[label].candidate(
            site, Reading(spread.get(channel, 0.0), "", rig.fastest)
        )
        return _sized(candidate, rng, {}, channel)
    candidate = candidates(rig.nominal, rig.fastest, rig.nuisances).get(label)
    return candidate and _sized(candidate, rng, rig.nuisances)


def _law(label: str, rig: Any, rng: np.random.Generator) -> Hidden:
    own, crank = RECIPE["laws"][label], rig.true.crank.length
    coefficients = {
        "V": crank * rig.fastest,
        "R": crank,
        "X": rig.true.rod.length,
        "A": float(rng.uniform(0, 6)),
    }
    used = set(re.findall("[A-Z]", own["formula"]))
    first = own["first"] * rig.true.slider.mass * crank ** (1 + own["power"]) * rig.fastest**2
    site = "crank" if "theta" in own["formula"] else "slider"
    law = {"formula": own["formula"], "coefficients": {key: coefficients[key] for key in used}}
    return Hidden(label, site, lambda size: {"s": size}, first, 200 * first, law=law)


def _sized(
    candidate: Candidate, rng: np.random.Generator, nuisances: Mapping[str, Parameter], sensor=""
) -> Hidden:
    """A candidate whose amplitudes grow with the size along a direction that is drawn, as its shape
    parameters are."""
    sizes = {p.key: p for p in candidate.coordinates if p.key in candidate.amplitudes}
    steps = {
        key: part * sizes[key].step
        for key, part in zip(sizes, _direction(candidate, rng), strict=True)
    }
    steps = dict(sorted(steps.items(), key=lambda item: -abs(item[1] / sizes[item[0]].step)))
    shapes = {p.key: _shape(candidate, p, rng) for p in candidate.coordinates if p.key not in sizes}
    ends = [
        (sizes[key].high if step > 0 else sizes[key].low) / step
        for key, step in steps.items()
        if step
    ]
    if candidate.name == "rod_flexibility":
        ends = [0.4 * ends[0]]  # five times as fast as the crank at least
    least, most = 0.0, min(ends + [_MOST])
    for (
        name,
        key,
    ) in candidate.replaces.items():  # beyond what the campaign states of the same parameter
        if steps[key]:
            least = (nuisances[name].high - nuisances[name].low) / abs(steps[key])
    searched = _VISCOSITIES if candidate.name == "lubricated_joint" else candidate.search_range
    if searched and not candidate.is_perturbation:
        least, most = (end / next(iter(steps.values())) for end in searched)

    def parameters(size: float) -> dict[str, float]:
        values = {key: size * step for key, step in steps.items()} | shapes
        return {key: float(value) for key, value in candidate.parameters(values).items()}

    first = min(max(_FIRST, 1.2 * least), most)
    return Hidden(candidate.name, candidate.site, parameters, first, most, least, sensor)


def _direction(candidate: Candidate, rng: np.random.Generator) -> list[float]:
    """A unit size in steps of each amplitude: a spring rests near the middle of the stroke, one of
    two lengths is wrong, and all others with two amplitudes have a phase."""
    low = candidate.coordinates[0].low
    sign = float(rng.choice([-1.0, 1.0])) if low < 0 and not candidate.is_perturbation else 1.0
    if candidate.name == "slider_spring":
        share = rng.uniform(0.44, 0.56)
        return [share, 1 - share]
    if candidate.name == "link_length_error":
        return list(sign * rng.permutation([1.0, 0.0]))
    angle = rng.uniform(0, tau)
    return [sign] if len(set(candidate.amplitudes)) == 1 else [math.cos(angle), math.sin(angle)]


def _shape(candidate: Candidate, p: Parameter, rng: np.random.Generator) -> float:
    if p.search_values:
        return rng.choice(
            [order for order in p.search_values if order <= _HIGHEST_ORDER[candidate.name]]
        )
    shares = RECIPE["shapes"].get(p.name)
    return rng.uniform(*(np.multiply(shares, p.nominal) if shares else (p.low, p.high)))


# Effects, each with its size
Effects = Sequence[tuple[Hidden, float]]

# What sensors read of a signal (n,) by faults that are not on the list
UNLISTED_FAULTS = {
    "drift": lambda u, size: u + size * np.linspace(0.0, 1.0, u.size),
    "quantisation": lambda u, size: size * (np.floor(u / size) + 0.5),
    "saturation": lambda u, size: np.clip(u, None, u.max() - size * np.ptp(u)),
    "cubic_sensor": lambda u, size: (
        u + size * (u - 0.5 * (u.max() + u.min())) ** 3 / (0.5 * np.ptp(u)) ** 2
    ),
}

_LOOSE = (PINS, PINS, PINS, ("piston_pin",), ("piston_pin",), ("crank_pin",))

# Share of a channel's standard deviation by which settled revolutions may differ: far below any
# sensor noise
_REPEATS_BELOW = 3e-3

# The same share above which samples cannot be compared, so that only statistics can
_CHAOTIC_ABOVE = 0.05

_MOST_DRAWS = 200  # mechanisms, until one moves as its base asks at all three speeds

_DRIFT_GRID = (
    240  # knots per revolution of a drifting crank: its angle between them is exact to 1e-11 rad
)
# samples per revolution on which a lag is applied: between them the signal is linear enough
_LAG_GRID = 2880
_LAGS_BEFORE = (
    5.0  # lags that are simulated before the first sample: what was before has decayed to 1 %
)

# Of one run by channel, SI
Readings = dict[str, np.ndarray]


@dataclass(frozen=True)
class Numerics:
    """What an integrator may choose."""

    tolerance: float = 1e-10  # Local error of a step [m]
    # ``coulomb`` (a hyperbolic tangent), ``threlfall`` (an exponential), ``ambrosio``
    friction_law: str = "coulomb"
    friction_factor: float = (
        1.0  # Factor on the sliding speed over which friction in loose joints is regularised
    )
    sign_factor: float = 1.0  # Factor on the width of the slider's and the crank's sign functions


@dataclass(frozen=True)
class Drift:
    """A slow drift of the speed: a sum of sinusoids of time."""

    sizes: np.ndarray  # Shares of the mean speed
    rates: np.ndarray  # Angular frequencies [rad/s]
    phases: np.ndarray  # [rad]

    def ahead(self, times: np.ndarray) -> np.ndarray:
        """Times [s] by which the crank is ahead of a steady one with which it agrees at time 0."""
        phases = np.multiply.outer(times, self.rates) + self.phases
        return (np.sin(phases) - np.sin(self.phases)) @ (self.sizes / self.rates)


@dataclass(frozen=True)
class Run:
    """How the crank turns in one run, and when it is sampled."""

    speed: float  # Mean speed [rad/s]
    phase: float  # Angle at time 0 [rad]
    times: np.ndarray  # Of the samples [s]
    start_angle: float = 0.0  # Crank angle at which the motion begins [rad], within a turn
    settling: int = 12  # Whole revolutions between the start and time 0
    nominal_speed: float = 0.0  # As the campaign file states it [rad/s]
    drift: Drift | None = None

    @property
    def lead(self) -> float:
        """Time from the start to time 0 [s]."""
        return (self.phase - self.start_angle + tau * self.settling) / self.speed


@dataclass(frozen=True)
class Sensor:
    """How one channel is measured."""

    noise_share: float  # Standard deviation of the noise over that of the signal
    correlation: float  # Of the noise of neighbouring samples
    gaps: bool  # Whether samples are lost
    every: int = 1  # Every how many samples of the run it is read


@dataclass(frozen=True)
class Rig:
    """One rig with its true, hidden values."""

    # The motion without an effect: ideal, loose (settles to a cycle) or chaotic (never repeats)
    base: str
    content: (
        Mapping  # Of the analyst's mechanism file, but for a swing of the crank among the effects
    )
    bounds: Mapping[
        str, tuple[float, float]
    ]  # Of nuisances by key of the campaign file, SI; of ``speed`` as a share
    values: Mapping[str, float]  # True values of nuisances, SI
    runs: Mapping[str, Run]  # By id, in the order of the campaign file
    confirm: str  # The held-out run
    sensors: Mapping[str, Sensor]  # By channel
    numerics: Numerics
    noise_is_stated: bool
    angle_noise: float = (
        0.0  # Standard deviation of the crank angle's reading [rad]; 0 where there is no encoder
    )
    angle_step: float = (
        0.0  # Of the encoder [rad], where the campaign file states that in place of its noise
    )
    drive: str = "constant_speed"

    @cached_property
    def nominal(self) -> Mechanism:
        """The analyst's mechanism."""
        return validate(Mechanism, self.content, "a drawn mechanism")

    @cached_property
    def true(self) -> Mechanism:
        """The mechanism with the true values of nuisances."""
        return with_nuisances(self.nominal, self.values)

    @property
    def fitted(self) -> list[str]:
        """Ids of the runs that are not held out."""
        return [run for run in self.runs if run != self.confirm]

    @property
    def fastest(self) -> float:
        """The largest speed of the runs [rad/s]."""
        return max(run.speed for run in self.runs.values())

    @property
    def nuisances(self) -> dict[str, Parameter]:
        """What the campaign states of nuisances that all runs share, by name."""
        return {
            key: Parameter(
                key, 0.5 * (low + high), low, high, 0.02 * (high - low), NUISANCES[key] or "1"
            )
            for key, (low, high) in self.bounds.items()
            if key != "speed"
        }


def simulate(
    mechanism: Mechanism, run: Run, numerics: Numerics, effects: Effects = (), perturbation=None
) -> Readings:
    """All signals at the samples of a run, without sensors; `effects` with their sizes act on the
    motion."""
    data = with_effects(mechanism, effects).model_dump()
    for joint in data["joints"].values():
        width = numerics.friction_factor * joint["contact"]["friction_speed"]
        joint["contact"] |= {"friction_law": numerics.friction_law, "friction_speed": width}
    mechanism = validate(Mechanism, data, "a drawn mechanism")
    wave = mechanism.effect("speed_fluctuation")
    mean = (
        run.speed / math.sqrt(1 - wave.ratio**2) if wave else run.speed
    )  # the law's w0 is the mean over the angle
    p = parameters(mechanism, options_of(mean, run.start_angle, numerics.tolerance))
    p.effects.slider_sign_speed *= numerics.sign_factor
    p.effects.crank_sign_speed *= numerics.sign_factor
    times = run.times + run.lead
    if run.drift:
        p, times = _drifting(p, run)
    angles = prescribed_angles(p, times)
    return channels_at(p, angles, numerics.tolerance, perturbation) | {
        "crank_angle": angles - tau * run.settling
    }


def _drifting(p: Parameters, run: Run) -> tuple[Parameters, np.ndarray]:
    """The crank of a run with drift, from one without, and the times of the samples since its start
    [s]."""
    begin = brentq(
        lambda t: t + run.drift.ahead(np.array([t]))[0] + run.lead, -2.0 * run.lead - 1.0, 0.0
    )
    step = tau / run.speed / _DRIFT_GRID
    knots = np.arange(begin, run.times[-1] + 8.0 * step, step)
    smooth = make_interp_spline(
        knots, prescribed_angles(p, knots + run.drift.ahead(knots) + run.lead), k=5
    )
    powers = [smooth(knots[:-1], k) / math.factorial(k) for k in range(5, -1, -1)]
    table = np.column_stack([knots[:-1] - begin, *powers])
    drive = DriveParameters(kind=MEASURED, speed=run.speed, start_angle=float(table[0, 6]))
    return p._replace(drive=record(drive), knots=knots_record(table)), run.times - begin


def with_effects(mechanism: Mechanism, effects: Effects) -> Mechanism:
    """A mechanism with those of `effects` that act on the motion, each at its size."""
    data = mechanism.model_dump()
    data["effects"] = [
        *data["effects"],
        *(entry for effect, size in effects for entry in effect.in_file(size)),
    ]
    return validate(Mechanism, data, "a drawn mechanism")


def read(mechanism: Mechanism, run: Run, numerics: Numerics, effects: Effects = ()) -> Readings:
    """What sensors without noise read."""
    readings = simulate(mechanism, run, numerics, effects)
    for effect, size in effects:
        if effect.sensor:
            (value,) = effect.parameters(size).values()
            fault, true = FAULTS.get(effect.name), readings[effect.sensor]

            def at(times, channel=effect.sensor):
                return simulate(mechanism, replace(run, times=times), numerics, effects)[channel]

            if effect.name == ENCODER_OFFSET:
                faulty = true + value
            elif fault is None:
                faulty = UNLISTED_FAULTS[effect.name](true, value)
            elif fault.delays:
                faulty = at(run.times - value)
            elif fault.over_time:
                step = tau / run.speed / _LAG_GRID
                grid = np.arange(
                    run.times[0] - _LAGS_BEFORE * value - step, run.times[-1] + 2 * step, step
                )
                faulty = np.interp(run.times, grid, fault.over_time(at(grid), step, 0.0, value))
            else:
                faulty = (fault.before_filter or fault.after_filter)(true, value)
            readings = readings | {effect.sensor: faulty}
    return readings


def read_truth(rig: Rig, run: Run, effects: Effects, by_exudyn: bool) -> Readings:
    """What the rig's sensors without noise read of a run, by the package's simulation or
    Exudyn's."""
    if not by_exudyn:
        return read(rig.true, run, rig.numerics, effects)
    model = SliderCrank(with_effects(rig.true, effects), run.speed, run.start_angle)
    readings = model.readings(run.times + run.lead)
    return readings | {"crank_angle": readings["crank_angle"] - tau * run.settling}


def visited(rig: Rig, effects: Effects) -> pd.DataFrame:
    """Signals over one revolution of each run."""
    frames = []
    for run in rig.runs.values():
        times = np.arange(100) / 100 * tau / run.speed
        frames.append(
            pd.DataFrame(simulate(rig.true, Run(run.speed, 0.0, times), rig.numerics, effects))
        )
    return pd.concat(frames, ignore_index=True)


def draw_rig(rng: np.random.Generator, trial: Any) -> Rig:
    """Draw a rig whose settled motion is as the trial's base says: the same in each revolution, or
    not."""

    def drawn(key: str, size: int | None = None) -> Any:
        return rng.uniform(*RECIPE["rig"][key], size)

    for _ in range(_MOST_DRAWS):
        content = _draw_mechanism(rng, drawn, trial)
        speeds = np.minimum(drawn("slowest") * np.cumprod([1.0, *drawn("faster", 2)]), 600)
        speeds = np.round(rng.permutation(speeds)) * tau / 60
        mechanism = validate(Mechanism, content, "a drawn mechanism")
        spreads = (revolution_spread(mechanism, speed) for speed in speeds if trial.base != "ideal")
        if all(
            one < _REPEATS_BELOW if trial.base == "loose" else one > _CHAOTIC_ABOVE
            for one in spreads
        ):
            break
    else:
        raise RuntimeError(f"no rig with a {trial.base} motion in {_MOST_DRAWS} draws")
    late = rng.random() < 0.2
    encoder = trial.needs_encoder or late or rng.random() < 0.85
    speed_known = encoder and (trial.measured_angle or rng.random() < 0.5)
    bounds = ({} if speed_known else {"speed": (-0.003, 0.003)}) | _draw_bounds(rng, content)
    bounds |= {"encoder_lag": tuple(RECIPE["rig"]["encoder_late"])} if late else {}
    inside = {key: 0.5 + 0.9 * (float(rng.random()) - 0.5) for key in bounds if key != "speed"}
    values = {
        key: bounds[key][0] + share * (bounds[key][1] - bounds[key][0])
        for key, share in inside.items()
    }
    if trial.kind != "exudyn":
        loose = [name for name, joint in content["joints"].items() if joint["loose"]]
        values |= {f"lasting_damping_{joint}": float(drawn("log_damping")) for joint in loose}
    chaotic, runs = trial.base == "chaotic", {}
    for number, nominal in enumerate(map(float, speeds), 1):
        speed = nominal * (1 + float(drawn("speed_off")))
        samples = min(round(drawn("samples")), 100 if chaotic else 200)
        times = np.arange(int((30 if chaotic else drawn("revolutions")) * samples)) * (
            tau / speed / samples
        )
        if rng.random() < 0.25:
            times[1:] += drawn("jitter", times.size - 1) * times[1]
        phase, start = (float(angle) for angle in rng.uniform(0, tau, 2))
        runs[f"run{number}"] = Run(speed, phase, times, start, int(drawn("settling")), nominal)
    sensors, slower = (
        {},
        int(rng.integers(*RECIPE["rig"]["slower"], endpoint=True)) if rng.random() < 0.2 else 1,
    )
    for channel in _draw_channels(rng, trial.base):
        correlation = float(drawn("correlation")) if rng.random() < 0.25 else 0.0
        every = slower if rng.random() < 0.5 else 1
        sensors[channel] = Sensor(
            float(drawn("noise")), correlation, bool(rng.random() < 0.15), every
        )
    law, width = (("coulomb", 0.5), ("coulomb", 1.5), ("threlfall", 1.5))[rng.integers(3)]
    noise, step = (
        math.radians(drawn("driving_encoder_deg" if trial.measured_angle else "encoder_deg")),
        0.0,
    )
    if trial.measured_angle and rng.random() < 0.5:
        step = tau / int(rng.choice([1000, 2000, 3600, 10_000]))
        noise = step * float(drawn("noise_of_step"))
    if trial.measured_angle and trial.kind != "exudyn" and rng.random() < 0.3:
        swing = {
            "ratio": float(drawn("swing")),
            "order": 0.5,
            "phase_rad": float(rng.uniform(0, tau)),
        }
        content["effects"] = [{"name": "speed_fluctuation", "parameters": swing}]
    rig = Rig(
        base=trial.base,
        content=content,
        bounds=bounds,
        values=values,
        runs=runs,
        confirm=str(rng.choice(list(runs))),
        sensors=sensors,
        numerics=Numerics(
            10 ** float(drawn("log_tolerance")), law, width, float(rng.choice([0.5, 1.0, 1.5]))
        ),
        noise_is_stated=bool(rng.random() < 0.8),
        angle_noise=noise if encoder else 0.0,
        angle_step=step,
        drive="measured_angle" if trial.measured_angle else "constant_speed",
    )
    for name, run in runs.items() if trial.drift and trial.kind != "exudyn" and not chaotic else ():
        sizes, turns, phases = (
            rng.uniform(0.3, 1.0, 3),
            drawn("drift_turns", 3),
            rng.uniform(0, tau, 3),
        )
        sizes *= drawn("drift") / sizes.sum()
        runs[name] = replace(run, drift=Drift(sizes, run.speed / turns, phases))
    return rig


def _draw_mechanism(rng: np.random.Generator, drawn: Callable[..., Any], trial: Any) -> dict:
    """Content of a mechanism file, around the paper's slider-crank."""
    scale, masses = drawn("scale"), [0.3704, 0.773, 0.4482] * drawn("heavier", 3)
    crank, rod = 0.15 * scale * drawn("crank"), 0.564 * scale
    choices = [joints for joints in _LOOSE if not trial.loose or trial.loose in joints]
    loose = () if trial.base == "ideal" else choices[rng.integers(len(choices))]
    mass, rod_mass, slider_mass = masses * scale
    bodies = {
        "crank": {"length": crank, "mass": mass, "inertia": mass * crank**2 * 0.175},
        "rod": {"length": rod, "mass": rod_mass, "inertia": rod_mass * rod**2 * 0.101},
        "slider": {"mass": slider_mass, "offset": drawn("offset") * (rng.random() < 1 / 3)},
    }
    bodies["crank"]["mass_centre"] = crank * drawn("crank_centre")
    bodies["rod"]["mass_centre"] = rod * drawn("rod_centre")
    journal, joints = round(float(drawn("journal_radius")), 5), {}
    for name, body in (("crank_pivot", "crank"), ("crank_pin", "crank"), ("piston_pin", "slider")):
        radii = {
            "journal_radius": journal,
            "bearing_radius": round(journal + 10 ** float(drawn("log_clearance")), 6),
        }
        joints[name] = {"loose": name in loose, "journal": body, **radii, "contact": "steel"}
    steel = {"law": "lankarani_nikravesh", "restitution": round(float(drawn("restitution")), 3)}
    steel["friction"] = round(float(drawn(f"friction_{trial.base}")), 3)
    if trial.kind == "exudyn":
        steel["memory"] = "published"  # Exudyn's contacts know no other
    rounded = {
        body: {key: float(f"{value:.5g}") for key, value in own.items()}
        for body, own in bodies.items()
    }
    shared = {"contacts": {"steel": steel}, "gravity_direction": -math.pi / 2, "effects": []}
    return rounded | {"joints": joints} | shared


def revolution_spread(mechanism: Mechanism, speed: float) -> float:
    """RMS difference of settled revolutions that began differently or are some apart, over the
    standard deviation."""
    times = np.arange(90) / 90 * tau / speed
    nudge = [1e-7 if pin in mechanism.loose else 0.0 for pin in PINS]  # [m]
    first, *others = (
        pd.DataFrame(
            simulate(mechanism, Run(speed, 0.3, times, settling=turns), Numerics(), (), start)
        )
        for start, turns in ((None, 12), ([nudge[0], 0.0, 0.0, nudge[1]], 2), (None, 15))
    )
    seen = ["slider_acceleration", "crank_torque"]
    return max(
        float((((first - one)[seen] ** 2).mean() ** 0.5 / first[seen].std()).max())
        for one in others
    )


def _draw_bounds(rng: np.random.Generator, content: Mapping) -> dict[str, tuple[float, float]]:
    """Of parameters that are not known exactly, around nominal."""
    joints, steel, bounds = content["joints"], content["contacts"]["steel"], {}
    for key, (share, often) in ((key, own.values()) for key, own in RECIPE["bounds"].items()):
        joint, (body, _, datum) = joints.get(key.removesuffix("_clearance")), key.partition("_")
        if joint is None:
            nominal = content[body][datum]
        else:
            nominal = (joint["bearing_radius"] - joint["journal_radius"]) * joint["loose"]
        width = nominal * rng.uniform(*share)
        if rng.random() < often and width:
            bounds[key] = nominal - width, nominal + width
    if any(joint["loose"] for joint in joints.values()):
        bounds["restitution"] = 0.3, 0.9
        if steel["friction"]:
            bounds["joint_friction"] = (
                round(0.5 * steel["friction"], 3),
                round(1.6 * steel["friction"], 3),
            )
    return bounds


def _draw_channels(rng: np.random.Generator, base: str) -> list[str]:
    """Channels, at least one of which carries forces."""
    kinds = RECIPE["channels"]
    informative = kinds["forces"] + (kinds["accelerations"] if base != "ideal" else [])
    first = "crank_torque" if rng.random() < 0.5 else str(rng.choice(informative))
    others = [name for names in kinds.values() for name in names if name != first]
    return [
        first,
        *map(
            str,
            rng.permutation(others)[
                : int(rng.integers(*RECIPE["rig"]["channels"], endpoint=True)) - 1
            ],
        ),
    ]
