"""Windows of a record, each from a state of its own, read what one trajectory does; a filter finds their states."""

import math
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest

from jointgap.config import Simulate, load_mechanism
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.joints import clearances
from jointgap.dynamics.parameters import Parameters
from jointgap.dynamics.sampling import SAMPLE
from jointgap.dynamics.simulation import integrate_to_angles, start_state
from jointgap.dynamics.windows import (
    Carried,
    FilterSettings,
    Readings,
    Rows,
    filtered,
    loose_joints,
    resting,
    rows_of,
    simulate_windows,
)
from tests.rows import each

TOLERANCE = 1e-10  # m
SPEED, SETTLED, PER_TURN, TURNS, SAMPLES = 20.0, 6, 16, 2, 120
POSITIONS = ("slider_position", "rod_angle")
FORCES = ("slider_acceleration", "crank_torque", "frame_force_x")
PINS, PIVOT = ("crank_pin", "piston_pin"), ("crank_pivot",)


class Settled(NamedTuple):
    """Two turns of a settled plain simulation, and its states at the beginnings of windows."""

    p: Parameters
    rows: Rows
    columns: dict[str, np.ndarray]
    slow: np.ndarray
    carried: Carried


def settled(loose) -> Settled:
    made = load_mechanism("config/mechanisms/erkaya2009.yaml")
    joints = {name: made.joint(name).model_copy(update={"loose": name in loose}) for name in (*PINS, *PIVOT)}
    made = made.model_copy(update={"joints": made.joints.model_copy(update=joints)}).applied()
    p = parameters(made, Simulate.model_construct(speed=SPEED, start_angle=0.0, tolerance=TOLERANCE))
    edges = math.tau * (SETTLED + np.arange(TURNS * PER_TURN + 1) / PER_TURN)
    angles = math.tau * (SETTLED + np.arange(TURNS * SAMPLES) / SAMPLES)
    every, places = np.unique(np.concatenate([[0.0], edges, angles]), return_inverse=True)
    motion = integrate_to_angles(p, start_state(p), every, TOLERANCE)
    at_edges, at_angles = places[1 : edges.size], places[edges.size + 1 :]
    slow, carried = np.zeros((edges.size - 1, 2 * len(loose))), resting(p, edges.size - 1)
    for k, row in enumerate(at_edges):
        vectors = clearances(motion.states[row], motion.auxiliary_states[row])
        for i, joint in enumerate(loose_joints(p)):
            x, y, vx, vy = vectors[joint]
            slow[k, 2 * i : 2 * i + 2] = math.atan2(y, x), (x * vy - y * vx) / (x * x + y * y) / SPEED
        carried.modes[k] = motion.modes[row]
    return Settled(p, rows_of(p, edges, angles), motion.part(at_angles).observed(p), slow, carried)


@pytest.fixture(scope="module")
def pins() -> Settled:
    return settled(PINS)


def turned(change):
    """Differences of states, angles the shorter way round."""
    change = change.copy()
    change[:, 0::2] = (change[:, 0::2] + math.pi) % math.tau - math.pi
    return change


def handed_on(carried: Carried, after: Carried) -> Carried:
    return Carried(*(np.concatenate([first[:1], then[:-1]]) for first, then in zip(carried, after, strict=True)))


def of_spread(found, true):
    """Root mean square of the difference over the standard deviation of what is true."""
    return float(np.sqrt(np.mean((found - true) ** 2)) / np.std(true))


@each("loose", [PINS, PIVOT])
def test_windows_that_begin_in_states_of_a_trajectory_read_what_it_does(loose, pins, worst):
    here = pins if loose is PINS else settled(loose)
    carried = here.carried
    for _ in range(3):
        columns, ends, after, done = simulate_windows(here.p, here.rows, here.slow, carried, TOLERANCE)
        assert done.all()
        carried = handed_on(carried, after)
    name = "windows of " + " and ".join(loose)
    for channel in POSITIONS:
        worst(f"{name}: {channel}", of_spread(columns[channel], here.columns[channel]), 1e-6)
    for channel in FORCES:
        worst(f"{name}: {channel}", of_spread(columns[channel], here.columns[channel]), 5e-3)
    jumps = np.abs(turned(ends[:-1] - here.slow[1:]))
    worst(f"{name}: jumps of angles", jumps[:, 0::2].max(), 1e-3)
    worst(f"{name}: jumps of rates", jumps[:, 1::2].max(), 5e-3)


def test_a_window_that_cannot_be_simulated_is_told_and_its_samples_are_missing(pins):
    slow = pins.slow.copy()
    slow[5, 1] = 1e4  # so fast that steps run out
    columns, ends, _, done = simulate_windows(pins.p, pins.rows, slow, pins.carried, TOLERANCE)
    assert np.flatnonzero(~done).tolist() == [5] and np.isnan(ends[5]).all()
    window = np.repeat(np.arange(done.size), np.diff(pins.rows.bounds))
    missing = np.zeros(pins.columns["crank_torque"].size, bool)
    missing[pins.rows.sample[(window == 5) & (pins.rows.sample >= 0)]] = True
    assert np.array_equal(np.isnan(columns["crank_torque"]), missing)


def test_a_filter_finds_the_states_of_noisy_readings_from_directions_alone(pins, worst):
    names, rng, count = (*POSITIONS, *FORCES), np.random.default_rng(0), len(pins.slow)
    data, weight = np.zeros((2, pins.rows.angles.size, len(names)))
    read = pins.rows.sample >= 0
    for i, name in enumerate(names):
        true = pins.columns[name]
        sd = 0.02 * np.std(true)
        data[read, i] = (true + sd * rng.standard_normal(true.size))[pins.rows.sample[read]]
        weight[read, i] = 1.0 / sd
    columns = np.array([SAMPLE.names.index(name) for name in names])
    readings = Readings(columns, np.ones(len(names)), np.zeros(len(names)), data, weight)
    guesses = np.array([(a, 0.0, b, 0.0) for a, b in product(np.linspace(0.0, math.tau, 8, endpoint=False), repeat=2)])
    nothing = np.full((count, 4), np.nan)
    found, sums = filtered(pins.p, pins.rows, count, readings, FilterSettings(0.1), guesses, False, nothing, TOLERANCE)
    assert sums.readings == TURNS * SAMPLES * len(names)
    away = np.abs(turned(found.slow - pins.slow))[PER_TURN:]
    for i, joint in enumerate(PINS):
        worst(f"angle of the {joint} by the filter", np.median(away[:, 2 * i]), 0.02)
