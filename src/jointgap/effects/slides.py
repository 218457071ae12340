"""Forces on a body along its slide of the frame: their laws, and `slide_force`, which sums them."""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from jointgap.core.candidates import LawFamily, Parameter
from jointgap.effects import base
from jointgap.effects.base import (
    FRICTION_SURVEY,
    LAWS,
    SLIDER_SIGN_SPEED,
    DiscoveredLaw,
    Effect,
    amplitude,
    numbers_of,
    parameter,
    register_effect,
)

_SIGN = f"sgn v = tanh(v / {SLIDER_SIGN_SPEED:g} m/s)"

# Start value and bounds of the Stribeck speed [1, of the root mean square speed]. Lower speeds have
# too few samples (a slider is slower than a tenth for 4.5 % of the time); higher ones resemble
# negative viscous friction
_STRIBECK_SPEED, _SLOWEST, _FASTEST = 0.2, 0.1, 0.5

# Positions of largest friction [half strokes from mid-stroke] at which fits start
_TIGHTEST = (0.0, -2.0 / 3.0, 2.0 / 3.0)

# Largest distance of a spring's rest position from mid-stroke [strokes]: beyond, the force is
# nearly constant
_FARTHEST_STROKES = 3.0


def _force(scale: base.MotionScale) -> float:
    return scale.force


def _force_over_speed(scale: base.MotionScale) -> float:
    return scale.force / scale.speed


def _force_over_speed_squared(scale: base.MotionScale) -> float:
    return scale.force / scale.speed**2


def _coefficient(scale: base.MotionScale) -> float:
    return min(scale.force / scale.guide, 0.1)


class SlideEffect(Effect):
    """A force on a body, along its slide."""

    ON, GROUP = "slide", "slider"


@register_effect(order=20)
class CoulombFriction(SlideEffect):
    """Dry friction of the {site} independent of the guide's load, such as of piston rings."""

    ON = "slide or track"
    LAW = f"F = -f sgn v, {_SIGN}"
    REFERENCE = "Coulomb, Théorie des machines simples (1785)"
    WORDS = "Coulomb friction of the {site}"
    force_N = parameter("N", "f, friction force", 20.0, ge=0, compiled="coulomb", step=_force)


@register_effect(order=45)
class PowerDrag(SlideEffect):
    """Drag with any power of the {site} speed: the family of dry friction, viscous friction and
    quadratic drag.

    Not a candidate itself: the exponent is fitted once a member of the family is found.
    """

    LAW = f"F = -f |v/v0|^p sgn v, {_SIGN}"
    REFERENCE = FRICTION_SURVEY
    WORDS = "drag of the {site}"
    MEMBERS = {
        "coulomb_friction": 0.0,
        "viscous_friction": 1.0,
        "quadratic_drag": 2.0,
    }
    SHAPE, IN_USE = "exponent", (0.0, 1.0, 2.0, 3.0, 5.0)
    force_N = parameter(
        "N", "f, force at the speed v0", 10.0, ge=0, compiled="power_drag", step=_force
    )
    speed_m_s = parameter(
        "m/s", "v0, speed at which the force is f", 1.0, gt=0, compiled="power_drag_speed", off=1.0
    )
    exponent = parameter(
        "", "p, exponent of the speed", 3.0, ge=0, le=6.0, compiled="power_drag_exponent"
    )

    @classmethod
    def family(cls, member: type[Effect], scale: base.MotionScale) -> LawFamily:
        speed, (key,) = scale.speed, member.DESCRIBED
        return super().family(
            member,
            scale,
            # the parameter of a member is force over a power of the speed
            values=lambda values: {"force_N": values[key] * speed ** cls.MEMBERS[member.NAME]},
            parameters=lambda values: {**values, "speed_m_s": speed},
        )


