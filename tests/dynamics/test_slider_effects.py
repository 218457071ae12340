"""Forces on the slider and friction of ideal pins, each against its own law at closed-form kinematics."""

import math

import numpy as np
import pytest

from jointgap.core.errors import SimulationError
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.simulation import integrate_to_angles, simulate, start_state
from tests.dynamics.cases import CRANK, PINS, ROD, SPEED, effect, mechanism, options
from tests.dynamics.closed import Closed

OFFSET = 0.05
OUTERMOST = math.sqrt((CRANK + ROD) ** 2 - OFFSET**2)
LAWS = {
    "slider_coulomb_friction": ({"force_N": 20.0}, lambda x, v, t, a: -20.0 * np.tanh(v / 0.01)),
    "slider_viscous_friction": ({"damping_N_s_m": 5.0}, lambda x, v, t, a: -5.0 * v),
    "slider_quadratic_drag": ({"drag_N_s2_m2": 0.5}, lambda x, v, t, a: -0.5 * v * np.abs(v)),
    "slider_stribeck_friction": (
        {"force_N": 30.0, "stribeck_speed_m_s": 0.5, "stribeck_share": 0.4},
        lambda x, v, t, a: -30.0 * (0.6 + 0.4 * np.exp(-np.abs(v) / 0.5)) * np.tanh(v / 0.01),
    ),
    "slider_position_friction": (
        {"force_N": 30.0, "tightest_position_m": 0.6, "length_m": 0.25, "varying_share": 0.4},
        lambda x, v, t, a: -30.0 * (0.6 + 0.4 * np.cos(np.pi * (x - 0.6) / 0.25) ** 2) * np.tanh(v / 0.01),
    ),
    "slider_power_drag": (
        {"force_N": 30.0, "speed_m_s": 2.0, "exponent": 3.5},
        lambda x, v, t, a: -30.0 * np.abs(v / 2.0) ** 3.5 * np.tanh(v / 0.01),
    ),
    "slider_constant_force": ({"force_N": -50.0}, lambda x, v, t, a: np.full_like(x, -50.0)),
    "slider_spring": ({"stiffness_N_m": 2e3, "rest_position_m": 0.56}, lambda x, v, t, a: -2e3 * (x - 0.56)),
    "slider_nonlinear_spring": (
        {"stiffness_N_m": 1e3, "rest_position_m": 0.6, "length_m": 0.1, "cubic_share": -0.4},
        lambda x, v, t, a: -1e3 * (1.4 * (x - 0.6) - 0.4 * (x - 0.6) ** 3 / 0.01),
    ),
    "gas_pressure": (
        {"force_N": 300.0, "dead_length_m": 0.05, "exponent": 1.3},
        lambda x, v, t, a: -300.0 * (0.05 / (0.05 + OUTERMOST - x)) ** 1.3,
    ),
    "harmonic_force": (
        {"force_N": 30.0, "frequency_Hz": 37.0, "phase_rad": 0.4},
        lambda x, v, t, a: 30.0 * np.cos(2 * np.pi * 37.0 * t + 0.4),
    ),
    "discovered_slider_force": (
        {"formula": "-a*v*|v| + b*sin(theta)^2 - exp(x)*sgn(v) + w*t", "coefficients": {"a": 0.3, "b": 7.0}},
        lambda x, v, t, a: -0.3 * v * np.abs(v) + 7 * np.sin(a) ** 2 - np.exp(x) * np.sign(v) + SPEED * t,
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_a_force_on_the_slider_asks_the_drive_for_its_virtual_work(name, worst):
    values, law = LAWS[name]
    made = mechanism(effect(name, **values), loose=(), offset=OFFSET, gravity=True)
    samples = simulate(made, options(start_angle=0.1)).samples
    exact = Closed(made, samples.crank_angle.to_numpy(), SPEED)
    force = law(exact.slider_position, exact.slider_rates[0], samples.time.to_numpy(), exact.angle)
    torque = exact.virtual_work_torque(force)
    worst("slider's forces: torque by virtual work", relative(samples.crank_torque, torque), 1e-12)
    assert np.abs(torque - exact.virtual_work_torque()).max() > 0.1
    guide = exact.reactions(force)[3]
    worst("slider's forces: guide force", relative(samples.guide_force, guide), 1e-12)


@pytest.mark.parametrize("name", LAWS)
def test_the_same_force_moves_a_slider_that_its_pin_has_let_go(name, worst):
    """In the free flight after the start nothing else acts on it."""
    values, law = LAWS[name]
    samples = simulate(mechanism(effect(name, **values), offset=OFFSET), options(start_angle=1.5)).samples
    free = samples[(samples.piston_pin_mode == "flight") & (samples.index < 3)]
    force = law(free.slider_position, free.slider_velocity, free.time, free.crank_angle)
    worst("slider's forces: acceleration in flight", np.abs(free.slider_acceleration * 0.4482 - force).max(), 1e-10)


def relative(seen, exact):
    return np.abs(np.asarray(seen) - exact).max() / np.abs(exact).max()


def guide_with_friction(exact, coefficient):
    """Guide force N = A + B F with F = -k |N| sgn v, that is A / (1 + B k sgn v sgn A), and sgn v."""
    sign = np.tanh(exact.slider_rates[0] / 0.01)
    free, slope = exact.reactions(0.0)[3], exact.reactions(1.0)[3] - exact.reactions(0.0)[3]
    return free / (1 + slope * coefficient * sign * np.sign(free)), sign


@pytest.mark.parametrize("coefficient", (0.1, 1.0))
def test_friction_in_proportion_to_the_guides_load_is_solved_for(coefficient, worst):
    made = mechanism(effect("slider_load_friction", coefficient=coefficient), loose=(), offset=OFFSET, gravity=True)
    samples = simulate(made, options()).samples
    exact = Closed(made, samples.crank_angle.to_numpy(), SPEED)
    guide, sign = guide_with_friction(exact, coefficient)
    worst("load friction: guide force", relative(samples.guide_force, guide), 1e-12)
    torque = exact.virtual_work_torque(-coefficient * np.abs(guide) * sign)
    worst("load friction: torque", relative(samples.crank_torque, torque), 1e-12)


def test_steep_load_friction_is_solved_for_where_it_works_against_the_load_and_refused_where_it_wedges(worst):
    made = mechanism(effect("slider_load_friction", coefficient=1.0), loose=(), offset=0.4, gravity=True)
    p = parameters(made, options(start_angle=5.4))
    angles = np.linspace(5.4, 6.1, 20)
    run = integrate_to_angles(p, start_state(p), angles, 1e-12)
    exact = Closed(made, angles, SPEED)
    guide, _ = guide_with_friction(exact, 1.0)
    assert np.abs(np.tan(exact.rod_angle)).min() > 1.1  # rounds of substitution would not settle
    worst("load friction: guide force", relative(run.observed(p)["guide_force"], guide), 1e-12)
    p = parameters(made, options(start_angle=4.8))
    with pytest.raises(SimulationError, match="holds itself"):
        integrate_to_angles(p, start_state(p), np.linspace(4.8, 5.0, 20), 1e-12)


def test_friction_of_ideal_pins_is_solved_for_together_with_their_reactions(worst):
    frictions = [effect("pin_friction", pin, coefficient=0.3) for pin in PINS]
    made = mechanism(*frictions, loose=(), offset=OFFSET, gravity=True)
    samples = simulate(made, options()).samples
    exact = Closed(made, samples.crank_angle.to_numpy(), SPEED)
    turning = np.tanh((exact.rod_rates[0] - SPEED) / 0.1), np.tanh(exact.rod_rates[0] / 0.1)
    moments = [np.zeros_like(exact.angle)] * 2
    for _ in range(100):
        forces = exact.reactions(0.0, *moments)
        moments = [-0.3 * 0.007 * np.hypot(*force) * sign for force, sign in zip(forces[:2], turning, strict=True)]
    worst("friction of ideal pins: guide force", relative(samples.guide_force, forces[3]), 1e-12)
    worst("friction of ideal pins: torque", relative(samples.crank_torque, forces[4]), 1e-12)
    np.testing.assert_allclose(samples.guide_moment, moments[1], atol=1e-12 * np.abs(moments[1]).max())
    assert np.abs(forces[4] - exact.reactions()[4]).max() > 0.01
