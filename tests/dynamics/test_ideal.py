"""Ideal joints: closed-form kinematics, drive torque by virtual work and reactions, to machine precision."""

import numpy as np
import pytest

from jointgap.dynamics.simulation import simulate
from tests.dynamics.cases import ALL, SPEED, effect, mechanism, options
from tests.dynamics.closed import Closed

EPSILON = np.finfo(float).eps
COUNTERWEIGHT = {"mass_centre": -0.02, "mass_centre_across": 0.03}
CASES = {
    "plain": ({}, {}),
    "offset and gravity": ({"offset": 0.05, "gravity": True}, {}),
    "far offset, slow": ({"offset": -0.3, "gravity": True}, {"speed": 5.0}),
    "counterweight beside the line": ({"gravity": True, "crank": COUNTERWEIGHT}, {}),
    "fast": ({}, {"speed": 600.0, "start_angle": 1.0}),
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


def test_the_transmission_angle_is_that_of_equation_10(pair, worst):
    samples, exact = pair
    worst("ideal joints: equation 10 [last places]", off(samples.transmission_angle, np.pi / 2 + exact.rod_angle), 5)


def test_the_drive_does_the_virtual_work(pair, worst):
    samples, exact = pair
    torque = exact.virtual_work_torque()
    worst("ideal joints: torque by virtual work [last places]", off(samples.crank_torque, torque), 50)


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
    worst("ideal joints: reactions [last places]", off(samples.crank_torque, torque), 50)
    for name, value in (("crank_pin", pin), ("piston_pin", piston), ("crank_pivot", frame)):
        worst("ideal joints: reactions [last places]", off(samples[f"{name}_normal_force"], np.hypot(*value)), 50)
        assert (samples[f"{name}_friction_force"] == 0).all()
    assert (samples.guide_moment == 0).all()


def test_ideal_joints_stay_shut_and_say_so(pair):
    samples, _ = pair
    for number, joint in ((1, "crank_pivot"), (2, "crank_pin"), (3, "piston_pin")):
        assert (samples[[f"r{number}{dots}" for dots in ("", "_dot", "_ddot")]] == 0).all(axis=None)
        assert samples[[f"gamma{number}{dots}" for dots in ("", "_dot", "_ddot")]].isna().all(axis=None)
        assert (samples[f"{joint}_mode"] == "ideal").all()


@pytest.mark.parametrize("joint", ALL)
def test_beside_a_loose_joint_the_others_stay_shut(joint):
    samples = simulate(mechanism(loose=(joint,)), options()).samples
    for number, name in ((1, "crank_pivot"), (2, "crank_pin"), (3, "piston_pin")):
        assert (samples[f"r{number}"].max() > 1e-3) == (name == joint)
        assert (samples[f"{name}_mode"] == "ideal").all() == (name != joint)


def test_lengths_offset_and_mass_beyond_nominal_are_lengths_offset_and_mass():
    beyond = [
        effect("link_length_error", crank_m=0.001, rod_m=-0.002),
        effect("slider_offset", offset_m=0.01),
        effect("added_slider_mass", mass_kg=0.1),
    ]
    samples = simulate(mechanism(*beyond, loose=()), options()).samples
    made = mechanism(*beyond, loose=()).applied()
    assert (made.crank.length, made.rod.length, made.slider.offset) == pytest.approx((0.151, 0.562, 0.01), rel=1e-14)
    assert made.slider.mass == pytest.approx(0.5482, rel=1e-14)
    exact = Closed(made, samples.crank_angle.to_numpy(), SPEED)
    assert off(samples.slider_position, exact.slider_position) < 10
    assert off(samples.crank_torque, exact.virtual_work_torque()) < 50
