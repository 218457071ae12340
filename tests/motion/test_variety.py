"""Random mechanisms."""

import numpy as np
import pytest

from jointgap.config.friction_laws import FRICTION_LAWS
from jointgap.motion.simulation import crank_angles, integrate_to_angles
from jointgap.motion.slider_crank import model_of, start_state
from tests.motion.cases import ALL, PINS, effect, mechanism, options


def any_case(random, films):
    """A mechanism and its options; `films` are slow at low speed."""
    loose, motor_driven = [joint for joint in ALL if random.random() < 0.7], random.random() < 0.3
    effects = [
        effect("slider_load_friction", coefficient=float(random.uniform(0, 1))),
        effect("slider_coulomb_friction", force_N=20.0),
        effect(
            "rod_flexibility", frequency_Hz=float(random.uniform(300, 2000)), damping_ratio=0.02
        ),
        *(
            []
            if motor_driven
            else [effect("speed_fluctuation", ratio=0.1, order=int(random.integers(1, 13)))]
        ),
        *(effect("pin_friction", pin, coefficient=float(random.uniform(0, 0.6))) for pin in PINS),
        *(
            effect("lubricated_joint", pin, viscosity_Pa_s=0.01, length_m=0.01)
            for pin in PINS
            if films and pin in loose
        ),
    ]
    made = mechanism(
        *(one for one in effects if random.random() < 0.2),
        loose=loose,
        friction=float(random.choice([0, 0.01, 0.05, 0.2])),
        friction_speed=float(random.choice([1e-3, 1e-2])),
        friction_law=str(random.choice(["coulomb", "coulomb", *FRICTION_LAWS])),
        restitution=float(random.uniform(0.05, 0.98)),
        law=str(random.choice(["lankarani_nikravesh", "exact_restitution"])),
        offset=float(random.choice([0, 0.05])),
        gravity=bool(random.integers(2)),
        journals=(str(random.choice(["crank", "rod"])), str(random.choice(["slider", "rod"]))),
        clearance=float(random.choice([1e-3, 2e-4, 5e-5])),
    )
    speed = float(random.choice([5, 60, 300]))
    motor = {"kind": "motor", "stall_torque": 0.2 * speed**2 + 10}
    motor |= {"no_load_speed": 2 * speed, "inertia": 0.5}
    started = options(
        speed=speed,
        start_angle=float(random.choice(np.linspace(0, 6, 61))),
        tolerance=float(random.choice([1e-9, 1e-11, 1e-13])),
        revolutions=2,
        samples_per_revolution=100,
        **({"drive": motor} if motor_driven else {}),
    )
    return made, started


def runs_through(seed, count, films=False):
    random = np.random.default_rng(seed)
    for _ in range(count):
        made, started = any_case(random, films)
        model = model_of(made, started)
        assert {*model.loose} == {*made.loose}
        run = integrate_to_angles(
            model, start_state(model), crank_angles(started), started.tolerance
        )
        assert np.isfinite(run.states).all()
        for name in model.loose:
            vector, _ = model.vector(run.states, name)
            # the rings hold their pins: at 300 rad/s some hits of 300 kN press them in by a third
            # of a millimetre
            assert np.hypot(*vector.T).max() <= made.clearance(name) + 7e-4


def test_random_mechanisms_can_be_simulated():
    runs_through(0, 8)


@pytest.mark.slow
def test_many_random_mechanisms_can_be_simulated():
    for seed in range(100, 110):
        runs_through(seed, 50, films=True)


def test_simulations_are_bitwise_reproducible():
    model = model_of(mechanism(loose=ALL, friction=0.1), options(speed=60.0, start_angle=1.0))
    angles = np.linspace(1.0, 7.0, 100)
    one, two = (integrate_to_angles(model, start_state(model), angles, 1e-10) for _ in range(2))
    np.testing.assert_array_equal(one.states, two.states)
    np.testing.assert_array_equal(one.events, two.events)
