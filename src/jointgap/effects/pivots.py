"""Torques on a body about its pivot on the frame: their laws, and `pivot_torque`, which sums them;
unbalance of the crank, and speed fluctuation of the drive."""

import math
from collections.abc import Sequence
from typing import Any

from jointgap.core.candidates import Candidate, LawFamily, Parameter
from jointgap.effects import base
from jointgap.effects.base import (
    CRANK_SIGN,
    CRANK_SIGN_SPEED,
    FRICTION_SURVEY,
    LAWS,
    DiscoveredLaw,
    Effect,
    numbers_of,
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


class PivotEffect(Effect):
    """A counter-clockwise torque on a body about its pivot."""

    ON, GROUP, SITE = "pivot", "crank", "{joint}"


@register_effect(order=110)
class CoulombFriction(PivotEffect):
    """Dry friction of the {site}'s bearings and seals, independent of load."""

    LAW = f"M = -m sgn w, {CRANK_SIGN}"
    REFERENCE = FRICTION_SURVEY
    WORDS = "Coulomb friction of the {site}"
    torque_N_m = parameter("N*m", "m, friction torque", 0.3, ge=0, compiled="coulomb", step=_torque)


@register_effect(order=115)
class AngleFriction(PivotEffect):
    """Angle-dependent dry friction of the {site}, such as of an eccentric seal or a bent shaft: a
    family of Coulomb friction.

    Not a candidate itself: the share is fitted once Coulomb friction is found.
    """

    LAW = f"M = -m [1 - s + s (1 + cos(theta - a)) / 2] sgn w, {CRANK_SIGN}"
    WORDS = "angle-dependent dry friction of the {site}"
    MEMBERS = {"coulomb_friction": 0.0}
    SHAPE = "varying_share"
    torque_N_m = parameter(
        "N*m", "m, largest friction torque", 0.3, ge=0, compiled="angle_friction", step=_torque
    )
    tightest_angle_rad = parameter(
        "rad",
        "a, {site} angle of the largest friction",
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
class ViscousFriction(PivotEffect):
    """Viscous friction of the {site}'s bearings."""

    LAW = "M = -c w"
    REFERENCE = FRICTION_SURVEY
    WORDS = "viscous friction of the {site}"
    damping_N_m_s = parameter(
        "N*m*s", "c, torque per speed", 0.01, ge=0, compiled="viscous", step=_damping
    )


@register_effect(order=123)
class Brake(PivotEffect):
    """The known torque of a brake, generator or dynamometer that loads the {site}; not a
    candidate."""

    ON = "crank"
    LAW = f"M = -T |w / w0|^n sgn w, {CRANK_SIGN}"
    WORDS = "a brake of the {site}"
    torque_N_m = parameter("N*m", "T, torque at the reference speed", 10.0, ge=0, compiled="brake")
    reference_speed_rad_s = parameter(
        "rad/s", "w0, speed at which the torque is T", 150.0, gt=0, compiled="brake_speed", off=1.0
    )
    exponent = parameter(
        "",
        "n: 0 constant, 1 generator with a resistor, 2 water brake",
        1.0,
        1.0,
        "brake_exponent",
        ge=0,
        le=4,
    )


class PeriodicEffect(PivotEffect):
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
            *cls.sizes(context.at(cls.BODY)),
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
class PeriodicTorque(PeriodicEffect):
    """A torque locked to the crank angle, such as cogging or gear meshing.

    At constant speed the drive compensates it, so that only the crank torque shows it.
    """

    ON = "crank"
    LAW = "M = a cos(k theta - phase)"
    WORDS = "a periodic torque on the {site}"
    torque_N_m = parameter("N*m", "a, amplitude", 0.2, ge=0, compiled="periodic", step=_torque)
    order = parameter("", "k, cycles per revolution", 12, ge=0.5, le=100, multiple_of=0.5)
    phase_rad = parameter(
        "rad",
        "angle k theta of the largest torque",
        0.5,
        default=0.0,
        compiled="periodic_phase",
    )

    def compile_into(self, records: base.Records) -> None:
        super().compile_into(records)
        records["sites"][self.BODY]["periodic_order"] = float(self.parameters.order)

    def mirrored(self) -> Effect:
        # theta' = -theta and M' = -M: -a cos(-k theta' - phase) = a cos(k theta' - (pi - phase))
        return self.with_parameters(phase_rad=math.pi - self.parameters.phase_rad)

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        yield cls.phase_locked(
            context, _FITTED_ORDERS, _USUAL_ORDERS, carrier=cls.name_at_same_site(CoulombFriction)
        )


@register_effect(order=130)
class Unbalance(PivotEffect):
    """An additional mass (imbalance) on the {site}, at the distance {site}.length from the pivot.

    Its mass is U / {site}.length, its inertia U {site}.length. Frame forces, gravity and a motor
    drive show it.
    """

    ON, SITE = "crank", ""
    LAW = "mass U / {site}.length, {site}.length from the pivot"
    REFERENCE = "ISO 21940-2:2017, rotor balancing, vocabulary"
    WORDS = "an unbalance of the {site}"
    ANGLE = "angle_rad"
    unbalance_kg_m = parameter(
        "kg*m", "U, mass times distance from the pivot", 0.005, ge=0, step=_unbalance
    )
    angle_rad = parameter("rad", "direction relative to the {site}", 1.0, default=0.0, odd=True)

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

    ON, SITE = "mechanism", "drive"
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
class DiscoveredTorque(DiscoveredLaw):
    """A counter-clockwise torque on the {site} [N m], given by a formula."""

    ON, GROUP, RULE = "pivot", "crank", "discovered_{site}_torque"
    LAW = "M = formula of v, x, w, theta, t"
    WORDS = "a {site} torque with a formula found by regression"

    def mirrored(self) -> Effect:
        effect = super().mirrored()
        return effect.with_parameters(formula=f"-({effect.parameters.formula})")

    @property
    def odd_variables(self) -> tuple[str, ...]:
        # of the crank x and v are those of the first slide, of others its own angle and speed
        of_slide = self.BODY == self.SITES.crank and self.SITES.slides
        return super().odd_variables if of_slide else (*super().odd_variables, "x", "v")


PIVOT_LAWS = numbers_of(law for law in LAWS if law.__module__ == __name__) | {
    "periodic_order": 0.0,
    "sign_speed": CRANK_SIGN_SPEED,
    "middle": 0.0,  # [rad] Mean of the angle minus the turns of the body in the ideal motion
    "turns": 0.0,  # Of the body in a turn of the crank
    "follows_slide": 0,  # 1: the variables of the formula are those of the first slide
    "formula": 0,  # Place of a program, from 1; 0: none
}
"""Numbers of `pivot_torque` and of a formula, by name."""


def pivot_torque(p, sign, angle, speed):
    """Torque [N m] on a body at an angle, with the numbers `PIVOT_LAWS` and the smooth `sign` of
    its speed; compiled in `jointgap.linkage.laws`."""
    torque = -p.coulomb * sign - p.viscous * speed
    if p.angle_friction != 0.0:
        phase = angle - p.angle_friction_tightest
        varying = 1.0 - p.angle_friction_share * (0.5 - 0.5 * math.cos(phase))
        torque -= p.angle_friction * varying * sign
    if p.periodic != 0.0:
        torque += p.periodic * math.cos(p.periodic_order * angle - p.periodic_phase)
    if p.brake != 0.0:
        torque -= p.brake * (abs(speed) / p.brake_speed) ** p.brake_exponent * sign
    return torque
