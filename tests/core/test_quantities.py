"""Numbers with units."""

import math
import re

import pytest

from jointgap.core.units import respelled, scaled_unit_factor, to_si, unit_factor

SI = {
    "rad/s": {
        "600 rpm": 20 * math.pi,
        "10 turn/s": 20 * math.pi,
        "10 revolutions/s": 20 * math.pi,
        "62": 62,
    }
    | {"3600 deg/s": 20 * math.pi, "62 rad/s": 62, "3 °/s": math.pi / 60},
    "Hz": {"10 Hz": 10, "10 kHz": 1e4, "10 / s": 10, "5 1/s": 5},
    "": {"2 %": 0.02},
    "m": {
        "7.5 mm": 7.5e-3,
        "7.5mm": 7.5e-3,
        "2e3 mm": 2,
        "\N{MINUS SIGN}20 mm": -0.02,
        "1e\N{MINUS SIGN}3 m": 1e-3,
    },
    "rad": {"90°": math.pi / 2, "turn/3600": math.tau / 3600, "\N{MINUS SIGN}90 deg": -math.pi / 2},
    "m/s^2": {"9.8 m/s^2": 9.8, "9.8 m s^-2": 9.8, "9.8 m/s2": 9.8},
    "kg*m^2": {"3 kg m2": 3, "3 kg*m**2": 3, "3 kg·m²": 3},
    "N*m": {"2 Nm": 2, "3 Nmm": 3e-3},
    "N*m/rad": {"0.2 N*m/rad": 0.2, "5 kNm/rad": 5e3},
    "rad/(N*m)": {"3 rad/Nm": 3},
    "1/(N*m)": {"3 1/kNm": 3e-3},
    "N*m^2": {"2 Nm2": 2},
    "N/m^2": {"5 N/(mm*m)": 5e3},
}
NO_NUMBERS = ["", " ", "mm", "0.1.5 m", "150:200 mm", "150 - 200 mm", "2*3 mm", "5 mm 3", "5 mm/"]
NO_NUMBERS += [
    "5 m//s",
    "7 mm.",
    "nan",
    "inf m",
    "turn/0",
    "turn/3600/2",
    "9" * 5000,
    "5 mm" * 1000,
]
NO_NUMBERS += [
    "5 1/2 inch",
    "1/2 inch",
    "1 500 mm",
    "1 500",
    "1'500 mm",
    "1,500.5 mm",
    "150 mm ± 1",
]
NO_NUMBERS += ["1\N{NARROW NO-BREAK SPACE}500 mm", "\N{EN DASH}150 mm", "360 mm/4096"]
WITH_COMMA = {"7,5 mm": "'7.5 mm'", "-1,5e-3 m": "'-1.5e-3 m'", ",5 m": "'0.5 m'"}
WITH_COMMA |= {"0,500 m": "'0.500 m'", "1,500 mm": "'1.500 mm' (or '1500 mm')"}
EVALUATED = ["9**9**9 m", "5 m^9999999999", "5 km⁹⁹⁹⁹⁹⁹⁹⁹", "m/9**9**9", "9**9**9"]
SPELLED = {
    "rad/s": {
        "RPM": "rpm",
        "r/min": "turn/min",
        "min-1": "rpm",
        "U/min": "turn/min",
        "RPS": "turn/s",
    },
    "rad": {"rev": "turn", "CAD": "deg", "°CA": "deg", "DEG": "deg"},
    "m/s^2": {"G": "g_n", "g": "g_n", "M/S2": "m/s2"},
    "N*m": {
        "N-m": "N*m",
        "N.m": "N*m",
        "nm": "N*m",
        "ft-lb": "lbf*ft",
        "in lbf": "lbf*inch",
        "kg-cm": "kgf*cm",
    },
    "s": {"Sec": "sec", "mS": "ms", "V": ""},
    "kg": {"Kg": "kg", "kgs": "kg"},
    "N": {"lbs": "lbf", "KN": "kN", "kp": "kgf"},
    "m": {"MM": "mm", '"': "inch"},
    "Pa": {"Mpa": "MPa", "barg": "bar"},
    "Hz": {"khz": "kHz", "kS/s": "kHz"},
    "kg*m^2": {"kgm2": "kg*m2", "kg.m^2": "kg*m^2"},
    "N*s/m": {"Ns/m": "N*s/m", "N-s/m": "N*s/m"},
    "": {"pct": "%"},
}


