"""Effects, values and places read as in a sentence."""

from jointgap.campaign.sentences import (
    estimate_row,
    format_effect,
    format_label,
    headline,
    parameter_rows,
    unit_of,
)
from jointgap.core.words import (
    format_falls,
    number,
    percent,
    rounded_gap,
    with_error,
    with_unit,
)
from jointgap.effects import EFFECTS
from tests.catalogue import each

NAN = float("nan")
SAID = [
    (with_error, (15.707781, 2.178e-4), ("15.71", "0.00022")),
    (with_error, (-0.04, 3.0), ("-0.040", "3.0")),
    (with_error, (2000.0, 1e3), ("2000", "1.0e+03")),
    (with_error, (12.0, 10.0), ("12", "10")),
    (with_error, (2.5, None), ("2.5", "–")),
    (with_error, (2.5, NAN), ("2.5", "–")),
    (with_error, (None, 0.1), ("–", "0.1")),
    (with_error, ("a*v", 0.1), ("a*v", "0.1")),
    (with_error, (0.0, 0.1), ("0", "0.1")),
    *((number, (value,), shown) for value, shown in ((12.34567, "12.35"), ("-a*v", "-a*v"), (None, "–"), (NAN, "–"))),
    *((with_unit, ("2", unit), shown) for unit, shown in (("N", "2 N"), ("1", "2"), ("", "2"))),
    *(
        (rounded_gap, (gap,), shown)
        for gap, shown in ((1.234, "1.23"), (99.994, "99.99"), (100.0, "100"), (100.6, "101"))
    ),
    (percent, (0.98765,), "98.8 %"),
    (percent, (0.98765, 0), "99 %"),
    (format_falls, ((5.0, 3.0),), "falls by 3.0 to 5.0 %"),
    (format_falls, ((5.0, -2.0),), "changes by −5.0 to +2.0 %"),
    (unit_of, ("rod_flexibility", "", "frequency_Hz"), "Hz"),
    (unit_of, ("sensor_bias", "slider_acceleration", "bias"), "m/s^2"),  # that of its channel
    (unit_of, ("sensor_bias", "motor_current", "bias"), "SI"),
    (unit_of, ("sensor_gain", "crank_torque", "gain_error"), "1"),
    (unit_of, ("unheard_of", "", "force_N"), ""),
    (format_label, ("sensor_bias:crank_torque",), "a bias of the sensor of crank torque"),
    (format_label, ("sensor_bias",), "sensor_bias"),  # which lacks its site
    (format_effect, ({"name": "new_kind_of_drag", "site": "slider"},), "new kind of drag"),
]


def test_values_units_places_and_names_read_as_in_a_sentence():
    def said(function, given, shown):
        assert function(*given) == shown

    each(said, SAID)
    for name in EFFECTS:
        words = format_effect({"name": name, "site": "crank_pin"})
        assert words != name.replace("_", " ") and "{" not in words


def test_a_family_is_told_with_the_range_of_its_shape_and_the_law_of_the_list_that_fits():
    def told(name, *ends, named=True):
        found = {"law": "slider_power_drag", "shape": "exponent", "value": 0.0, "interval_99": ends, "named": named}
        return format_effect({"name": name, "site": "slider", "families": [found]})

    fits = "drag of the slider (exponent 1.6 to 5; quadratic drag of the slider fits)"
    assert told("slider_quadratic_drag", 1.62, 5.0) == fits
    assert told("slider_power_drag", 2.81, 3.2) == "drag of the slider (exponent 2.8 to 3.2)"
    assert told("slider_quadratic_drag", 1.62, 5.0, named=False) == "quadratic drag of the slider"


def test_a_row_of_a_parameter_has_the_digits_of_its_error_in_the_value_and_at_both_ends_of_its_interval():
    force = {"value": 21.3, "sd": 0.4, "interval_90": [20.6, 22.0]}
    bound = {"value": 9.0, "sd": None, "interval_90": [None, None], "remark": "at its bound"}
    effects = [
        {"name": "slider_coulomb_friction", "site": "slider", "parameters": {"force_N": force}},
        {"name": "added_slider_mass", "site": "slider", "parameters": {"mass_kg": bound}},
    ]
    assert parameter_rows(effects) == (
        ("Coulomb friction of the slider: friction force", "21.30 N", "20.60 to 22.00", ""),
        ("a deviating slider mass: deviation from nominal", "9 kg", "–", "at its bound"),
    )
    sizes = [(0.003048, "s", "3.048 ms"), (0.0021983, "s", "2.198 ms"), (5.05e-5, "m", "50.50 µm")]
    for value, unit, shown in [*sizes, (5e-4, "m", "0.5000 mm")]:
        estimate = {"value": value, "sd": 1e-3 * value, "interval_90": [0.99 * value, 1.01 * value]}
        assert estimate_row("", estimate, unit)[1] == shown


def test_of_sizes_of_one_kind_the_surest_leads_the_headline_and_one_at_its_bound_is_called_so():
    crank = {"value": -7.2e-5, "sd": 5e-5, "interval_90": [-1.5e-4, 1e-5]}
    rod = {"value": 2.02e-3, "sd": 3e-5, "interval_90": [1.97e-3, 2.07e-3]}
    lengths = {"name": "link_length_error", "site": "crank and rod", "parameters": {"crank_m": crank, "rod_m": rod}}
    assert headline([lengths]).endswith("deviation of the rod length 2.020 mm (90 % interval 1.970 to 2.070)")
    bound = {"value": 1.13, "sd": None, "interval_90": [0.015, 1.13], "remark": "at its bound"}
    friction = {"name": "slider_coulomb_friction", "site": "slider", "parameters": {"force_N": bound}}
    assert headline([friction]).endswith("1.13 N (at its bound; 90 % interval 0.015 to 1.13)")
