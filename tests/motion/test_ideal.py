"""Ideal joints and a bending rod: closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointgap.motion.simulation import integrate_to_angles, observed
from jointgap.motion.slider_crank import model_of, simulate, start_state
from tests.motion.cases import (
    ALL,
    MOTOR,
    PINS,
    ROD,
    SPEED,
    effect,
    integrated,
    mechanism,
    options,
)
from tests.motion.closed import Closed

COUNTERWEIGHT = {"mass_centre": -0.02, "mass_centre_across": 0.03}


def of_largest(seen, exact):
    """Largest deviation over the largest value."""
    return np.abs(np.asarray(seen) - exact).max() / np.abs(exact).max()


@pytest.mark.parametrize(
    "keys, drive",
    [
        ({"offset": 0.05}, {}),
        ({"offset": -0.3}, {"speed": 5.0}),
        ({"crank": COUNTERWEIGHT}, {"speed": 600.0}),
    ],
)
def test_motion_and_reactions_are_exact(keys, drive, worst):
    made = mechanism(loose=(), gravity=True, **keys)
    samples = simulate(made, options(**drive)).samples
    exact = Closed(made, samples.crank_angle.to_numpy(), drive.get("speed", SPEED))
    pin, piston, frame, guide, torque = exact.reactions()
    centre = exact.on_rod(made.rod.mass_centre)[0]
    places = {
        "rod_angle": exact.rod_angle,
        "transmission_angle": np.pi / 2 + exact.rod_angle,
        "rod_angular_velocity": exact.rod_rates[0],
        "slider_position": exact.slider_position,
        "slider_velocity": exact.slider_rates[0],
    }
    accelerations = {
        "rod_angular_acceleration": exact.rod_rates[1],
        "slider_acceleration": exact.slider_rates[1],
    }
    forces = {"guide_force": guide}
    for i, axis in enumerate("xy"):
        places |= {
            f"rod_position_{axis}": centre[i],
            f"rod_velocity_{axis}": exact.centre_rates[0][i],
        }
        accelerations[f"rod_acceleration_{axis}"] = exact.centre_rates[1][i]
        forces[f"frame_force_{axis}"] = -frame[i]
    for name, value in (("crank_pin", pin), ("piston_pin", piston), ("crank_pivot", frame)):
        forces |= {f"{name}_force_{axis}": value[i] for i, axis in enumerate("xy")}
        forces[f"{name}_normal_force"] = np.hypot(*value)
        assert (samples[f"{name}_friction_force"] == 0).all()
    assert (samples.guide_moment == 0).all()
    epsilon = np.finfo(float).eps
    for what, bound, columns in (
        ("positions, velocities", 10, places),
        ("accelerations", 50, accelerations),
        ("reactions", 50, forces),
    ):
        for name, value in columns.items():
            off = of_largest(samples[name], value) / epsilon
            worst(f"ideal joints: {what} [last places]", off, bound)
    for value in (torque, exact.virtual_work_torque()):
        off = of_largest(samples.crank_torque, value) / epsilon
        worst("ideal joints: torque [last places]", off, 50)


@pytest.mark.parametrize("loose", [(), *((joint,) for joint in ALL)])
def test_ideal_joints_stay_closed(loose):
    samples = simulate(mechanism(loose=loose), options()).samples
    for number, name in enumerate(ALL, 1):
        assert (samples[f"r{number}"].max() > 1e-3) == (name in loose)
        ideal = samples[f"{name}_mode"] == "ideal"
        assert ideal.all() == samples[f"gamma{number}"].isna().all() == (name not in loose)


@pytest.mark.parametrize("ratio, order, phase, loose", [(0.02, 2, 0.5, PINS), (0.3, 12, 4.0, ())])
def test_a_fluctuating_speed_follows_its_law(ratio, order, phase, loose, worst):
    made = mechanism(
        effect("speed_fluctuation", ratio=ratio, order=order, phase_rad=phase), loose=loose
    )
    samples = simulate(made, options(start_angle=0.7, revolutions=2)).samples
    angle, time = samples.crank_angle.to_numpy(), samples.time.to_numpy()

    def pace(_, a):
        return SPEED * (1 + ratio * np.cos(order * a - phase))

    worst("fluctuating speed: speed", of_largest(samples.crank_speed, pace(0, angle)), 1e-13)
    slope = -SPEED * ratio * order * np.sin(order * angle - phase) * pace(0, angle)
    assert np.abs(samples.crank_acceleration - slope).max() <= 1e-12 * SPEED**2
    turned = solve_ivp(
        pace, (0.0, time[-1]), [0.7], "DOP853", t_eval=time, rtol=1e-13, atol=1e-13
    ).y[0]
    worst("fluctuating speed: angle over time [rad]", np.abs(turned - angle).max(), 1e-10)


def test_a_motor_accelerates_by_lagranges_equation(worst):
    effects = [
        effect("crank_viscous_friction", damping_N_m_s=0.2),
        effect("crank_coulomb_friction", torque_N_m=3.0),
        effect("crank_unbalance", unbalance_kg_m=0.02, angle_rad=2.0),
    ]
    made = mechanism(*effects, loose=(), gravity=True)
    start = {"speed": 5.0, "drive": MOTOR, "revolutions": 3, "start_angle": 0.3}
    samples = simulate(made, options(**start, tolerance=1e-14)).samples
    time = samples.time.to_numpy()

    def slope(_, z):
        angle, speed = z
        still, moved = Closed(
            made, np.full(2, angle), speed, np.array([0.0, 1.0])
        ).virtual_work_torque()
        inertia = moved - still + MOTOR["inertia"] + 0.02 * made.crank.length
        line = MOTOR["stall_torque"] * (1 - speed / MOTOR["no_load_speed"])
        weight = 0.02 * made.gravity[1] * np.cos(angle + 2.0)
        return speed, (line - 0.2 * speed - 3.0 * np.tanh(speed / 0.1) + weight - still) / inertia

    exact = solve_ivp(
        slope, (0, time[-1]), [0.3, 5.0], "DOP853", t_eval=time, rtol=1e-12, atol=1e-12
    ).y
    worst("motor: run-up, angle [rad]", np.abs(exact[0] - samples.crank_angle).max(), 1e-9)
    worst("motor: run-up, speed", of_largest(samples.crank_speed, exact[1]), 1e-9)
    assert samples.crank_speed.iloc[-1] > 30


def test_guide_load_friction_is_solved_for(worst):
    """Guide force N = A + B F with F = -k |N| sgn v, that is A / (1 + B k sgn v sgn A), k = 1."""
    made = mechanism(
        effect("slider_load_friction", coefficient=1.0), loose=(), offset=0.05, gravity=True
    )
    samples = simulate(made, options()).samples
    exact = Closed(made, samples.crank_angle.to_numpy(), SPEED)
    sign = np.tanh(exact.slider_rates[0] / 0.01)
    free, slope = exact.reactions(0.0)[3], exact.reactions(1.0)[3] - exact.reactions(0.0)[3]
    guide = free / (1 + slope * sign * np.sign(free))
    worst("load friction: guide force", of_largest(samples.guide_force, guide), 1e-12)
    torque = exact.virtual_work_torque(-np.abs(guide) * sign)
    worst("load friction: torque", of_largest(samples.crank_torque, torque), 1e-12)


MASS, GRAVITY = 0.773, 9.80665


def bending(frequency, ratio=0.0):
    return effect("rod_flexibility", frequency_Hz=frequency, damping_ratio=ratio)


def deflection(made, times, start=0.0):
    """Deflection (n,) [m] of the rod of a mechanism nearly at rest."""
    model = model_of(made, options(speed=1e-6))
    y, bend = start_state(model), model.positions - 1
    y[bend] = start
    return integrate_to_angles(model, y, 1e-6 * times, 1e-15).states[:, bend]


@pytest.mark.parametrize("ratio", (0.0, 0.05))
def test_a_rod_at_rest_rings_with_its_frequency_and_damping(ratio, worst):
    times, angular_frequency = np.linspace(0.0, 0.1, 200), 2 * math.pi * 250.0
    damped = angular_frequency * math.sqrt(1 - ratio**2)
    swing = np.cos(damped * times) + ratio * angular_frequency / damped * np.sin(damped * times)
    exact = 1e-4 * np.exp(-ratio * angular_frequency * times) * swing
    found = deflection(mechanism(bending(250.0, ratio), loose=()), times, 1e-4)
    worst("flexible rod: free vibration", np.abs(found - exact).max() / 1e-4, 1e-9)


def test_a_rod_at_rest_sags_like_a_beam(worst):
    """First mode of a pinned beam: sag 4 rho g l^4 / (pi^5 EI), with EI from the frequency."""
    frequency, line_mass = 50.0, MASS / ROD
    rigidity = line_mass * (2 * math.pi * frequency) ** 2 * ROD**4 / math.pi**4
    sag = -4 * line_mass * GRAVITY * ROD**4 / (math.pi**5 * rigidity)
    found = deflection(
        mechanism(bending(frequency, 0.9), loose=(), gravity=True), np.array([0.0, 1.0])
    )
    worst("flexible rod: sag", abs(found[-1] / sag - 1), 1e-9)


def test_the_deflection_solves_the_modal_equation(worst):
    """q'' + 2 zeta w0 q' + (w0^2 - turn^2) q = -4/pi times the acceleration of midspan across the
    rod."""
    made = mechanism(bending(100.0, 0.02), loose=(), offset=0.05, gravity=True)
    model, run = integrated(made, np.arange(0, 361), 1e-14)
    angular_frequency = 2 * math.pi * 100.0

    def slope(time, z):
        exact = Closed(made, np.array([SPEED * time]), SPEED)
        middle = exact.rated(*exact.on_rod(0.5 * ROD)[1:])[1][:, 0] - made.gravity
        angle, turn = exact.rod_angle[0], exact.rod_rates[0][0]
        across = middle[1] * math.cos(angle) - middle[0] * math.sin(angle)
        force = -(angular_frequency**2 - turn**2) * z[0] - 4 / math.pi * across
        return z[1], force - 0.04 * angular_frequency * z[1]

    found = solve_ivp(
        slope, (0, run.times[-1]), [0, 0], "DOP853", t_eval=run.times, rtol=1e-12, atol=1e-16
    ).y[0]
    off = np.abs(found - observed(model, run)["rod_deflection"]).max()
    worst("flexible rod: modal equation [m]", off, 1e-11)
    assert np.abs(found).max() > 1e-3