SPELLINGS = [(base, *pair) for base, units in SPELLED.items() for pair in units.items()]
SUGGESTED = [pair for pair in SPELLINGS if all(pair) and " " not in pair[1]]


@pytest.mark.parametrize(
    "text, unit, number",
    [(text, unit, number) for unit, texts in SI.items() for text, number in texts.items()],
)
def test_a_number_with_a_unit_is_converted(text, unit, number):
    assert to_si(text, unit) == pytest.approx(number, rel=1e-14)


@pytest.mark.parametrize("base, spelling, unit", SPELLINGS)
def test_usual_spellings_of_units_are_understood(base, spelling, unit):
    assert respelled(spelling, base) == unit


@pytest.mark.parametrize("base, spelling, unit", SUGGESTED)
def test_an_unknown_unit_gets_a_suggestion(base, spelling, unit):
    with pytest.raises(ValueError, match=re.escape(f"; did you mean '2 {unit}'?")):
        to_si(f"2 {spelling}", base)
    with pytest.raises(ValueError, match=re.escape(f"did you mean '{unit}'?")):
        unit_factor(spelling, base)


def test_units_of_sensors_get_a_suggestion():
    with pytest.raises(ValueError, match="did you mean 'turn/3600'"):
        to_si("rev/3600", "rad")
    for unit in ("N-m", "ft-lb", "lb.in"):
        with pytest.raises(ValueError, match="did you mean"):
            scaled_unit_factor(f"0.35 {unit}/A", "A", "N*m")


WRONG = [(text, "m", "is not a number with a unit") for text in NO_NUMBERS + EVALUATED]
WRONG += [(text, "m", f"has a decimal comma; write {point}") for text, point in WITH_COMMA.items()]
WRONG += [(text, "m", "with a unit") for text in ("1_500 mm", "5 furlongg", "0x10 mm", "5½ inch")]
WRONG += [(number, "m", "too large for a number") for number in (10**400, -(10**400))]
WRONG += [(value, "m", "finite") for value in ("1e400", "1e400 mm", math.inf, math.nan)]
WRONG += [(text, "rad/s", "write rpm, turn/s or rad/s") for text in ("10 Hz", "10 / s", "0.6 / ms")]
WRONG += [(text, "Hz", "write Hz or 1/s") for text in ("600 rpm", "10 rad/s", "10 turn/s")]


@pytest.mark.parametrize("text, unit, words", WRONG)
def test_a_text_that_is_not_a_number_with_a_unit_is_an_error_and_is_not_evaluated(
    text, unit, words
):
    with pytest.raises(ValueError, match=re.escape(words)):
        to_si(text, unit)


def test_a_unit_has_a_factor():
    assert unit_factor("mm", "m") == pytest.approx(1e-3, rel=1e-15)
    assert unit_factor("turn/4000", "rad") == pytest.approx(math.tau / 4000, rel=1e-15)
    for unit in ("", " ", "5 mm", "1", "000 mm", "9**9**9 m", "m*0"):
        with pytest.raises(ValueError, match=" such as m"):
            unit_factor(unit, "m")


def test_the_factor_of_a_sensor_makes_its_signal_a_quantity():
    assert scaled_unit_factor("0.35 Nm/A", "mA", "N*m") == pytest.approx(0.35e-3, rel=1e-14)
    assert scaled_unit_factor("2.5", "mm", "m") == pytest.approx(2.5e-3, rel=1e-14)
    with pytest.raises(ValueError, match=r"requires N\*m"):
        scaled_unit_factor("0.35 N*m/V", "A", "N*m")
