"""Weight, deviations of masses and lengths, and bending of the rod."""

import math
from typing import Any

from jointgap.core.candidates import Parameter
from jointgap.effects import base
from jointgap.effects.base import (
    DETECTABLE_SHARE,
    DataEffect,
    Effect,
    amplitude,
    parameter,
    register_effect,
)

# Bending in the mode sin(pi s / l) of a uniform beam of mass m reduces the moment of inertia of a
# rod whose mass centre is b from midspan by m b^2 times this: 2 k^2 / (1 - 2 k^2) with the mode's
# mean k = 2 / pi
_BENDING_COUPLING = 8 / (math.pi**2 - 8)

# Least remaining share of rod.inertia: with a farther mass centre the rod is no uniform beam
_LEAST_INERTIA_SHARE = 0.5

# 1 / (2 pi nu)^2 [s^2] of a natural frequency of 3 kHz: a stiffer rod deflects quasi-statically
_LEAST_COMPLIANCE = 2.8e-9

# Natural frequencies over the crank speed at which fits start
_BENDING_ORDERS = (60.0, 25.0, 10.0)


@register_effect(order=10)
class Gravity(Effect):
    """Weight of all bodies along the mechanism's gravity_direction."""

    GROUP, SITE = "bodies", "all bodies"
    LAW = "F = m g along gravity_direction, each body"
    REFERENCE = "3rd Conférence générale des poids et mesures (1901)"
    WORDS = "the weight of the bodies"
    OPTIONAL = True
    acceleration_m_s2 = parameter(
        "m/s^2",
        "g, gravitational acceleration",
        9.80665,
        default=9.80665,
        ge=0,
        le=15,
        step=lambda scale: 0.5,
    )


@register_effect(order=140)
class AddedSliderMass(DataEffect):
    """Deviation of the slider mass from nominal."""

    GROUP, SITE = "bodies", "slider"
    LAW = "slider.mass + m"
    WORDS = "a deviating slider mass"
    ADDS_TO = {"mass_kg": ("slider", "mass")}
    mass_kg = parameter("kg", "m, deviation from nominal", 0.05)

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        mass = context.mechanism.slider.mass
        deviation = amplitude("mass_kg", DETECTABLE_SHARE * mass, "kg", -0.95 * mass)
        yield cls.candidate(deviation, replaces=context.replaced({"slider_mass": "mass_kg"}))


@register_effect(order=160)
class SliderOffset(DataEffect):
    """Deviation of the slide's offset from nominal."""

    GROUP, SITE = "bodies", "guide"
    LAW = "slider.offset + b"
    WORDS = "an offset of the slide"
    ADDS_TO = {"offset_m": ("slider", "offset")}
    offset_m = parameter("m", "b, deviation from nominal", 0.01, odd=True)

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        crank, rod = context.mechanism.crank.length, context.mechanism.rod.length
        replaces = context.replaced({"slider_offset": "offset_m"})
        yield cls.candidate(amplitude("offset_m", 0.01 * crank, "m", -rod, rod), replaces=replaces)


@register_effect(order=170)
class LinkLengthError(DataEffect):
    """Deviations of crank and rod length; mass centres scale with the lengths, masses and inertias
    do not change."""

    GROUP, SITE = "bodies", "crank, rod"
    LAW = "crank.length + a, rod.length + b"
    WORDS = "deviating lengths of crank and rod"
    ADDS_TO = {"crank_m": ("crank", "length"), "rod_m": ("rod", "length")}
    crank_m = parameter("m", "a, deviation of the crank length", 0.0005, default=0.0)
    rod_m = parameter("m", "b, deviation of the rod length", -0.001, default=0.0)

    def apply(self, data: dict[str, Any]) -> None:
        for key, (body, _) in self.ADDS_TO.items():
            link, error = data[body], getattr(self.parameters, key)
            link["mass_centre"] *= (link["length"] + error) / link["length"]
            link["length"] += error

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        crank, rod = context.mechanism.crank.length, context.mechanism.rod.length
        lengths = (("crank_m", crank), ("rod_m", rod))
        replaces = context.replaced({"crank_length": "crank_m", "rod_length": "rod_m"})
        yield cls.candidate(
            *(amplitude(key, 2e-3 * length, "m", -0.5 * length) for key, length in lengths),
            replaces=replaces,
        )


@register_effect(order=210)
class RodFlexibility(Effect):
    """Bending of the rod, excited by the inertia of its own mass; requires a mass centre near the
    middle."""

    GROUP, SITE = "bodies", "rod"
    LAW = (
        "q'' + 2 zeta (2 pi nu) q' + (2 pi nu)^2 q = inertia, deflection q sin(pi s / l): first"
        " mode of the pinned-pinned uniform beam with the rod's mass"
    )
    REFERENCE = "Meirovitch, Fundamentals of vibrations (2001)"
    WORDS = "bending of the rod"
    frequency_Hz = parameter("Hz", "nu, natural frequency of the mode", 250.0, gt=0)
    damping_ratio = parameter("", "zeta, damping over critical damping", 0.01, ge=0, lt=1)

    def check(self, mechanism: Any) -> None:
        rod, least = mechanism.rod, _LEAST_INERTIA_SHARE
        off_centre = rod.mass_centre - rod.length / 2
        remaining = rod.inertia - _BENDING_COUPLING * rod.mass * off_centre**2
        if remaining < least * rod.inertia:
            farthest = math.sqrt((1 - least) * rod.inertia / (_BENDING_COUPLING * rod.mass))
            raise ValueError(
                "effects: rod_flexibility models a uniform beam; with rod.mass_centre"
                f" {rod.mass_centre:g} m bending reduces rod.inertia from {rod.inertia:g} to"
                f" {remaining:.3g} kg m^2; put the mass centre within {farthest:.3g} m of"
                f" {rod.length / 2:g} m, or remove the effect"
            )

    def compile_into(self, records: base.Records) -> None:
        frequency, damping = self.parameters.frequency_Hz, self.parameters.damping_ratio
        records["bodies"]["bending"] = 2 * math.pi * frequency, damping

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        turning, damping = context.scale.turning, {"damping_ratio": 0.02}
        compliances = [(order * turning) ** -2.0 for order in _BENDING_ORDERS]

        def parameters(values: base.Values) -> dict[str, float]:
            frequency = 1.0 / (2.0 * math.pi * math.sqrt(max(values["compliance_s2"], 1e-300)))
            return {"frequency_Hz": frequency, "damping_ratio": values["damping_ratio"]}

        # squared period instead of frequency: for a stiff rod the deflection is proportional to it
        step, largest = 0.1 * (1.0 / (30.0 * turning) ** 2), 0.1 / turning**2
        yield cls.candidate(
            amplitude("compliance_s2", step, "s^2", 0.0, largest),
            Parameter("damping_ratio", 0.02, 0.0, 0.9, 0.01),
            amplitudes=("compliance_s2",),
            initial_guesses=(
                damping,
                *({**damping, "compliance_s2": compliance} for compliance in compliances),
            ),
            parameters=parameters,
        )

    @classmethod
    def simulated(cls, values: base.Values) -> tuple[base.Values, float]:
        compliance = values["compliance_s2"]
        if not 0.0 < compliance < _LEAST_COMPLIANCE:
            return values, 1.0
        return {**values, "compliance_s2": _LEAST_COMPLIANCE}, compliance / _LEAST_COMPLIANCE
