"""Effects that a trial can inject: how large at first, how large at most, and their entries in a mechanism file.

One number is the size, zero where the effect is absent; further parameters (a rest position, a frequency, a phase) are
drawn once and stay.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from jointgap.effects import EFFECTS
from jointgap.effects.base import LARGEST_SIZE, Effect, TrialContext, TrialSize, random_sign
from jointgap.rig.sensors import DELAY_SHARES, ENCODER_OFFSET, FAULTS, LAG_AND_DELAY, SENSOR_DELAY, SensorFault

Parameters = dict[str, float]


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


def _effect(page: type[Effect], site: str) -> DrawEffect:
    def make(rig: RigScales, rng: np.random.Generator) -> InjectedEffect | None:
        size = page.trial(TrialContext(rig, rng, site))
        return None if size is None else InjectedEffect(page.NAME, site or page.SITE, *size)

    return make


def _fault(fault: SensorFault) -> DrawEffect:
    def make(rig: RigScales, rng: np.random.Generator) -> InjectedEffect:
        encoder = fault.name == ENCODER_OFFSET
        channel = "crank_angle" if encoder else str(rng.choice(rig.channels))
        sign = random_sign(rng) if fault.either_sign else max(random_sign(rng), 1.0)
        size = TrialSize.of(fault.parameter, *fault.trial(rig, channel), sign)
        return InjectedEffect(fault.name, "sensor" if encoder else channel, *size, sensor=channel)

    return make


LISTED: dict[str, DrawEffect] = {
    **{
        f"{page.NAME}:{site}" if site else page.NAME: _effect(page, site)
        for page in EFFECTS.values()
        if page.trial.__func__ is not Effect.trial.__func__
        for site in page.sites() or ("",)
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
