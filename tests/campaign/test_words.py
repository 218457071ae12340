"""Effects, values and places read as in a sentence."""

import pytest

from jointgap.campaign.phrasing import effect_in_words, parameter_rows, place_of, unit_of
from jointgap.effects import EFFECTS
from jointgap.report.plain_words import joined, with_error


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_of_the_catalogue_has_words(name):
    said = effect_in_words({"name": name, "site": "crank_pin"})
    assert said != name.replace("_", " ")
    assert "{" not in said


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (15.707781, 2.178e-4, ("15.70778", "0.00022")),
        (-0.04, 3.0, ("-0.040", "3.0")),
        (1234.5, 98.0, ("1234", "98")),
        (2.5, None, ("2.5", "–")),
        (0.0, 0.1, ("0", "0.1")),
    ],
)
def test_a_value_has_the_digits_that_its_error_leaves(value, error, shown):
    assert with_error(value, error) == shown


def test_a_window_that_is_most_of_a_revolution_is_told_by_what_it_leaves_out():
    assert place_of("a", "crank_torque", 190.0, 170.0) == "run a, crank torque, all crank angles but 170 to 190 deg"
    assert place_of("a", "crank_torque", 350.0, 10.0) == "run a, crank torque, 350 to 10 deg of crank angle"


def test_lists_read_as_in_a_sentence():
    assert [joined("abc"[:n]) for n in range(4)] == ["", "a", "a and b", "a, b and c"]


@pytest.mark.parametrize(
    ("effect", "parameter", "unit"),
    [
        (("rod_flexibility", ""), "frequency_Hz", "Hz"),
        (("sensor_bias", "slider_acceleration"), "bias", "m/s^2"),
        (("sensor_bias", "motor_current"), "bias", "SI"),
        (("sensor_gain", "crank_torque"), "gain_error", "1"),
        (("unheard_of", ""), "force_N", ""),
    ],
)
def test_a_bias_is_in_the_unit_of_its_channel_and_all_else_in_that_of_the_catalogue(effect, parameter, unit):
    assert unit_of(*effect, parameter) == unit


def test_a_parameter_without_an_interval_has_a_dash_there():
    effect = {"name": "sensor_bias", "site": "crank_torque", "parameters": {"bias": {"value": 0.5}}}
    assert parameter_rows([effect]) == (("sensor_bias: bias", "0.5 N*m", "–", "–"),)