@register_effect(order=25)
class StribeckFriction(SlideEffect):
    """Dry friction of the {site} that decreases with speed (stiction): a family of Coulomb
    friction.

    Not a candidate itself: the share is fitted once Coulomb friction is found.
    """

    LAW = f"F = -f (1 - s + s exp(-|v|/v_s)) sgn v, {_SIGN}"
    REFERENCE = FRICTION_SURVEY
    WORDS = "dry friction of the {site}"
    MEMBERS = {"coulomb_friction": 0.0}
    SHAPE = "stribeck_share"
    force_N = parameter(
        "N", "f, friction force at low speed", 20.0, ge=0, compiled="stribeck", step=_force
    )
    stribeck_speed_m_s = parameter(
        "m/s", "v_s, Stribeck speed", 0.3, gt=0, compiled="stribeck_speed", off=1.0
    )
    stribeck_share = parameter(
        "",
        "s, share of the force that decreases with speed",
        0.5,
        ge=0,
        le=1,
        compiled="stribeck_share",
    )

    @classmethod
    def family(cls, member: type[Effect], scale: base.MotionScale) -> LawFamily:
        start, low, high = (share * scale.speed for share in (_STRIBECK_SPEED, _SLOWEST, _FASTEST))
        speed = Parameter("stribeck_speed_m_s", start, low, high, 0.1 * start, "m/s")
        return super().family(
            member, scale, shape_details=(speed,), values=lambda force: {**force, speed.name: start}
        )


@register_effect(order=27)
class PositionFriction(SlideEffect):
    """Position-dependent dry friction of the {site}, such as in a locally tight or worn bore: a
    family of Coulomb friction.

    Not a candidate itself: the share is fitted once Coulomb friction is found.
    """

    LAW = f"F = -f [1 - s + s (1 + cos(2 pi (x - x_t) / l)) / 2] sgn v, {_SIGN}"
    WORDS = "position-dependent dry friction of the {site}"
    MEMBERS = {"coulomb_friction": 0.0}
    SHAPE = "varying_share"
    force_N = parameter(
        "N", "f, largest friction force", 20.0, ge=0, compiled="position_friction", step=_force
    )
    tightest_position_m = parameter(
        "m",
        "x_t, {site} position of the largest friction",
        0.56,
        compiled="position_friction_tightest",
    )
    length_m = parameter(
        "m", "l, period along the stroke", 0.3, gt=0, compiled="position_friction_length", off=1.0
    )
    varying_share = parameter(
        "", "s, varying share of the force", 0.5, ge=0, le=1, compiled="position_friction_share"
    )

    @classmethod
    def family(cls, member: type[Effect], scale: base.MotionScale) -> LawFamily:
        middle, half = scale.middle, scale.stroke
        # one period to either side of mid-stroke, so that no position of the stroke is a bound
        low, high = middle - 2.0 * half, middle + 2.0 * half
        tightest = Parameter("tightest_position_m", middle, low, high, 0.1 * half, "m")
        guesses = tuple({tightest.name: middle + share * half} for share in _TIGHTEST)
        length = {"length_m": 2.0 * half}
        return super().family(
            member,
            scale,
            shape_details=(tightest,),
            initial_guesses=guesses,
            parameters=lambda values: {**values, **length},
        )


@register_effect(order=30)
class ViscousFriction(SlideEffect):
    """Viscous friction of the {site}, such as of a damper."""

    ON = "slide or track"
    LAW = "F = -c v"
    REFERENCE = FRICTION_SURVEY
    WORDS = "viscous friction of the {site}"
    damping_N_s_m = parameter(
        "N*s/m", "c, force per velocity", 5.0, ge=0, compiled="viscous", step=_force_over_speed
    )


@register_effect(order=40)
class QuadraticDrag(SlideEffect):
    """Drag of a fluid displaced by the {site} or forced through an orifice."""

    LAW = "F = -d v |v|"
    REFERENCE = "Newton, Principia (1687), book II, section II"
    WORDS = "quadratic drag of the {site}"
    drag_N_s2_m2 = parameter(
        "N*s^2/m^2",
        "d, force per velocity squared",
        0.5,
        ge=0,
        compiled="drag",
        step=_force_over_speed_squared,
    )


