"""Factors by which figures magnify follow from what they draw."""

import pytest

from jointgap.config import resolve
from jointgap.scenario.animation import magnification
from jointgap.scenario.figure_data import round_number


@pytest.mark.parametrize(
    ("value", "factor"), [(0.3, 1), (1.9, 1), (2.1, 2), (49.0, 20), (700.0, 500), (float("inf"), 1)]
)
def test_a_factor_to_draw_by_is_round_and_not_larger_than_what_fits(value, factor):
    assert round_number(value) == factor


@pytest.mark.parametrize(("clearance", "factor"), [(0.03, 200), (0.3, 20)])
def test_the_largest_clearance_is_drawn_as_up_to_a_quarter_of_the_crank(clearance, factor):
    pin = {"bearing_radius": f"{10 + clearance} mm"}
    mechanism = {
        "base": "config/mechanisms/compressor.yaml",
        "joints": {"crank_pin": pin, "piston_pin": {"bearing_radius": f"{6 + clearance} mm"}},
    }
    mine = {"mechanism": mechanism}
    asked = {"mechanism": mechanism, "figures": {"magnification": 7}}
    scenarios = resolve({"scenarios": {"mine": mine, "asked": asked}})
    assert magnification(scenarios["mine"]) == factor
    assert magnification(scenarios["asked"]) == 7
