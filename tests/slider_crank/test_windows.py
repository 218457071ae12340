"""A measured run of loose joints reads in windows what it does as one settled simulation, whatever its sensors do."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointgap.rig.model import SliderCrankModel, build_model
from tests.slider_crank.rigs import campaign, mechanism

PINS = ("crank_pin", "piston_pin")
CHANNELS = ("time", "crank_angle", "slider_position", "slider_acceleration", "crank_torque", "guide_force")
FILM = {"name": "lubricated_joint", "site": "crank_pin", "parameters": {"viscosity_Pa_s": 0.05, "length_m": 0.014}}
MOTOR = {"kind": "motor", "stall_torque": 30.0, "no_load_speed": 40.0, "inertia": 0.02}
FILTER = {"slider_acceleration": {"bandwidth": "500 Hz"}}
GAIN, LAG, DELAY = (
    {"sensor_gain:crank_torque": {"gain_error": 0.1}},
    {"sensor_lag:guide_force": {"lag_s": 2e-4}},
    {"sensor_delay:crank_torque": {"delay_s": 2e-4}},
)


def rig(loose=PINS, effects=(), **keys) -> SliderCrankModel:
    return build_model(campaign(mechanism(loose, effects=effects), CHANNELS, speeds=(20.0, 30.0), **keys))


@pytest.mark.parametrize(
    ("direction", "sensors", "faults"),
    [("counter_clockwise", {}, {}), ("clockwise", FILTER, GAIN), ("clockwise", FILTER, LAG), ("clockwise", {}, DELAY)],
    ids=["plain", "filter_and_gain", "filter_and_lag", "delay"],
)
def test_a_run_reads_in_windows_what_it_does_as_one_simulation(direction, sensors, faults):
    model = rig(run={"direction": direction}, sensors=sensors)
    effects = [(one, faults[one.label]) for one in model.candidates if one.label in faults]
    assert len(effects) == len(faults)
    values = model.nominal("slow")
    true, windows = model.simulate("slow", values), model.windows("slow", values)
    noise = {name: np.full(value.size, 0.01 * np.std(value)) for name, value in true.items()}
    # lags and delays are nothing that the filter of states knows
    states = windows.find(true, noise, 16, 0.01, math.inf).states
    read, faulty = model.simulate("slow", values, effects), model.windows("slow", values, effects)
    again, ends, handed, done = faulty.simulate(states)
    assert done.all() and ends.shape == states.slow.shape == (len(handed.modes), faulty.size)
    for name, value in read.items():
        bound = 1e-5 if name == "slider_position" else 1e-9 if name == "crank_angle" else 5e-3
        apart = np.sqrt(np.mean((again[name] - value) ** 2)) / np.std(value)
        assert apart < bound, name


def test_the_filter_knows_gains_and_signs():
    model = rig(run={"direction": "clockwise"})
    effects = [(one, GAIN[one.label]) for one in model.candidates if one.label in GAIN]
    values = model.nominal("slow")
    read, windows = model.simulate("slow", values, effects), model.windows("slow", values, effects)
    noise = {name: np.full(value.size, 0.01 * np.std(value)) for name, value in read.items()}
    found, without = (one.find(read, noise, 16, 0.01, math.inf) for one in (windows, model.windows("slow", values)))
    assert found.readings == sum(read[name].size for name in windows.channels)
    assert found.deviance + found.readings < without.deviance


def test_windows_cover_the_turns_that_are_asked_for_and_each_holds_its_own_samples():
    model = rig()
    values, time = model.nominal("slow"), next(one.time for one in model.series if one.run == "slow")
    read, windows = model.simulate("slow", values), model.windows("slow", values)
    noise = {name: np.full(value.size, 0.01 * np.std(value)) for name, value in read.items()}
    states, turn = windows.find(read, noise, 16, 0.1, 1.0).states, math.tau / 20.0
    assert turn <= states.edges[-1] < turn * (1 + 1 / 16) and len(states.slow) == states.edges.size - 1
    since = time[time < time[0] + turn] - time[0]
    window = windows.window_of(since + time[0], states)
    assert np.all((states.edges[window] <= since) & (since < states.edges[window + 1]))


@pytest.fixture(scope="module")
def found():
    """A run, its windows, what is read of it and the states that a filter finds in that."""
    model = rig()
    values = model.nominal("slow")
    true, windows = model.simulate("slow", values), model.windows("slow", values)
    noise = {name: np.full(value.size, 0.01 * np.std(value)) for name, value in true.items()}
    return model, windows, true, windows.find(true, noise, 16, 0.01, math.inf).states


def test_the_motion_that_began_long_before_the_record_is_that_of_one_simulation_and_jumps_nowhere(found):
    _, windows, true, states = found
    states = windows.settled(replace(states, slow=states.slow + 1.0))
    read, ends, _, done = windows.simulate(states)
    jumps = ends[:-1] - states.slow[1:]
    jumps[:, 0::2] -= math.tau * np.round(jumps[:, 0::2] / math.tau)
    assert done.all() and np.abs(jumps).max() < 5e-3
    for name, value in true.items():
        bound = 1e-5 if name == "slider_position" else 1e-9 if name == "crank_angle" else 5e-3
        assert np.sqrt(np.mean((read[name] - value) ** 2)) / np.std(value) < bound, name


def test_states_are_those_of_a_run_if_there_are_as_many_of_as_many_numbers_as_its_windows_have(found):
    _, windows, _, states = found
    known = windows.known(states.slow, 16)
    np.testing.assert_array_equal(known.edges, states.edges)
    np.testing.assert_array_equal(known.slow, states.slow)
    assert windows.known(states.slow[:-1], 16) is None
    assert windows.known(states.slow[:, :2], 16) is None
    assert windows.known(states.slow, 8) is None


def test_what_a_sensor_errs_by_is_in_no_reading_but_its_own(found):
    model, windows, _, states = found
    effects = [(one, GAIN[one.label]) for one in model.candidates if one.label in GAIN]
    before = windows.simulate(states)[0]
    faulty = model.windows("slow", model.nominal("slow"), effects).simulate(states)[0]
    again = windows.simulate(states)[0]
    for name, value in before.items():
        np.testing.assert_allclose(faulty[name], value * (1.1 if name == "crank_torque" else 1.0))
        np.testing.assert_array_equal(again[name], value)


@pytest.mark.parametrize(
    ("loose", "effects", "keys"),
    [((), (), {}), (PINS, (FILM,), {}), (PINS, (), {"drive": "motor", "motor": MOTOR})],
    ids=["ideal_joints", "a_film", "a_motor"],
)
def test_what_has_no_state_on_a_clearance_circle_of_its_own_has_no_windows(loose, effects, keys):
    model = rig(loose, effects, **keys)
    assert model.windows("slow", model.nominal("slow")) is None


def test_a_channel_of_which_no_sample_counts_tells_the_filter_nothing():
    model = rig()
    values = model.nominal("slow")
    read, windows = model.simulate("slow", values), model.windows("slow", values)
    noise = {name: np.full(value.size, 0.01 * np.std(value)) for name, value in read.items()}
    rest = {name: value for name, value in read.items() if name != "guide_force"}
    found = windows.find(rest, {name: noise[name] for name in rest}, 16, 0.01, math.inf)
    assert found.readings == sum(rest[name].size for name in windows.channels if name in rest)


def test_a_run_of_which_the_crank_angle_alone_is_read_has_no_windows():
    model = build_model(campaign(mechanism(PINS), ("time", "crank_angle"), speeds=(20.0, 30.0)))
    assert model.windows("slow", model.nominal("slow")) is None
