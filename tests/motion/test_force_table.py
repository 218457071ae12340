"""Loads on the slider from tables."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline

from jointgap.core.errors import InputError
from jointgap.effects.force_table import MOST_ROWS
from jointgap.motion.mechanism_warnings import odd_data
from jointgap.motion.slider_crank import simulate
from jointgap.rig.model import build_model
from jointgap.rig.recording import Measurements
from tests.config.mechanisms import mechanism as listed
from tests.motion.cases import CRANK, ROD, effect, mechanism, options
from tests.motion.closed import Closed
from tests.rig.rigs import campaign, read, recorded, seen
from tests.rig.rigs import mechanism as content

TURN = np.arange(0.0, 360.0, 2.0)  # deg
WAVE = 30.0 * np.cos(np.radians(TURN))
FOUR_STROKE = "40*cos(theta/2) + 10*sin(1.5*theta)"


def four_stroke(degrees):
    theta = np.radians(degrees)
    return 40.0 * np.cos(theta / 2) + 10.0 * np.sin(1.5 * theta)


def gas_force(degrees):
    position = Closed(mechanism(loose=()), np.radians(degrees), 1.0).slider_position
    return -300.0 * (0.05 / (0.05 + CRANK + ROD - position)) ** 1.3


@pytest.fixture
def table(tmp_path):
    """The entry of an effect with a table of a load over an angle or over time."""

    def write(place, load, unit="deg", kind="force", load_unit="N", name="load", **more):
        pd.DataFrame({"at": place, "F": load}).to_csv(tmp_path / f"{name}.csv", index=False)
        columns = {"angle" if unit == "deg" else "time": ("at", unit), kind: ("F", load_unit)}
        given = {name: {"column": column, "unit": unit} for name, (column, unit) in columns.items()}
        return effect(
            "slider_force_table", **{"file": str(tmp_path / f"{name}.csv")} | given | more
        )

    return write


def torque(*effects, revolutions=1):
    """Of the drive at each sample [N m]."""
    chosen = options(
        start_angle=0.1, revolutions=revolutions, samples_per_revolution=90, tolerance=1e-11
    )
    return simulate(mechanism(*effects, loose=()), chosen).samples.crank_torque.to_numpy()


def away(found, expected):
    return np.abs(found - expected).max() / np.abs(expected).max()


def test_a_table_of_a_gas_spring_is_the_gas_spring(table):
    expected = torque(effect("gas_pressure", force_N=300.0, dead_length_m=0.05, exponent=1.3))
    errors = []
    for step in (4.0, 2.0, 1.0):
        degrees = np.arange(0.0, 360.0, step)
        errors.append(away(torque(table(degrees, gas_force(degrees))), expected))
    assert away(torque(), expected) > 0.1
    assert errors[0] / errors[1] > 8  # cubic: 16 times nearer with half the step
    assert errors[2] < 1e-7


def test_pressure_times_area_is_a_force_and_an_angle_may_be_reversed(table):
    degrees, area = np.arange(0.0, 361.0, 1.0), math.pi * 0.07**2 / 4
    force = gas_force(degrees) + 30.0 * np.sin(np.radians(degrees))
    by_force = torque(table(degrees, force))
    bar = {"kind": "pressure", "load_unit": "bar", "bore": "70 mm", "ambient_pressure": "1 bar"}
    assert away(torque(table(degrees, 1.0 - force / area / 1e5, **bar)), by_force) < 1e-12
    assert away(torque(table(degrees, force[::-1], reversed=True)), by_force) < 1e-9


def test_loads_repeat_after_their_period(table):
    degrees = np.arange(-180.0, 540.0, 1.0)
    expected = torque(effect("discovered_slider_force", formula=FOUR_STROKE), revolutions=3)
    assert away(torque(table(degrees, four_stroke(degrees)), revolutions=3), expected) < 1e-6
    later = torque(table(degrees, four_stroke(degrees), zero="360 deg"), revolutions=3)
    np.testing.assert_allclose(later[:90], expected[90:180], rtol=1e-5, atol=1e-5)
    assert np.abs(later[:90] - expected[:90]).max() > 1.0

    time = np.linspace(0.0, 1.0 / 37.0, 200, endpoint=False)
    entry = table(time, 30.0 * np.cos(math.tau * 37.0 * time + 0.4), "s", period=1.0 / 37.0)
    expected = torque(
        effect("harmonic_force", force_N=30.0, frequency_Hz=37.0, phase_rad=0.4), revolutions=3
    )
    assert away(torque(entry, revolutions=3), expected) < 1e-6


def test_several_tables_act_together(table):
    """Two- and four-stroke loads, one reversed and shifted, and two loads over time."""
    coarse, fine = np.arange(0.0, 360.0, 3.0), np.arange(-180.0, 540.0, 1.7)
    two = table(coarse, gas_force(coarse), name="two", reversed=True, zero="40 deg")
    four = table(fine, four_stroke(fine), name="four")
    time = np.linspace(0.0, 1.0, 300, endpoint=False)
    slow = table(time * 0.3, 30.0 * np.cos(math.tau * time), "s", name="slow", period=0.3)
    fast = table(time * 0.1, 9.0 * np.sin(math.tau * time), "s", name="fast", period=0.1)
    long = np.linspace(0.0, 720.0, 3601)
    rows = [
        table(long + shift, four_stroke(long + shift), name=f"of {shift}") for shift in (0.0, 0.1)
    ]
    alone = torque(revolutions=3)
    for one, other in ((two, four), (slow, fast), rows):
        parts = [torque(each, revolutions=3) - alone for each in (one, other)]
        assert min(np.abs(part).max() for part in parts) > 0.1
        assert away(torque(one, other, revolutions=3) - alone, sum(parts)) < 1e-7
    with pytest.raises(InputError, match="one load is over the crank angle and another one over"):
        listed(two, slow)
    odd = table(time * 0.123, 9.0 * np.sin(math.tau * time), "s", name="odd", period=0.123456)
    with pytest.raises(InputError, match="no common multiple"):
        listed(slow, odd)


def test_pressure_on_the_crank_side_pushes_outwards_and_sensors_have_zero_and_gain(table):
    degrees, area = np.arange(0.0, 361.0, 1.0), math.pi * 0.07**2 / 4
    bar = 2.0 + np.sin(np.radians(degrees))
    keys = {"kind": "pressure", "load_unit": "bar", "bore": "70 mm", "ambient_pressure": "1 bar"}
    head = torque(table(degrees, bar, **keys))
    crank = torque(table(degrees, bar, side="crank", **keys))
    assert away(crank - torque(), torque() - head) < 1e-12
    read = (bar - 0.3) / 1.1
    for side, expected in (("head", head), ("crank", crank)):
        entry = table(degrees, read, side=side, pressure_gain=1.1, pressure_zero="0.3 bar", **keys)
        assert away(torque(entry), expected) < 1e-12
    force = table(degrees, area * bar, side="crank")
    with pytest.raises(InputError, match="pressure_gain are only for a pressure"):
        listed(force)


DEGREES, TIME = np.arange(0.0, 720.0, 1.0), np.linspace(0.0, 0.3, 300, endpoint=False)


@pytest.mark.parametrize(
    "written, keys",
    [
        ((DEGREES, four_stroke(DEGREES)), {}),
        ((TIME, 30.0 * np.cos(math.tau * TIME / 0.3), "s"), {"period": 0.3}),
    ],
)
def test_a_campaign_simulates_the_recorded_load(table, written, keys):
    """Two different turns, recorded from the third turn on."""
    own = campaign(
        content(effects=[table(*written, **keys)]), channels=("time", "crank_angle", "crank_torque")
    )
    runs = {
        name: replace(one, time=one.time + 2 * math.tau / {"slow": 30.0, "fast": 45.0}[name])
        for name, one in recorded(own).runs.items()
    }
    model = build_model(own, Measurements(runs))
    for run in runs:
        true = seen(model, run)["crank_torque"]
        assert np.abs(true[:90] - true[90:180]).max() > 0.1 * np.std(true)
        np.testing.assert_allclose(
            read(model, run=run)["crank_torque"], true, atol=1e-5 * np.std(true)
        )


BELOW_ZERO = {"force": None, "pressure": {"column": "F", "unit": "bar"}, "bore": 0.07}


@pytest.mark.parametrize(
    "place, load, keys, message",
    [
        (TURN, TURN, {}, "column F: not periodic.*358 N"),
        (1.5 * TURN, WAVE, {}, "span 537 deg.*neither 360 nor 720 deg"),
        (TURN[::-1], WAVE, {}, "row 3: not increasing"),
        (TURN[:5], WAVE[:5], {}, "5 rows; give 8 rows"),
        (TURN, WAVE, {"angle": {"column": "at", "unit": "mm"}}, "unit = 'mm'.*requires rad"),
        (TURN, WAVE, {"period": 1.0}, "period is only for a table over time"),
        (TURN, WAVE, {"bore": 0.07}, "pressure and bore require each other"),
        (TURN, WAVE, BELOW_ZERO, "column F, row 48: negative"),
        (TURN, WAVE, {"time": {"column": "t", "unit": "s"}}, "requires either angle or time"),
    ],
)
def test_invalid_load_tables_are_refused(table, place, load, keys, message):
    with pytest.raises(InputError, match=f"(?s){message}"):
        listed(table(place, load, **keys))


def pressure(degrees):
    """A four-stroke engine [bar], with a fourfold rise within 3 deg."""
    away = np.radians(degrees - 360.0)
    burnt = (
        15.0 * (1.0 + np.tanh(degrees - 365.0)) * np.exp(-np.logaddexp(0.0, degrees - 365.0) / 40.0)
    )
    return 1.0 + 9.0 * np.exp(-((away / 0.5) ** 2)) + burnt


BAR = {"kind": "pressure", "load_unit": "bar", "bore": "70 mm"}


def remarks_of(entry):
    return [text for text in odd_data(mechanism(entry)) if text.startswith("slider_force_table: ")]


def test_a_spike_is_remarked_and_a_steep_rise_is_not(table):
    for step in (0.5, 1.0, 2.0, 5.0):
        degrees = np.arange(0.0, 720.0, step)
        assert remarks_of(table(degrees, pressure(degrees), **BAR)) == []
    one, two = pressure(np.arange(0.0, 720.0, 2.0)), pressure(np.arange(0.0, 720.0, 2.0))
    one[60], two[[100, 101]] = 500.0, 300.0
    for load, words in (
        (one, "row 62: 500 bar is far"),
        (two, "row 102 and 1 more: 300 bar is far"),
    ):
        (remark,) = remarks_of(table(np.arange(0.0, 720.0, 2.0), load, **BAR))
        assert "load.csv, column F" in remark and words in remark
    noisy = pressure(DEGREES) + 0.3 * np.random.default_rng(0).standard_normal(DEGREES.size)
    assert remarks_of(table(DEGREES, noisy, **BAR)) == []
    for rows in (8, 12, 36):  # of a wave sampled coarsely
        degrees = np.linspace(0.0, 360.0, rows, endpoint=False)
        assert remarks_of(table(degrees, np.cos(np.radians(degrees)))) == []


def test_a_long_table_is_thinned_accurately(table):
    degrees = np.linspace(0.0, 720.0, 7201)
    force = -1e5 * math.pi * 0.07**2 / 4 * pressure(degrees)
    entry = table(degrees, force)
    (remark,) = remarks_of(entry)
    assert "7201 rows are thinned" in remark
    exact = CubicSpline(np.radians(degrees), np.append(force[:-1], force[0]), bc_type="periodic")
    records = {"sites": {}, "tables": {}}
    mechanism(entry).effects[0].compile_into(records)
    pieces = records["table"]
    assert len(pieces) <= MOST_ROWS
    places = np.radians(np.linspace(0.0, 719.99, 100_003))
    row = np.searchsorted(pieces[:, 0], places, side="right") - 1
    since, c = places - pieces[row, 0], pieces[row].T
    thinned = ((c[1] * since + c[2]) * since + c[3]) * since + c[4]
    error = np.abs(thinned - exact(places)).max()
    assert error < 1e-4 * np.ptp(force)
    stated = float(remark.partition("at most ")[2].partition(" N")[0])
    assert error <= 1.1 * stated
    (remark,) = remarks_of(table(degrees, np.zeros(degrees.size)))
    assert "at most 0 N, 0 % of the range" in remark


def test_contradictory_units_below_the_headings_are_refused(table, tmp_path):
    rows = "".join(f"{at:g};{load:g}\n" for at, load in zip(TURN, 100.0 + WAVE, strict=True))
    keys = {"bore": "70 mm", "pressure": {"column": "F", "unit": "kPa"}, "force": None}
    for unit, said in (
        ("bar", "row below the headings says 'bar', but pressure.unit is 'kPa'"),
        ("kPa", None),
    ):
        entry = table(TURN, WAVE, **keys)
        (tmp_path / "load.csv").write_text(f"at;F\ndeg;{unit}\n{rows}")
        if said:
            with pytest.raises(InputError, match=said):
                listed(entry)
        else:
            listed(entry)
