"""A load on the slider from a table moves the mechanism as the law that the table was sampled from."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml

from jointgap.config import load_mechanism
from jointgap.core.errors import InputError
from jointgap.dynamics.simulation import simulate
from jointgap.rig.model import build_model
from jointgap.rig.recording import Measurements
from tests.config.mechanisms import mechanism as listed
from tests.dynamics.cases import CRANK, ROD, effect, mechanism, options
from tests.dynamics.closed import Closed
from tests.rows import each
from tests.slider_crank.rigs import campaign, recorded
from tests.slider_crank.rigs import mechanism as content

GAS = {"force_N": 300.0, "dead_length_m": 0.05, "exponent": 1.3}
FOUR_STROKE = "40*cos(theta/2) + 10*sin(1.5*theta)"


def four_stroke(degrees):
    theta = np.radians(degrees)
    return 40.0 * np.cos(theta / 2) + 10.0 * np.sin(1.5 * theta)


@pytest.fixture
def table(tmp_path):
    """The entry of an effect whose table has these columns, the first one over which the other is."""

    def write(unit="deg", load_unit="N", file="load.csv", over="angle", load="force", **columns):
        place, value = columns
        pd.DataFrame(columns).to_csv(tmp_path / file, index=False)
        given = {over: {"column": place, "unit": unit}, load: {"column": value, "unit": load_unit}}
        return lambda **more: effect("slider_force_table", file=str(tmp_path / file), **given, **more)

    return write


def simulated(*effects, loose=(), revolutions=1, **more):
    chosen = options(start_angle=0.1, revolutions=revolutions, samples_per_revolution=90, tolerance=1e-11)
    return simulate(mechanism(*effects, loose=loose, **more), chosen).samples


def away(found, expected, column="crank_torque"):
    return np.abs(found[column] - expected[column]).max() / np.abs(expected[column]).max()


def gas_force(degrees):
    angle = np.radians(degrees)
    position = Closed(mechanism(loose=()), angle, 1.0).slider_position
    return -300.0 * (0.05 / (0.05 + CRANK + ROD - position)) ** 1.3


def test_a_table_of_a_gas_springs_force_is_the_gas_spring(table):
    expected, without = simulated(effect("gas_pressure", **GAS)), simulated()
    errors = []
    for step in (4.0, 2.0, 1.0):
        degrees = np.arange(0.0, 360.0, step)
        errors.append(away(simulated(table(theta=degrees, F=gas_force(degrees))()), expected))
    assert away(without, expected) > 0.1
    assert errors[0] / errors[1] > 8  # cubic: 16 times nearer with half the step
    assert errors[2] < 1e-7


def test_pressure_and_bore_are_a_force_and_an_angle_may_be_reversed(table):
    degrees, area = np.arange(0.0, 361.0, 1.0), math.pi * 0.07**2 / 4
    force = gas_force(degrees) + 30.0 * np.sin(np.radians(degrees))
    by_force = simulated(table(theta=degrees, F=force)())
    by_pressure = table(load="pressure", load_unit="bar", file="p.csv", theta=degrees, p=1.0 - force / area / 1e5)
    assert away(simulated(by_pressure(bore="70 mm", ambient_pressure="1 bar")), by_force) < 1e-12
    assert away(simulated(table(theta=degrees, F=force[::-1])(reversed=True)), by_force) < 1e-9


def test_a_four_stroke_load_repeats_after_two_revolutions(table):
    degrees = np.arange(-180.0, 540.0, 1.0)
    entry = table(theta=degrees, F=four_stroke(degrees))
    expected = simulated(effect("discovered_slider_force", formula=FOUR_STROKE), revolutions=3).crank_torque.to_numpy()
    found = simulated(entry(), revolutions=3).crank_torque.to_numpy()
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    later = simulated(entry(zero="360 deg"), revolutions=3).crank_torque.to_numpy()
    np.testing.assert_allclose(later[:90], expected[90:180], rtol=1e-5, atol=1e-5)
    assert np.abs(later[:90] - expected[:90]).max() > 1.0


def test_a_load_over_time_repeats_in_its_own_period(table):
    expected = simulated(effect("harmonic_force", force_N=30.0, frequency_Hz=37.0, phase_rad=0.4), revolutions=3)
    time = np.linspace(0.0, 1.0 / 37.0, 200, endpoint=False)
    load = 30.0 * np.cos(math.tau * 37.0 * time + 0.4)
    found = simulated(table("s", over="time", t=time, F=load)(period=1.0 / 37.0), revolutions=3)
    assert away(found, expected) < 1e-6


@each("over", ["angle", "time"])
def test_a_campaign_simulates_the_load_as_its_records_have_it(table, over):
    """In two turns that are not alike, read from the third turn on by a clock that begins with the first."""
    time = np.linspace(0.0, 0.3, 300, endpoint=False)
    if over == "angle":
        degrees = np.arange(0.0, 720.0, 1.0)
        entry = table(theta=degrees, F=four_stroke(degrees))()
    else:
        entry = table("s", over="time", t=time, F=30.0 * np.cos(math.tau * time / 0.3))(period=0.3)
    own = campaign(content(effects=[entry]), channels=("time", "crank_angle", "crank_torque"))
    measurements = recorded(own)
    runs = {
        name: replace(one, time=one.time + 2 * math.tau / speed)
        for (name, one), speed in zip(measurements.runs.items(), (30.0, 45.0), strict=True)
    }
    model = build_model(own, Measurements(runs))
    for name, one in runs.items():
        found = model.simulate(name, model.nominal(name))["crank_torque"]
        read = one.channels["crank_torque"]
        assert np.abs(read[:90] - read[90:180]).max() > 0.1 * np.std(read)
        np.testing.assert_allclose(found, read, atol=1e-5 * np.std(read))


def test_the_file_is_looked_for_beside_the_mechanism_that_lists_it(tmp_path, table):
    (tmp_path / "parts").mkdir()
    entry = table(file="parts/load.csv", theta=DEGREES, F=WAVE)()
    entry["parameters"]["file"] = "load.csv"
    (tmp_path / "parts/engine.yaml").write_text(yaml.safe_dump(content(effects=[entry])), encoding="utf-8")
    assert load_mechanism(tmp_path / "parts/engine.yaml").files == (str(tmp_path / "parts/load.csv"),)
    (tmp_path / "parts/load.csv").unlink()
    with pytest.raises(InputError, match=r"engine\.yaml: effects\.slider_force_table.*no file 'load\.csv'"):
        load_mechanism(tmp_path / "parts/engine.yaml")


DEGREES = np.arange(0.0, 360.0, 2.0)
WAVE = 30.0 * np.cos(np.radians(DEGREES))
BELOW_ZERO = {"force": None, "pressure": {"column": "F", "unit": "bar"}, "bore": 0.07}


@each(
    "written, more, words",
    [
        ({"theta": DEGREES, "F": DEGREES}, {}, ["column F: the period does not close", "358 N apart"]),
        ({"theta": 1.5 * DEGREES, "F": WAVE}, {}, ["span 537 deg", "neither 360 nor 720 deg"]),
        ({"theta": DEGREES[::-1], "F": WAVE}, {}, ["row 3: does not rise"]),
        ({"theta": DEGREES[:5], "F": WAVE[:5]}, {}, ["5 rows; give 8 to 4096"]),
        ({"theta": DEGREES, "F": WAVE}, {"angle": {"column": "theta", "unit": "mm"}}, ["unit = 'mm'", "requires rad"]),
        ({"theta": DEGREES, "F": WAVE}, {"period": 1.0}, ["it is 360 or 720 deg; remove it"]),
        ({"theta": DEGREES, "F": WAVE}, {"bore": 0.07}, ["pressure and bore go together"]),
        ({"theta": DEGREES, "F": WAVE}, BELOW_ZERO, ["column F, row 48: an absolute pressure is not below zero"]),
        ({"theta": DEGREES, "F": WAVE}, {"time": {"column": "t", "unit": "s"}}, ["needs angle or time, one of them"]),
    ],
)
def test_a_table_that_is_no_load_of_one_period_is_refused(table, written, more, words):
    entry = table(**written)()
    entry["parameters"] |= more
    with pytest.raises(InputError) as caught:
        listed(entry)
    for word in words:
        assert word in str(caught.value)
