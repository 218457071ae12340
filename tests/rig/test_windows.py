"""A measured run of loose joints reads in windows what it does as one settled simulation, whatever
its sensors do."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointgap.rig.model import LinkageModel, build_model
from tests.rig.rigs import campaign, chosen, mechanism, read

PINS = ("crank_pin", "piston_pin")
CHANNELS = (
    "time",
    "crank_angle",
    "slider_position",
    "slider_acceleration",
    "crank_torque",
    "guide_force",
)
FILM = {
    "name": "lubricated_joint",
    "site": "crank_pin",
    "parameters": {"viscosity_Pa_s": 0.05, "length_m": 0.014},
}
MOTOR = {"kind": "motor", "stall_torque": 30.0, "no_load_speed": 40.0, "inertia": 0.02}
FILTER = {"slider_acceleration": {"bandwidth": "500 Hz"}}
CLOCKWISE = {"direction": "clockwise"}
GAIN = ("sensor_gain:crank_torque", {"gain_error": 0.1})
LAG = ("sensor_lag:guide_force", {"lag_s": 2e-4})
DELAY = ("sensor_delay:crank_torque", {"delay_s": 2e-4})


def rig(loose=PINS, effects=(), channels=CHANNELS, **keys) -> LinkageModel:
    return build_model(
        campaign(mechanism(loose, effects=effects), channels, speeds=(20.0, 30.0), **keys)
    )


def windows_of(model, *effects):
    effects = [(chosen(model, label), values) for label, values in effects]
    return model.windows("slow", model.nominal("slow"), effects)


def filtered(windows, values):
    """States by the filter from readings with a noise of 1 % of their variation."""
    noise = {name: np.full(value.size, 0.01 * np.std(value)) for name, value in values.items()}
    return windows.filter_states(values, noise, 16, 0.01, math.inf)


def assert_alike(found, expected):
    for name, value in expected.items():
        bound = {"slider_position": 1e-5, "crank_angle": 1e-9}.get(name, 5e-3)
        assert np.sqrt(np.mean((found[name] - value) ** 2)) / np.std(value) < bound, name


@pytest.fixture(scope="module")
def found():
    """A model, the windows of a run, its readings and the states that a filter finds in
    that."""
    model = rig()
    windows, true = windows_of(model), read(model)
    return model, windows, true, filtered(windows, true)


@pytest.mark.parametrize(
    "keys, faults",
    [
        ({}, ()),
        ({"run": CLOCKWISE, "sensors": FILTER}, (GAIN, LAG)),
        ({"run": CLOCKWISE}, (DELAY,)),
    ],
)
def test_readings_in_windows_equal_those_of_one_simulation(keys, faults):
    model = rig(**keys)
    # the filter of states has no lags and delays
    states = filtered(windows_of(model), read(model)).states
    faulty = windows_of(model, *faults)
    again, ends, handed, done = faulty.simulate(states)
    assert done.all() and ends.shape == states.slow.shape == (len(handed.modes), faulty.size)
    assert_alike(again, read(model, *faults))


def test_settled_windows_are_continuous_and_equal_one_simulation(found):
    _, windows, true, own = found
    states = windows.steady_states(replace(own.states, slow=own.states.slow + 1.0))
    again, ends, _, done = windows.simulate(states)
    jumps = ends[:-1] - states.slow[1:]
    jumps[:, 0::2] -= math.tau * np.round(jumps[:, 0::2] / math.tau)
    assert done.all() and np.abs(jumps).max() < 5e-3
    assert_alike(again, true)


def test_the_filter_finds_the_states_from_noisy_readings(found):
    _, windows, true, own = found
    rng = np.random.default_rng(0)
    noisy = {
        name: value + 0.02 * np.std(value) * rng.standard_normal(value.size)
        for name, value in true.items()
    }
    away = (filtered(windows, noisy).states.slow - windows.steady_states(own.states).slow)[
        16:, 0::2
    ]
    away -= math.tau * np.round(away / math.tau)
    assert np.median(np.abs(away), axis=0).max() < 0.02


def test_loose_joints_are_more_likely_than_ideal_ones_where_joints_are_loose(found):
    _, windows, true, own = found
    noise = {name: np.full(value.size, 0.01 * np.std(value)) for name, value in true.items()}
    by_ideal = windows.deviance_of(read(rig(loose=())), true, noise)
    assert own.deviance < 0.1 * by_ideal
    assert windows.deviance_of(true, true, noise) == 0.0
    # gaps do not count, and few large residuals weigh less than their squares
    one = {"crank_torque": np.where(np.arange(true["crank_torque"].size) == 3, 9.0, np.nan)}
    unit = {"crank_torque": np.ones(true["crank_torque"].size)}
    zero = {"crank_torque": np.zeros(true["crank_torque"].size)}
    assert windows.deviance_of(zero, one, unit) == pytest.approx(9.0 * math.log(10.0))


def test_the_filter_ends_at_a_given_deviance(found):
    _, windows, true, own = found
    noise = {name: np.full(value.size, 0.01 * np.std(value)) for name, value in true.items()}
    most = 0.25 * own.deviance
    ended = windows.filter_states(true, noise, 16, 0.01, math.inf, most)
    assert most < ended.deviance < 0.5 * own.deviance and ended.readings < own.readings


def test_samples_of_a_window_without_simulation_are_missing(found):
    model, windows, _, own = found
    slow = own.states.slow.copy()
    slow[5, 1] = 1e4  # so fast that steps run out
    read_again, ends, _, done = windows.simulate(replace(own.states, slow=slow))
    assert np.flatnonzero(~done).tolist() == [5] and np.isnan(ends[5]).all()
    series = next(item for item in model.series if item.channel == "crank_torque")
    missing = windows.window_of(series.time, own.states) == 5
    assert np.array_equal(np.isnan(read_again["crank_torque"]), missing)


def test_filters_do_not_spread_a_window_without_simulation():
    model = rig(sensors=FILTER)
    states = filtered(windows_of(model), read(model)).states
    slow = states.slow.copy()
    slow[20, 1] = 1e6  # so fast that steps run out
    faulty, series = windows_of(model, LAG), model.series[0]
    complete, *_ = faulty.simulate(states)
    again, _, _, done = faulty.simulate(replace(states, slow=slow))
    assert np.flatnonzero(~done).tolist() == [20]
    missing = faulty.window_of(series.time, states) == 20
    far = np.arange(missing.size) < np.flatnonzero(missing)[0] - 3
    for channel in ("guide_force", "slider_acceleration"):
        assert np.array_equal(np.isnan(again[channel]), missing)
        away = (again[channel] - complete[channel])[far]
        assert np.sqrt(np.mean(away**2)) < 0.02 * np.std(complete[channel])


@pytest.mark.parametrize(
    "keys",
    [
        {"loose": ()},
        {"effects": (FILM,)},
        {"drive": "motor", "motor": MOTOR},
        {"channels": ("time", "crank_angle")},
    ],
)
def test_films_motors_ideal_joints_and_angles_alone_have_no_windows(keys):
    assert windows_of(rig(**keys)) is None
