"""Effects that a trial can inject: how large at first, how large at most, and their entries in a mechanism file.

One number is the size, zero where the effect is absent; further parameters (a rest position, a frequency, a phase) are
drawn once and stay.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jointgap.effects import EFFECTS
from jointgap.rig.sensors import DELAY_SHARES, ENCODER_OFFSET, FAULTS, LAG_AND_DELAY, SENSOR_DELAY, Reading, SensorFault

Parameters = dict[str, float]


LARGEST_SIZE = 200.0
"""How many times the first amplitude a trial may give an effect that nothing else bounds."""


@dataclass(frozen=True)
class RigScales:
    """The scales of a rig that the sizes of effects follow."""

    mechanism: Mapping  # Content of a mechanism file
    speed: float  # Largest of the runs [rad/s]
    loose: tuple[str, ...]  # Loose joints, measured channels
    channels: tuple[str, ...]  # Loose joints, measured channels
    spread: Mapping[str, float]  # Standard deviation of each channel in the fastest run [SI]

    @property
    def force(self) -> float:
        """The slider's largest inertia force [N], about."""
        return self.mechanism["slider"]["mass"] * self.mechanism["crank"]["length"] * self.speed**2

    @property
    def velocity(self) -> float:
        """The slider's largest velocity [m/s], about."""
        return self.mechanism["crank"]["length"] * self.speed

    @property
    def stroke(self) -> tuple[float, float]:
        """Middle and half of the slider's stroke [m]."""
        return self.mechanism["rod"]["length"], self.mechanism["crank"]["length"]


@dataclass(frozen=True)
class InjectedEffect:
    """One effect that acts, at a size still open."""

    name: str  # As in a verdict; of an effect that is not on the list, its own name
    site: str  # As in a verdict; of an effect that is not on the list, its own name
    parameters: Callable[[float], Parameters]  # From the size to the parameters of a verdict [SI]
    first: float  # Size to begin with, largest and smallest size
    most: float  # Size to begin with, largest and smallest size
    least: float = 0.0  # Size to begin with, largest and smallest size
    listed: bool = True  # Whether it is among the candidates of the naming
    sensor: str = ""  # Channel of a sensor's fault, else empty
    formula: tuple[str, str] | None = None  # Of a law that is not on the list

    def in_file(self, size: float) -> list[dict]:
        """Entries of a mechanism file's effects; none for a sensor's fault."""
        if self.sensor:
            return []
        if self.formula:
            kind, text = self.formula
            return [{"name": kind, "parameters": {"formula": text, "coefficients": {"s": size}}}]
        choice = {"site": self.site} if EFFECTS[self.name].sites() else {}
        return [{"name": self.name, **choice, "parameters": self.parameters(size)}]


DrawEffect = Callable[[RigScales, np.random.Generator], InjectedEffect | None]
"""Draws an effect for a rig; None where it cannot act."""


class TrialSize(NamedTuple):
    """How a trial hides an effect: by one number, 0 where the effect is absent; all else is drawn once and stays."""

    parameters: Callable[[float], Parameters]  # From the amplitude to the parameters that a verdict states
    first: float  # Amplitude to begin the search with, its largest and its smallest value
    largest: float
    smallest: float = 0.0

    @classmethod
    def of(cls, key: str, first: float, largest: float | None = None, sign: float = 1.0, **drawn: float) -> "TrialSize":
        """The amplitude, from `first` up to `largest`, times `sign` is the parameter `key`; others are as `drawn`."""
        bound = LARGEST_SIZE * first if largest is None else largest
        return cls(lambda amplitude: {key: sign * amplitude, **drawn}, first, bound)


def _random_sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _random_angle(rng: np.random.Generator) -> float:
    return float(rng.uniform(-math.pi, math.pi))


def _spring(rig: RigScales, rng: np.random.Generator, site: str) -> TrialSize:
    middle, half = rig.stroke
    rest = float(middle + rng.uniform(-0.7, 0.7) * half)
    return TrialSize.of("stiffness_N_m", 0.05 * rig.force / half, rest_position_m=rest)


