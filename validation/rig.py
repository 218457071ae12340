"""Random virtual rigs with hidden effects, and the readings of their sensors without noise."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from functools import cached_property, partial
from math import tau
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import make_interp_spline
from scipy.optimize import brentq

from jointgap.config import EFFECTS, Mechanism, load_mechanism, read_yaml
from jointgap.config.campaign import nuisances_of
from jointgap.config.channels import ChannelKind, channel_kinds
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.load import validate
from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.formula import compile_formula
from jointgap.core.joints import PINS
from jointgap.core.records import record
from jointgap.effects import CRANK_SIGN_SPEED, SLIDER_SIGN_SPEED, effects_of
from jointgap.effects.base import DETECTABLE_SHARE, FitContext
from jointgap.effects.own_law import formula_effect
from jointgap.linkage.assembly import signs_of
from jointgap.linkage.equations import Crank, Pose
from jointgap.linkage.from_file import linkage_of_file
from jointgap.linkage.laws import evaluate
from jointgap.linkage.parameters import MEASURED, DriveParameters, knots_record
from jointgap.motion.model import Model
from jointgap.motion.of_file import model_of
from jointgap.rig.drives import options_of, prescribed_angles
from jointgap.rig.missing_effects import motion_scales, physical_candidates
from jointgap.rig.sensors import (
    DELAY_SHARES,
    ENCODER_BACKLASH,
    ENCODER_ECCENTRICITY,
    ENCODER_FAULTS,
    ENCODER_OFFSET,
    ENCODER_WINDUP,
    FAULTS,
    LAG_AND_DELAY,
    SENSOR_DELAY,
    SENSOR_LAG,
    Reading,
)
from jointgap.rig.simulate_run import channels_at, with_nuisances
from validation.exudyn import SliderCrank
from validation.exudyn_linkage import Linkage, Start

RECIPE = read_yaml(Path(__file__).with_name("recipe.yaml"))

_FIRST_SIZE, _LARGEST_SIZE = 3.0, 600.0  # [steps of a fit] start and end of a search for a size
_HIGHEST_ORDER = {"speed_fluctuation": 4, "crank_periodic_torque": 6}
_VISCOSITIES = (0.03, 1.0)  # [Pa s] thinner films hardly act

# The shipped linkages that rigs vary, by name
LINKAGES: dict[str, LinkageFile] = {
    name: load_mechanism(name) for name in RECIPE["linkages"]["joints"]
}

# The shape [1] at which the law of a family is an effect, by law and effect
SHAPES = {
    law.NAME: dict(law.MEMBERS) | RECIPE["families"].get(law.NAME.replace(law.BODY, "slider"), {})
    for effects in (EFFECTS, *(effects_of(file.sites) for file in LINKAGES.values()))
    for law in effects.values()
}
SHAPES[LAG_AND_DELAY] = DELAY_SHARES


@dataclass(frozen=True)
class Hidden:
    """A hidden effect whose size is still open; it vanishes at size 0."""

    name: str  # as in a verdict
    site: str
    parameters: Callable[[float], dict[str, float]]  # parameters of a verdict [SI] of a size
    first: float  # size with which a search starts
    most: float
    lowest: float = 0.0
    sensor: str = ""  # channel of a sensor fault
    has_site: bool = False  # whether an entry of a mechanism file needs the site
    law: Mapping[str, Any] | None = None  # formula and coefficients of an unlisted force
    formula_effect: str = ""  # name of its entry in a mechanism file

    def in_file(self, size: float) -> list[dict]:
        """Entries in a mechanism file; none for a sensor fault."""
        if self.sensor:
            return []
        values = self.parameters(size)
        if self.law:
            law = {**self.law, "coefficients": self.law["coefficients"] | values}
            return [{"name": self.formula_effect, "parameters": law}]
        site = {"site": self.site} if self.has_site else {}
        return [{"name": self.name, **site, "parameters": values}]


def candidates(
    mechanism: Mechanism | LinkageFile, speed: float, nuisances: Mapping[str, Parameter]
) -> dict[str, Candidate]:
    """Physical candidates at a crank `speed` [rad/s], by label."""
    scale, scales = motion_scales(mechanism, speed)
    context = FitContext(
        mechanism, scale, nuisances, True, speed / tau, (None, None), scales=scales
    )
    return {candidate.label: candidate for candidate in physical_candidates(context)}


LISTED = (
    *candidates(load_mechanism("erkaya2009"), 30.0, {}),
    *(ENCODER_OFFSET, "sensor_bias", "sensor_gain", SENSOR_LAG, SENSOR_DELAY),
)
OFF_LIST = (*RECIPE["laws"], *RECIPE["faults"])
CHANNELS = tuple(name for names in RECIPE["channels"].values() for name in names)
HIGH_PASS = "sensor_high_pass"
# Channels of piezoelectric sensors
AC_COUPLED = (*RECIPE["channels"]["forces"], *RECIPE["channels"]["accelerations"])
SENSOR_FAULTS = tuple(name for name in LISTED if name in FAULTS and name != ENCODER_OFFSET)

# Labels of right answers: effects and encoder faults, then sensor faults with their channel
LABELS = (
    *(name for name in LISTED if name not in SENSOR_FAULTS),
    *(f"{fault}:{channel}" for channel in CHANNELS for fault in SENSOR_FAULTS),
)


def draw_effect(
    label: str, rig: Any, spread: Mapping[str, float], rng: np.random.Generator
) -> Hidden | None:
    """The effect `label` of a rig with the standard deviations `spread` [SI] of its channels; None
    if it cannot act."""
    if label in ENCODER_FAULTS:
        channel = "crank_angle"
    elif label == HIGH_PASS:
        channel = str(rng.choice([name for name in rig.sensors if name in AC_COUPLED]))
    else:
        channel = str(rng.choice(list(rig.sensors)))
    if label in RECIPE["faults"]:
        fault = RECIPE["faults"][label]
        unit = spread[channel] if fault["of_spread"] else 1.0

        def fault_parameters(size: float) -> dict[str, float]:
            return {label: size * unit}

        sizes = fault["first"], fault["most"]
        return Hidden(label, channel, fault_parameters, *sizes, sensor=channel)
    if label in RECIPE["laws"] or label in RECIPE["linkages"]["laws"]:
        return _unlisted_law(label, rig, rng)
    if label in FAULTS:
        site = "sensor" if label in ENCODER_FAULTS else channel
        torque = _torque(rig)
        reading = Reading(spread.get(channel, 0.0), "", rig.fastest, torque)
        return _listed_effect(FAULTS[label].candidate(site, reading), rng, {}, channel)
    candidate = candidates(rig.nominal, rig.fastest, rig.nuisances).get(label)
    hidden = candidate and _listed_effect(candidate, rng, rig.nuisances)
    if hidden and rig.is_linkage and label.endswith("_clearance"):
        unit = hidden.parameters(1.0)["clearance_m"]
        lowest, most = (float(end) / unit for end in RECIPE["linkages"]["clearance"])
        return replace(hidden, first=lowest, lowest=lowest, most=most)
    return hidden


def _torque(rig: Any) -> float:
    """Size of the torque on the crank [N m]."""
    if rig.is_linkage:
        scale, _ = motion_scales(rig.true, rig.fastest)
        return scale.force / DETECTABLE_SHARE * scale.stroke
    return rig.true.slider.mass * (rig.true.crank.length * rig.fastest) ** 2


def _unlisted_law(label: str, rig: Any, rng: np.random.Generator) -> Hidden:
    if rig.is_linkage:
        return _unlisted_law_of_linkage(label, rig, rng)
    law, crank = RECIPE["laws"][label], rig.true.crank.length
    constants = {"V": crank * rig.fastest, "R": crank, "X": rig.true.rod.length}
    constants["A"] = float(rng.uniform(0, 6))
    first = law["first"] * rig.true.slider.mass * crank ** (1 + law["power"]) * rig.fastest**2
    site = "crank" if "theta" in law["formula"] else "slider"
    return _hidden_law(label, rig, site, law["formula"], constants, first)


def _unlisted_law_of_linkage(label: str, rig: Any, rng: np.random.Generator) -> Hidden:
    """A law at a body on a slide or pivot of the frame, or on the crank; its size starts from the
    inertia forces there."""
    law, sites = RECIPE["linkages"]["laws"][label], rig.true.sites
    on_crank = "theta" in law["formula"]
    site = sites.crank if on_crank else str(rng.choice([*sites.slides, *sites.pivots]))
    crank, scales = motion_scales(rig.true, rig.fastest)
    scale = scales.get(site, crank)
    turns = site not in sites.slides
    constants = {"X": scale.middle, "A": float(rng.uniform(0, 6))}
    constants["V"] = scale.turning if turns else scale.speed
    constants["R"] = scale.swing if turns else scale.stroke
    constants["W"] = CRANK_SIGN_SPEED if turns else SLIDER_SIGN_SPEED
    force = scale.force / DETECTABLE_SHARE * (scale.stroke if turns else 1.0)
    return _hidden_law(label, rig, site, law["formula"], constants, law["first"] * force)


def _hidden_law(
    label: str, rig: Any, site: str, formula: str, constants: Mapping[str, float], first: float
) -> Hidden:
    used = set(re.findall("[A-Z]", formula))
    law = {"formula": formula, "coefficients": {key: constants[key] for key in used}}
    effect = formula_effect(rig.true.sites, site)
    return Hidden(
        label,
        site,
        lambda size: {"s": size},
        first,
        200 * first,
        law=law,
        formula_effect=effect,
    )


def _listed_effect(
    candidate: Candidate, rng: np.random.Generator, nuisances: Mapping[str, Parameter], sensor=""
) -> Hidden:
    """A candidate with random shape parameters and a random direction of its amplitudes."""
    amplitudes = {p.key: p for p in candidate.coordinates if p.key in candidate.amplitudes}
    direction = dict(zip(amplitudes, _direction(candidate, rng), strict=True))
    order = sorted(direction, key=lambda key: -abs(direction[key]))
    steps = {key: direction[key] * amplitudes[key].step for key in order}
    shapes = {
        p.key: _draw_shape(candidate, p, rng)
        for p in candidate.coordinates
        if p.key not in amplitudes
    }
    ends = [
        (amplitudes[key].high if step > 0 else amplitudes[key].low) / step
        for key, step in steps.items()
        if step
    ]
    if candidate.name == "rod_flexibility":
        ends = [0.4 * ends[0]]  # at least five times as fast as the crank
    lowest, most = 0.0, min([*ends, _LARGEST_SIZE])
    for name, key in candidate.replaces.items():  # beyond the stated range of the parameter
        if steps[key]:
            lowest = (nuisances[name].high - nuisances[name].low) / abs(steps[key])
    searched = _VISCOSITIES if candidate.name == "lubricated_joint" else candidate.search_range
    if searched and not candidate.is_perturbation:
        lowest, most = (end / next(iter(steps.values())) for end in searched)

    def effect_parameters(size: float) -> dict[str, float]:
        values = {key: size * step for key, step in steps.items()} | shapes
        return {key: float(value) for key, value in candidate.parameters(values).items()}

    first = min(max(_FIRST_SIZE, 1.2 * lowest), most)
    return Hidden(
        candidate.name,
        candidate.site,
        effect_parameters,
        first,
        most,
        lowest,
        sensor,
        candidate.has_site and not candidate.sensor,
    )


def _direction(candidate: Candidate, rng: np.random.Generator) -> list[float]:
    """Steps of each amplitude at size 1: a spring rests near mid-stroke, one of two lengths is
    wrong, other pairs of amplitudes have a phase."""
    low = candidate.coordinates[0].low
    sign = float(rng.choice([-1.0, 1.0])) if low < 0 and not candidate.is_perturbation else 1.0
    if candidate.name.endswith("_spring"):
        share = rng.uniform(0.44, 0.56)
        return [share, 1 - share]
    if candidate.name == "link_length_error":
        return list(sign * rng.permutation([1.0] + [0.0] * (len(candidate.amplitudes) - 1)))
    angle = rng.uniform(0, tau)
    return [sign] if len(set(candidate.amplitudes)) == 1 else [math.cos(angle), math.sin(angle)]


def _draw_shape(candidate: Candidate, p: Parameter, rng: np.random.Generator) -> float:
    if p.search_values:
        highest = _HIGHEST_ORDER[candidate.name]
        return rng.choice([order for order in p.search_values if order <= highest])
    shares = RECIPE["shapes"].get(p.name)
    return rng.uniform(*(np.multiply(shares, p.nominal) if shares else (p.low, p.high)))


# Effects with their sizes
Effects = Sequence[tuple[Hidden, float]]


def _cubic_sensor(u: np.ndarray, size: float) -> np.ndarray:
    middle, half = 0.5 * (u.max() + u.min()), 0.5 * np.ptp(u)
    return u + size * (u - middle) ** 3 / half**2


# Errors (n,) [rad] of an encoder at crank angles (n,) [rad] and driving torques (n,) [N m], with
# the parameters of a verdict
ENCODER_ERRORS = {
    ENCODER_OFFSET: lambda angle, torque, offset_rad: np.full(angle.size, offset_rad),
    ENCODER_WINDUP: lambda angle, torque, stiffness_N_m_rad: torque / stiffness_N_m_rad,
    ENCODER_BACKLASH: lambda angle, torque, play_rad: 0.5 * play_rad * np.sign(torque),
    ENCODER_ECCENTRICITY: lambda angle, torque, amplitude_rad, phase_rad: (
        amplitude_rad * np.cos(angle - phase_rad)
    ),
}

# Encoder faults that change the shape of the angle over time
MOVED_ANGLE = ENCODER_ERRORS.keys() - {ENCODER_OFFSET}

# Readings of a signal (n,) with unlisted sensor faults
UNLISTED_FAULTS = {
    "drift": lambda u, size: u + size * np.linspace(0.0, 1.0, u.size),
    "quantisation": lambda u, size: size * (np.floor(u / size) + 0.5),
    "saturation": lambda u, size: np.clip(u, None, u.max() - size * np.ptp(u)),
    "cubic_sensor": _cubic_sensor,
}

_LOOSE = (PINS, PINS, PINS, ("piston_pin",), ("piston_pin",), ("crank_pin",))

# Difference of settled revolutions over a channel's standard deviation: periodic below (far below
# sensor noise), non-periodic above
_PERIODIC_BELOW, _CHAOTIC_ABOVE = 3e-3, 0.05
_MOST_DRAWS = 200  # of mechanisms until the motion is as required at all three speeds

# Knots per revolution of a drifting crank: its angle between them is exact to 1e-11 rad
_DRIFT_GRID = 240
# Samples per revolution for a filter; lags simulated before the first sample (decay to 1 %)
_FILTER_GRID, _LAGS_BEFORE = 2880, 5.0

# Of one run by channel, SI
Readings = dict[str, np.ndarray]


@dataclass(frozen=True)
class Numerics:
    """Solver settings that vary between simulators."""

    tolerance: float = 1e-10  # local error of a step [m]
    friction_law: str = "coulomb"  # or threlfall, ambrosio
    friction_factor: float = 1.0  # on the regularisation speed of friction in loose joints
    sign_factor: float = 1.0  # on the width of the sign functions of slider and crank


@dataclass(frozen=True)
class Drift:
    """A slow drift of the speed: a sum of sinusoids of time."""

    sizes: np.ndarray  # shares of the mean speed
    rates: np.ndarray  # angular frequencies [rad/s]
    phases: np.ndarray  # [rad]

    def ahead(self, times: np.ndarray) -> np.ndarray:
        """Lead [s] over a steady crank that agrees at time 0."""
        phases = np.multiply.outer(times, self.rates) + self.phases
        return (np.sin(phases) - np.sin(self.phases)) @ (self.sizes / self.rates)

    def __add__(self, other: "Drift") -> "Drift":
        return Drift(*map(np.append, astuple(self), astuple(other)))


@dataclass(frozen=True)
class Run:
    """Motion of the crank in one run, and its sample times."""

    speed: float  # mean speed [rad/s]
    phase: float  # angle at time 0 [rad]
    times: np.ndarray  # of the samples [s]
    start_angle: float = 0.0  # crank angle at the start of the simulation [rad]
    settling: int = 12  # revolutions between the start and time 0
    nominal_speed: float = 0.0  # as stated in the campaign file [rad/s]
    drift: Drift | None = None

    @property
    def lead(self) -> float:
        """Time from the start to time 0 [s]."""
        return (self.phase - self.start_angle + tau * self.settling) / self.speed

    def as_read(self, amplitude: float, phase: float) -> "Run":
        """The run as an encoder reads it whose eccentric disc reads most too much, by `amplitude`
        [rad], at the crank angle `phase` [rad]."""
        wave = Drift(*np.array([[amplitude], [self.speed], [self.phase - phase + 0.5 * math.pi]]))
        start = self.phase + amplitude * math.cos(self.phase - phase)
        return replace(self, phase=start, drift=self.drift + wave if self.drift else wave)


@dataclass(frozen=True)
class Sensor:
    """Noise and sampling of a channel."""

    noise_share: float  # standard deviation of the noise over that of the signal
    correlation: float  # of the noise of neighbouring samples
    gaps: bool
    every: int = 1  # read at every n-th sample


@dataclass(frozen=True)
class Rig:
    """A rig with its true values."""

    base: str  # motion without an effect: ideal, loose (periodic) or chaotic (non-periodic)
    content: Mapping  # mechanism file of the analyst; a crank swing among the effects is hidden
    bounds: Mapping[str, tuple[float, float]]  # of nuisances by key, SI; ``speed`` as a share
    values: Mapping[str, float]  # true values of nuisances, SI
    runs: Mapping[str, Run]
    confirm: str  # the held-out run
    sensors: Mapping[str, Sensor]  # by channel
    numerics: Numerics
    noise_is_stated: bool
    angle_noise: float = 0.0  # standard deviation of the crank angle [rad]; 0 without encoder
    angle_step: float = 0.0  # of the encoder [rad], if stated instead of its noise
    truncates: bool = False  # a counter of whole steps, not the nearest step
    compares_angle: bool = False  # whether effects act on the angle at constant speed
    drive: str = "constant_speed"

    @property
    def is_linkage(self) -> bool:
        return isinstance(self.nominal, LinkageFile)

    @property
    def channel_kinds(self) -> dict[str, ChannelKind]:
        return channel_kinds(self.nominal.sites, self.nominal.loose)

    @cached_property
    def nominal(self) -> Mechanism | LinkageFile:
        """The mechanism of the analyst."""
        return mechanism_of(self.content)

    @cached_property
    def true(self) -> Mechanism | LinkageFile:
        """The mechanism with the true values of nuisances."""
        return with_nuisances(self.nominal, self.values)

    @property
    def fitted(self) -> list[str]:
        """Runs that are not held out."""
        return [run for run in self.runs if run != self.confirm]

    @property
    def fastest(self) -> float:
        """The largest speed of the runs [rad/s]."""
        return max(run.speed for run in self.runs.values())

    @property
    def nuisances(self) -> dict[str, Parameter]:
        """Nuisances of all runs as stated in the campaign file, by name."""
        found, kinds = {}, nuisances_of(self.nominal.sites, self.nominal.loose)
        for key, (low, high) in self.bounds.items():
            if key != "speed":
                middle, step = 0.5 * (low + high), 0.02 * (high - low)
                found[key] = Parameter(key, middle, low, high, step, kinds[key].unit or "1")
        return found


def mechanism_of(content: Mapping) -> Mechanism | LinkageFile:
    """The mechanism of the content of a file."""
    kind = LinkageFile if "frame" in content else Mechanism
    return validate(kind, content, "a drawn mechanism")


def simulate(
    mechanism: Mechanism | LinkageFile,
    run: Run,
    numerics: Numerics,
    effects: Effects = (),
    perturbation=None,
) -> Readings:
    """All signals at the samples of a run, without sensor faults."""
    data = with_effects(mechanism, effects).model_dump()
    for joint in data["joints"].values():
        if not joint.get("contact"):  # an ideal slide
            continue
        width = numerics.friction_factor * joint["contact"]["friction_speed"]
        joint["contact"] |= {"friction_law": numerics.friction_law, "friction_speed": width}
    mechanism = mechanism_of(data)
    wave = mechanism.effect("speed_fluctuation")
    # the speed of the law is the mean over the angle
    mean = run.speed / math.sqrt(1 - wave.ratio**2) if wave else run.speed
    model = model_of(mechanism, options_of(mean, run.start_angle, numerics.tolerance))
    for laws in (model.p.slides.laws, model.p.pivots.laws):
        laws["sign_speed"] *= numerics.sign_factor
    times = run.times + run.lead
    if run.drift:
        model, times = _drifting(model, run)
    angles = prescribed_angles(model.p, times)
    readings = channels_at(model, angles, numerics.tolerance, perturbation)
    return readings | {"crank_angle": angles - tau * run.settling}


def _drifting(model: Model, run: Run) -> tuple[Model, np.ndarray]:
    """The model with a drifting crank, and the times of the samples since its start [s]."""

    def start(t: float) -> float:
        return t + run.drift.ahead(np.array([t]))[0] + run.lead

    begin = brentq(start, -2.0 * run.lead - 1.0, 0.0)
    step = tau / run.speed / _DRIFT_GRID
    knots = np.arange(begin, run.times[-1] + 8.0 * step, step)
    angles = prescribed_angles(model.p, knots + run.drift.ahead(knots) + run.lead)
    smooth = make_interp_spline(knots, angles, k=5)
    powers = [smooth(knots[:-1], k) / math.factorial(k) for k in range(5, -1, -1)]
    table = np.column_stack([knots[:-1] - begin, *powers])
    drive = DriveParameters(kind=MEASURED, speed=run.speed, start_angle=float(table[0, 6]))
    p = model.p._replace(drive=record(drive), knots=knots_record(table))
    return replace(model, p=p), run.times - begin


def with_effects(mechanism: Mechanism, effects: Effects) -> Mechanism:
    """The mechanism with the effects that act on its motion."""
    data = mechanism.model_dump()
    added = [entry for effect, size in effects for entry in effect.in_file(size)]
    data["effects"] = [*data["effects"], *added]
    return mechanism_of(data)


def read(
    mechanism: Mechanism | LinkageFile, run: Run, numerics: Numerics, effects: Effects = ()
) -> Readings:
    """Sensor readings without noise."""
    return _with_faults(run, effects, lambda run: simulate(mechanism, run, numerics, effects))


def _with_faults(run: Run, effects: Effects, simulated: Callable[[Run], Readings]) -> Readings:
    """Readings of a run with the sensor faults among the effects; `simulated`: without them."""
    motion = simulated(run)
    readings = motion
    for effect, size in effects:
        if not effect.sensor:
            continue
        values = effect.parameters(size)
        value = next(iter(values.values()))
        fault, true = FAULTS.get(effect.name), readings[effect.sensor]

        def at(times, channel=effect.sensor):
            return simulated(replace(run, times=times))[channel]

        if effect.name in ENCODER_ERRORS:
            error = ENCODER_ERRORS[effect.name]
            faulty = true + error(true, motion["crank_torque"], **values)
        elif effect.name == HIGH_PASS:
            faulty = _high_passed(true, run, at, value)
        elif fault is None:
            faulty = UNLISTED_FAULTS[effect.name](true, value)
        elif fault.delays:
            faulty = at(run.times - value)
        elif fault.over_time:
            step = tau / run.speed / _FILTER_GRID
            begin = run.times[0] - _LAGS_BEFORE * value - step
            grid = np.arange(begin, run.times[-1] + 2 * step, step)
            faulty = np.interp(run.times, grid, fault.over_time(at(grid), step, 0.0, value))
        else:
            faulty = (fault.before_filter or fault.after_filter)(true, value)
        readings = readings | {effect.sensor: faulty}
    return readings


def _high_passed(true: np.ndarray, run: Run, at: Callable, corner: float) -> np.ndarray:
    """The `true` signal (n,) of a run after a first-order high-pass of `corner` [Hz], from the
    spectrum of two revolutions (a swing has half order), which repeat."""
    period, count = 2 * tau / run.speed, 2 * _FILTER_GRID
    times = run.times[0] + period / count * np.arange(count)
    frequencies = np.fft.rfftfreq(count, period / count)
    low_passed = np.fft.irfft(np.fft.rfft(at(times)) / (1 + 1j * frequencies / corner), count)
    return true - np.interp(run.times, times, low_passed, period=period)


def read_truth(rig: Rig, run: Run, effects: Effects, by_exudyn: bool) -> Readings:
    """Readings of the rig without noise, simulated by the package or by Exudyn."""
    if not by_exudyn:
        return read(rig.true, run, rig.numerics, effects)
    if rig.is_linkage:
        file = with_effects(rig.true, effects)
        return _with_faults(run, effects, lambda run: _read_linkage(file, run))
    model = SliderCrank(with_effects(rig.true, effects), run.speed, run.start_angle)
    readings = model.readings(run.times + run.lead)
    return readings | {"crank_angle": readings["crank_angle"] - tau * run.settling}


def _read_linkage(file: LinkageFile, run: Run) -> Readings:
    """Readings by Exudyn; with ideal joints from half a revolution before the run on."""
    if file.applied().loose:
        model = exudyn_linkage(file, run.speed, run.start_angle)
        readings = model.readings(run.times + run.lead)
        return readings | {"crank_angle": readings["crank_angle"] - tau * run.settling}
    before = math.pi + run.speed * max(0.0, -float(run.times[0]))
    model = exudyn_linkage(file, run.speed, run.phase - before)
    return model.readings(run.times + before / run.speed)


def exudyn_linkage(file: LinkageFile, speed: float, angle: float, **keys: Any) -> Linkage:
    """Exudyn's model of a linkage whose crank starts at an `angle` [rad] with a `speed` [rad/s]."""
    formulas = {}
    for body in file.bodies:
        if found := file.effect(formula_effect(file.sites, body)):
            program = compile_formula(found.formula, found.coefficients)
            formulas[body] = partial(evaluate, program.codes, program.numbers)
    starts = _starts_of(file.applied(), speed, angle)
    return Linkage(file, speed, angle, starts, formulas, **keys)


