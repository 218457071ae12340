"""Effects, values and places read as in a sentence."""

import pytest

from jointgap.campaign.sentences import (
    effect_in_words,
    estimate_row,
    explanation_in_words,
    headline,
    label_in_words,
    parameter_rows,
    place_of,
    unit_of,
)
from jointgap.core.words import fall_in_percent, joined, number, percent, rounded_gap, with_error, with_unit
from jointgap.effects import EFFECTS


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_of_the_catalogue_has_words(name):
    said = effect_in_words({"name": name, "site": "crank_pin"})
    assert said != name.replace("_", " ")
    assert "{" not in said


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (15.707781, 2.178e-4, ("15.71", "0.00022")),
        (-0.04, 3.0, ("-0.040", "3.0")),
        (1234.5, 98.0, ("1234", "98")),
        (2000.0, 1e3, ("2000", "1.0e+03")),
        (12345.0, 98.0, ("12345", "98")),
        (12.0, 10.0, ("12", "10")),
        (2.5, None, ("2.5", "–")),
        (2.5, float("nan"), ("2.5", "–")),
        (None, 0.1, ("–", "0.1")),
        ("a*v", 0.1, ("a*v", "0.1")),
        (0.0, 0.1, ("0", "0.1")),
    ],
)
def test_a_value_has_the_digits_that_its_error_leaves(value, error, shown):
    assert with_error(value, error) == shown


def test_a_family_is_told_with_the_range_of_its_shape_and_the_law_of_the_list_that_fits():
    found = {"law": "slider_power_drag", "shape": "exponent", "value": 2.4, "interval_99": [1.62, 5.0], "named": True}
    quadratic = {"name": "slider_quadratic_drag", "site": "slider", "families": [found]}
    told = "drag of the slider (exponent 1.6 to 5; quadratic drag of the slider fits)"
    assert effect_in_words(quadratic) == told
    law = quadratic | {"name": "slider_power_drag", "families": [found | {"interval_99": [2.81, 3.2]}]}
    assert effect_in_words(law) == "drag of the slider (exponent 2.8 to 3.2)"
    found = {"law": "slider_nonlinear_spring", "shape": "cubic_share", "interval_99": [-0.31, 0.62], "named": True}
    linear = {"name": "slider_spring", "site": "slider", "families": [found]}
    told = "a spring on the slider (cubic share -0.31 to 0.62; a linear spring on the slider fits)"
    assert effect_in_words(linear) == told
    drag = {"law": "slider_power_drag", "shape": "exponent", "interval_99": [0.0, 1.3], "named": True}
    dry = {"law": "slider_stribeck_friction", "shape": "stribeck_share", "interval_99": [0.0, 0.72], "named": True}
    assert effect_in_words({"name": "slider_coulomb_friction", "site": "slider", "families": [drag, dry]}) == (
        "drag of the slider (exponent 0 to 1.3; Coulomb friction of the slider fits) or "
        "dry friction of the slider (stribeck share 0 to 0.72; Coulomb friction of the slider fits)"
    )
    alone = quadratic | {"families": [found | {"named": False}]}
    assert effect_in_words(alone) == "quadratic drag of the slider"


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
    assert parameter_rows([effect]) == (("bias", "0.5 N m", "–", ""),)


def test_an_effect_that_is_not_in_the_catalogue_keeps_its_name():
    assert effect_in_words({"name": "new_kind_of_drag", "site": "slider"}) == "new kind of drag"


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ("sensor_bias:crank_torque", "a bias of the sensor of crank torque"),
        ("pin_friction:piston_pin", "friction in the piston pin"),
        ("slider_spring", "a linear spring on the slider"),
        ("sensor_bias", "sensor_bias"),
    ],
)
def test_a_label_reads_as_its_effect_and_one_that_lacks_its_site_stays_a_name(label, words):
    assert label_in_words(label) == words


def test_an_explanation_has_the_values_of_all_parameters_with_their_units():
    spring = {"stiffness_N_m": {"value": 120.0}, "rest_position_m": {"value": 0.56}}
    effects = [
        {"name": "slider_spring", "site": "slider", "parameters": spring},
        {"name": "gravity", "site": "all bodies", "parameters": {}},
        {"name": "slider_offset", "site": "slider"},
    ]
    assert explanation_in_words(effects) == (
        "a linear spring on the slider (force per length 120 N/m, position of the slider without force 560 mm), "
        "the weight of the bodies and "
        f"{EFFECTS['slider_offset'].WORDS}"
    )