def _gas(rig: RigScales, rng: np.random.Generator, site: str) -> TrialSize:
    length, exponent = float(rig.stroke[1] * rng.uniform(0.2, 0.8)), float(rng.uniform(1.0, 1.4))
    return TrialSize.of("force_N", 0.1 * rig.force, dead_length_m=length, exponent=exponent)


def _harmonic_force(rig: RigScales, rng: np.random.Generator, site: str) -> TrialSize:
    frequency, phase = float(rig.speed / (2 * math.pi) * rng.uniform(1.3, 6.0)), _random_angle(rng)
    return TrialSize.of("force_N", 0.05 * rig.force, frequency_Hz=frequency, phase_rad=phase)


def _pin_friction(rig: RigScales, rng: np.random.Generator, site: str) -> TrialSize:
    nominal = rig.mechanism["contacts"]["steel"]["friction"] if site in rig.loose else 0.0
    return TrialSize(lambda size: {"coefficient": nominal + size}, 0.05, 0.6 - nominal)


def _unbalance(rig: RigScales, rng: np.random.Generator, site: str) -> TrialSize:
    return TrialSize.of("unbalance_kg_m", 0.1 * rig.force / rig.speed**2, 1.0, angle_rad=_random_angle(rng))


def _speed_fluctuation(rig: RigScales, rng: np.random.Generator, site: str) -> TrialSize:
    order, phase = int(rng.choice([1, 2, 3, 4])), _random_angle(rng)
    return TrialSize.of("ratio", 0.005, 0.3, order=order, phase_rad=phase)


def _link_length(rig: RigScales, rng: np.random.Generator, site: str) -> TrialSize:
    return TrialSize.of(str(rng.choice(["crank_m", "rod_m"])), 1e-4, 0.02, _random_sign(rng))


def _clearance(joint: str) -> Callable[[RigScales, np.random.Generator, str], TrialSize]:
    def size(rig: RigScales, rng: np.random.Generator, site: str) -> TrialSize:
        data = rig.mechanism["joints"][joint]
        nominal = data["bearing_radius"] - data["journal_radius"] if joint in rig.loose else 0.0
        return TrialSize(lambda size: {"clearance_m": nominal + size}, 1e-5 if nominal else 5e-5, 1.5e-3, 2e-6)

    return size


def _bending(rig: RigScales, rng: np.random.Generator, site: str) -> TrialSize:
    damping, softest = float(rng.uniform(0.005, 0.05)), 5 * rig.speed / (2 * math.pi)
    # Amplitudes are squares of periods, as in a fit. A rod above 2000 Hz shows in no channel.
    sizes = (1 / (2 * math.pi * frequency) ** 2 for frequency in (200.0, softest, 2000.0))
    return TrialSize(
        lambda size: {"frequency_Hz": 1 / (2 * math.pi * math.sqrt(size)), "damping_ratio": damping}, *sizes
    )


def _film(rig: RigScales, rng: np.random.Generator, site: str) -> TrialSize | None:
    if site not in rig.loose:
        return None
    length = 2 * rig.mechanism["joints"][site]["journal_radius"]
    return TrialSize(lambda viscosity: {"viscosity_Pa_s": viscosity, "length_m": length}, 0.1, 1.0, 0.03)


