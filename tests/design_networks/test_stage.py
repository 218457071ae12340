"""The stage design-networks: what is refused before anything is simulated, and what comes out."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.errors import InputError
from jointgap.core.page import to_markdown
from jointgap.design_networks.design_networks import design_networks
from jointgap.design_networks.design_space import design_space
from jointgap.design_networks.networks_figures import draw_errors
from jointgap.design_networks.networks_page import headline, page, verdict
from tests.design_networks.spaces import MADE, PARAMETERS, scenario
from tests.dynamics.cases import mechanism

FRICTION = PARAMETERS["friction"]


@pytest.mark.parametrize(
    "parameters, words",
    [
        ({}, "nothing varies besides the lengths"),
        ({"frictoin": FRICTION}, "did you mean 'friction'"),
        ({"friction": {"from": 0.2, "to": 0.1}}, "the wrong way round"),
        ({"clearance": {"from": "1 kg", "to": "2 kg"}}, "clearance"),
        ({"crank_length": {"from": "149 mm", "to": "151 mm"}}, "lengths lie in the first of optimise.boxes"),
        ({"mechanism.rod.length": {"from": "560 mm", "to": "566 mm"}}, "lengths lie in the first of optimise.boxes"),
        ({"mechanism.joints.crank_pin.journal": ["crank", "rod"]}, "a network knows numbers alone"),
        ({"mechanism.joints.crank_pin.loose": [True, False]}, "a network knows numbers alone"),
        ({"friction": [0.1]}, "does not vary"),
        ({"simulate.revolutions": [2, 3]}, "no property of a design"),
    ],
)
def test_what_no_network_can_know_is_one_clear_error_before_anything_is_simulated(parameters, words, monkeypatch):
    monkeypatch.setattr("jointgap.design_networks.settled_motion.simulate_runs", None)
    with pytest.raises(InputError) as error:
        design_networks(scenario(parameters))
    assert words in str(error.value)
    assert "design_networks" in str(error.value)


def test_a_mechanism_without_loose_joints_has_no_motion_to_learn():
    joints = {name: "ideal" for name in ("crank_pivot", "crank_pin", "piston_pin")}
    ideal = MADE.model_copy(update={"joints": MADE.joints.model_copy(update=joints)})
    with pytest.raises(InputError, match="all joints are ideal"):
        design_space(scenario({"mechanism.slider.mass": {"from": "1 kg", "to": "2 kg"}}, ideal))


def test_an_offset_is_refused_beside_a_constraint_that_is_worked_out_with_the_nominal_one():
    offset = {"mechanism.slider.offset": {"from": "0 mm", "to": "20 mm"}}
    with pytest.raises(InputError, match=r"offset: optimise\.constraints\.stroke"):
        design_space(scenario(offset, optimise={"constraints": {"stroke": ["299 mm", "301 mm"]}}))


@pytest.fixture(scope="module")
def once():
    return design_networks(scenario(), 1)


def test_any_number_of_workers_trains_the_same_network(once):
    again = design_networks(scenario(), 2)
    assert once.errors.equals(again.errors)
    assert once.trained.network.to_frame().equals(again.trained.network.to_frame())


def test_the_costs_are_counted_and_every_output_is_judged(once):
    assert once.costs["step"].tolist() == ["simulate", "train"]
    assert (once.costs["cpu_time"] > 0.0).all()
    assert once.errors["design"].nunique() == 8
    expected = ["crank pin x", "crank pin y", "piston pin x", "piston pin y", "lift", "transmission angle", "RMS error"]
    assert once.errors["output"].unique().tolist() == expected
    assert np.isfinite(once.errors[["simulated", "network", "frozen"]].to_numpy()).all()


def test_the_page_says_which_is_nearer_and_what_it_cost(once):
    assert "mdeg" in headline(once)
    assert "The frozen motion is the nearer one to the simulation" in verdict(once)
    level = once.errors.assign(network=1.02 * once.errors["frozen"])
    assert "are about as near" in verdict(replace(once, errors=level))
    text = to_markdown(page(once, scenario(), "mine"))
    for words in ("8 designs that took no part", "frozen motion", "CPU-seconds", "friction"):
        assert words in text
    assert set(draw_errors(once.errors).data["series"]) == {"network", "frozen motion"}


def test_one_loose_joint_is_enough():
    found = design_networks(scenario(made=mechanism(loose=("crank_pin",), friction=0.1)), 1)
    assert "piston pin x" not in found.errors["output"].unique()
