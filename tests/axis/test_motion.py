"""Simulated motion of an axis against exact solutions."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from jointgap.axis.analyse import ModelState
from jointgap.axis.motion import behind_play, played
from tests.axis.folders import write

FILE = """
name: slide
given: drive
channels:
  time: {column: t, unit: s}
  drive: {column: F, unit: N}
  position: {column: x, unit: m, noise: 0.001}
  inertia_force: {column: I, unit: N, noise: 0.1}
runs:
  - {id: one, file: one.csv, role: identify}
  - {id: two, file: two.csv, role: confirm}
"""

CODE = """
from jointgap.axis import Axis, parameter


class Slide(Axis):
    stiffness = parameter(0.0, "N/m", low=0.0, high=1000.0)
    damping = parameter(0.0, "N*s/m", low=0.0, high=100.0)
    MASS = 2.0

    def mass(self):
        return self.MASS

    def force(self, position, velocity):
        return -self.stiffness * position - self.damping * velocity

    def inertia_force(self, acceleration):
        return self.MASS * acceleration
"""


@pytest.fixture(scope="module")
def slide(tmp_path_factory):
    """A function: positions of the slide under a drive, from a start."""
    folder = tmp_path_factory.mktemp("slide")
    place = np.linspace(-1.0, 1.0, 100)
    samples = pd.DataFrame({"t": np.arange(100.0), "F": place, "x": place, "I": place})
    write(folder, FILE, CODE, {"one": samples, "two": samples})
    model = ModelState(folder, folder / "results").model

    def simulate(time, drive, start, friction=0.0, numerics=0, channel="position", **parameters):
        channels = {"drive": drive, "position": np.linspace(-1.0, 1.0, time.size)}
        model.runs["one"] = replace(
            model.runs["one"], time=time, channels=channels, reduce=lambda samples: samples
        )
        values = {"stiffness": 0.0, "damping": 0.0, **parameters}
        values |= {"start_position": start[0], "start_velocity": start[1]}
        candidates = {candidate.label: candidate for candidate in model.candidates}
        effects = ((candidates["coulomb_friction"], {"force_N": friction}),) if friction else ()
        return model.simulate("one", values, effects, numerics)[channel]

    return simulate


def test_a_damped_oscillation_is_that_of_the_exact_solution_with_second_order(slide):
    errors = []
    for interval in (0.02, 0.01):
        time = np.arange(0.0, 3.0, interval)
        found = slide(time, np.zeros(time.size), (0.1, 0.0), stiffness=8.0, damping=0.8)
        decay, square = 0.2, 4.0
        frequency = math.sqrt(square - decay**2)
        exact = 0.1 * np.exp(-decay * time)
        exact = exact * (np.cos(frequency * time) + decay / frequency * np.sin(frequency * time))
        errors.append(np.abs(found - exact).max())
    assert errors[0] < 1e-4
    assert 3.4 < errors[0] / errors[1] < 4.6


def test_dry_friction_stops_the_slide_at_the_exact_place_for_good(slide):
    time = np.arange(0.0, 2.0, 0.01)
    found = slide(time, np.zeros(time.size), (0.0, 1.0), friction=3.0)
    stop = 1.0**2 / (2.0 * 3.0 / 2.0)  # v^2 m / 2 f
    assert found[-1] == pytest.approx(stop, rel=1e-4)
    assert np.ptp(found[time > 0.7]) == 0.0


def test_a_drive_below_the_friction_holds_and_one_above_moves(slide):
    time = np.arange(0.0, 4.0, 0.01)
    drive = 1.0 * time
    found = slide(time, drive, (0.0, 0.0), friction=2.0)
    assert np.ptp(found[time < 1.99]) == 0.0
    moving = time >= 2.0
    exact = (time[moving] - 2.0) ** 3 / 6.0 / 2.0  # m x'' = t - f
    np.testing.assert_allclose(found[moving], exact, atol=2e-4)


def test_reversals_under_friction_lose_the_same_amplitude_each(slide):
    time = np.arange(0.0, 6.0, 0.005)
    found = slide(time, np.zeros(time.size), (1.0, 0.0), friction=1.0, stiffness=18.0)
    # the amplitude falls by 2 f / k each half period pi sqrt(m / k)
    half = math.pi * math.sqrt(2.0 / 18.0)
    for turn in range(1, 5):
        extreme = (-1.0) ** turn * (1.0 - turn * 2.0 / 18.0)
        assert np.interp(turn * half, time, found) == pytest.approx(extreme, abs=2e-4)


def test_a_method_of_a_channel_gets_the_acceleration_which_is_zero_where_friction_holds(slide):
    time = np.arange(0.0, 4.0, 0.01)
    force = slide(time, 1.0 * time, (0.0, 0.0), friction=2.0, channel="inertia_force")
    assert np.ptp(force[time < 1.99]) == 0.0 == force[0]
    moving = time > 2.05
    np.testing.assert_allclose(force[moving], time[moving] - 2.0, atol=1e-6)


def test_half_the_step_changes_little(slide):
    time = np.arange(0.0, 3.0, 0.01)
    drive = 5.0 * np.sin(2.0 * time)
    usual = slide(time, drive, (0.0, 0.1), friction=1.0, stiffness=8.0)
    finer = slide(time, drive, (0.0, 0.1), friction=1.0, stiffness=8.0, numerics=1)
    assert 0.0 < np.abs(usual - finer).max() < 1e-4


def test_what_is_behind_a_play_stands_still_until_it_is_crossed():
    given = np.concatenate([np.linspace(0.0, 1.0, 101), np.linspace(1.0, -1.0, 201)])
    behind = played(given, 0.4)
    assert behind[0] == -0.2 and behind[100] == pytest.approx(0.8)
    crossing = slice(100, 141)
    assert np.ptp(behind[crossing]) == pytest.approx(0.0, abs=1e-12)
    assert behind[-1] == pytest.approx(-0.8)
    np.testing.assert_array_equal(played(given, 0.0), given)
    _, is_open = behind_play(given, 0.4)
    assert is_open[105:140].all() and not is_open[:100].any() and not is_open[142:].any()
