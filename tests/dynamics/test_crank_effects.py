"""Drives and effects on the crank: fluctuating speed, motor, unbalance, friction of the bearings."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointgap.dynamics.simulation import simulate
from tests.dynamics.cases import ALL, MOTOR, PINS, SPEED, effect, mechanism, options
from tests.dynamics.closed import Closed


def relative(seen, exact):
    return np.abs(np.asarray(seen) - exact).max() / np.abs(exact).max()


@pytest.mark.parametrize(("ratio", "order", "phase"), [(0.02, 2, 0.5), (0.3, 1, -2.0), (0.3, 12, 4.0), (0.0, 3, 1.0)])
@pytest.mark.parametrize("loose", ((), PINS))
def test_a_fluctuating_speed_follows_its_law_over_angle_and_time(ratio, order, phase, loose, worst):
    made = mechanism(effect("speed_fluctuation", ratio=ratio, order=order, phase_rad=phase), loose=loose)
    samples = simulate(made, options(start_angle=0.7, revolutions=2)).samples
    angle = samples.crank_angle.to_numpy()
    wave = ratio * np.cos(order * angle - phase)
    speed = SPEED * (1 + wave)
    worst("fluctuating speed: speed", relative(samples.crank_speed, speed), 1e-13)
    slope = -SPEED * ratio * order * np.sin(order * angle - phase) * speed
    assert np.abs(samples.crank_acceleration - slope).max() <= 1e-12 * SPEED**2

    def pace(_, a):
        return SPEED * (1 + ratio * np.cos(order * a - phase))

    time = samples.time.to_numpy()
    turned = solve_ivp(pace, (0.0, time[-1]), [0.7], "DOP853", t_eval=time, rtol=1e-13, atol=1e-13).y[0]
    worst("fluctuating speed: angle over time [rad]", np.abs(turned - angle).max(), 1e-10)


def test_a_fluctuating_drive_gives_the_torque_of_the_closed_form(worst):
    made = mechanism(effect("speed_fluctuation", ratio=0.1, order=2, phase_rad=0.5), loose=(), gravity=True)
    samples = simulate(made, options()).samples
    exact = Closed(made, *(samples[f"crank_{name}"].to_numpy() for name in ("angle", "speed", "acceleration")))
    worst("fluctuating speed: torque", relative(samples.crank_torque, exact.virtual_work_torque()), 1e-13)
    assert relative(samples.slider_acceleration, exact.slider_rates[1]) < 1e-13


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


@pytest.mark.parametrize(
    "extra",
    ([], [effect("crank_viscous_friction", damping_N_m_s=0.2), effect("crank_coulomb_friction", torque_N_m=3.0)]),
)
def test_a_motor_runs_up_as_lagranges_equation_says(extra, worst):
    made = mechanism(*extra, effect("crank_unbalance", unbalance_kg_m=0.02, angle_rad=2.0), loose=(), gravity=True)
    start = {"speed": 5.0, "drive": MOTOR, "revolutions": 3, "start_angle": 0.3}
    samples = simulate(made, options(**start, tolerance=1e-14)).samples
    time = samples.time.to_numpy()

    def slope(_, z):
        angle, speed = z
        inertia, bend = (one[0] for one in kinetic_inertia(made, np.array([angle])))
        inertia += MOTOR["inertia"] + 0.02 * made.crank.length
        line = MOTOR["stall_torque"] * (1 - speed / MOTOR["no_load_speed"])
        losses = 0.2 * speed + 3.0 * np.tanh(speed / 0.1) if extra else 0.0
        centre = Closed(made, np.array([angle]), 1.0).on_rod(made.rod.mass_centre)[1][:, 0]
        weight = made.gravity[1] * (
            made.crank.mass * made.crank.mass_centre * np.cos(angle)
            + 0.02 * np.cos(angle + 2.0)
            + made.rod.mass * centre[1]
        )
        return speed, (line - losses + weight - 0.5 * bend * speed**2) / inertia

    exact = solve_ivp(slope, (0, time[-1]), [0.3, 5.0], "DOP853", t_eval=time, rtol=1e-12, atol=1e-12).y
    worst("motor: run-up, angle [rad]", np.abs(exact[0] - samples.crank_angle).max(), 1e-9)
    worst("motor: run-up, speed", relative(samples.crank_speed, exact[1]), 1e-9)
    assert samples.crank_speed.iloc[-1] > 30


def test_a_motor_with_a_flywheel_keeps_the_speed_at_which_torque_and_load_balance():
    friction, damping, stroke = 40.0, 0.05, 2 * 0.15
    lost = friction * 2 * stroke / (2 * np.pi)  # per radian: over the stroke and back against the slider's friction
    slope = MOTOR["stall_torque"] / MOTOR["no_load_speed"]
    steady = (MOTOR["stall_torque"] - lost) / (slope + damping)
    made = mechanism(
        effect("slider_coulomb_friction", force_N=friction),
        effect("crank_viscous_friction", damping_N_m_s=damping),
        loose=(),
    )
    motor = MOTOR | {"inertia": 100.0}
    samples = simulate(made, options(speed=steady, drive=motor, revolutions=1)).samples
    assert samples.crank_speed.iloc[-1] == pytest.approx(steady, rel=1e-5)
    other = simulate(made, options(speed=1.1 * steady, drive=motor, revolutions=1)).samples
    pulled = 100.0 / (slope + damping)  # [s] in which a deviation falls by e
    expected = 0.1 * np.exp(-other.time.iloc[-1] / pulled)
    assert other.crank_speed.iloc[-1] / steady - 1 == pytest.approx(expected, rel=1e-3)


def test_an_unbalance_pulls_at_the_frame_and_leaves_the_pins_alone(worst):
    plain, heavy = (
        simulate(mechanism(*effects, loose=(), gravity=True), options()).samples
        for effects in ([], [effect("crank_unbalance", unbalance_kg_m=0.02, angle_rad=2.0)])
    )
    direction = plain.crank_angle + 2.0
    pull = 0.02 * SPEED**2
    force_x, force_y = pull * np.cos(direction), pull * np.sin(direction) - 0.02 / 0.15 * 9.80665
    worst("unbalance: frame force", relative(heavy.frame_force_x - plain.frame_force_x, force_x), 1e-12)
    worst("unbalance: frame force", relative(heavy.frame_force_y - plain.frame_force_y, force_y), 1e-12)
    weight = 0.02 * 9.80665 * np.cos(direction)
    worst("unbalance: torque", relative(heavy.crank_torque - plain.crank_torque, weight), 1e-12)
    for name in ("crank_pin_force_x", "crank_pin_force_y", "guide_force", "slider_position"):
        np.testing.assert_array_equal(heavy[name], plain[name])


@pytest.mark.parametrize("loose", ((), PINS, ALL))
def test_friction_of_the_cranks_bearings_is_asked_of_the_drive_alone(loose, worst):
    frictions = [
        effect("crank_coulomb_friction", torque_N_m=0.3),
        effect("crank_angle_friction", torque_N_m=0.2, tightest_angle_rad=1.0, varying_share=0.7),
        effect("crank_viscous_friction", damping_N_m_s=0.01),
        effect("discovered_crank_torque", formula="-c*w^2*cos(theta)", coefficients={"c": 1e-4}),
        effect("crank_periodic_torque", torque_N_m=0.4, order=12, phase_rad=0.7),
    ]
    plain, rubbed = (simulate(mechanism(*effects, loose=loose), options()).samples for effects in ([], frictions))
    added = 0.3 + 0.01 * SPEED + 1e-4 * SPEED**2 * np.cos(plain.crank_angle)
    added = added - 0.4 * np.cos(12 * plain.crank_angle - 0.7)
    added = added + 0.2 * (0.3 + 0.7 * np.cos((plain.crank_angle - 1.0) / 2) ** 2)
    difference = np.abs(rubbed.crank_torque - plain.crank_torque - added).max()
    worst("friction of the crank's bearings: torque", difference / np.abs(plain.crank_torque).max(), 1e-14)
    np.testing.assert_array_equal(rubbed.slider_position, plain.slider_position)
