"""A measured crank angle: what is recovered of a known one, how far it errs, and what is refused."""

import numpy as np
import pandas as pd
import pytest
from scipy.sparse import eye_array

from jointgap.core.errors import InputError
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.drive import AngleErrors, smooth_angle, unwrapped
from jointgap.dynamics.simulation import integrate_to_angles, simulate, start_state
from tests.config.mechanisms import mechanism as listed
from tests.dynamics.cases import SPEED, mechanism, options
from tests.dynamics.closed import Closed
from tests.rows import each

RATIO, STEP = 0.02, np.radians(0.1)


def known(time):
    """A crank that swings about a steady rotation: angle, speed, acceleration."""
    rate = 2 * SPEED
    angle = 0.2 + SPEED * time + RATIO * np.sin(rate * time)
    return angle, SPEED + RATIO * rate * np.cos(rate * time), -RATIO * rate**2 * np.sin(rate * time)


def measured(folder, angle_of=lambda angle: angle, unit=1.0, count=2001, revolutions=2, **keys):
    """Options for a run along the table of `known` angles as an instrument shows them."""
    time = np.linspace(0.0, 0.1 * (revolutions + 0.5), count)
    path = folder / "angle.csv"
    pd.DataFrame({"t": time + 7.0, "theta": angle_of(known(time)[0]) * unit}).to_csv(path, index=False)
    drive = {"kind": "measured", "file": str(path), "time": "t", "angle": "theta", **keys}
    return options(drive=drive, start_angle=0.5, revolutions=revolutions)


def deviations(samples):
    """Largest deviations of angle [rad], speed and acceleration from the known ones at the samples' times."""
    fine = np.linspace(0.0, 0.01, 100001)
    start = np.interp(0.5, known(fine)[0], fine)
    exact = known(samples.time.to_numpy() + start)
    seen = samples.crank_angle, samples.crank_speed, samples.crank_acceleration
    inside = slice(10, -10)
    off = [np.abs(np.asarray(one) - value)[inside].max() for one, value in zip(seen, exact, strict=True)]
    return off[0], off[1] / SPEED, off[2] / np.abs(exact[2]).max()


def test_a_clean_angle_is_recovered_with_its_derivatives(tmp_path, worst):
    samples = simulate(mechanism(loose=()), measured(tmp_path)).samples
    angle, speed, acceleration = deviations(samples)
    worst("measured angle, clean: angle [rad]", angle, 1e-9)
    worst("measured angle, clean: speed", speed, 1e-6)
    worst("measured angle, clean: acceleration", acceleration, 1e-3)
    exact = Closed(mechanism(), *(samples[f"crank_{name}"].to_numpy() for name in ("angle", "speed", "acceleration")))
    off = np.abs(samples.crank_torque - exact.virtual_work_torque()).max() / np.abs(samples.crank_torque).max()
    worst("measured angle: torque by virtual work", off, 1e-13)


def test_an_angle_in_steps_or_with_noise_of_unknown_size_is_recovered_within_these(tmp_path, worst):
    stepped = measured(
        tmp_path, lambda angle: np.degrees(STEP * np.round(angle / STEP)) % 360, angle_unit="deg", resolution=STEP
    )
    angle, speed, acceleration = deviations(simulate(mechanism(loose=()), stepped).samples)
    worst("measured angle, 0.1 deg steps: angle [rad]", angle, 0.5 * STEP)
    worst("measured angle, 0.1 deg steps: speed", speed, 2e-3)
    worst("measured angle, 0.1 deg steps: acceleration", acceleration, 0.2)
    noise = np.random.default_rng(1).normal(scale=1e-3, size=2001)
    angle, speed, _ = deviations(simulate(mechanism(loose=()), measured(tmp_path, lambda a: a + noise)).samples)
    worst("measured angle, 1e-3 rad noise: angle [rad]", angle, 1e-3)
    worst("measured angle, 1e-3 rad noise: speed", speed, 1e-2)


