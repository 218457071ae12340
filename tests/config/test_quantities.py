"""Numbers with units mean what they say, or are refused."""

import math

import pytest

from jointgap.quantities import to_si


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("600 rpm", "rad/s", 20 * math.pi),
        ("10 turn/s", "rad/s", 20 * math.pi),
        ("10 revolutions/s", "rad/s", 20 * math.pi),
        ("3600 deg/s", "rad/s", 20 * math.pi),
        ("62 rad/s", "rad/s", 62.0),
        ("62", "rad/s", 62.0),
        ("10 Hz", "Hz", 10.0),
        ("10 kHz", "Hz", 1e4),
        ("10 / s", "Hz", 10.0),
        ("2 %", "", 0.02),
        ("7.5 mm", "m", 7.5e-3),
    ],
)
def test_a_number_with_a_unit_is_converted(text, unit, number):
    assert to_si(text, unit) == pytest.approx(number, rel=1e-14)


@pytest.mark.parametrize("text", ["10 Hz", "10 1/s", "10 / s", "0.6 / ms"])
def test_a_speed_of_rotation_says_what_turns(text):
    with pytest.raises(ValueError, match="write rpm, turn/s or rad/s"):
        to_si(text, "rad/s")


@pytest.mark.parametrize("text", ["600 rpm", "10 rad/s", "10 turn/s"])
def test_a_frequency_is_no_speed_of_rotation(text):
    with pytest.raises(ValueError, match="write Hz or 1/s"):
        to_si(text, "Hz")


@pytest.mark.parametrize("text", ["7,5 mm", "7,5", "1,5e-3 m"])
def test_a_decimal_comma_is_refused_with_the_number_that_may_be_meant(text):
    with pytest.raises(ValueError, match=f"has a comma; write {text.replace(',', '.')}"):
        to_si(text, "m")


@pytest.mark.parametrize("value", [10**400, -(10**400), "10**400 mm"])
def test_a_number_beyond_all_floats_is_refused(value):
    with pytest.raises(ValueError, match="too large for a number"):
        to_si(value, "m")


@pytest.mark.parametrize("value", ["1e400", "1e400 mm", math.inf, math.nan])
def test_a_number_that_is_not_finite_is_refused(value):
    with pytest.raises(ValueError, match="finite"):
        to_si(value, "m")
