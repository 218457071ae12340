"""Weight, deviations of masses and lengths, and bending of the rod."""

import math
import string
from itertools import cycle
from typing import Any

from jointgap.core.candidates import Parameter
from jointgap.core.sites import Sites
from jointgap.effects import base
from jointgap.effects.base import (
    DETECTABLE_SHARE,
    DataEffect,
    Effect,
    EffectParameter,
    amplitude,
    body_data,
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

    ON, GROUP, SITE = "mechanism", "bodies", "all bodies"
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
class AddedMass(DataEffect):
    """Deviation of the {site} mass from nominal."""

    ON, GROUP, RULE = "body", "bodies", "added_{site}_mass"
    OF_SLIDER_CRANK = ("slider",)
    LAW = "{site}.mass + m"
    WORDS = "a deviating {site} mass"
    ADDS_TO = {"mass_kg": ("{site}", "mass")}
    mass_kg = parameter("kg", "m, deviation from nominal", 0.05)

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        mass = context.mechanism.body(cls.BODY).mass
        deviation = amplitude("mass_kg", DETECTABLE_SHARE * mass, "kg", -0.95 * mass)
        yield cls.candidate(deviation, replaces=context.replaced({f"{cls.BODY}_mass": "mass_kg"}))


@register_effect(order=160)
class Offset(DataEffect):
    """Deviation of the slide's offset from nominal."""

    ON, GROUP, SITE = "slide", "bodies", "{joint}"
    LAW = "{site}.offset + b"
    WORDS = "an offset of the slide"
    offset_m = parameter("m", "b, deviation from nominal", 0.01, odd=True)

    def apply(self, data: dict[str, Any]) -> None:
        if "bodies" not in data:
            data[self.BODY]["offset"] += self.parameters.offset_m
            return
        slide, moved = data["joints"][self.SITE], self.parameters.offset_m
        (x, y), direction = slide["at"] or (0.0, 0.0), slide["direction"] or 0.0
        slide["at"] = x - moved * math.sin(direction), y + moved * math.cos(direction)

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        step, farthest = 0.01 * context.scale.stroke, max(_lengths(context.mechanism).values())
        replaces = context.replaced({f"{cls.BODY}_offset": "offset_m"})
        yield cls.candidate(
            amplitude("offset_m", step, "m", -farthest, farthest), replaces=replaces
        )


def _lengths(mechanism: Any) -> dict[str, float]:
    """Lengths [m] of the links."""
    return {link: mechanism.body(link).length for link in mechanism.sites.links}


@register_effect(order=170)
class LinkLengthError(DataEffect):
    """Deviations of the lengths of {links}; mass centres scale with the lengths, masses and
    inertias do not change."""

    ON, GROUP, SITE = "mechanism", "bodies", "{links}"
    LAW = "{lengths}"
    WORDS = "deviating lengths of {links}"

    @classmethod
    def described_at(cls, sites: Sites) -> dict[str, EffectParameter]:
        return {
            f"{link}_m": parameter(
                "m",
                f"{letter}, deviation of the {link.replace('_', ' ')} length",
                example,
                default=0.0,
            )
            for link, letter, example in zip(
                sites.links, string.ascii_lowercase, cycle((5e-4, -1e-3)), strict=False
            )
        }

    @classmethod
    def adds_to_at(cls, site: str, sites: Sites) -> dict[str, tuple[str, str]]:
        return {f"{link}_m": (link, "length") for link in sites.links}

    def apply(self, data: dict[str, Any]) -> None:
        for key, (body, _) in self.ADDS_TO.items():
            link, error = body_data(data, body), getattr(self.parameters, key)
            factor, centre = (link["length"] + error) / link["length"], link["mass_centre"]
            link["mass_centre"] = (
                (factor * centre[0], centre[1])
                if isinstance(centre, list | tuple)
                else factor * centre
            )
            link["length"] += error

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        lengths = {f"{link}_m": length for link, length in _lengths(context.mechanism).items()}
        if not lengths:
            return
        replaces = {f"{key.removesuffix('_m')}_length": key for key in lengths}
        yield cls.candidate(
            *(amplitude(key, 2e-3 * length, "m", -0.5 * length) for key, length in lengths.items()),
            replaces=context.replaced(replaces),
        )


@register_effect(order=210)
class RodFlexibility(Effect):
    """Bending of the rod, excited by the inertia of its own mass; requires a mass centre near the
    middle."""

    ON, GROUP, SITE, ANY_LINKAGE = "mechanism", "bodies", "rod", False
    LAW = (
        "q'' + 2 zeta (2 pi nu) q' + (2 pi nu)^2 q = inertia, deflection q sin(pi s / l): first"
        " mode of the pinned-pinned uniform beam with the rod's mass"
    )
    REFERENCE = "Meirovitch, Fundamentals of vibrations (2001)"
    WORDS = "bending of the rod"
    frequency_Hz = parameter("Hz", "nu, natural frequency of the mode", 250.0, gt=0)
    damping_ratio = parameter("", "zeta, damping over critical damping", 0.01, ge=0, lt=1)

    def check(self, mechanism: Any) -> None:
        rod, least = mechanism.body("rod"), _LEAST_INERTIA_SHARE
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
