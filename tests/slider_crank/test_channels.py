"""Each channel that a model reads is what its name says: by geometry and Newton's laws, written down again here.

No value comes from the code that fills the channels, so that no two of them can be swapped, and no sign turned, in
silence.
"""

import numpy as np
import pytest

from jointgap.config.campaign import CHANNELS
from jointgap.rig.model import build_model
from tests.slider_crank.rigs import campaign, mechanism

SPEED, OFFSET = 30.0, 0.02  # rad/s; m, of the slide above the crank pivot
CRANK, ROD, SLIDER = (mechanism()[body] for body in ("crank", "rod", "slider"))


def by_hand(angle: np.ndarray) -> dict[str, np.ndarray]:
    """Every channel of the mechanism without clearance, friction and weight, at crank angles (n,) [rad] and constant
    speed.
    """
    r, length, w = CRANK["length"], ROD["length"], SPEED
    rod_angle = np.arcsin((OFFSET - r * np.sin(angle)) / length)
    rate = -r * w * np.cos(angle) / (length * np.cos(rod_angle))
    acceleration = (r * w**2 * np.sin(angle) + length * rate**2 * np.sin(rod_angle)) / (length * np.cos(rod_angle))
    along = np.array([np.cos(rod_angle), np.sin(rod_angle)])
    across = np.array([-along[1], along[0]])
    pin = r * np.array([np.cos(angle), np.sin(angle)])
    pin_acceleration = -(w**2) * pin

    def at_rod(distance: float) -> np.ndarray:
        return pin_acceleration + distance * (acceleration * across - rate**2 * along)

    x = pin[0] + length * np.cos(rod_angle)
    velocity = -r * w * np.sin(angle) - length * rate * np.sin(rod_angle)
    slider_force = SLIDER["mass"] * at_rod(length)[0]  # of the rod on the slider, x
    inertia = ROD["mass"] * at_rod(ROD["mass_centre"])
    # Moments on the rod about the crank pin: of its inertia, and of the slider on its end (-slider_force, guide).
    centre, end = ROD["mass_centre"] * along, length * along
    moment = ROD["inertia"] * acceleration + centre[0] * inertia[1] - centre[1] * inertia[0]
    guide_on_rod = (moment - end[1] * slider_force) / end[0]
    on_rod = inertia - np.array([-slider_force, guide_on_rod])  # of the crank on the rod
    crank_inertia = -CRANK["mass"] * CRANK["mass_centre"] * w**2 * pin / r
    on_bearing = -(crank_inertia + on_rod)
    return {
        "crank_angle": angle,
        "crank_speed": np.full(angle.size, w),
        "slider_position": x,
        "slider_velocity": velocity,
        "slider_acceleration": at_rod(length)[0],
        "rod_angle": rod_angle,
        "rod_angular_velocity": rate,
        "rod_acceleration_x": at_rod(ROD["mass_centre"])[0],
        "rod_acceleration_y": at_rod(ROD["mass_centre"])[1],
        "crank_torque": pin[0] * on_rod[1] - pin[1] * on_rod[0],
        "guide_force": guide_on_rod,
        "frame_force_x": on_bearing[0],
        "frame_force_y": on_bearing[1],
    }


@pytest.fixture(scope="module")
def read():
    content = mechanism(slider={**SLIDER, "offset": OFFSET})
    own = campaign(content, tuple(CHANNELS), speeds=(SPEED, 40.0))
    model = build_model(own)
    return model.simulate("slow", model.nominal("slow"))


@pytest.mark.parametrize("channel", [name for name in CHANNELS if name != "time"])
def test_a_channel_is_what_its_name_says(read, channel):
    angle = np.arange(4 * 120) * (2 * np.pi / 120)
    expected = by_hand(angle)
    assert read[channel] == pytest.approx(expected[channel], rel=1e-9, abs=1e-9 * np.max(np.abs(expected[channel])))


def test_no_two_channels_of_a_unit_are_alike():
    channels = by_hand(np.linspace(0.0, 6.0, 60))
    for name, unit in CHANNELS.items():
        alike = [
            other
            for other, its in CHANNELS.items()
            if name in channels and its == unit and np.allclose(channels[other], channels[name], rtol=0.05)
        ]
        assert alike in ([name], []), alike
