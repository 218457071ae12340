"""Ideal joints: closed-form kinematics, drives, torque by virtual work, reactions, frictions; a rod that bends."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.simulation import integrate_to_angles, simulate, start_state
from tests.dynamics.cases import ALL, MOTOR, PINS, ROD, SPEED, effect, integrated, mechanism, options
from tests.dynamics.closed import Closed
from tests.rows import each

EPSILON = np.finfo(float).eps
COUNTERWEIGHT = {"mass_centre": -0.02, "mass_centre_across": 0.03}
CASES = {
    "offset and gravity": ({"offset": 0.05, "gravity": True}, {}),
    "far offset, slow": ({"offset": -0.3, "gravity": True}, {"speed": 5.0}),
    "counterweight beside the line, fast": ({"gravity": True, "crank": COUNTERWEIGHT}, {"speed": 600.0}),
}


def off(seen, exact):
    """Largest deviation in units of the last place of the largest value."""
    return np.abs(np.asarray(seen) - exact).max() / np.abs(exact).max() / EPSILON


@pytest.fixture(params=CASES)
def pair(request):
    """Samples of a simulation and the closed form there."""
    keys, drive = CASES[request.param]
    made = mechanism(loose=(), **keys)
    samples = simulate(made, options(**drive)).samples
    return samples, Closed(made, samples.crank_angle.to_numpy(), drive.get("speed", SPEED))


def test_positions_rates_and_accelerations_are_those_of_the_closed_form(pair, worst):
    samples, exact = pair
    centre = exact.on_rod(exact.made.rod.mass_centre)[0]
    for name, value in {
        "rod_angle": exact.rod_angle,
        "transmission_angle": np.pi / 2 + exact.rod_angle,
        "rod_angular_velocity": exact.rod_rates[0],
        "slider_position": exact.slider_position,
        "slider_velocity": exact.slider_rates[0],
        "rod_position_x": centre[0],
        "rod_position_y": centre[1],
        "rod_velocity_x": exact.centre_rates[0][0],
        "rod_velocity_y": exact.centre_rates[0][1],
    }.items():
        worst("ideal joints: places and velocities [last places]", off(samples[name], value), 10)
    for name, value in {
        "rod_angular_acceleration": exact.rod_rates[1],
        "slider_acceleration": exact.slider_rates[1],
        "rod_acceleration_x": exact.centre_rates[1][0],
        "rod_acceleration_y": exact.centre_rates[1][1],
    }.items():
        worst("ideal joints: accelerations [last places]", off(samples[name], value), 50)


def test_reactions_are_those_of_newton_and_euler(pair, worst):
    samples, exact = pair
    pin, piston, frame, guide, torque = exact.reactions()
    for axis, along in enumerate("xy"):
        for name, value in {
            f"crank_pin_force_{along}": pin,
            f"piston_pin_force_{along}": piston,
            f"crank_pivot_force_{along}": frame,
            f"frame_force_{along}": -frame,
        }.items():
            worst("ideal joints: reactions [last places]", off(samples[name], value[axis]), 50)
    worst("ideal joints: reactions [last places]", off(samples.guide_force, guide), 50)
    for value in (torque, exact.virtual_work_torque()):
        worst("ideal joints: torque [last places]", off(samples.crank_torque, value), 50)
    for name, value in (("crank_pin", pin), ("piston_pin", piston), ("crank_pivot", frame)):
        worst("ideal joints: reactions [last places]", off(samples[f"{name}_normal_force"], np.hypot(*value)), 50)
        assert (samples[f"{name}_friction_force"] == 0).all()
    assert (samples.guide_moment == 0).all()


@each("loose", [(), *((joint,) for joint in ALL)])
def test_ideal_joints_stay_shut_and_say_so(loose):
    samples = simulate(mechanism(loose=loose), options()).samples
    for number, name in ((1, "crank_pivot"), (2, "crank_pin"), (3, "piston_pin")):
        assert (samples[f"r{number}"].max() > 1e-3) == (name in loose)
        ideal = samples[f"{name}_mode"] == "ideal"
        assert ideal.all() == samples[f"gamma{number}"].isna().all() == (name not in loose)


def of_largest(seen, exact):
    return np.abs(np.asarray(seen) - exact).max() / np.abs(exact).max()


@each("ratio, order, phase, loose", [(0.02, 2, 0.5, PINS), (0.3, 12, 4.0, ())])
def test_a_fluctuating_speed_follows_its_law_over_angle_and_time(ratio, order, phase, loose, worst):
    made = mechanism(effect("speed_fluctuation", ratio=ratio, order=order, phase_rad=phase), loose=loose)
    samples = simulate(made, options(start_angle=0.7, revolutions=2)).samples
    angle = samples.crank_angle.to_numpy()
    wave = ratio * np.cos(order * angle - phase)
    speed = SPEED * (1 + wave)
    worst("fluctuating speed: speed", of_largest(samples.crank_speed, speed), 1e-13)
    slope = -SPEED * ratio * order * np.sin(order * angle - phase) * speed
    assert np.abs(samples.crank_acceleration - slope).max() <= 1e-12 * SPEED**2

    def pace(_, a):
        return SPEED * (1 + ratio * np.cos(order * a - phase))

    time = samples.time.to_numpy()
    turned = solve_ivp(pace, (0.0, time[-1]), [0.7], "DOP853", t_eval=time, rtol=1e-13, atol=1e-13).y[0]
    worst("fluctuating speed: angle over time [rad]", np.abs(turned - angle).max(), 1e-10)


def kinetic_inertia(made, angle):
    """Inertia of crank, rod and slider as the crank feels it [kg m^2] and its derivative over the angle."""
    exact = Closed(made, angle, 1.0)
    rod, slider, crank = made.rod, made.slider, made.crank
    _, centre, bent = exact.on_rod(rod.mass_centre)
    _, end, end_bent = exact.on_rod(rod.length)
    turn, bend = exact.rod_primes
    inertia = rod.mass * (centre**2).sum(0) + rod.inertia * turn**2 + slider.mass * end[0] ** 2
    slope = 2 * (rod.mass * (centre * bent).sum(0) + rod.inertia * turn * bend + slider.mass * end[0] * end_bent[0])
    return inertia + crank.inertia + crank.mass * crank.mass_centre**2, slope


def test_a_motor_runs_up_as_lagranges_equation_says(worst):
    losses = [effect("crank_viscous_friction", damping_N_m_s=0.2), effect("crank_coulomb_friction", torque_N_m=3.0)]
    made = mechanism(*losses, effect("crank_unbalance", unbalance_kg_m=0.02, angle_rad=2.0), loose=(), gravity=True)
    start = {"speed": 5.0, "drive": MOTOR, "revolutions": 3, "start_angle": 0.3}
    samples = simulate(made, options(**start, tolerance=1e-14)).samples
    time = samples.time.to_numpy()

    def slope(_, z):
        angle, speed = z
        inertia, bend = (one[0] for one in kinetic_inertia(made, np.array([angle])))
        inertia += MOTOR["inertia"] + 0.02 * made.crank.length
        line = MOTOR["stall_torque"] * (1 - speed / MOTOR["no_load_speed"])
        centre = Closed(made, np.array([angle]), 1.0).on_rod(made.rod.mass_centre)[1][:, 0]
        weight = made.gravity[1] * (
            made.crank.mass * made.crank.mass_centre * np.cos(angle)
            + 0.02 * np.cos(angle + 2.0)
            + made.rod.mass * centre[1]
        )
        return speed, (line - 0.2 * speed - 3.0 * np.tanh(speed / 0.1) + weight - 0.5 * bend * speed**2) / inertia

    exact = solve_ivp(slope, (0, time[-1]), [0.3, 5.0], "DOP853", t_eval=time, rtol=1e-12, atol=1e-12).y
    worst("motor: run-up, angle [rad]", np.abs(exact[0] - samples.crank_angle).max(), 1e-9)
    worst("motor: run-up, speed", of_largest(samples.crank_speed, exact[1]), 1e-9)
    assert samples.crank_speed.iloc[-1] > 30


OFFSET = 0.05


def guide_with_friction(exact, coefficient):
    """Guide force N = A + B F with F = -k |N| sgn v, that is A / (1 + B k sgn v sgn A), and sgn v."""
    sign = np.tanh(exact.slider_rates[0] / 0.01)
    free, slope = exact.reactions(0.0)[3], exact.reactions(1.0)[3] - exact.reactions(0.0)[3]
    return free / (1 + slope * coefficient * sign * np.sign(free)), sign


def test_friction_in_proportion_to_the_guides_load_is_solved_for(worst):
    coefficient = 1.0
    made = mechanism(effect("slider_load_friction", coefficient=coefficient), loose=(), offset=OFFSET, gravity=True)
    samples = simulate(made, options()).samples
    exact = Closed(made, samples.crank_angle.to_numpy(), SPEED)
    guide, sign = guide_with_friction(exact, coefficient)
    worst("load friction: guide force", of_largest(samples.guide_force, guide), 1e-12)
    torque = exact.virtual_work_torque(-coefficient * np.abs(guide) * sign)
    worst("load friction: torque", of_largest(samples.crank_torque, torque), 1e-12)


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
    worst("friction of ideal pins: guide force", of_largest(samples.guide_force, forces[3]), 1e-12)
    worst("friction of ideal pins: torque", of_largest(samples.crank_torque, forces[4]), 1e-12)
    np.testing.assert_allclose(samples.guide_moment, moments[1], atol=1e-12 * np.abs(moments[1]).max())
    assert np.abs(forces[4] - exact.reactions()[4]).max() > 0.01


MASS, GRAVITY = 0.773, 9.80665


def bending(frequency, ratio=0.0):
    return effect("rod_flexibility", frequency_Hz=frequency, damping_ratio=ratio)


@each("ratio", (0.0, 0.05))
def test_a_rod_at_rest_rings_at_its_frequency_and_dies_away_with_its_damping(ratio, worst):
    slowly = {"speed": 1e-6}
    p = parameters(mechanism(bending(250.0, ratio), loose=()), options(**slowly))
    y, x = start_state(p)
    x[3] = 1e-4
    times = np.linspace(0.0, 0.1, 200)
    run = integrate_to_angles(p, (y, x), 1e-6 * times, 1e-15)
    angular_frequency = 2 * math.pi * 250.0
    damped = angular_frequency * math.sqrt(1 - ratio**2)
    swing = np.cos(damped * times) + ratio * angular_frequency / damped * np.sin(damped * times)
    exact = 1e-4 * np.exp(-ratio * angular_frequency * times) * swing
    worst("flexible rod: free vibration", np.abs(run.auxiliary_states[:, 3] - exact).max() / 1e-4, 1e-9)


def test_a_rod_at_rest_sags_under_its_weight_as_a_beam_does(worst):
    """First mode of w'''' = rho g / EI with both ends pinned: 4 rho g l^4 / (pi^5 EI); and EI from the frequency."""
    frequency, heavy = 50.0, mechanism(bending(50.0, 0.9), loose=(), gravity=True)
    p = parameters(heavy, options(speed=1e-6))
    run = integrate_to_angles(p, start_state(p), 1e-6 * np.array([0.0, 1.0]), 1e-15)
    line_mass = MASS / ROD
    rigidity = line_mass * (2 * math.pi * frequency) ** 2 * ROD**4 / math.pi**4
    sag = -4 * line_mass * GRAVITY * ROD**4 / (math.pi**5 * rigidity)
    worst("flexible rod: sag", abs(run.auxiliary_states[-1, 3] / sag - 1), 1e-9)


def test_the_deflection_obeys_the_modal_equation_of_the_beam(worst):
    """q'' + 2 zeta w0 q' + (w0^2 - turn^2) q = -4/pi times the acceleration of midspan across the rod."""
    made = mechanism(bending(100.0, 0.02), loose=(), offset=0.05, gravity=True)
    p, run = integrated(made, np.arange(0, 361), 1e-14)
    angular_frequency = 2 * math.pi * 100.0

    def slope(time, z):
        exact = Closed(made, np.array([SPEED * time]), SPEED)
        middle = exact.rated(*exact.on_rod(0.5 * ROD)[1:])[1][:, 0] - made.gravity
        angle, turn = exact.rod_angle[0], exact.rod_rates[0][0]
        across = middle[1] * math.cos(angle) - middle[0] * math.sin(angle)
        return z[1], -0.04 * angular_frequency * z[1] - (angular_frequency**2 - turn**2) * z[0] - 4 / math.pi * across

    found = solve_ivp(slope, (0, run.times[-1]), [0, 0], "DOP853", t_eval=run.times, rtol=1e-12, atol=1e-16).y[0]
    worst("flexible rod: modal equation [m]", np.abs(found - run.observed(p)["rod_deflection"]).max(), 1e-11)
    assert np.abs(found).max() > 1e-3