_SIZES: dict[str, Callable[[RigScales, np.random.Generator, str], TrialSize | None]] = {
    "gravity": lambda rig, rng, site: TrialSize.of("acceleration_m_s2", 5.0, 15.0),
    "slider_coulomb_friction": lambda rig, rng, site: TrialSize.of("force_N", 0.05 * rig.force),
    "slider_viscous_friction": lambda rig, rng, site: TrialSize.of("damping_N_s_m", 0.05 * rig.force / rig.velocity),
    "slider_quadratic_drag": lambda rig, rng, site: TrialSize.of("drag_N_s2_m2", 0.05 * rig.force / rig.velocity**2),
    "slider_load_friction": lambda rig, rng, site: TrialSize.of("coefficient", 0.1, 1.0),
    "slider_constant_force": lambda rig, rng, site: TrialSize.of(
        "force_N", 0.05 * rig.force, 10 * rig.force, _random_sign(rng)
    ),
    "slider_spring": _spring,
    "gas_pressure": _gas,
    "harmonic_force": _harmonic_force,
    "pin_friction": _pin_friction,
    "crank_coulomb_friction": lambda rig, rng, site: TrialSize.of("torque_N_m", 0.05 * rig.force * rig.stroke[1]),
    "crank_viscous_friction": lambda rig, rng, site: TrialSize.of(
        "damping_N_m_s", 0.05 * rig.force * rig.stroke[1] / rig.speed
    ),
    "crank_unbalance": _unbalance,
    "added_slider_mass": lambda rig, rng, site: TrialSize.of("mass_kg", 0.03, 3.0),
    "speed_fluctuation": _speed_fluctuation,
    "slider_offset": lambda rig, rng, site: TrialSize.of("offset_m", 1e-3, 0.1, _random_sign(rng)),
    "link_length_error": _link_length,
    "crank_pivot_clearance": _clearance("crank_pivot"),
    "crank_pin_clearance": _clearance("crank_pin"),
    "piston_pin_clearance": _clearance("piston_pin"),
    "rod_flexibility": _bending,
    "lubricated_joint": _film,
}
"""How large an effect of the list is at first and at most, by name in the order of the catalogue; None where it cannot
act."""


def _effect(name: str, site: str) -> DrawEffect:
    def make(rig: RigScales, rng: np.random.Generator) -> InjectedEffect | None:
        size = _SIZES[name](rig, rng, site)
        return None if size is None else InjectedEffect(name, site or EFFECTS[name].SITE, *size)

    return make


def _fault(fault: SensorFault) -> DrawEffect:
    def make(rig: RigScales, rng: np.random.Generator) -> InjectedEffect:
        encoder = fault.name == ENCODER_OFFSET
        channel = "crank_angle" if encoder else str(rng.choice(rig.channels))
        sign = _random_sign(rng)
        if fault.bounds(Reading(1.0, "1", rig.speed))[1] >= 0.0:
            sign = 1.0
        size = TrialSize.of(fault.parameter, *fault.trial(rig, channel), sign)
        return InjectedEffect(fault.name, "sensor" if encoder else channel, *size, sensor=channel)

    return make


LISTED: dict[str, DrawEffect] = {
    **{
        f"{name}:{site}" if site else name: _effect(name, site)
        for name in _SIZES
        for site in EFFECTS[name].sites() or ("",)
    },
    **{fault.name: _fault(fault) for fault in FAULTS.values() if fault.trial},
}
"""Effects of the list by name, with the site where there is a choice."""

DRAWN_APART = (SENSOR_DELAY,)
"""Effects of the list that came after sets were published; others are drawn without them."""

_FORCE, _TORQUE = "discovered_slider_force", "discovered_crank_torque"

