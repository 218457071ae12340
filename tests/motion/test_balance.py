"""Balances of energy and momentum for many mechanisms."""

from itertools import pairwise

import numpy as np
import pytest

from jointgap.config.friction_laws import FRICTION_LAWS
from tests.motion import ledger
from tests.motion.cases import ALL, LUGRE, MOTOR, PINS, effect, mechanism
from tests.motion.quadrature import motion

RUB = {"friction": 0.1, "friction_speed": 0.1}
WEIGHT = {"gravity": True, "offset": 0.03}
BENDING = effect("rod_flexibility", frequency_Hz=250.0, damping_ratio=0.02)
FLUCTUATION = effect("speed_fluctuation", ratio=0.1, order=2, phase_rad=0.5)
FILMS = [effect("lubricated_joint", pin, viscosity_Pa_s=0.4, length_m=0.02) for pin in PINS]
PIN_FRICTION = [effect("pin_friction", pin, coefficient=0.1) for pin in PINS]
UNBALANCE = effect("crank_unbalance", unbalance_kg_m=0.02, angle_rad=2.0)
TIGHT = {"tightest_position_m": 0.6, "length_m": 0.25, "varying_share": 0.8}
STIFFENING = {"rest_position_m": 0.6, "length_m": 0.15, "cubic_share": 0.7}
SIZES = {"a": 2.0, "b": 3.0}
SLIDER = [
    effect("slider_coulomb_friction", force_N=20.0),
    effect("slider_viscous_friction", damping_N_s_m=5.0),
    effect("slider_quadratic_drag", drag_N_s2_m2=0.5),
    effect("slider_stribeck_friction", force_N=15.0, stribeck_speed_m_s=0.5, stribeck_share=0.7),
    effect("slider_position_friction", force_N=10.0, **TIGHT),
    effect("slider_power_drag", force_N=2.0, speed_m_s=1.5, exponent=3.5),
    effect("slider_load_friction", coefficient=0.1),
    effect("slider_constant_force", force_N=-50.0),
    effect("slider_spring", stiffness_N_m=2000.0, rest_position_m=0.56),
    effect("slider_nonlinear_spring", stiffness_N_m=1000.0, **STIFFENING),
    effect("gas_pressure", force_N=300.0, dead_length_m=0.05, exponent=1.3),
    effect("harmonic_force", force_N=30.0, frequency_Hz=37.0, phase_rad=0.4),
    effect("discovered_slider_force", formula="-a*v*|v| + b*sin(theta)", coefficients=SIZES),
]
CRANK = [
    effect("crank_coulomb_friction", torque_N_m=0.3),
    effect("crank_angle_friction", torque_N_m=0.2, tightest_angle_rad=1.0, varying_share=0.7),
    effect("crank_viscous_friction", damping_N_m_s=0.01),
    effect("crank_brake", torque_N_m=0.4, reference_speed_rad_s=25.0, exponent=1.7),
    effect("crank_periodic_torque", torque_N_m=0.2, order=5, phase_rad=-1.1),
    effect("discovered_crank_torque", formula="-0.3*cos(theta)^2"),
]
MOTORED, EVERY = {"drive": MOTOR}, [*SLIDER, *CRANK]
THREE_LOOSE = {"loose": ALL} | RUB | WEIGHT
TWO_LOOSE = LUGRE | WEIGHT | {"loose": ("crank_pivot", "crank_pin")}
PENALTY = {"law": "penalty", "penalty_damping": 2e3, "penalty_depth": 1e-4}
ON_ROD = {"journals": ("rod", "rod"), "law": "exact_restitution"}
BENGISU_AKAY = {"friction_law": "bengisu_akay", "static_friction": 0.15, "stribeck_speed": 0.1}

CASES = {
    "with friction": ([], RUB, {}),
    "all ideal": ([], {"loose": ()} | WEIGHT, {}),
    "penalty form": ([], PENALTY | RUB, {}),
    "film": (FILMS, RUB, {}),
    "flexible rod": ([BENDING], RUB | WEIGHT, {}),
    "fluctuating speed": ([FLUCTUATION, UNBALANCE], RUB | WEIGHT, {}),
    "every force, three loose, motor": ([*EVERY, UNBALANCE], THREE_LOOSE, MOTORED),
    "every force, all ideal, motor": (EVERY, {"loose": ()} | WEIGHT, MOTORED),
    "friction of ideal pins": (PIN_FRICTION, {"loose": ()} | WEIGHT, {}),
    "lugre": ([], LUGRE, {}),
}
LATER = {
    "all at once": ([*EVERY, UNBALANCE, BENDING, FILMS[0], PIN_FRICTION[1]], TWO_LOOSE, MOTORED),
    "journals on the rod": ([], ON_ROD | RUB | WEIGHT, {}),
    "crank pivot alone loose": ([], {"loose": ("crank_pivot",)} | RUB | WEIGHT, {}),
    "exponent 2": ([], {"stiffness": 5e12, "exponent": 2.0}, {}),
    "bengisu-akay": ([], BENGISU_AKAY | RUB, {}),
    "lugre, three loose": ([], LUGRE | {"loose": ALL}, MOTORED),
    "flexible rod, three loose, motor": ([BENDING], THREE_LOOSE, MOTORED),
}
BOUND = 1e-8