@register_effect(order=50)
class LoadFriction(SlideEffect):
    """Dry friction between {site} and guide, proportional to the guide's normal force N."""

    SITE = "{joint}"
    LAW = f"F = -k |N| sgn v, {_SIGN}, N: normal force of the guide"
    REFERENCE = "Amontons, Mém. Acad. R. Sci. (1699) 206-222"
    WORDS = "load-dependent friction of the {site} guide"
    coefficient = parameter(
        "",
        "k, coefficient of friction",
        0.1,
        ge=0,
        le=1,
        compiled="load_friction",
        step=_coefficient,
    )

    def check(self, mechanism: Any) -> None:
        if self.SITE in mechanism.loose:
            raise ValueError(
                f"effects: {self.NAME} requires an ideal slide; friction of the loose {self.SITE}"
                " is that of its contact"
            )


@register_effect(order=60)
class ConstantForce(SlideEffect):
    """A constant force, such as a load or a pressure difference."""

    LAW = "F = f"
    WORDS = "a constant force on the {site}"
    force_N = parameter("N", "f, force along +x", -50.0, compiled="constant", step=_force)


@register_effect(order=70)
class Spring(SlideEffect):
    """A linear spring between frame and {site}."""

    LAW = "F = -k (x - x0)"
    REFERENCE = "Hooke, De potentia restitutiva (1678)"
    WORDS = "a linear spring on the {site}"
    stiffness_N_m = parameter(
        "N/m", "k, force per length", 2000.0, ge=0, compiled="spring_stiffness"
    )
    rest_position_m = parameter(
        "m", "x0, {site} position without force", 0.56, compiled="spring_rest"
    )

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        parameters = partial(_one_spring, context.at(cls.BODY))
        yield cls.candidate(
            *_two_springs(context.at(cls.BODY)),
            parameters=parameters,
            families=cls.families(context),
        )


@register_effect(order=75)
class NonlinearSpring(SlideEffect):
    """A softening or hardening spring between frame and {site}: the family of the linear spring.

    Not a candidate itself: the share of the cubic part is fitted once a linear spring is found.
    """

    LAW = "F = -k [(1 - c) (x - x0) + c (x - x0)^3 / h^2]"
    REFERENCE = "Duffing, Erzwungene Schwingungen bei veränderlicher Eigenfrequenz (1918)"
    WORDS = "a spring on the {site}"
    MEMBERS = {"spring": 0.0}
    SHAPE, IN_USE = "cubic_share", (-0.5, 0.0, 0.5, 1.0)
    stiffness_N_m = parameter(
        "N/m",
        "k, force per length at the distance h from x0",
        2000.0,
        ge=0,
        compiled="nonlinear_spring",
    )
    rest_position_m = parameter(
        "m", "x0, {site} position without force", 0.56, compiled="nonlinear_spring_rest"
    )
    length_m = parameter(
        "m",
        "h, distance from x0 at which the force is k h",
        0.15,
        gt=0,
        compiled="nonlinear_spring_length",
        off=1.0,
    )
    # the stiffness vanishes at the distance h from rest for -1/2, and at rest for 1
    cubic_share = parameter(
        "",
        "c, share of the cubic part; negative: softening",
        1.0,
        ge=-0.5,
        le=1.0,
        compiled="nonlinear_spring_share",
    )

    @classmethod
    def family(cls, member: type[Effect], scale: base.MotionScale) -> LawFamily:
        def parameters(values: base.Values) -> dict[str, float]:
            return _one_spring(scale, values) | {
                "length_m": scale.stroke,
                "cubic_share": values["cubic_share"],
            }

        return super().family(member, scale, _two_springs(scale), parameters=parameters)


def _two_springs(scale: base.MotionScale) -> tuple[Parameter, ...]:
    """Stiffnesses of two springs at the extreme rest positions: equivalent to one between them, and
    linear."""
    step = scale.force / (_FARTHEST_STROKES * 2.0 * scale.stroke)
    return tuple(
        amplitude(key, step, "N/m", 0.0) for key in ("farthest_out_N_m", "farthest_in_N_m")
    )