# Kind, formula and first size of laws that are not on the list.
_UNLISTED_LAWS: dict[str, tuple[str, Callable[[RigScales, np.random.Generator], str], Callable[[RigScales], float]]] = {
    "stribeck_friction": (
        _FORCE,
        lambda rig, rng: f"-s*tanh(v/0.01)*exp(-|v|/{0.1 * rig.velocity:.6g})",
        lambda rig: 0.2 * rig.force,
    ),
    "fifth_power_drag": (
        _FORCE,
        lambda rig, rng: f"-s*v*|v|^4/{rig.velocity**5:.6g}",
        lambda rig: 0.1 * rig.force,
    ),
    "friction_by_position": (
        _FORCE,
        lambda rig, rng: f"-s*tanh(v/0.01)*(1+cos({3 / rig.stroke[1]:.6g}*(x-{rig.stroke[0]:.6g})))/2",
        lambda rig: 0.1 * rig.force,
    ),
    "end_stop": (
        _FORCE,
        lambda rig, rng: (lambda x: f"-s*(x-{x:.6g}+|x-{x:.6g}|)/2")(rig.stroke[0] + 0.6 * rig.stroke[1]),
        lambda rig: 0.5 * rig.force / rig.stroke[1],
    ),
    "cubic_spring": (
        _FORCE,
        lambda rig, rng: f"-s*(x-{rig.stroke[0]:.6g})^3",
        lambda rig: 0.1 * rig.force / rig.stroke[1] ** 3,
    ),
    "crank_friction_by_angle": (
        _TORQUE,
        lambda rig, rng: f"-s*(1+sin(theta-{rng.uniform(0, 6):.4g}))^2/4",
        lambda rig: 0.1 * rig.force * rig.stroke[1],
    ),
}

# First and largest size of sensor faults that are not on the list, and whether they are shares of the channel's spread.
_UNLISTED_FAULTS = {
    "drift": (0.1, 5.0, True),
    "quantisation": (0.1, 2.0, True),
    "saturation": (0.05, 0.9, False),
    "cubic_sensor": (0.02, 0.5, False),
}


def _unlisted_law(name: str) -> DrawEffect:
    kind, text, first = _UNLISTED_LAWS[name]
    site = "slider" if kind == _FORCE else "crank"

    def make(rig: RigScales, rng: np.random.Generator) -> InjectedEffect:
        size, law = first(rig), (kind, text(rig, rng))
        return InjectedEffect(name, site, lambda s: {"s": s}, size, LARGEST_SIZE * size, listed=False, formula=law)

    return make


def _unlisted_fault(name: str) -> DrawEffect:
    first, most, of_spread = _UNLISTED_FAULTS[name]

    def make(rig: RigScales, rng: np.random.Generator) -> InjectedEffect:
        channel = str(rng.choice(rig.channels))
        unit = rig.spread[channel] if of_spread else 1.0
        return InjectedEffect(
            name, channel, lambda size: {name: size * unit}, first, most, listed=False, sensor=channel
        )

    return make


def _torque_ripple(rig: RigScales, rng: np.random.Generator) -> InjectedEffect:
    """A periodic torque: drawn among the effects off the list since sets were made when it was one of them."""
    order, phase = int(rng.integers(3, 7)), -float(rng.uniform(0, 6))
    page = EFFECTS["crank_periodic_torque"]
    size = TrialSize.of("torque_N_m", 0.1 * rig.force * rig.stroke[1], order=order, phase_rad=phase)
    return InjectedEffect(page.NAME, page.SITE, *size)


SHAPES: dict[tuple[str, str], float] = {
    **{(law.NAME, name): shape for law in EFFECTS.values() for name, shape in law.MEMBERS.items()},
    ("slider_power_drag", "fifth_power_drag"): 5.0,
    ("slider_nonlinear_spring", "cubic_spring"): 1.0,
    ("slider_stribeck_friction", "stribeck_friction"): 1.0,
    ("slider_position_friction", "friction_by_position"): 1.0,  # but for its period, which is 4.7 % longer
    **{(LAG_AND_DELAY, name): share for name, share in DELAY_SHARES.items()},
}
"""The shape [1] at which the law of a family is an effect, by the law and the effect."""

_FORCES, _TORQUES = ([name for name, law in _UNLISTED_LAWS.items() if law[0] == kind] for kind in (_FORCE, _TORQUE))

# The order decides what a seed draws.
OFF_LIST: dict[str, DrawEffect] = {
    **{name: _unlisted_law(name) for name in _FORCES},
    "torque_ripple": _torque_ripple,
    **{name: _unlisted_law(name) for name in _TORQUES},
    **{name: _unlisted_fault(name) for name in _UNLISTED_FAULTS},
}
"""Effects that are not on the list, likewise: force laws, torques, and sensors that err in other ways."""
