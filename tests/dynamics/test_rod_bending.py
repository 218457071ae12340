"""The flexible rod against beam theory and against its modal equation at closed-form kinematics."""

import math

import numpy as np
from scipy.integrate import solve_ivp

from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.simulation import integrate_to_angles, start_state
from tests.dynamics.cases import ROD, SPEED, effect, integrated, mechanism, options
from tests.dynamics.closed import Closed
from tests.rows import each

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
