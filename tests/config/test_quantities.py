"""Numbers with units mean what they say, or are refused."""

import math

import pytest

from jointgap.core.units import scaled_unit_factor, to_si, unit_factor


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
        ("7.5mm", "m", 7.5e-3),
        ("2e3 mm", "m", 2.0),
        ("0.2 N*m/rad", "N*m/rad", 0.2),
        ("9.8 m/s^2", "m/s^2", 9.8),
        ("9.8 m s^-2", "m/s^2", 9.8),
        ("9.8 m/s2", "m/s^2", 9.8),
        ("3 kg m2", "kg*m^2", 3.0),
        ("2 Nm", "N*m", 2.0),
        ("3 Nmm", "N*m", 3e-3),
        ("5 kNm/rad", "N*m/rad", 5e3),
        ("3 rad/Nm", "rad/(N*m)", 3.0),
        ("3 1/kNm", "1/(N*m)", 3e-3),
        ("2 Nm2", "N*m^2", 2.0),
        ("3 °/s", "rad/s", math.pi / 60),
        ("3 kg*m**2", "kg*m^2", 3.0),
        ("3 kg·m²", "kg*m^2", 3.0),
        ("5 N/(mm*m)", "N/m^2", 5e3),
        ("5 1/s", "Hz", 5.0),
        ("90°", "rad", math.pi / 2),
        ("turn/3600", "rad", math.tau / 3600),
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


@pytest.mark.parametrize("value", [10**400, -(10**400)])
def test_a_number_beyond_all_floats_is_refused(value):
    with pytest.raises(ValueError, match="too large for a number"):
        to_si(value, "m")


@pytest.mark.parametrize("value", ["1e400", "1e400 mm", math.inf, math.nan])
def test_a_number_that_is_not_finite_is_refused(value):
    with pytest.raises(ValueError, match="finite"):
        to_si(value, "m")


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("\N{MINUS SIGN}90 deg", "rad", -math.pi / 2),
        ("\N{MINUS SIGN}20 mm", "m", -0.02),
        ("1e\N{MINUS SIGN}3 m", "m", 1e-3),
    ],
)
def test_a_typographic_minus_is_a_minus(text, unit, number):
    assert to_si(text, unit) == pytest.approx(number, rel=1e-14)


@pytest.mark.parametrize(
    "text",
    ["", " ", "mm", "0.1.5 m", "150:200 mm", "150 - 200 mm", "2*3 mm", "5 mm 3", "5 mm/", "5 m//s", "7 mm."]
    + ["nan", "inf m", "turn/0", "turn/3600/2", "9" * 5000, "5 mm" * 1000]
    + ["7,5 mm", "7,5", "1,5e-3 m", "1 500 mm", "1 500", "1'500 mm", "1\N{NARROW NO-BREAK SPACE}500 mm", "1,500.5 mm"]
    + ["5 1/2 inch", "1/2 inch", "150 mm ± 1", "\N{EN DASH}150 mm", "360 mm/4096"],
)
def test_text_that_is_no_number_with_a_unit_is_refused(text):
    with pytest.raises(ValueError, match="is not a number with a unit"):
        to_si(text, "m")


@pytest.mark.parametrize("text", ["9**9**9 m", "5 m^9999999999", "5 km⁹⁹⁹⁹⁹⁹⁹⁹", "m/9**9**9", "9**9**9"])
def test_nothing_in_a_text_is_evaluated(text):
    with pytest.raises(ValueError, match="is not a number with a unit"):
        to_si(text, "m")


@pytest.mark.parametrize("text", ["1_500 mm", "5 furlongg", "0x10 mm", "5 and", "5½ inch"])
def test_a_unit_that_there_is_none_of_is_named(text):
    with pytest.raises(ValueError, match="with a unit"):
        to_si(text, "m")


@pytest.mark.parametrize("unit", ["", " ", "5 mm", "1", "000 mm", "9**9**9 m", "m*0"])
def test_what_is_no_unit_has_no_factor(unit):
    with pytest.raises(ValueError, match=r"is (empty|not a unit); write .* such as m"):
        unit_factor(unit, "m")


def test_a_unit_has_a_factor():
    assert unit_factor("mm", "m") == 1e-3
    assert unit_factor("1/min", "Hz") == pytest.approx(1 / 60)
    assert unit_factor("turn/4000", "rad") == pytest.approx(math.tau / 4000, rel=1e-15)


def test_a_sensors_factor_makes_its_signal_a_quantity():
    assert scaled_unit_factor("0.35 Nm/A", "mA", "N*m") == pytest.approx(0.35e-3, rel=1e-14)
    assert scaled_unit_factor("2.5", "mm", "m") == pytest.approx(2.5e-3, rel=1e-14)
    with pytest.raises(ValueError, match=r"needs N\*m"):
        scaled_unit_factor("0.35 N*m/V", "A", "N*m")