def steady(folder, angle, **keys):
    """Options for four revolutions along `angle` (n,), sampled over ten seconds."""
    pd.DataFrame({"time": np.linspace(0.0, 10.0, angle.size), "crank_angle": angle}).to_csv(
        folder / "a.csv", index=False
    )
    drive = {"kind": "measured", "file": str(folder / "a.csv"), **keys}
    return options(drive=drive, revolutions=4, samples_per_revolution=36)


def test_samples_beyond_a_record_are_refused(tmp_path):
    p = parameters(mechanism(loose=()), steady(tmp_path, np.pi * np.linspace(0, 10, 4001), resolution=STEP))
    with pytest.raises(InputError, match=r"ends at 1800.1 deg and 10.0005\d* s, the samples at 1980 deg"):
        integrate_to_angles(p, start_state(p), np.linspace(0.0, 11 * np.pi, 100), 1e-12)


def test_noise_at_the_ends_costs_no_revolution(tmp_path):
    """The record holds four turns, from the start angle to the start angle."""
    exact = np.linspace(0.0, 8 * np.pi, 2001)
    noise = np.random.default_rng(0).normal(scale=1e-3, size=exact.size)
    rounded, floored = STEP * np.round(exact / STEP + 0.3), STEP * np.floor(exact / STEP)
    for angle, resolution in ((exact + noise, None), (rounded, STEP), (floored, STEP)):
        samples = simulate(mechanism(loose=()), steady(tmp_path, angle, resolution=resolution)).samples
        assert samples.time.iloc[-1] == pytest.approx(10.0, abs=4e-3)


def test_angles_run_on_over_turns_wherever_they_fall_back():
    exact = np.linspace(0.1, 30.0, 301)
    for turns in (1, 2):
        np.testing.assert_allclose(unwrapped(exact % (2 * np.pi * turns)), exact, atol=1e-12)
    np.testing.assert_allclose(unwrapped((exact + np.pi) % (2 * np.pi) - np.pi), exact, atol=1e-12)
    np.testing.assert_array_equal(unwrapped(exact[::60]), exact[::60])
    to_and_fro = np.array([6.2, 6.3, 6.27, 6.29, 6.4])
    np.testing.assert_allclose(unwrapped(to_and_fro % (2 * np.pi)), to_and_fro, atol=1e-12)


def with_value(column, row, value):
    return lambda table: table.astype(object).assign(**{column: table[column].mask(table.index == row, value)})


def backwards(table):
    return table.assign(theta=-table.theta % (2 * np.pi))


def standing(table):
    return table.assign(theta=table.theta.mask(table.index < 99, 0.2))


def coarse(table):
    return table[::50].iloc[:41].assign(theta=table.theta * 10)


@each(
    "change, says, keys",
    [
        (with_value("t", 4, np.nan), "angle.csv, column t, row 5: 'nan' is not a finite number", {}),
        (with_value("t", 4, 0.0), "column t, row 5: time 0 s does not increase", {}),
        (lambda table: table.rename(columns={"theta": "thetas"}), "no column 'theta'.*thetas", {}),
        (lambda table: table[:5], "5 samples are too few", {}),
        (backwards, "the crank turns clockwise", {}),
        (standing, "stands still or turns", {}),
        (lambda table: table[:1000], "contains 1 whole revolutions, .*revolutions is 2", {}),
        (coarse, "steps by .* than half a turn", {}),
        (lambda table: table, "time and angle are both column 't'", {"angle": "t"}),
        (lambda table: table, "resolution: 180 deg is more than a quarter turn", {"resolution": np.pi}),
        (lambda table: table, "16999 pieces, more than 16384", {"count": 17000}),
    ],
)
def test_tables_that_cannot_drive_a_crank_are_refused_with_file_column_and_row(tmp_path, change, says, keys):
    chosen = measured(tmp_path, **keys)
    path = tmp_path / "angle.csv"
    change(pd.read_csv(path)).to_csv(path, index=False)
    with pytest.raises(InputError, match=says):
        simulate(mechanism(loose=()), chosen)


