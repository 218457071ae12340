"""A torque on the crank in step with its angle."""

import math

from jointgap.effects.base import (
    Candidates,
    Effect,
    FitContext,
    Records,
    amplitude,
    from_cosine_and_sine,
    order_of_crank,
    page,
    parameter,
    stated_order,
)
from jointgap.effects.crank_coulomb_friction import CrankCoulombFriction

LOWEST_FITTED_ORDER, HIGHEST_FITTED_ORDER = 3, 24
"""Whole orders [cycles per revolution] that a fit tries. Masses, weight and steady forces on the slider make torques of
orders one and two: there the usual causes are offered, not a torque by itself. Poles, slots and teeth of drives lie
below the highest one, and few encoders resolve more."""

_USUAL_ORDERS = (3, 4, 6, 8, 12)
"""Orders [1] that a preflight tries, before there is a residual in which to look for them."""


@page(order=127)
class CrankPeriodicTorque(Effect):
    """A torque locked to the crank's angle, as cogging, teeth of a gear or poles of a motor make it.

    At a constant speed the drive has to make up for it, so that it stands in the crank's torque and nowhere else.
    """

    GROUP = "crank"
    SITE = "crank_pivot"
    LAW = "M = a cos(k theta - phase)"
    REFERENCE = "definition"
    WORDS = "a periodic torque on the crank"
    COMPILED = {"crank_periodic": "torque_N_m", "crank_periodic_phase": "phase_rad"}
    PARAMETERS = {
        "torque_N_m": parameter("N*m", "a, amplitude", 0.2, ge=0),
        "order": parameter("", "k, cycles per revolution", 12, ge=0.5, le=100, multiple_of=0.5),
        "phase_rad": parameter("rad", "angle k theta of the largest torque", 0.5, default=0.0),
    }

    def compile_into(self, records: Records) -> None:
        super().compile_into(records)
        records["effects"]["crank_periodic_order"] = float(self.parameters.order)

    def mirrored(self) -> Effect:
        # theta' = -theta and M' = -M: -a cos(-k theta' - phase) = a cos(k theta' - (pi - phase))
        return self.with_parameters(phase_rad=math.pi - self.parameters.phase_rad)

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        step = context.scale.force * context.scale.stroke
        yield cls.candidate(
            amplitude("cosine", step, "N*m"),
            amplitude("sine", step, "N*m"),
            order_of_crank(range(LOWEST_FITTED_ORDER, HIGHEST_FITTED_ORDER + 1), context.runs),
            amplitudes=("cosine", "sine"),
            initial_guesses=tuple({"order": float(order)} for order in _USUAL_ORDERS),
            parameters=lambda values: (
                from_cosine_and_sine("torque_N_m", "phase_rad", values) | {"order": stated_order(values["order"])}
            ),
            steady_counterpart=CrankCoulombFriction.NAME,
        )