def _starts_of(file: LinkageFile, speed: float, angle: float) -> dict[str, Start]:
    """Start of each body of the ideal linkage at a crank `speed` [rad/s] and `angle` [rad]."""
    joints = {
        name: joint.model_copy(update={"loose": False}) if name in file.loose_pins else joint
        for name, joint in file.joints.items()
    }
    linkage = linkage_of_file(file.model_copy(update={"joints": joints}))
    crank = Crank(math.cos(angle), math.sin(angle), speed)
    pose = Pose(linkage, signs_of(linkage, 0.0), crank, {})
    starts = {}
    for name in file.bodies:
        place, velocity = (complex(*map(float, pair)) for pair in pose.point(name, None))
        cosine, sine = pose.directions[name]
        starts[name] = place, math.atan2(sine, cosine), velocity, float(pose.speeds[name])
    return starts


def visited_states(rig: Rig, effects: Effects) -> pd.DataFrame:
    """Signals over one revolution of each run."""
    frames = []
    for run in rig.runs.values():
        turn = Run(run.speed, 0.0, np.arange(100) / 100 * tau / run.speed)
        frames.append(pd.DataFrame(simulate(rig.true, turn, rig.numerics, effects)))
    return pd.concat(frames, ignore_index=True)


def draw_rig(rng: np.random.Generator, trial: Any) -> Rig:
    """Draw a rig whose settled motion is periodic or not, as the base of the trial requires."""

    def drawn(key: str, size: int | None = None) -> Any:
        return rng.uniform(*RECIPE["rig"][key], size)

    for _ in range(_MOST_DRAWS):
        content = _draw_mechanism(rng, drawn, trial)
        speeds = np.minimum(drawn("slowest") * np.cumprod([1.0, *drawn("faster", 2)]), 600)
        speeds = np.round(rng.permutation(speeds)) * tau / 60
        if has_base_motion(mechanism_of(content), speeds, trial.base):
            break
    else:
        raise RuntimeError(f"no rig with a {trial.base} motion in {_MOST_DRAWS} draws")
    late = rng.random() < 0.2
    encoder = trial.needs_encoder or late or rng.random() < 0.85
    speed_known = encoder and (trial.measured_angle or rng.random() < 0.5)
    bounds = {} if speed_known else {"speed": (-0.003, 0.003)}
    bounds |= _draw_bounds(rng, content)
    if late:
        bounds["encoder_lag"] = tuple(RECIPE["rig"]["encoder_late"])
    values = {}
    for key, (low, high) in bounds.items():
        if key != "speed":
            values[key] = low + (0.5 + 0.9 * (float(rng.random()) - 0.5)) * (high - low)
    if trial.kind != "exudyn":
        for name, joint in content["joints"].items():
            if joint["loose"]:
                values[f"lasting_damping_{name}"] = float(drawn("log_damping"))
    runs = {
        f"run{number}": draw_run(rng, drawn, float(nominal), trial.base == "chaotic")
        for number, nominal in enumerate(speeds, 1)
    }
    sensors = draw_sensors(rng, drawn, lambda: _draw_channels(rng, trial.base))
    law, width = (("coulomb", 0.5), ("coulomb", 1.5), ("threlfall", 1.5))[rng.integers(3)]
    moved_angle = not MOVED_ANGLE.isdisjoint(trial.effects)
    accurate = trial.measured_angle or moved_angle
    noise = math.radians(drawn("driving_encoder_deg" if accurate else "encoder_deg"))
    step, truncates = 0.0, trial.kind == "counter"
    if truncates or (accurate and rng.random() < 0.5):
        step = tau / int(rng.choice(RECIPE["rig"]["accurate_counts" if accurate else "counts"]))
        noise = step * float(drawn("noise_of_step"))
    if trial.measured_angle and trial.kind != "exudyn" and rng.random() < 0.3:
        swing = {"ratio": float(drawn("swing")), "order": 0.5}
        swing["phase_rad"] = float(rng.uniform(0, tau))
        content["effects"] = [{"name": "speed_fluctuation", "parameters": swing}]
    confirm = str(rng.choice(list(runs)))
    tolerance, sign_factor = 10 ** float(drawn("log_tolerance")), float(rng.choice([0.5, 1.0, 1.5]))
    rig = Rig(
        base=trial.base,
        content=content,
        bounds=bounds,
        values=values,
        runs=runs,
        confirm=confirm,
        sensors=sensors,
        numerics=Numerics(tolerance, law, width, sign_factor),
        noise_is_stated=bool(rng.random() < 0.8),
        angle_noise=noise if encoder else 0.0,
        angle_step=step,
        truncates=truncates,
        compares_angle=moved_angle and not trial.measured_angle,
        drive="measured_angle" if trial.measured_angle else "constant_speed",
    )
    if trial.drift and trial.kind != "exudyn" and trial.base != "chaotic":
        for name, run in runs.items():
            sizes, turns = rng.uniform(0.3, 1.0, 3), drawn("drift_turns", 3)
            phases = rng.uniform(0, tau, 3)
            sizes *= drawn("drift") / sizes.sum()
            runs[name] = replace(run, drift=Drift(sizes, run.speed / turns, phases))
    return rig


