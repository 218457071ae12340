"""Torques on the crank, its unbalance, and speed fluctuation of the drive."""

import math
from collections.abc import Sequence
from typing import Any

from jointgap.core.candidates import Candidate, LawFamily, Parameter
from jointgap.effects import base
from jointgap.effects.base import (
    CRANK_SIGN,
    FRICTION_SURVEY,
    DiscoveredLaw,
    Effect,
    parameter,
    register_effect,
)

# Angles [rad] of largest friction at which fits start
_TIGHTEST = (0.0, -2.0 * math.pi / 3.0, 2.0 * math.pi / 3.0)

# Integer orders [cycles per revolution] of a fitted torque. Orders one and two are those of masses,
# weight and slider forces, which are candidates themselves. Poles, slots and teeth of drives are
# below the highest
_FITTED_ORDERS = range(3, 25)

# Orders [1] of a preflight, which has no residual
_USUAL_ORDERS = (3, 4, 6, 8, 12)


def _torque(scale: base.MotionScale) -> float:
    return scale.force * scale.stroke


def _damping(scale: base.MotionScale) -> float:
    return scale.force * scale.stroke / scale.turning


def _unbalance(scale: base.MotionScale) -> float:
    return scale.force / scale.turning**2


class CrankEffect(Effect):
    """A counter-clockwise torque on the crank."""

    GROUP, SITE = "crank", "crank_pivot"


@register_effect(order=110)
class CrankCoulombFriction(CrankEffect):
    """Dry friction of the crank's bearings and seals, independent of load."""

    LAW = f"M = -m sgn w, {CRANK_SIGN}"
    REFERENCE = FRICTION_SURVEY
    WORDS = "Coulomb friction of the crank"
    torque_N_m = parameter(
        "N*m", "m, friction torque", 0.3, ge=0, compiled="crank_coulomb", step=_torque
    )


@register_effect(order=115)
class CrankAngleFriction(CrankEffect):
    """Angle-dependent dry friction of the crank, such as of an eccentric seal or a bent shaft: a
    family of Coulomb friction.

    Not a candidate itself: the share is fitted once Coulomb friction is found.
    """

    LAW = f"M = -m [1 - s + s (1 + cos(theta - a)) / 2] sgn w, {CRANK_SIGN}"
    WORDS = "angle-dependent dry friction of the crank"
    MEMBERS = {"crank_coulomb_friction": 0.0}
    SHAPE = "varying_share"
    torque_N_m = parameter(
        "N*m", "m, largest friction torque", 0.3, ge=0, compiled="angle_friction", step=_torque
    )
    tightest_angle_rad = parameter(
        "rad",
        "a, crank angle of the largest friction",
        0.5,
        0.0,
        "angle_friction_tightest",
        odd=True,
    )
    varying_share = parameter(
        "", "s, varying share of the torque", 0.5, ge=0, le=1, compiled="angle_friction_share"
    )

    @classmethod
    def family(cls, member: type[Effect], scale: base.MotionScale) -> LawFamily:
        # one revolution to either side, so that no angle is a bound
        angle = Parameter("tightest_angle_rad", 0.0, -2.0 * math.pi, 2.0 * math.pi, 0.1, "rad")
        guesses = tuple({angle.name: tightest} for tightest in _TIGHTEST)
        return super().family(member, scale, shape_details=(angle,), initial_guesses=guesses)


@register_effect(order=120)
class CrankViscousFriction(CrankEffect):
    """Viscous friction of the crank's bearings."""

    LAW = "M = -c w"
    REFERENCE = FRICTION_SURVEY
    WORDS = "viscous friction of the crank"
    damping_N_m_s = parameter(
        "N*m*s", "c, torque per speed", 0.01, ge=0, compiled="crank_viscous", step=_damping
    )


@register_effect(order=123)
class CrankBrake(CrankEffect):
    """The known torque of a brake, generator or dynamometer that loads the crank; not a
    candidate."""

    LAW = f"M = -T |w / w0|^n sgn w, {CRANK_SIGN}"
    WORDS = "a brake of the crank"
    torque_N_m = parameter(
        "N*m", "T, torque at the reference speed", 10.0, ge=0, compiled="crank_brake"
    )
    reference_speed_rad_s = parameter(
        "rad/s", "w0, speed at which the torque is T", 150.0, gt=0, compiled="crank_brake_speed"
    )
    exponent = parameter(
        "",
        "n: 0 constant, 1 generator with a resistor, 2 water brake",
        1.0,
        1.0,
        "crank_brake_exponent",
        ge=0,
        le=4,
    )


