"""A measured run of loose joints reads in windows what it does as one settled simulation, whatever its sensors do."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointgap.rig.model import SliderCrankModel, build_model
from tests.rows import each
from tests.slider_crank.rigs import campaign, chosen, mechanism, read

PINS = ("crank_pin", "piston_pin")
CHANNELS = ("time", "crank_angle", "slider_position", "slider_acceleration", "crank_torque", "guide_force")
FILM = {"name": "lubricated_joint", "site": "crank_pin", "parameters": {"viscosity_Pa_s": 0.05, "length_m": 0.014}}
MOTOR = {"kind": "motor", "stall_torque": 30.0, "no_load_speed": 40.0, "inertia": 0.02}
FILTER = {"slider_acceleration": {"bandwidth": "500 Hz"}}
CLOCKWISE = {"direction": "clockwise"}
GAIN = ("sensor_gain:crank_torque", {"gain_error": 0.1})
LAG = ("sensor_lag:guide_force", {"lag_s": 2e-4})
DELAY = ("sensor_delay:crank_torque", {"delay_s": 2e-4})


def rig(loose=PINS, effects=(), channels=CHANNELS, **keys) -> SliderCrankModel:
    return build_model(campaign(mechanism(loose, effects=effects), channels, speeds=(20.0, 30.0), **keys))


def windows_of(model, *effects):
    effects = [(chosen(model, label), values) for label, values in effects]
    return model.windows("slow", model.nominal("slow"), effects)


def filtered(windows, values, turns=math.inf, spread=0.01):
    """What the filter finds in readings whose noise is 1 % of what they vary by."""
    noise = {name: np.full(value.size, 0.01 * np.std(value)) for name, value in values.items()}
    return windows.find(values, noise, 16, spread, turns)


def assert_alike(found, expected):
    for name, value in expected.items():
        bound = {"slider_position": 1e-5, "crank_angle": 1e-9}.get(name, 5e-3)
        assert np.sqrt(np.mean((found[name] - value) ** 2)) / np.std(value) < bound, name


@pytest.fixture(scope="module")
def found():
    """A model, the windows of a run, what is read of it and the states that a filter finds in that."""
    model = rig()
    windows, true = windows_of(model), read(model)
    return model, windows, true, filtered(windows, true)


@each(
    "keys, faults",
    [
        ({}, ()),
        ({"run": CLOCKWISE, "sensors": FILTER}, (GAIN,)),
        ({"run": CLOCKWISE, "sensors": FILTER}, (LAG,)),
        ({"run": CLOCKWISE}, (DELAY,)),
    ],
)
def test_a_run_reads_in_windows_what_it_does_as_one_simulation(keys, faults):
    model = rig(**keys)
    # lags and delays are nothing that the filter of states knows
    states = filtered(windows_of(model), read(model)).states
    faulty = windows_of(model, *faults)
    again, ends, handed, done = faulty.simulate(states)
    assert done.all() and ends.shape == states.slow.shape == (len(handed.modes), faulty.size)
    assert_alike(again, read(model, *faults))


def test_the_filter_knows_gains_and_signs():
    model = rig(run=CLOCKWISE)
    faulty = read(model, GAIN)
    with_gain, without = (filtered(windows_of(model, *faults), faulty) for faults in ((GAIN,), ()))
    assert with_gain.readings == sum(faulty[name].size for name in windows_of(model).channels)
    assert with_gain.deviance + with_gain.readings < without.deviance


def test_windows_cover_the_turns_that_are_asked_for_and_each_holds_its_own_samples(found):
    model, windows, true, _ = found
    time = next(one.time for one in model.series if one.run == "slow")
    states, turn = filtered(windows, true, 1.0, 0.1).states, math.tau / 20.0
    assert turn <= states.edges[-1] < turn * (1 + 1 / 16) and len(states.slow) == states.edges.size - 1
    since = time[time < time[0] + turn] - time[0]
    window = windows.window_of(since + time[0], states)
    assert np.all((states.edges[window] <= since) & (since < states.edges[window + 1]))


def test_the_motion_that_began_long_before_the_record_is_that_of_one_simulation_and_jumps_nowhere(found):
    _, windows, true, own = found
    states = windows.settled(replace(own.states, slow=own.states.slow + 1.0))
    again, ends, _, done = windows.simulate(states)
    jumps = ends[:-1] - states.slow[1:]
    jumps[:, 0::2] -= math.tau * np.round(jumps[:, 0::2] / math.tau)
    assert done.all() and np.abs(jumps).max() < 5e-3
    assert_alike(again, true)


def test_of_noisy_readings_a_filter_finds_the_states_from_directions_alone(found):
    _, windows, true, own = found
    rng = np.random.default_rng(0)
    noisy = {name: value + 0.02 * np.std(value) * rng.standard_normal(value.size) for name, value in true.items()}
    away = (filtered(windows, noisy).states.slow - windows.settled(own.states).slow)[16:, 0::2]
    away -= math.tau * np.round(away / math.tau)
    assert np.median(np.abs(away), axis=0).max() < 0.02


def test_a_window_that_cannot_be_simulated_is_told_and_its_samples_are_missing(found):
    model, windows, _, own = found
    slow = own.states.slow.copy()
    slow[5, 1] = 1e4  # so fast that steps run out
    read_again, ends, _, done = windows.simulate(replace(own.states, slow=slow))
    assert np.flatnonzero(~done).tolist() == [5] and np.isnan(ends[5]).all()
    series = next(one for one in model.series if one.channel == "crank_torque")
    missing = windows.window_of(series.time, own.states) == 5
    assert np.array_equal(np.isnan(read_again["crank_torque"]), missing)


def test_states_are_those_of_a_run_if_there_are_as_many_of_as_many_numbers_as_its_windows_have(found):
    _, windows, _, own = found
    states = own.states
    known = windows.known(states.slow, 16)
    np.testing.assert_array_equal(known.edges, states.edges)
    np.testing.assert_array_equal(known.slow, states.slow)
    for slow, count in ((states.slow[:-1], 16), (states.slow[:, :2], 16), (states.slow, 8)):
        assert windows.known(slow, count) is None


def test_what_a_sensor_errs_by_is_in_no_reading_but_its_own(found):
    model, windows, _, own = found
    before = windows.simulate(own.states)[0]
    faulty = windows_of(model, GAIN).simulate(own.states)[0]
    again = windows.simulate(own.states)[0]
    for name, value in before.items():
        np.testing.assert_allclose(faulty[name], value * (1.1 if name == "crank_torque" else 1.0))
        np.testing.assert_array_equal(again[name], value)


def test_a_channel_of_which_no_sample_counts_tells_the_filter_nothing(found):
    _, windows, true, _ = found
    rest = {name: value for name, value in true.items() if name != "guide_force"}
    assert filtered(windows, rest).readings == sum(rest[name].size for name in windows.channels if name in rest)


@each(
    "keys",
    [
        {"loose": ()},
        {"effects": (FILM,)},
        {"drive": "motor", "motor": MOTOR},
        {"channels": ("time", "crank_angle")},
    ],
)
def test_what_has_no_state_on_a_clearance_circle_of_its_own_or_reads_the_angle_alone_has_no_windows(keys):
    assert windows_of(rig(**keys)) is None