def has_base_motion(mechanism: Mechanism | LinkageFile, speeds: np.ndarray, base: str) -> bool:
    """Whether the settled motion is periodic (loose) or not (chaotic) at all speeds."""
    if base == "ideal":
        return True
    spreads = (revolution_spread(mechanism, speed) for speed in speeds)
    if base == "loose":
        return all(spread < _PERIODIC_BELOW for spread in spreads)
    return all(spread > _CHAOTIC_ABOVE for spread in spreads)


def draw_run(rng: np.random.Generator, drawn: Callable, nominal: float, chaotic: bool) -> Run:
    speed = nominal * (1 + float(drawn("speed_off")))
    samples = min(round(drawn("samples")), 100 if chaotic else 200)
    count = int((30 if chaotic else drawn("revolutions")) * samples)
    times = np.arange(count) * (tau / speed / samples)
    if rng.random() < 0.25:
        times[1:] += drawn("jitter", times.size - 1) * times[1]
    phase, start = (float(angle) for angle in rng.uniform(0, tau, 2))
    return Run(speed, phase, times, start, int(drawn("settling")), nominal)


def draw_sensors(
    rng: np.random.Generator, drawn: Callable, channels: Callable[[], list[str]]
) -> dict[str, Sensor]:
    """Sensors of the channels that `channels` draws."""
    slower = RECIPE["rig"]["slower"]
    slower = int(rng.integers(*slower, endpoint=True)) if rng.random() < 0.2 else 1
    sensors = {}
    for channel in channels():
        correlation = float(drawn("correlation")) if rng.random() < 0.25 else 0.0
        every = slower if rng.random() < 0.5 else 1
        noise, gaps = float(drawn("noise")), bool(rng.random() < 0.15)
        sensors[channel] = Sensor(noise, correlation, gaps, every)
    return sensors


