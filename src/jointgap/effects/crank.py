"""Torques on the crank, its unbalance, and a drive whose speed fluctuates."""

import math
from collections.abc import Sequence
from typing import Any

from jointgap.core.candidates import Candidate, LawFamily, Parameter
from jointgap.effects import base
from jointgap.effects.base import CRANK_SIGN, FRICTION_SURVEY, DiscoveredLaw, Effect, parameter, register_effect

# Angles [rad] of most friction from which fits begin: each within 60 degrees of any other
_TIGHTEST = (0.0, -2.0 * math.pi / 3.0, 2.0 * math.pi / 3.0)

# Whole orders [cycles per revolution] of a torque that a fit tries. Masses, weight and steady forces on the slider make
# torques of orders one and two: there the usual causes are offered, not a torque by itself. Poles, slots and teeth of
# drives lie below the highest one, and few encoders resolve more
_FITTED_ORDERS = range(3, 25)

# Orders [1] that a preflight tries, before there is a residual in which to look for them
_USUAL_ORDERS = (3, 4, 6, 8, 12)


def _torque(scale: base.MotionScale) -> float:
    return scale.force * scale.stroke


def _damping(scale: base.MotionScale) -> float:
    return scale.force * scale.stroke / scale.turning


def _unbalance(scale: base.MotionScale) -> float:
    return scale.force / scale.turning**2


class CrankEffect(Effect):
    """A moment on the crank, counter-clockwise."""

    GROUP, SITE = "crank", "crank_pivot"


@register_effect(order=110)
class CrankCoulombFriction(CrankEffect):
    """Dry friction of the crank's bearings and seals, whatever their load."""

    LAW = f"M = -m sgn w, {CRANK_SIGN}"
    REFERENCE = FRICTION_SURVEY
    WORDS = "Coulomb friction of the crank"
    torque_N_m = parameter("N*m", "m, moment of friction", 0.3, ge=0, compiled="crank_coulomb", step=_torque)


@register_effect(order=115)
class CrankAngleFriction(CrankEffect):
    """Dry friction of the crank of which a share varies with its angle: the family of Coulomb friction.

    The least that an eccentric seal or a bent shaft does: one wave over the revolution. No candidate by itself: the
    share is fitted once Coulomb friction is found.
    """

    LAW = f"M = -m [1 - s + s (1 + cos(theta - a)) / 2] sgn w, {CRANK_SIGN}"
    WORDS = "dry friction of the crank that varies with its angle"
    MEMBERS = {"crank_coulomb_friction": 0.0}
    SHAPE = "varying_share"
    torque_N_m = parameter(
        "N*m", "m, moment of friction where it is largest", 0.3, ge=0, compiled="angle_friction", step=_torque
    )
    tightest_angle_rad = parameter(
        "rad", "a, angle of the crank where friction is largest", 0.5, 0.0, "angle_friction_tightest", odd=True
    )
    varying_share = parameter(
        "", "s, share of the moment that varies", 0.5, ge=0, le=1, compiled="angle_friction_share"
    )

    @classmethod
    def family(cls, member: type[Effect], scale: base.MotionScale) -> LawFamily:
        # A revolution to either side of 0, so that no angle is a bound of what is periodic.
        angle = Parameter("tightest_angle_rad", 0.0, -2.0 * math.pi, 2.0 * math.pi, 0.1, "rad")
        guesses = tuple({angle.name: tightest} for tightest in _TIGHTEST)
        return super().family(member, scale, others=(angle,), initial_guesses=guesses)


@register_effect(order=120)
class CrankViscousFriction(CrankEffect):
    """Friction of the crank's bearings in their lubricant."""

    LAW = "M = -c w"
    REFERENCE = FRICTION_SURVEY
    WORDS = "viscous friction of the crank"
    damping_N_m_s = parameter("N*m*s", "c, moment per speed", 0.01, ge=0, compiled="crank_viscous", step=_damping)