def test_smoothing_does_not_flatten_what_repeats_in_every_turn():
    time = np.arange(700) / 50.0
    steady = 8.0 * time + 0.2 * np.sin(0.4 * time)
    true = steady + 0.12 * np.sin(steady) + 0.036 * np.sin(2.0 * steady + 1.0)
    parts = np.column_stack([np.cos(2.0 * steady), np.sin(2.0 * steady)])
    for seed in range(3):
        read = true + 6e-3 * np.random.default_rng(seed).standard_normal(time.size)  # stamps that are 0.7 ms off
        away = smooth_angle(time, read, None)(time) - true
        flattened = np.linalg.lstsq(parts[20:-20], away[20:-20], rcond=None)[0]
        assert np.hypot(*flattened) < 1.5e-3  # four standard errors of 700 samples are 1.3e-3


@each("unsteadiness, mean_speed", [(0.0, 8.0), (0.6, 80.0), (0.95, 8.0)])
def test_the_smooth_angle_of_exact_readings_is_exact_however_unsteadily_the_crank_turns(unsteadiness, mean_speed):
    """The speed falls and rises by `unsteadiness` of its mean within each turn, and drifts over the record."""
    per_turn, turns = 120, 12
    time = np.arange(per_turn * turns) * (2 * np.pi / mean_speed / per_turn)

    def crank(t):
        steady = mean_speed * t + 0.3 * np.sin(0.05 * mean_speed * t)
        speed = mean_speed * (1 + 0.015 * np.cos(0.05 * mean_speed * t))
        return steady + unsteadiness * np.sin(steady), speed * (1 + unsteadiness * np.cos(steady))

    angle, _ = crank(time)
    smooth = smooth_angle(time, angle, None)
    np.testing.assert_allclose(smooth(time), angle, atol=2e-6)
    between = time[per_turn:-per_turn] + 0.5 * (time[1] - time[0])
    np.testing.assert_allclose(smooth(between), crank(between)[0], atol=1e-5)
    np.testing.assert_allclose(smooth(between, 1), crank(between)[1], atol=2e-4 * mean_speed)


def test_contacts_are_judged_at_the_speed_of_the_measured_angle(tmp_path):
    rubber = listed(contacts={"steel": {"youngs_modulus": "10 MPa"}})  # firm enough at 10 rad/s, the speed of `slow`
    given, slow = measured(tmp_path), options(speed=10.0)
    parameters(rubber, slow)
    with pytest.raises(InputError, match=r"youngs_modulus 1e\+07 Pa is too soft.* inertia at 599\.6 rpm"):
        parameters(rubber, given)


RATE, TURNS, PER_TURN, ERROR = 30.0, 5, 30, 1e-3


def ahead(unsteady: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and true angles of a crank that runs ahead, by so many rad, in its first two orders and once in a while."""
    time = np.arange(TURNS * PER_TURN) * (2 * np.pi / RATE / PER_TURN)
    phase = RATE * time
    return time, 0.4 + phase + unsteady * (np.sin(phase) + 0.3 * np.cos(2 * phase) + 0.5 * np.sin(phase / 3.7))


@each("unsteady, stepped", [(0.05, False), (0.0, True)])
def test_errors_are_as_large_as_those_of_drawn_noise(unsteady, stepped):
    time, true = ahead(unsteady)
    rng, inside = np.random.default_rng(0), slice(PER_TURN // 2, -PER_TURN // 2)
    resolution = np.sqrt(12.0) * ERROR if stepped else None  # a quintic for white noise of that size
    drawn, told = [], []
    for draw in range(16):
        angle = true + ERROR * rng.standard_normal(time.size)
        smooth = smooth_angle(time, angle, resolution)
        drawn.append([smooth(time, derivative)[inside] for derivative in range(3)])
        if draw < 3:
            errors = AngleErrors(time, angle, smooth, stepped, eye_array(time.size, format="csr"), None)
            told.append([np.mean(errors(time, derivative)[inside] ** 2) * errors.count for derivative in range(3)])
    for derivative in range(3):
        spread = np.sqrt(np.mean(np.var([each[derivative] for each in drawn], axis=0)))
        assert np.sqrt(np.mean(told, axis=0)[derivative]) == pytest.approx(spread, rel=0.3)
