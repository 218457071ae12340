"""The one list of joints agrees with the compiled one and with the mechanism file."""

from jointgap.config import Joints
from jointgap.core.joints import FROM_FRAME, JOINT, JOINTS, PINS
from jointgap.dynamics.parameters import Parameters


def test_the_compiled_order_is_that_of_the_parameters():
    assert tuple(name for name in Parameters._fields if name in JOINT) == JOINTS
    assert [joint.index for joint in JOINT.values()] == [0, 1, 2]


def test_the_papers_numbers_run_from_the_frame_to_the_slider():
    assert FROM_FRAME == tuple(Joints.model_fields) == ("crank_pivot", "crank_pin", "piston_pin")
    assert [JOINT[name].number for name in FROM_FRAME] == [1, 2, 3]
    assert PINS == ("crank_pin", "piston_pin")
