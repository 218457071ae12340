"""Effects that a blind trial can hide: how large at first, how large at most, and what a mechanism file says of them.

One number is the size, zero where the effect is absent; what else an effect has (a rest position, a frequency, a phase) is
drawn once and stays.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from jointgap.effects import EFFECTS, Effect
from jointgap.effects.base import LARGEST_SIZE, TrialContext, TrialSize, random_sign
from jointgap.slider_crank.sensor_faults import ENCODER_OFFSET, FAULTS, SensorFault

Parameters = dict[str, float]


@dataclass(frozen=True)
class Rig:
    """What the sizes of effects go by: a mechanism file's content, its largest speed [rad/s], loose joints, channels."""

    mechanism: Mapping
    speed: float
    loose: tuple[str, ...]
    channels: tuple[str, ...]
    spread: Mapping[str, float]  # typical standard deviation of each channel, SI

    @property
    def force(self) -> float:
        """The slider's largest force of inertia [N], about."""
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
class Hidden:
    """One effect that acts.

    Attributes
    ----------
    name, site : str
        As a verdict states them; of one that is on nobody's list, its own name.
    parameters : function
        From the size to the parameters that a verdict states.
    first, most, least : float
        Size to begin with, largest and smallest size.
    listed : bool
        Whether the analyst knows it.
    sensor : str
        Channel of a sensor's fault, else empty.
    formula : tuple of (kind, text), optional
        ``discovered_slider_force`` or ``discovered_crank_torque`` and the formula in which s is the size, of a law on nobody's list.
    """

    name: str
    site: str
    parameters: Callable[[float], Parameters]
    first: float
    most: float
    least: float = 0.0
    listed: bool = True
    sensor: str = ""
    formula: tuple[str, str] | None = None

    def in_file(self, size: float) -> list[dict]:
        """Entries of a mechanism file's effects; none for a sensor's fault."""
        if self.sensor:
            return []
        if self.formula:
            kind, text = self.formula
            return [{"name": kind, "parameters": {"formula": text, "coefficients": {"s": size}}}]
        choice = {"site": self.site} if EFFECTS[self.name].sites() else {}
        return [{"name": self.name, **choice, "parameters": self.parameters(size)}]


Make = Callable[[Rig, np.random.Generator], Hidden | None]


def _effect(page: type[Effect], site: str) -> Make:
    def make(rig: Rig, rng: np.random.Generator) -> Hidden | None:
        size = page.trial(TrialContext(rig, rng, site))
        return None if size is None else Hidden(page.NAME, site or page.SITE, *size)

    return make


def _fault(fault: SensorFault) -> Make:
    def make(rig: Rig, rng: np.random.Generator) -> Hidden:
        encoder = fault.name == ENCODER_OFFSET
        channel = "crank_angle" if encoder else str(rng.choice(rig.channels))
        sign = random_sign(rng) if fault.either_sign else max(random_sign(rng), 1.0)
        size = TrialSize.of(fault.parameter, *fault.trial(rig, channel), sign)
        return Hidden(fault.name, "sensor" if encoder else channel, *size, sensor=channel)

    return make


LISTED: dict[str, Make] = {
    **{
        f"{page.NAME}:{site}" if site else page.NAME: _effect(page, site)
        for page in EFFECTS.values()
        if page.trial.__func__ is not Effect.trial.__func__
        for site in page.sites() or ("",)
    },
    **{fault.name: _fault(fault) for fault in FAULTS.values()},
}
"""Effects of the list by name, with the site where there is a choice: functions of the rig, None where they cannot act."""


def _law(
    name: str, kind: str, text: Callable[[Rig, np.random.Generator], str], first: Callable[[Rig], float]
) -> Callable:
    site = "slider" if kind == "discovered_slider_force" else "crank"

    def make(rig: Rig, rng) -> Hidden:
        formula = text(rig, rng)
        return Hidden(
            name,
            site,
            lambda size: {"s": size},
            first(rig),
            LARGEST_SIZE * first(rig),
            listed=False,
            formula=(kind, formula),
        )

    return make


def _odd_fault(name: str, first: float, most: float, relative: Callable[[Rig, str], float]) -> Callable:
    def make(rig: Rig, rng) -> Hidden:
        channel = str(rng.choice(rig.channels))
        unit = relative(rig, channel)
        return Hidden(
            name, channel, lambda size: {name: size * unit}, first, most, listed=False, sensor=channel
        )  # fmt: skip

    return make


_FORCE, _TORQUE = "discovered_slider_force", "discovered_crank_torque"

OFF_LIST: dict[str, Callable[[Rig, np.random.Generator], Hidden | None]] = {
    "stribeck_friction": _law(
        "stribeck_friction", _FORCE,
        lambda rig, rng: f"-s*tanh(v/0.01)*exp(-|v|/{0.1 * rig.velocity:.6g})", lambda rig: 0.2 * rig.force,
    ),
    "fifth_power_drag": _law(
        "fifth_power_drag", _FORCE, lambda rig, rng: f"-s*v*|v|^4/{rig.velocity**5:.6g}", lambda rig: 0.1 * rig.force
    ),
    "friction_by_position": _law(
        "friction_by_position", _FORCE,
        lambda rig, rng: f"-s*tanh(v/0.01)*(1+cos({3 / rig.stroke[1]:.6g}*(x-{rig.stroke[0]:.6g})))/2",
        lambda rig: 0.1 * rig.force,
    ),
    "end_stop": _law(
        "end_stop", _FORCE,
        lambda rig, rng: (lambda x: f"-s*(x-{x:.6g}+|x-{x:.6g}|)/2")(rig.stroke[0] + 0.6 * rig.stroke[1]),
        lambda rig: 0.5 * rig.force / rig.stroke[1],
    ),
    "cubic_spring": _law(
        "cubic_spring", _FORCE, lambda rig, rng: f"-s*(x-{rig.stroke[0]:.6g})^3", lambda rig: 0.1 * rig.force / rig.stroke[1] ** 3
    ),
    "torque_ripple": _law(
        "torque_ripple", _TORQUE,
        lambda rig, rng: f"s*cos({int(rng.integers(3, 7))}*theta+{rng.uniform(0, 6):.4g})",
        lambda rig: 0.1 * rig.force * rig.stroke[1],
    ),
    "crank_friction_by_angle": _law(
        "crank_friction_by_angle", _TORQUE, lambda rig, rng: f"-s*(1+sin(theta-{rng.uniform(0, 6):.4g}))^2/4",
        lambda rig: 0.1 * rig.force * rig.stroke[1],
    ),
    "drift": _odd_fault("drift", 0.1, 5.0, lambda rig, channel: rig.spread[channel]),
    "quantisation": _odd_fault("quantisation", 0.1, 2.0, lambda rig, channel: rig.spread[channel]),
    "saturation": _odd_fault("saturation", 0.05, 0.9, lambda rig, channel: 1.0),
    "cubic_sensor": _odd_fault("cubic_sensor", 0.02, 0.5, lambda rig, channel: 1.0),
}  # fmt: skip
"""Effects on nobody's list, likewise: force laws, torques, and sensors that err in other ways."""
