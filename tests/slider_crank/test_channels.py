"""Each channel that a model reads is what its name says, by geometry and Newton's laws in closed form."""

import numpy as np
import pytest

from jointgap.config.campaign import CHANNELS
from jointgap.rig.model import build_model
from tests.dynamics.closed import Closed
from tests.slider_crank.rigs import campaign, mechanism, read


def test_every_channel_is_what_its_name_says():
    speed, angle = 30.0, np.arange(4 * 120) * (2 * np.pi / 120)
    own = campaign(mechanism(slider={"mass": 0.4482, "offset": 0.02}), tuple(CHANNELS), speeds=(speed, 40.0))
    exact = Closed(own.mechanism, angle, speed)
    _, _, frame, guide, torque = exact.reactions()
    expected = {
        "crank_angle": angle,
        "crank_speed": np.full(angle.size, speed),
        "slider_position": exact.slider_position,
        "slider_velocity": exact.slider_rates[0],
        "slider_acceleration": exact.slider_rates[1],
        "rod_angle": exact.rod_angle,
        "rod_angular_velocity": exact.rod_rates[0],
        "rod_acceleration_x": exact.centre_rates[1][0],
        "rod_acceleration_y": exact.centre_rates[1][1],
        "crank_torque": torque,
        "guide_force": guide,
        "frame_force_x": -frame[0],
        "frame_force_y": -frame[1],
    }
    found = read(build_model(own))
    assert found.keys() == expected.keys() == set(CHANNELS) - {"time"}
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-9, abs=1e-9 * np.max(np.abs(value))), name
