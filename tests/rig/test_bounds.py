"""Impossible bounds of nuisances are refused before a simulation."""

import pytest

from jointgap.core.errors import InputError
from jointgap.core.joints import PINS
from jointgap.rig.model import build_model, check_bounds
from tests.rig.rigs import campaign, mechanism


def with_nuisances(**nuisance):
    content = mechanism(PINS, friction=0.5)
    content["contacts"]["steel"]["restitution"] = 0.9
    return campaign(content, speeds=(30.0, 31.0), nuisance=nuisance)


@pytest.mark.parametrize(
    "key, bounds, words",
    [
        ("restitution", "20 %", "restitution is 0.9, and 1.08 at 20.0 % must be less than 1"),
        ("joint_friction", "50 %", "0.75 at 50.0 % must be less than or equal to 0.6"),
        ("restitution_piston_pin", [0.3, 1.0], r"\[0.3, 1.0\]: must be less than 1"),
        ("crank_pin_clearance", [0.0, "2 mm"], "must be greater than or equal to 0.000000001"),
        ("slider_mass", [0.0, 1.0], r"slider_mass = \[0.0, 1.0\]: must be greater than 0"),
    ],
)
def test_impossible_bounds_are_refused_with_the_limit(key, bounds, words):
    with pytest.raises(ValueError, match=words):
        with_nuisances(**{key: bounds})


def test_bounds_up_to_the_ends_of_what_is_possible_are_accepted():
    check_bounds(
        with_nuisances(
            restitution=[0.001, 0.999], joint_friction=[0.0, 0.6], crank_pin_clearance=[1e-9, 1e-3]
        )
    )


@pytest.mark.parametrize(
    "nuisance, words",
    [
        ({"crank_length": [0.1, 0.8]}, "crank_length = 0.8 m: .*cannot turn.*narrow the bounds"),
        (
            {"crank_length": [0.1, 0.4], "rod_length": [0.3, 0.6]},
            "at the bound crank_length = 0.4 m, rod_length = 0.3",
        ),
    ],
)
def test_bounds_at_which_the_crank_cannot_turn_are_refused_by_the_model(nuisance, words):
    with pytest.raises(InputError, match=words):
        build_model(with_nuisances(**nuisance))


def test_a_film_thicker_than_the_least_clearance_is_refused():
    film = {"viscosity_Pa_s": 0.05, "length_m": 0.01, "least_film_m": 1e-5}
    content = mechanism(
        PINS, effects=[{"name": "lubricated_joint", "site": "crank_pin", "parameters": film}]
    )
    check_bounds(campaign(content, nuisance={"crank_pin_clearance": [3e-5, 6e-4]}))
    with pytest.raises(
        InputError, match=r"crank_pin_clearance = 1.5e-05 m: .*least_film_m.*narrow the bounds"
    ):
        check_bounds(campaign(content, nuisance={"crank_pin_clearance": [1.5e-5, 6e-4]}))