def _one_spring(scale: base.MotionScale, values: base.Values) -> dict[str, float]:
    """The spring equivalent to `_two_springs`."""
    outer, inner = values["farthest_out_N_m"], values["farthest_in_N_m"]
    stiffness = outer + inner
    share = (outer - inner) / stiffness if stiffness > 0.0 else 0.0
    farthest = _FARTHEST_STROKES * 2.0 * scale.stroke
    return {"stiffness_N_m": stiffness, "rest_position_m": scale.middle + share * farthest}


@register_effect(order=80)
class GasPressure(SlideEffect):
    """A closed gas spring beyond the {site} without loss. For a cylinder with valves or combustion
    use `{site}_force_table`.
    """

    ALIASES = {"slider": "gas_pressure"}
    LAW = "F = -f (h / (h + x_out - x))^n, closed cycle, x_out: farthest-out position"
    REFERENCE = "Heywood, Internal combustion engine fundamentals (1988)"
    WORDS = "the pressure of a closed gas volume on the {site}"
    force_N = parameter(
        "N", "f, force with the {site} farthest out", 100.0, ge=0, compiled="gas_force", step=_force
    )
    dead_length_m = parameter(
        "m",
        "h, cylinder length beyond the farthest-out position",
        0.05,
        gt=0,
        compiled="gas_length",
        off=1.0,
    )
    exponent = parameter(
        "",
        "n, polytropic exponent: 1 isothermal, 1.4 adiabatic for air",
        1.3,
        ge=1,
        le=1.4,
        compiled="gas_exponent",
        off=1.0,
    )

    def largest_force(self, stroke: float) -> float:
        parameters = self.parameters
        compression = 1 + stroke / parameters.dead_length_m
        return parameters.force_N * compression**parameters.exponent

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        stroke = context.at(cls.BODY).stroke
        short, long = 0.2 * stroke, stroke
        yield cls.candidate(
            *cls.sizes(context.at(cls.BODY)),
            Parameter("dead_length_m", short, 0.01 * stroke, 20.0 * stroke, 0.1 * short, "m"),
            Parameter("exponent", 1.2, 1.0, 1.4, 0.05),
            amplitudes=("force_N",),
            initial_guesses=tuple(
                {"dead_length_m": length, "exponent": 1.2} for length in (short, long)
            ),
        )


@register_effect(order=90)
class HarmonicForce(SlideEffect):
    """A harmonic force that is not locked to the crank."""

    ALIASES = {"slider": "harmonic_force"}
    LAW = "F = f cos(2 pi nu t + phase), not locked to the crank"
    WORDS = "a harmonic force on the {site}"
    force_N = parameter("N", "f, amplitude", 10.0, ge=0, compiled="harmonic")
    frequency_Hz = parameter("Hz", "nu, frequency", 37.0)
    phase_rad = parameter("rad", "phase at t = 0", 0.0, default=0.0, compiled="harmonic_phase")

    def compile_into(self, records: base.Records) -> None:
        super().compile_into(records)
        angular_frequency = 2 * math.pi * self.parameters.frequency_Hz
        records["sites"][self.BODY]["harmonic_angular_frequency"] = angular_frequency

    @classmethod
    def candidates(cls, context: base.FitContext) -> base.Candidates:
        frequency, step = context.frequency_Hz, context.at(cls.BODY).force
        # runs are recorded at different times: each has its own phase
        names = [(part, run) for run in context.runs for part in ("cosine", "sine")]
        parts = [Parameter(part, 0.0, step=step, unit="N", run=run) for part, run in names]
        yield cls.candidate(
            *parts,
            Parameter("frequency_Hz", frequency, 0.0, math.inf, 1e-3 * frequency, "Hz"),
            amplitudes=tuple(part.key for part in parts),
            initial_guesses=({"frequency_Hz": frequency},),
            parameters=partial(_amplitude_and_phase, context.middles),
            carrier=cls.name_at_same_site(ConstantForce),
            middles=context.middles,
        )


