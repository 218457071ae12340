"""A measured crank angle: smoothing, errors and invalid records."""

import numpy as np
import pandas as pd
import pytest

from jointgap.core.errors import InputError
from jointgap.linkage.drive import smooth_angle, unwrapped
from jointgap.motion.simulation import integrate_to_angles
from jointgap.motion.slider_crank import model_of, simulate, start_state
from tests.motion.cases import SPEED, mechanism, options
from tests.motion.closed import Closed

RATIO, STEP, TURN = 0.02, np.radians(0.1), 2 * np.pi
IDEAL = mechanism(loose=())
NOISE = np.random.default_rng(1).normal(scale=1e-3, size=2001)


def known(time):
    """A crank that oscillates about a steady rotation: angle, speed, acceleration."""
    rate = 2 * SPEED
    angle = 0.2 + SPEED * time + RATIO * np.sin(rate * time)
    return angle, SPEED + RATIO * rate * np.cos(rate * time), -RATIO * rate**2 * np.sin(rate * time)


def along(folder, times, angles, revolutions, start=0.0, **keys):
    """Options for a run along a table of angles."""
    pd.DataFrame({"t": times, "theta": angles}).to_csv(folder / "angle.csv", index=False)
    drive = {"kind": "measured", "file": str(folder / "angle.csv"), "time": "t", "angle": "theta"}
    drive |= keys
    return options(
        drive=drive, start_angle=start, revolutions=revolutions, samples_per_revolution=360
    )


def measured(folder, angle_of=lambda angle: angle, count=2001, **keys):
    """Options for a run along the table of `known` angles as an instrument shows them."""
    time = np.linspace(0.0, 0.25, count)
    return along(folder, time + 7.0, angle_of(known(time)[0]), 2, 0.5, **keys)


def in_steps(angle):
    return np.degrees(STEP * np.round(angle / STEP)) % 360


@pytest.mark.parametrize(
    "name, angle_of, keys, bounds",
    [
        ("clean", lambda angle: angle, {}, (1e-9, 1e-6, 1e-3)),
        (
            "0.1 deg steps",
            in_steps,
            {"angle_unit": "deg", "resolution": STEP},
            (0.5 * STEP, 2e-3, 0.2),
        ),
        ("1e-3 rad noise", lambda angle: angle + NOISE, {}, (1e-3, 1e-2, np.inf)),
    ],
)
def test_angle_speed_and_acceleration_are_recovered(tmp_path, worst, name, angle_of, keys, bounds):
    samples = simulate(IDEAL, measured(tmp_path, angle_of, **keys)).samples
    fine = np.linspace(0.0, 0.01, 100001)
    exact = known(samples.time.to_numpy() + np.interp(0.5, known(fine)[0], fine))
    columns, scales = ("angle", "speed", "acceleration"), (1.0, SPEED, np.abs(exact[2]).max())
    for column, value, scale, bound in zip(columns, exact, scales, bounds, strict=True):
        off = np.abs(samples[f"crank_{column}"] - value)[10:-10].max() / scale
        worst(f"measured angle, {name}: {column}", off, bound)
    exact = Closed(mechanism(), *(samples[f"crank_{column}"].to_numpy() for column in columns))
    exact = exact.virtual_work_torque()
    off = np.abs(samples.crank_torque - exact).max() / np.abs(samples.crank_torque).max()
    worst("measured angle: torque by virtual work", off, 1e-13)


def test_samples_beyond_a_record_are_refused(tmp_path):
    time = np.linspace(0.0, 10.0, 4001)
    model = model_of(IDEAL, along(tmp_path, time, np.pi * time, 4, resolution=STEP))
    with pytest.raises(
        InputError, match=r"ends at 1800.1 deg and 10.0005\d* s, the samples at 1980 deg"
    ):
        integrate_to_angles(model, start_state(model), np.linspace(0.0, 11 * np.pi, 100), 1e-12)


def test_noise_at_the_ends_costs_no_revolution(tmp_path):
    """The record contains four turns from the start angle."""
    exact, time = np.linspace(0.0, 4 * TURN, 2001), np.linspace(0.0, 10.0, 2001)
    rounded, floored = STEP * np.round(exact / STEP + 0.3), STEP * np.floor(exact / STEP)
    for angle, resolution in ((exact + NOISE, None), (rounded, STEP), (floored, STEP)):
        samples = simulate(IDEAL, along(tmp_path, time, angle, 4, resolution=resolution)).samples
        assert samples.time.iloc[-1] == pytest.approx(10.0, abs=4e-3)


def test_angles_are_unwrapped():
    exact, to_and_fro = np.linspace(0.1, 30.0, 301), np.array([6.2, 6.3, 6.27, 6.29, 6.4])
    for read, true in (
        (exact % TURN, exact),
        (exact % (2 * TURN), exact),
        ((exact + np.pi) % TURN - np.pi, exact),
        (exact[::60], exact[::60]),
        (to_and_fro % TURN, to_and_fro),
    ):
        np.testing.assert_allclose(unwrapped(read), true, atol=1e-12)


def with_value(row, value):
    return lambda table: table.astype(object).assign(t=table.t.mask(table.index == row, value))


def as_it_is(table):
    return table


@pytest.mark.parametrize(
    "change, says, keys",
    [
        (with_value(4, np.nan), "angle.csv, column t, row 6: has no number", {}),
        (with_value(4, 0.0), "column t, row 6: time 0 s does not increase", {}),
        (lambda table: table.rename(columns={"theta": "thetas"}), "no column 'theta'.*thetas", {}),
        (lambda table: table[:5], "5 samples are too few", {}),
        (lambda table: table.assign(theta=-table.theta % TURN), "the crank turns clockwise", {}),
        (
            lambda table: table.assign(theta=table.theta.mask(table.index < 99, 0.2)),
            "stands still or turns",
            {},
        ),
        (lambda table: table[:1000], "contains 1 whole revolutions, .*revolutions is 2", {}),
        (
            lambda table: table[::50].iloc[:41].assign(theta=table.theta * 10),
            "steps by .* than half a turn",
            {},
        ),
        (as_it_is, "time and angle are both column 't'", {"angle": "t"}),
        (as_it_is, "resolution: 180 deg is more than a quarter turn", {"resolution": np.pi}),
        (as_it_is, "16999 pieces, more than 16384", {"count": 17000}),
    ],
)
def test_tables_that_cannot_drive_a_crank_are_refused(tmp_path, change, says, keys):
    chosen, path = measured(tmp_path, **keys), tmp_path / "angle.csv"
    change(pd.read_csv(path)).to_csv(path, index=False)
    with pytest.raises(InputError, match=says):
        simulate(IDEAL, chosen)


@pytest.mark.parametrize("unsteadiness, mean_speed", [(0.0, 8.0), (0.6, 80.0), (0.95, 8.0)])
def test_the_smooth_angle_of_exact_readings_is_exact(unsteadiness, mean_speed):
    """The speed varies by `unsteadiness` within each turn and drifts over the record."""
    per_turn, turns = 120, 6
    time = np.arange(per_turn * turns) * (TURN / mean_speed / per_turn)

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