def _draw_mechanism(rng: np.random.Generator, drawn: Callable[..., Any], trial: Any) -> dict:
    """Content of a mechanism file similar to the paper's slider-crank."""
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
        bearing = round(journal + 10 ** float(drawn("log_clearance")), 6)
        radii = {"journal_radius": journal, "bearing_radius": bearing}
        joints[name] = {"loose": name in loose, "journal": body, **radii, "contact": "steel"}
    steel = {"law": "lankarani_nikravesh", "restitution": round(float(drawn("restitution")), 3)}
    steel["friction"] = round(float(drawn(f"friction_{trial.base}")), 3)
    if trial.kind == "exudyn":
        steel["memory"] = "published"  # the only contact law of Exudyn
    rounded = {
        body: {key: float(f"{value:.5g}") for key, value in data.items()}
        for body, data in bodies.items()
    }
    shared = {"contacts": {"steel": steel}, "gravity_direction": -math.pi / 2, "effects": []}
    return rounded | {"joints": joints} | shared


def revolution_spread(mechanism: Mechanism | LinkageFile, speed: float) -> float:
    """Largest RMS difference of settled revolutions from different starts, over the standard
    deviation."""
    times = np.arange(90) / 90 * tau / speed
    if isinstance(mechanism, LinkageFile):
        nudged: Any = {joint: (1e-7, 0.0) for joint in mechanism.loose}  # [m]
        kinds = channel_kinds(mechanism.sites, mechanism.loose)
        compared = ["crank_torque", *(name for name, kind in kinds.items() if kind.axis)]
    else:
        nudge = [1e-7 if pin in mechanism.loose else 0.0 for pin in PINS]
        nudged = [nudge[0], 0.0, 0.0, nudge[1]]
        compared = ["slider_acceleration", "crank_torque"]

    def revolution(start: Any, turns: int) -> pd.DataFrame:
        run = Run(speed, 0.3, times, settling=turns)
        return pd.DataFrame(simulate(mechanism, run, Numerics(), (), start))[compared]

    first = revolution(None, 12)
    others = revolution(nudged, 2), revolution(None, 15)
    return max(
        float((((first - other) ** 2).mean() ** 0.5 / first.std()).max()) for other in others
    )