class PeriodicEffect(CrankEffect):
    """An effect in step with the crank: its parameter ``order`` is a number of cycles per revolution."""

    ANGLE = "phase_rad"

    @classmethod
    def in_step(cls, context: base.FitContext, whole: range, first: Sequence[int], **attributes: Any) -> Candidate:
        """The candidate whose ``order`` is one of the `whole` numbers, or of the halves between them where there is one
        run alone, as in which of two turns a run began nobody knows; fits begin at the orders `first`.
        """
        orders = [float(order) for order in whole]
        if len(context.runs) == 1:
            orders = sorted({*orders, *(k + 0.5 for k in range(int(orders[-1])))})
        order = Parameter("order", orders[0], orders[0], orders[-1], 1e-3, whole=True, tried=tuple(orders))
        guesses = tuple({"order": float(tried)} for tried in first or orders if first or tried < 9)
        sizes = cls.sizes(context.scale)
        attributes |= {"initial_guesses": guesses, "parameters": cls.stated}
        return cls.candidate(*sizes, order, amplitudes=("cosine", "sine"), **attributes)

    @classmethod
    def stated(cls, values: base.Values) -> dict[str, float]:
        """The order is the whole or half one next to the fitted value."""
        doubled = round(2.0 * values["order"])
        return super().stated(values) | {"order": doubled // 2 if doubled % 2 == 0 else doubled / 2.0}


@register_effect(order=127)
class CrankPeriodicTorque(PeriodicEffect):
    """A torque locked to the crank's angle, as cogging, teeth of a gear or poles of a motor make it.

    At a constant speed the drive has to make up for it, so that it stands in the crank's torque and nowhere else.
    """

    LAW = "M = a cos(k theta - phase)"
    WORDS = "a periodic torque on the crank"
    torque_N_m = parameter("N*m", "a, amplitude", 0.2, ge=0, compiled="crank_periodic", step=_torque)
    order = parameter("", "k, cycles per revolution", 12, ge=0.5, le=100, multiple_of=0.5)
    phase_rad = parameter(
        "rad", "angle k theta of the largest torque", 0.5, default=0.0, compiled="crank_periodic_phase"
    )

    def compile_into(self, records: base.Records) -> None:
        super().compile_into(records)
        records["effects"]["crank_periodic_order"] = float(self.parameters.order)

    def mirrored(self) -> Effect:
        # theta' = -theta and M' = -M: -a cos(-k theta' - phase) = a cos(k theta' - (pi - phase))
        return self.with_parameters(phase_rad=math.pi - self.parameters.phase_rad)

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        yield cls.in_step(context, _FITTED_ORDERS, _USUAL_ORDERS, steady_counterpart=CrankCoulombFriction.NAME)


@register_effect(order=130)
class CrankUnbalance(CrankEffect):
    """A mass on the crank beyond nominal.

    It sits at the crank's length from the pivot, so that U / crank.length is its mass and U crank.length its inertia.
    Frame forces, gravity and a motor's drive show it.
    """

    SITE = "crank"
    LAW = "mass U / crank.length, crank.length from the pivot"
    REFERENCE = "ISO 21940-2:2017, rotor balancing, vocabulary"
    WORDS = "an unbalance of the crank"
    ANGLE = "angle_rad"
    unbalance_kg_m = parameter("kg*m", "U, mass times distance from the pivot", 0.005, ge=0, step=_unbalance)
    angle_rad = parameter("rad", "its direction, from the crank's own", 1.0, default=0.0, odd=True)

    def compile_into(self, records: base.Records) -> None:
        bodies, unbalance, angle = records["bodies"], self.parameters.unbalance_kg_m, self.parameters.angle_rad
        bodies["crank_mass"] += unbalance / bodies["crank_length"]
        bodies["crank_moment_x"] += unbalance * math.cos(angle)
        bodies["crank_moment_y"] += unbalance * math.sin(angle)
        bodies["crank_inertia"] += unbalance * bodies["crank_length"]


@register_effect(order=150)
class SpeedFluctuation(PeriodicEffect):
    """The drive's speed depends on the crank angle; for the constant drive alone, of which simulate.speed is w0."""

    SITE = "drive"
    LAW = "w = w0 (1 + a cos(k theta - phase))"
    WORDS = "a drive whose speed fluctuates"
    DRIVE = "constant"
    ratio = parameter("", "a, amplitude over the mean", 0.02, ge=0, le=0.3, step=lambda scale: 1e-3)
    order = parameter("", "k, cycles per revolution", 2, ge=0.5, le=12, multiple_of=0.5)
    phase_rad = parameter("rad", "angle k theta of the largest speed", 0.5, default=0.0, odd=True)

    def compile_into(self, records: base.Records) -> None:
        ratio, order, phase = self.parameters.ratio, float(self.parameters.order), self.parameters.phase_rad
        records["drive"] |= {"kind": "fluctuating", "ratio": ratio, "order": order, "phase": phase}

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        return [cls.in_step(context, range(1, 13), ())] if context.constant_speed else []


@register_effect(order=240)
class DiscoveredCrankTorque(DiscoveredLaw):
    """A moment on the crank, counter-clockwise [N m]."""

    GROUP, SITE = "crank", "crank"
    LAW = "M = formula of v, x, w, theta, t"
    WORDS = "a torque on the crank that follows a formula found by regression"

    def mirrored(self) -> Effect:
        seen = super().mirrored()
        return seen.with_parameters(formula=f"-({seen.parameters.formula})")
