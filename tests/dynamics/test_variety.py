"""Mechanisms of all kinds run through, and a simulation is the same every time."""

import numpy as np
import pytest

from jointgap.dynamics.contact import LAWS
from jointgap.dynamics.parameters import parameters
from jointgap.dynamics.simulate import run_march
from jointgap.dynamics.start import start_state
from tests.dynamics.cases import mechanism


def any_case(random):
    """A mechanism, speed [rad/s], start angle [rad] and tolerance [m]."""
    made = mechanism(
        friction=float(random.choice([0, 0.01, 0.05, 0.2])),
        friction_speed=float(random.choice([1e-3, 1e-2])),
        restitution=float(random.uniform(0.05, 0.98)),
        law=str(random.choice(["lankarani_nikravesh", "exact_restitution"])),
        offset=float(random.choice([0, 0.05])),
        gravity=bool(random.integers(2)),
        journals=(str(random.choice(["crank", "rod"])), str(random.choice(["slider", "rod"]))),
        bearing_radius=0.007 + float(random.choice([1e-3, 2e-4, 5e-5])),
    )
    return made, *(float(random.choice(of)) for of in ([5, 60, 300], np.linspace(0, 6, 61), [1e-9, 1e-11, 1e-13]))


def runs_through(seed, count):
    random = np.random.default_rng(seed)
    for _ in range(count):
        made, speed, start_angle, tolerance = any_case(random)
        p = parameters(made, speed, start_angle)
        run = run_march(p, start_state(p), np.linspace(0, 4 * np.pi / speed, 200), tolerance)
        assert np.isfinite(run.states).all()
        ends = np.array([run.states[:, :2], run.states[:, :2]])
        along = np.stack((np.cos(run.states[:, 2]), np.sin(run.states[:, 2])), axis=1)
        ends[0] -= p.rod_to_crank_end * along
        ends[1] += p.rod_to_piston_end * along
        angle = start_angle + np.linspace(0, 4 * np.pi, 200)
        pin = p.crank_length * np.stack((np.cos(angle), np.sin(angle)), axis=1)
        piston = np.stack((run.states[:, 3], np.full(200, p.slider_offset)), axis=1)
        for centre, end, joint in zip((pin, piston), ends, (p.crank_pin, p.piston_pin), strict=True):
            # the rings hold their pins: the surfaces give way by tenths of a millimetre at most
            assert np.hypot(*(end - centre).T).max() < joint.clearance + 3e-4


@pytest.mark.parametrize("seed", range(4))
def test_mechanisms_of_all_kinds_run_through(seed):
    runs_through(seed, 10)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 110))
def test_very_many_mechanisms_run_through(seed):
    runs_through(seed, 200)


@pytest.mark.parametrize("law", LAWS)
def test_a_simulation_is_the_same_to_the_last_bit_every_time(law):
    p = parameters(mechanism(), 60.0, 1.0)
    p = p._replace(crank_pin=p.crank_pin._replace(damping=LAWS[law](0.4)))
    times = np.linspace(0, 0.1, 100)
    one, two = (run_march(p, start_state(p), times, 1e-10) for _ in range(2))
    np.testing.assert_array_equal(one.states, two.states)
    np.testing.assert_array_equal(one.events, two.events)