def _draw_bounds(rng: np.random.Generator, content: Mapping) -> dict[str, tuple[float, float]]:
    """Bounds of uncertain parameters about their nominal values."""
    joints, steel, bounds = content["joints"], content["contacts"]["steel"], {}
    for key, recipe in RECIPE["bounds"].items():
        joint, (body, _, datum) = joints.get(key.removesuffix("_clearance")), key.partition("_")
        if joint is None:
            nominal = content[body][datum]
        else:
            nominal = (joint["bearing_radius"] - joint["journal_radius"]) * joint["loose"]
        width = nominal * rng.uniform(*recipe["share"])
        if rng.random() < recipe["often"] and width:
            bounds[key] = nominal - width, nominal + width
    if any(joint["loose"] for joint in joints.values()):
        bounds["restitution"] = 0.3, 0.9
        if friction := steel["friction"]:
            bounds["joint_friction"] = round(0.5 * friction, 3), round(1.6 * friction, 3)
    return bounds


def _draw_channels(rng: np.random.Generator, base: str) -> list[str]:
    """Channels, at least one of which depends on forces."""
    groups = RECIPE["channels"]
    informative = groups["forces"] + (groups["accelerations"] if base != "ideal" else [])
    first = "crank_torque" if rng.random() < 0.5 else str(rng.choice(informative))
    others = rng.permutation([name for names in groups.values() for name in names if name != first])
    count = int(rng.integers(*RECIPE["rig"]["channels"], endpoint=True))
    return [first, *map(str, others[: count - 1])]
