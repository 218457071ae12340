"""Effects that a blind trial can hide: how large at first, how large at most, and what a mechanism file says of them.

One number is the size, zero where the effect is absent; what else an effect has (a rest position, a frequency, a phase) is
drawn once and stays.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

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
        choice = {"site": self.site} if self.name in ("pin_friction", "lubricated_joint") else {}
        return [{"name": self.name, **choice, "parameters": self.parameters(size)}]


_MOST = 200.0
"""How many times the first size an effect may have that nothing else bounds."""


def one(name: str, site: str, key: str, first: float, most: float | None = None, **further: float) -> Hidden:
    """An effect whose size is its parameter `key`."""
    return Hidden(name, site, lambda size: {key: size, **further}, first, most or _MOST * first)


def _signed(rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _lengths(rig: Rig, rng) -> Hidden:
    which, sign = rng.choice(["crank_m", "rod_m"]), _signed(rng)
    return Hidden("link_length_error", "crank, rod", lambda size: {str(which): sign * size}, 1e-4, 0.02)


def _clearance(joint: str) -> Callable:
    def make(rig: Rig, rng) -> Hidden | None:
        data = rig.mechanism["joints"][joint]
        nominal = data["bearing_radius"] - data["journal_radius"] if joint in rig.loose else 0.0
        law = lambda size: {"clearance_m": nominal + size}  # noqa: E731
        return Hidden(f"{joint}_clearance", joint, law, 1e-5 if nominal else 5e-5, 1.5e-3, 2e-6)

    return make


def _pin_friction(joint: str) -> Callable:
    def make(rig: Rig, rng) -> Hidden:
        nominal = rig.mechanism["contacts"]["steel"]["friction"] if joint in rig.loose else 0.0
        return Hidden("pin_friction", joint, lambda size: {"coefficient": nominal + size}, 0.05, 0.6 - nominal)

    return make


def _film(joint: str) -> Callable:
    def make(rig: Rig, rng) -> Hidden | None:
        if joint not in rig.loose:
            return None
        length = 2 * rig.mechanism["joints"][joint]["journal_radius"]
        law = lambda size: {"viscosity_Pa_s": size, "length_m": length}  # noqa: E731
        return Hidden("lubricated_joint", joint, law, 0.1, 1.0, 0.03)

    return make


def _wave(rig: Rig, rng) -> Hidden:
    shape = {"order": int(rng.choice([1, 2, 3, 4])), "phase_rad": float(rng.uniform(-math.pi, math.pi))}
    return Hidden("speed_fluctuation", "drive", lambda size: {"ratio": size, **shape}, 0.005, 0.3)


def _harmonic(rig: Rig, rng) -> Hidden:
    turns = rig.speed / (2 * math.pi)
    shape = {
        "frequency_Hz": float(turns * rng.uniform(1.3, 6.0)),
        "phase_rad": float(rng.uniform(-math.pi, math.pi)),
    }
    return one("harmonic_force", "slider", "force_N", 0.05 * rig.force, **shape)


_STIFFEST = 2000.0
"""Largest natural frequency of a rod [Hz]; a stiffer one shows in no channel."""


def _bending(rig: Rig, rng) -> Hidden:
    damping = float(rng.uniform(0.005, 0.05))
    law = lambda size: {"frequency_Hz": 1 / (2 * math.pi * math.sqrt(size)), "damping_ratio": damping}  # noqa: E731
    softest = 5 * rig.speed / (2 * math.pi)
    first, most, least = (1 / (2 * math.pi * frequency) ** 2 for frequency in (200.0, softest, _STIFFEST))
    return Hidden("rod_flexibility", "rod", law, first, most, least)


def _fault(name: str, key: str, first: Callable[[Rig, str], float], most: float, lowest: float = -1.0) -> Callable:
    def make(rig: Rig, rng) -> Hidden:
        channel = str(rng.choice(rig.channels))
        sign = max(_signed(rng), lowest)
        law = lambda size: {key: sign * size}  # noqa: E731
        return Hidden(name, channel, law, first(rig, channel), most, sensor=channel)

    return make


def _encoder(rig: Rig, rng) -> Hidden:
    sign = _signed(rng)
    return Hidden(
        "encoder_offset", "sensor", lambda size: {"offset_rad": sign * size}, 0.005, 0.5, sensor="crank_angle"
    )


LISTED: dict[str, Callable[[Rig, np.random.Generator], Hidden | None]] = {
    "gravity": lambda rig, rng: one("gravity", "all", "acceleration_m_s2", 5.0, 15.0),
    "slider_coulomb_friction": lambda rig, rng: one("slider_coulomb_friction", "slider", "force_N", 0.05 * rig.force),
    "slider_viscous_friction": lambda rig, rng: one(
        "slider_viscous_friction", "slider", "damping_N_s_m", 0.05 * rig.force / rig.velocity
    ),
    "slider_quadratic_drag": lambda rig, rng: one(
        "slider_quadratic_drag", "slider", "drag_N_s2_m2", 0.05 * rig.force / rig.velocity**2
    ),
    "slider_load_friction": lambda rig, rng: one("slider_load_friction", "guide", "coefficient", 0.1, 1.0),
    "slider_constant_force": lambda rig, rng: (
        lambda sign: Hidden(
            "slider_constant_force", "slider", lambda size: {"force_N": sign * size}, 0.05 * rig.force, 10 * rig.force
        )
    )(_signed(rng)),
    "slider_spring": lambda rig, rng: one(
        "slider_spring", "slider", "stiffness_N_m", 0.05 * rig.force / rig.stroke[1],
        rest_position_m=float(rig.stroke[0] + rng.uniform(-0.7, 0.7) * rig.stroke[1]),
    ),
    "gas_pressure": lambda rig, rng: one(
        "gas_pressure", "slider", "force_N", 0.1 * rig.force,
        dead_length_m=float(rig.stroke[1] * rng.uniform(0.2, 0.8)), exponent=float(rng.uniform(1.0, 1.4)),
    ),
    "harmonic_force": _harmonic,
    "pin_friction:crank_pin": _pin_friction("crank_pin"),
    "pin_friction:piston_pin": _pin_friction("piston_pin"),
    "crank_coulomb_friction": lambda rig, rng: one(
        "crank_coulomb_friction", "crank_pivot", "torque_N_m", 0.05 * rig.force * rig.stroke[1]
    ),
    "crank_viscous_friction": lambda rig, rng: one(
        "crank_viscous_friction", "crank_pivot", "damping_N_m_s", 0.05 * rig.force * rig.stroke[1] / rig.speed
    ),
    "crank_unbalance": lambda rig, rng: one(
        "crank_unbalance", "crank", "unbalance_kg_m", 0.1 * rig.force / rig.speed**2, 1.0,
        angle_rad=float(rng.uniform(-math.pi, math.pi)),
    ),
    "added_slider_mass": lambda rig, rng: one("added_slider_mass", "slider", "mass_kg", 0.03, 3.0),
    "speed_fluctuation": _wave,
    "slider_offset": lambda rig, rng: (
        lambda sign: Hidden("slider_offset", "guide", lambda size: {"offset_m": sign * size}, 1e-3, 0.1)
    )(_signed(rng)),
    "link_length_error": _lengths,
    "crank_pivot_clearance": _clearance("crank_pivot"),
    "crank_pin_clearance": _clearance("crank_pin"),
    "piston_pin_clearance": _clearance("piston_pin"),
    "rod_flexibility": _bending,
    "lubricated_joint:crank_pin": _film("crank_pin"),
    "lubricated_joint:piston_pin": _film("piston_pin"),
    "encoder_offset": _encoder,
    "sensor_bias": _fault("sensor_bias", "bias", lambda rig, channel: 0.1 * rig.spread[channel], math.inf),
    "sensor_gain": _fault("sensor_gain", "gain_error", lambda rig, channel: 0.05, 1.0),
    "sensor_lag": _fault("sensor_lag", "lag_s", lambda rig, channel: 0.02 / rig.speed, 0.02, lowest=1.0),
}  # fmt: skip
"""Effects of the list by name, with the site where there is a choice: functions of the rig, None where they cannot act."""


def _law(
    name: str, kind: str, text: Callable[[Rig, np.random.Generator], str], first: Callable[[Rig], float]
) -> Callable:
    site = "slider" if kind == "discovered_slider_force" else "crank"

    def make(rig: Rig, rng) -> Hidden:
        formula = text(rig, rng)
        return Hidden(
            name, site, lambda size: {"s": size}, first(rig), _MOST * first(rig), listed=False, formula=(kind, formula)
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
