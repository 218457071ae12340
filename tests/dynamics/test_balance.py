"""Energy and momentum of the whole mechanism, integrated over its motion."""

import numpy as np
import pytest

from tests.dynamics.cases import SPEED, mechanism
from tests.dynamics.quadrature import motion

CASES = {
    "frictionless": {},
    "with friction": {"friction": 0.1, "friction_speed": 0.1},
    "journals on the rod, gravity, offset": {
        "friction": 0.1,
        "friction_speed": 0.1,
        "journals": ("rod", "rod"),
        "gravity": True,
        "offset": 0.03,
        "law": "exact_restitution",
    },
}


@pytest.fixture(scope="module", params=CASES)
def moved(request):
    return motion(mechanism(**CASES[request.param]), revolutions=0.5)


def close(balance, scale, relative):
    assert np.abs(balance).max() <= relative * np.abs(scale).max()


def test_work_of_the_drive_becomes_motion_strain_and_heat(moved):
    p = moved.p
    kinetic = 0.5 * (
        (moved.state(4) ** 2 + moved.state(5) ** 2) / p.rod_inverse_mass
        + moved.state(6) ** 2 / p.rod_inverse_inertia
        + p.slider_mass * moved.state(7) ** 2
    )
    angle = SPEED * moved.times
    height = (
        p.crank_mass * p.crank_mass_centre * np.sin(angle) + moved.state(1) / p.rod_inverse_mass
    )  # the slider keeps its height
    energy = kinetic - p.gravity_y * height
    power = SPEED * moved["crank_torque"]
    loss = np.zeros_like(power)
    for number, name, joint, partner_rate in (
        (2, "crank_pin", p.crank_pin, SPEED),
        (3, "piston_pin", p.piston_pin, 0.0),
    ):
        depth = np.maximum(moved[f"r{number}"] - joint.clearance, 0.0)
        apart = moved.run.modes[:, number - 2].reshape(depth.shape) == 0
        elastic = np.where(apart, 0.0, joint.stiffness * depth**joint.exponent)
        energy = energy + elastic * depth / (joint.exponent + 1)
        sliding = (
            np.nan_to_num(moved[f"r{number}"] * moved[f"gamma{number}_dot"])
            + joint.side * (joint.rod_radius * moved.state(6) - joint.partner_radius * partner_rate)
            - 0.5 * depth * (moved.state(6) + partner_rate)
        )
        loss = loss + (moved[f"{name}_normal_force"] - elastic) * moved[f"r{number}_dot"]
        loss = loss - moved[f"{name}_friction_force"] * sliding
    assert (loss > -1e-6).all()
    balance = energy[:, -1] - energy[0, 0] + moved.integral(loss) - moved.integral(power)
    close(balance, kinetic, 1e-9)


def test_linear_momentum_changes_by_the_reactions_of_frame_and_guide(moved):
    p = moved.p
    angle = SPEED * moved.times
    arm = p.crank_mass * p.crank_mass_centre * SPEED
    mass = p.crank_mass + 1 / p.rod_inverse_mass + p.slider_mass
    along = -arm * np.sin(angle) + moved.state(4) / p.rod_inverse_mass + p.slider_mass * moved.state(7)
    across = arm * np.cos(angle) + moved.state(5) / p.rod_inverse_mass
    push = moved.integral(p.gravity_x * mass - moved["frame_force_x"])
    lift = moved.integral(p.gravity_y * mass - moved["frame_force_y"] + moved["guide_force"])
    close(along[:, -1] - along[0, 0] - push, along, 1e-9)
    close(across[:, -1] - across[0, 0] - lift, across, 1e-9)


def test_angular_momentum_changes_by_drive_guide_and_weight(moved):
    p = moved.p
    angle = SPEED * moved.times
    x, y, slider = moved.state(0), moved.state(1), moved.state(3)
    rod_mass = 1 / p.rod_inverse_mass
    spin = (
        rod_mass * (x * moved.state(5) - y * moved.state(4))
        + moved.state(6) / p.rod_inverse_inertia
        - p.slider_mass * p.slider_offset * moved.state(7)
    )  # the crank's is constant
    weight_x = p.crank_mass * p.crank_mass_centre * np.cos(angle) + rod_mass * x + p.slider_mass * slider
    weight_y = p.crank_mass * p.crank_mass_centre * np.sin(angle) + rod_mass * y + p.slider_mass * p.slider_offset
    moment = (
        moved["crank_torque"]
        + moved["guide_moment"]
        + slider * moved["guide_force"]
        + weight_x * p.gravity_y
        - weight_y * p.gravity_x
    )
    close(spin[:, -1] - spin[0, 0] - moved.integral(moment), spin, 1e-9)


@pytest.mark.parametrize("joint", (2, 3))
@pytest.mark.parametrize("symbol", ("r", "gamma"))
def test_derivatives_of_the_clearance_are_derivatives(moved, symbol, joint):
    seen = {dots: moved[f"{symbol}{joint}{dots}"] for dots in ("", "_dot", "_ddot")}
    hit = np.flatnonzero(moved.run.modes[:, joint - 2].reshape(moved.times.shape)[:, 0])[0]
    for quantity, rate in (("", "_dot"), ("_dot", "_ddot")):
        steps = (seen[rate][:, 1:-1] * moved.weights).sum(axis=1)[hit:]
        change = (seen[quantity][:, -1] - seen[quantity][:, 0])[hit:]
        close(change - steps, seen[quantity][hit:], 1e-9)
