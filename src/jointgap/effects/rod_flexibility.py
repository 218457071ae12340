"""Bending of the rod."""

import math
from typing import Any

from jointgap.core.candidates import Parameter
from jointgap.effects.base import (
    Candidates,
    Effect,
    FitContext,
    Records,
    TrialContext,
    TrialSize,
    Values,
    amplitude,
    page,
    parameter,
)

BENDING_COUPLING = 8 / (math.pi**2 - 8)
"""The mode sin(pi s / l) of a uniform beam of mass m takes the moment of inertia m b^2 times this from a rod that turns
about its mass centre at the distance b from midspan: 2 k^2 / (1 - 2 k^2) with the mode's mean k = 2 / pi.
"""

LEAST_INERTIA_SHARE = 0.5
"""Share of rod.inertia that bending has to leave: a rod whose mass centre is farther off is no uniform beam."""

LEAST_COMPLIANCE = 2.8e-9
"""1 / (2 pi nu)^2 [s^2] of a rod that bends at 3 kHz: one that is stiffer follows its load as a spring does."""

_BENDING_ORDERS = (60.0, 25.0, 10.0)
"""Natural frequencies over the crank's speed from which fits start."""


@page(order=210)
class RodFlexibility(Effect):
    """The rod bends across its axis; excited by the inertia of its own mass. Its mass centre is near the middle."""

    GROUP = "bodies"
    SITE = "rod"
    LAW = (
        "q'' + 2 zeta (2 pi nu) q' + (2 pi nu)^2 q = inertia, deflection q sin(pi s / l): first mode of the "
        "pinned-pinned uniform beam with the rod's mass"
    )
    REFERENCE = "Meirovitch, Fundamentals of vibrations (2001)"
    WORDS = "bending of the rod"
    PARAMETERS = {
        "frequency_Hz": parameter("Hz", "nu, natural frequency of the mode", 250.0, gt=0),
        "damping_ratio": parameter("", "zeta, damping over critical damping", 0.01, ge=0, lt=1),
    }

    def check(self, mechanism: Any) -> None:
        rod = mechanism.rod
        lost = BENDING_COUPLING * rod.mass * (rod.mass_centre - rod.length / 2) ** 2
        if lost > (1 - LEAST_INERTIA_SHARE) * rod.inertia:
            farthest = math.sqrt((1 - LEAST_INERTIA_SHARE) * rod.inertia / (BENDING_COUPLING * rod.mass))
            raise ValueError(
                f"effects: rod_flexibility is the law of a uniform beam, of which rod.mass_centre {rod.mass_centre:g} "
                "m "
                f"is too far from the middle: bending leaves {rod.inertia - lost:.3g} of rod.inertia {rod.inertia:g} "
                f"kg m^2, less than {LEAST_INERTIA_SHARE:g} of it; put the mass centre within {farthest:.3g} m of "
                f"{rod.length / 2:g} m, or leave the effect out"
            )

    def compile_into(self, records: Records) -> None:
        records["bodies"]["rod_angular_frequency"] = 2 * math.pi * self.parameters.frequency_Hz
        records["bodies"]["rod_damping_ratio"] = self.parameters.damping_ratio

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        turning = context.scale.turning
        compliances = [(order * turning) ** -2.0 for order in _BENDING_ORDERS]
        yield cls.candidate(
            # The square of the period in place of the frequency: near a rigid rod the deflection is proportional to it.
            amplitude("compliance_s2", 0.1 * (1.0 / (30.0 * turning) ** 2), "s^2", 0.0, 0.1 / turning**2),
            Parameter("damping_ratio", 0.02, 0.0, 0.9, 0.01),
            amplitudes=("compliance_s2",),
            initial_guesses=(
                {"damping_ratio": 0.02},
                *({"damping_ratio": 0.02, "compliance_s2": compliance} for compliance in compliances),
            ),
            parameters=lambda values: {
                "frequency_Hz": 1.0 / (2.0 * math.pi * math.sqrt(max(values["compliance_s2"], 1e-300))),
                "damping_ratio": values["damping_ratio"],
            },
        )

    @classmethod
    def simulated(cls, values: Values) -> tuple[Values, float]:
        compliance = values["compliance_s2"]
        if not 0.0 < compliance < LEAST_COMPLIANCE:
            return values, 1.0
        return {**values, "compliance_s2": LEAST_COMPLIANCE}, compliance / LEAST_COMPLIANCE

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize:
        damping = float(context.rng.uniform(0.005, 0.05))
        softest = 5 * context.rig.speed / (2 * math.pi)
        # Amplitudes are squares of periods, as in a fit. A rod above 2000 Hz shows in no channel.
        first, largest, smallest = (1 / (2 * math.pi * frequency) ** 2 for frequency in (200.0, softest, 2000.0))

        def parameters(size):
            return {"frequency_Hz": 1 / (2 * math.pi * math.sqrt(size)), "damping_ratio": damping}

        return TrialSize(parameters, first, largest, smallest)