class PeriodicEffect(CrankEffect):
    """An effect with ``order`` cycles per revolution."""

    ANGLE = "phase_rad"

    @classmethod
    def phase_locked(
        cls, context: base.FitContext, integers: range, start: Sequence[int], **attributes: Any
    ) -> Candidate:
        """The candidate with an integer ``order`` out of `integers`; fits start at the orders
        `start`, or else at all below 9.

        With one run half-integer orders are tried too; with several runs their phase is ambiguous.
        """
        orders = [float(order) for order in integers]
        if len(context.runs) == 1:
            orders = sorted({*orders, *(k + 0.5 for k in range(int(orders[-1])))})
        least, largest = orders[0], orders[-1]
        order = Parameter(
            "order", least, least, largest, 1e-3, integer=True, search_values=tuple(orders)
        )
        start = [float(order) for order in start] or [order for order in orders if order < 9]
        return cls.candidate(
            *cls.sizes(context.scale),
            order,
            amplitudes=("cosine", "sine"),
            initial_guesses=tuple({"order": order} for order in start),
            parameters=cls.stated,
            **attributes,
        )

    @classmethod
    def stated(cls, values: base.Values) -> dict[str, float]:
        """The order is rounded to an integer or half-integer."""
        halves = round(2.0 * values["order"])
        return super().stated(values) | {"order": halves / 2.0 if halves % 2 else halves // 2}


@register_effect(order=127)
class CrankPeriodicTorque(PeriodicEffect):
    """A torque locked to the crank angle, such as cogging or gear meshing.

    At constant speed the drive compensates it, so that only the crank torque shows it.
    """

    LAW = "M = a cos(k theta - phase)"
    WORDS = "a periodic torque on the crank"
    torque_N_m = parameter(
        "N*m", "a, amplitude", 0.2, ge=0, compiled="crank_periodic", step=_torque
    )
    order = parameter("", "k, cycles per revolution", 12, ge=0.5, le=100, multiple_of=0.5)
    phase_rad = parameter(
        "rad",
        "angle k theta of the largest torque",
        0.5,
        default=0.0,
        compiled="crank_periodic_phase",
    )

    def compile_into(self, records: base.Records) -> None:
        super().compile_into(records)
        records["effects"]["crank_periodic_order"] = float(self.parameters.order)

    def mirrored(self) -> Effect:
        # theta' = -theta and M' = -M: -a cos(-k theta' - phase) = a cos(k theta' - (pi - phase))
        return self.with_parameters(phase_rad=math.pi - self.parameters.phase_rad)

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        yield cls.phase_locked(
            context, _FITTED_ORDERS, _USUAL_ORDERS, carrier=CrankCoulombFriction.NAME
        )


@register_effect(order=130)
class CrankUnbalance(CrankEffect):
    """An additional mass (imbalance) on the crank, at the distance crank.length from the pivot.

    Its mass is U / crank.length, its inertia U crank.length. Frame forces, gravity and a motor
    drive show it.
    """

    SITE = "crank"
    LAW = "mass U / crank.length, crank.length from the pivot"
    REFERENCE = "ISO 21940-2:2017, rotor balancing, vocabulary"
    WORDS = "an unbalance of the crank"
    ANGLE = "angle_rad"
    unbalance_kg_m = parameter(
        "kg*m", "U, mass times distance from the pivot", 0.005, ge=0, step=_unbalance
    )
    angle_rad = parameter("rad", "direction relative to the crank", 1.0, default=0.0, odd=True)

    def compile_into(self, records: base.Records) -> None:
        bodies, parameters = records["bodies"], self.parameters
        unbalance, angle = parameters.unbalance_kg_m, parameters.angle_rad
        radius = bodies["crank_length"]
        place = radius * math.cos(angle), radius * math.sin(angle)
        bodies["unbalance"] = unbalance / radius, place


@register_effect(order=150)
class SpeedFluctuation(PeriodicEffect):
    """A speed that depends on the crank angle; only for the constant-speed drive, with w0 =
    simulate.speed."""

    SITE = "drive"
    LAW = "w = w0 (1 + a cos(k theta - phase))"
    WORDS = "a fluctuating drive speed"
    DRIVE = "constant"
    ratio = parameter("", "a, amplitude over the mean", 0.02, ge=0, le=0.3, step=lambda scale: 1e-3)
    order = parameter("", "k, cycles per revolution", 2, ge=0.5, le=12, multiple_of=0.5)
    phase_rad = parameter("rad", "angle k theta of the largest speed", 0.5, default=0.0, odd=True)

    def compile_into(self, records: base.Records) -> None:
        parameters = self.parameters
        records["drive"] |= {
            "kind": "fluctuating",
            "ratio": parameters.ratio,
            "order": float(parameters.order),
            "phase": parameters.phase_rad,
        }

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        return [cls.phase_locked(context, range(1, 13), ())] if context.constant_speed else []


@register_effect(order=240)
class DiscoveredCrankTorque(DiscoveredLaw):
    """A counter-clockwise torque on the crank [N m], given by a formula."""

    GROUP, SITE = "crank", "crank"
    LAW = "M = formula of v, x, w, theta, t"
    WORDS = "a crank torque with a formula found by regression"

    def mirrored(self) -> Effect:
        effect = super().mirrored()
        return effect.with_parameters(formula=f"-({effect.parameters.formula})")