def _amplitude_and_phase(middles: Mapping[str, float], values: base.Values) -> dict[str, float]:
    """Parameters of one run, or the mean amplitude over runs and the phase in the first; the parts
    refer to the `middles` [s] of the runs."""
    runs = [key.removeprefix("cosine") for key in values if key.startswith("cosine")]
    cosines = [values[f"cosine{run}"] for run in runs]
    # f cos(w t + phase) = f cos(phase) cos(w t) - f sin(phase) sin(w t)
    sines = [-values[f"sine{run}"] for run in runs]
    squares = [cosine**2 + sine**2 for cosine, sine in zip(cosines, sines, strict=True)]
    middle = values.get("middle_s", middles.get(runs[0].removeprefix("@"), 0.0))
    turned = 2.0 * math.pi * values["frequency_Hz"] * middle
    return {
        "force_N": math.sqrt(sum(squares) / len(runs)),
        "frequency_Hz": values["frequency_Hz"],
        "phase_rad": math.remainder(math.atan2(sines[0], cosines[0]) - turned, 2.0 * math.pi),
    }


@register_effect(order=230)
class DiscoveredForce(DiscoveredLaw):
    """A force on the {site} along +x [N], given by a formula."""

    ON, GROUP, RULE = "slide", "slider", "discovered_{site}_force"
    LAW = "F = formula of v, x, w, theta, t"
    WORDS = "a {site} force with a formula found by regression"


SLIDE_LAWS = numbers_of(law for law in LAWS if law.__module__ == __name__) | {
    "harmonic_angular_frequency": 0.0,
    "gas_outermost": 0.0,  # [m] position of the body farthest out
    "sign_speed": SLIDER_SIGN_SPEED,
    "table_over": 0,  # 1: a load over the crank angle, 2: over time, 0: none
    "table_sign": 1.0,
    "table_begin": 0.0,
    "table_period": 1.0,
    "formula": 0,  # Place of a program, from 1; 0: none
}
"""Numbers of `slide_force`, of a table and of a formula, by name."""


def slide_force(p, sign, guide_force, x, v, time):
    """Force [N] on a body along its slide, with the numbers `SLIDE_LAWS` and the smooth `sign` of
    its velocity; compiled in `jointgap.linkage.laws`."""
    force = (
        p.constant
        - (p.coulomb + p.load_friction * abs(guide_force)) * sign
        - p.viscous * v
        - p.drag * v * abs(v)
    )
    if p.stribeck != 0.0:
        falling = p.stribeck_share * math.exp(-abs(v) / p.stribeck_speed)
        force -= p.stribeck * (1.0 - p.stribeck_share + falling) * sign
    if p.position_friction != 0.0:
        phase = 2.0 * math.pi * (x - p.position_friction_tightest) / p.position_friction_length
        varying = 1.0 - p.position_friction_share * (0.5 - 0.5 * math.cos(phase))
        force -= p.position_friction * varying * sign
    if p.power_drag != 0.0:
        force -= p.power_drag * (abs(v) / p.power_drag_speed) ** p.power_drag_exponent * sign
    force -= p.spring_stiffness * (x - p.spring_rest)
    if p.nonlinear_spring != 0.0:
        stretch, share = x - p.nonlinear_spring_rest, p.nonlinear_spring_share
        cubic = (stretch / p.nonlinear_spring_length) ** 2
        force -= p.nonlinear_spring * stretch * (1.0 - share + share * cubic)
    if p.gas_force != 0.0:
        force -= (
            p.gas_force * (p.gas_length / (p.gas_length + p.gas_outermost - x)) ** p.gas_exponent
        )
    if p.harmonic != 0.0:
        force += p.harmonic * math.cos(p.harmonic_angular_frequency * time + p.harmonic_phase)
    return force
