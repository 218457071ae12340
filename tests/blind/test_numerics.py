"""Data of blind trials come from another integrator; where the motion repeats it agrees with the package's."""

import math

import numpy as np
import pytest

from jointgap.blind.motion import Numerics, Turn, moved
from jointgap.config import Simulate
from jointgap.dynamics import simulate
from tests.independent.cases import mechanism

SPEED = 40.0
SEEN = ("slider_position", "slider_acceleration", "crank_torque", "guide_force", "frame_force_x")


def content(loose=(), **contact) -> dict:
    made = mechanism(loose, **{"friction": 0.1, **contact}).model_dump()
    steel = {"law": "lankarani_nikravesh", "youngs_modulus": 207e9, "poisson_ratio": 0.3, "restitution": 0.46}
    made["contacts"] = {"steel": steel | {"friction": 0.1}}
    made["joints"] = {name: joint | {"contact": "steel"} for name, joint in made["joints"].items()}
    return made


@pytest.mark.parametrize("loose", [(), ("piston_pin",), ("crank_pin", "piston_pin")], ids=["ideal", "one pin", "both"])
def test_both_integrators_give_the_same_motion(loose):
    ours = simulate(
        mechanism(loose, friction=0.1), Simulate(speed=SPEED, revolutions=2, samples_per_revolution=60, tolerance=1e-13)
    ).samples.iloc[60:]
    times = ours["time"].to_numpy() - 2 * math.pi / SPEED
    other = moved(content(loose), Turn(SPEED, 0.0, times), Numerics(1e-12), settling=1)
    for name in SEEN:
        spread = float(ours[name].std())
        assert np.abs(other[name] - ours[name]).max() < 2e-3 * spread, name
    assert other["crank_angle"] == pytest.approx(ours["crank_angle"] - 2 * math.pi, abs=1e-9)


def test_a_smaller_tolerance_changes_the_motion_less():
    times = np.linspace(0.0, 2 * math.pi / SPEED, 60)
    exact = moved(content(("piston_pin",)), Turn(SPEED, 0.0, times), Numerics(1e-13), settling=0)
    off = [
        np.abs(moved(content(("piston_pin",)), Turn(SPEED, 0.0, times), Numerics(t), settling=0)["slider_velocity"] - exact["slider_velocity"]).max()
        for t in (1e-8, 1e-10, 1e-12)
    ]  # fmt: skip
    assert off[0] > off[1] > off[2]