@pytest.fixture(
    scope="module", params=[*CASES, *(pytest.param(case, marks=pytest.mark.slow) for case in LATER)]
)
def moved(request):
    effects, keys, drive = (CASES | LATER)[request.param]
    return motion(mechanism(*effects, **keys), revolutions=0.5, start_angle=0.4, **drive)


def relative(balance, scale):
    return np.abs(balance).max() / np.abs(scale).max()


def test_energy_is_balanced(moved, worst):
    made, bend = moved.made, ledger.bending(moved)
    kinetic, height = bend["kinetic"], bend["potential"]
    for mass, place, velocity, inertia, turn in ledger.bodies(moved):
        kinetic = kinetic + 0.5 * mass * (velocity**2).sum(0) + 0.5 * inertia * turn**2
        height = height - mass * (made.gravity[:, None, None] * place).sum(0)
    stored, joint_loss = bend["strain"], np.zeros_like(kinetic)
    for name in ALL:
        elastic, loss = ledger.joint_powers(moved, name)
        stored, joint_loss = stored + elastic, joint_loss + loss
    on_crank = moved["crank_torque"] + ledger.crank_losses(moved)
    work = ledger.slider_effects(moved) * moved["slider_velocity"]
    work = work + on_crank * moved["crank_speed"] - joint_loss - bend["loss"]
    energy = kinetic + height + stored
    law = moved.model.bearings["crank_pin"].friction_law
    if law != FRICTION_LAWS["lugre"].code:  # bristles return stored energy
        assert (joint_loss > -1e-6 * np.abs(kinetic).max()).all()
    change = energy[:, -1] - energy[0, 0] - moved.integral(work)
    worst("energy balance", relative(change, kinetic), BOUND)


def test_linear_momentum_is_balanced(moved, worst):
    made, momentum, total = moved.made, ledger.bending(moved)["momentum"], 0.0
    for mass, _, velocity, _, _ in ledger.bodies(moved):
        momentum, total = momentum + mass * velocity, total + mass
    pushed = total * made.gravity[0] - moved["frame_force_x"] + ledger.slider_effects(moved)
    lifted = total * made.gravity[1] - moved["frame_force_y"] + moved["guide_force"]
    for i, force in enumerate((pushed, lifted)):
        change = momentum[i, :, -1] - momentum[i, 0, 0] - moved.integral(force)
        worst("linear momentum", relative(change, momentum), BOUND)


def test_angular_momentum_is_balanced(moved, worst):
    made, bend = moved.made, ledger.bending(moved)
    spin, moment = bend["spin"], bend["moment"]
    for mass, place, velocity, inertia, turn in ledger.bodies(moved):
        spin = spin + mass * ledger.cross(place, velocity) + inertia * turn
        moment = moment + mass * ledger.cross(place, made.gravity)
    moment = (
        moment + moved["crank_torque"] + ledger.crank_losses(moved) + ledger.frame_moment(moved)
    )
    moment = moment + moved["slider_position"] * moved["guide_force"] + moved["guide_moment"]
    moment = moment - made.slider.offset * ledger.slider_effects(moved)
    worst(
        "angular momentum", relative(spin[:, -1] - spin[0, 0] - moved.integral(moment), spin), BOUND
    )


@pytest.mark.parametrize("joint", ALL)
def test_clearance_rates_are_derivatives(moved, worst, joint):
    # at the centre directions turn at any rate
    away = moved[f"r{ledger.NUMBERS[joint]}"].min(axis=1) > 1e-4
    for symbol in ("r", "gamma") if joint in moved.model.loose else ():
        seen = [moved[f"{symbol}{ledger.NUMBERS[joint]}{dots}"] for dots in ("", "_dot", "_ddot")]
        for quantity, rate in pairwise(seen):
            change = quantity[:, -1] - quantity[:, 0] - moved.steps(rate)
            worst("derivatives of a clearance vector", relative(change[away], quantity[away]), 1e-7)
