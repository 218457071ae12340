"""The one list of joints agrees with the vectors of a start and with the mechanism file."""

from jointgap.config import Joints
from jointgap.core.joints import FROM_FRAME, JOINT, JOINTS, PINS
from jointgap.motion.slider_crank import model_of, start_state
from tests.motion.cases import mechanism, options


def test_the_vectors_of_a_start_are_in_the_order_of_the_list():
    assert [joint.index for joint in JOINT.values()] == [0, 1, 2]
    model = model_of(mechanism(loose=JOINTS), options())
    assert {*model.loose} == {*model.bearings} == {*JOINTS}
    state = start_state(model, [1e-4, 2e-4, 3e-4, 4e-4, 5e-4, 6e-4])
    vectors = [[*model.vector(state, name)[0]] for name in JOINTS]
    assert vectors == [[1e-4, 2e-4], [3e-4, 4e-4], [5e-4, 6e-4]]


def test_the_papers_numbers_run_from_the_frame_to_the_slider():
    assert FROM_FRAME == tuple(Joints.model_fields) == ("crank_pivot", "crank_pin", "piston_pin")
    assert [JOINT[name].number for name in FROM_FRAME] == [1, 2, 3]
    assert PINS == ("crank_pin", "piston_pin")