@pytest.mark.parametrize(
    ("start", "end", "where"),
    [
        (0.0, 360.0, "all crank angles"),
        (0.0, 359.0, "0 to 359 deg of crank angle"),
        (189.0, 10.0, "all crank angles but 10 to 189 deg"),
        (190.0, 10.0, "190 to 10 deg of crank angle"),
        (190.5, 10.0, "190 to 10 deg of crank angle"),
        (30.0, 30.0, "30 to 30 deg of crank angle"),
    ],
)
def test_what_is_left_out_of_a_window_is_told_up_to_half_a_revolution(start, end, where):
    assert place_of("a", "guide_force", start, end) == f"run a, guide force, {where}"


@pytest.mark.parametrize(
    ("value", "shown"), [(12.34567, "12.35"), ("-a*v", "-a*v"), (None, "–"), (float("nan"), "–"), (0.0, "0")]
)
def test_a_number_has_four_digits_and_a_dash_stands_for_what_is_not_known(value, shown):
    assert number(value) == shown


@pytest.mark.parametrize(("unit", "shown"), [("N", "2 N"), ("1", "2"), ("", "2")])
def test_a_pure_number_has_no_unit(unit, shown):
    assert with_unit("2", unit) == shown


@pytest.mark.parametrize(("gap", "shown"), [(1.234, "1.23"), (99.994, "99.99"), (100.0, "100"), (100.6, "101")])
def test_a_gap_from_a_hundred_on_has_no_digits_after_the_point(gap, shown):
    assert rounded_gap(gap) == shown


def test_a_share_is_told_in_percent():
    assert percent(0.98765) == "98.8 %"
    assert percent(0.98765, 0) == "99 %"


def test_a_row_of_a_parameter_has_the_digits_of_its_error_in_the_value_and_at_both_ends_of_its_interval():
    force = {"value": 21.3, "sd": 0.4, "interval_90": [20.6, 22.0]}
    bound = {"value": 9.0, "sd": None, "interval_90": [None, None], "remark": "at its bound"}
    effects = [
        {"name": "slider_coulomb_friction", "site": "slider", "parameters": {"force_N": force}},
        {"name": "added_slider_mass", "site": "slider", "parameters": {"mass_kg": bound}},
    ]
    assert parameter_rows(effects) == (
        ("Coulomb friction of the slider: force of friction", "21.30 N", "20.60 to 22.00", ""),
        ("a slider mass other than nominal: mass beyond nominal", "9 kg", "–", "at its bound"),
    )


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [(0.003048, "s", "3.048 ms"), (0.0021983, "s", "2.198 ms"), (5.05e-5, "m", "50.50 µm"), (5e-4, "m", "0.5000 mm")],
)
def test_small_times_and_lengths_stand_in_units_that_need_no_zeros(value, unit, shown):
    estimate = {"value": value, "sd": 1e-3 * value, "interval_90": [0.99 * value, 1.01 * value]}
    assert estimate_row("", estimate, unit)[1] == shown


def test_of_sizes_of_one_kind_the_surest_leads_the_headline():
    crank = {"value": -7.2e-5, "sd": 5e-5, "interval_90": [-1.5e-4, 1e-5]}
    rod = {"value": 2.02e-3, "sd": 3e-5, "interval_90": [1.97e-3, 2.07e-3]}
    lengths = {"name": "link_length_error", "site": "crank and rod", "parameters": {"crank_m": crank, "rod_m": rod}}
    assert headline([lengths]).endswith("rod's length beyond nominal 2.020 mm (90 % interval 1.970 to 2.070)")


def test_a_size_at_its_bound_is_called_so_in_the_headline():
    bound = {"value": 1.13, "sd": None, "interval_90": [0.015, 1.13], "remark": "at its bound"}
    friction = {"name": "slider_coulomb_friction", "site": "slider", "parameters": {"force_N": bound}}
    assert headline([friction]).endswith("1.13 N (at its bound; 90 % interval 0.015 to 1.13)")


def test_what_grows_in_one_scenario_is_not_said_to_fall():
    assert fall_in_percent((5.0, 3.0)) == "falls by 3.0 to 5.0 %"
    assert fall_in_percent((5.0, -2.0)) == "changes by −5.0 to +2.0 %"
