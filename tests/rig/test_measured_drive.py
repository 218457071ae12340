"""An angle that was read drives the model: how far off it may be is part of what the model's
residuals may be."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.interpolate import PPoly

from jointgap.identification.noise import numerics_noise
from jointgap.identification.problem import Noise, Problem
from jointgap.linkage.drive import SlowRotation
from jointgap.rig.drives import measured_drive
from jointgap.rig.model import build_model
from jointgap.rig.recording import Measurements
from jointgap.rig.sampling import sample_grid
from tests.rig.rigs import campaign, mechanism, recorded

CHANNELS = ("time", "crank_angle", "slider_acceleration", "crank_torque")
NOISE = 1e-3  # of the encoder [rad]
SHARE = 0.01  # noise over variation of a channel


@cache
def exact(resolution: float | None = None):
    """A campaign whose crank turns evenly, and what exact sensors read of it."""
    sensors = {"crank_angle": {"resolution": resolution}} if resolution else {}
    rig_campaign = campaign(mechanism(), CHANNELS, drive="measured_angle", sensors=sensors)
    return rig_campaign, recorded(rig_campaign, kept=4, per_turn=36)


def read(seed: int, resolution: float | None = None, encoder: float = NOISE):
    """The model of a campaign whose sensors are noisy, and the sd of each channel's own noise, by
    series."""
    own, measurements = exact(resolution)
    rng, runs, sds = np.random.default_rng(seed), {}, {}
    for run, recording in measurements.runs.items():
        angle = recording.crank_angle + encoder * rng.standard_normal(recording.time.size)
        if resolution:
            zero = rng.uniform()
            angle = (np.round(angle / resolution + zero) - zero) * resolution
        channels = {}
        for name, value in recording.channels.items():
            sds[run, name] = SHARE * float(np.std(value))
            channels[name] = value + sds[run, name] * rng.standard_normal(value.size)
        runs[run] = replace(recording, crank_angle=angle, channels=channels)
    return build_model(own, Measurements(runs)), sds


def problems(model, sds, held_out: bool = False):
    """The samples of one role, with noise of the channels alone and with that of the driving
    angle."""
    alone = {s.key: Noise(np.full(s.value.size, sds[s.key])) for s in model.series}
    return (Problem(model, noise, held_out) for noise in (alone, numerics_noise(model, {}, alone)))


@pytest.mark.parametrize("resolution, encoder", [(None, NOISE), (np.pi / 180, 0.0)])
def test_chi2_of_the_true_model_is_one_per_sample_with_errors_of_the_drive(resolution, encoder):
    chi2 = []
    for seed in range(4):
        model, sds = read(seed, resolution, encoder)
        for role in (False, True):
            chi2.append([np.mean(item.residual({}) ** 2) for item in problems(model, sds, role)])
    alone, total = np.mean(chi2, axis=0)
    assert alone > 1.1
    assert total == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("turns", [3, 4, 7])
def test_half_orders_continue_without_a_jump_before_the_record(turns):
    """As in a four-stroke engine. With copies of one revolution the acceleration is off by three
    times its size."""
    speed, swing, noise = 30.0, 0.03, 3e-4
    time = np.linspace(0.0, turns * 2.0 * np.pi / speed, 100 * turns)
    read = speed * time + swing * np.sin(0.5 * speed * time + 0.4)
    read += noise * np.random.default_rng(turns).standard_normal(time.size)
    drive = measured_drive(sample_grid(time, read, speed, None, constant=False), 0.0, noise, back=2)
    smooth = PPoly(drive.table[:, 1:].T, np.append(drive.table[:, 0], np.inf))
    at = np.linspace(-2.0 * 2.0 * np.pi / speed, time[-1], 1000)
    exact = -swing * (0.5 * speed) ** 2 * np.sin(0.5 * speed * at + 0.4)
    assert np.sqrt(np.mean((smooth(drive.begin + at, 2) - exact) ** 2)) < 0.2 * np.std(exact)


@pytest.mark.parametrize(
    "turns, swing, resolution", [(2.5, 0.0, 0.0), (4, 0.01, 0.0), (4, 0.0, np.radians(0.1))]
)
def test_errors_of_a_drifting_drive_are_right_at_both_ends(turns, swing, resolution):
    """The speed drifts by up to 3.7 %. Whitened residuals of the acceleration, 15 at each end, over
    50 draws."""
    speed, noise, own, squares = 30.0, 3e-4, 3.0, []
    for seed in range(50):
        rng = np.random.default_rng(seed)
        time = np.arange(0.0, turns, 1.0 / 36) * 2.0 * np.pi / speed
        sizes = 0.037 * np.array([0.5, 0.3, 0.2])
        rates = np.append(speed / rng.uniform(6.0, 30.0, 3), 0.5 * speed)
        sizes, phases = np.append(sizes, swing) * speed, rng.uniform(0.0, 2.0 * np.pi, 4)
        inner = np.multiply.outer(time, rates) + phases
        angle, exact = (
            speed * time + np.sin(inner) @ (sizes / rates),
            -np.sin(inner) @ (sizes * rates),
        )
        read = angle + noise * rng.standard_normal(time.size)
        if resolution:
            read = resolution * np.round(angle / resolution + rng.uniform())
        samples = sample_grid(time, read, speed, None, resolution, constant=False)
        drive = measured_drive(samples, resolution, None if resolution else noise, back=2)

        def acceleration(item, at=time):
            return PPoly(item.table[:, 1:].T, np.append(item.table[:, 0], np.inf))(
                item.begin + at, 2
            )

        errors = np.transpose(
            [acceleration(item) - acceleration(drive) for item in drive.perturbed]
        )
        root = np.linalg.cholesky(own**2 * np.eye(time.size) + errors @ errors.T)
        residual = acceleration(drive) - exact + own * rng.standard_normal(time.size)
        squares.append(np.linalg.solve(root, residual) ** 2)
    first, last = np.mean(squares, axis=0)[:15].mean(), np.mean(squares, axis=0)[-15:].mean()
    assert max(abs(first - 1.0), abs(last - 1.0)) < 0.2


@pytest.mark.parametrize("noise, resolution", [(np.radians(0.05), 0.0), (0.0, np.radians(0.1))])
def test_errors_of_the_drive_cover_orders_hidden_by_noise(noise, resolution):
    """Accelerations of a crank that a gas drives; an accelerometer or torque shows 0.5 % of
    them."""
    speed, orders = 37.0, np.arange(1, 13)
    swings, squares = 300.0 * np.exp(-0.7 * (orders - 1)), []  # [rad/s^2]
    time = np.arange(0.0, 6.05, 1.0037 / 100) * 2.0 * np.pi / speed
    for seed in range(4):
        rng = np.random.default_rng(seed)
        phases = np.multiply.outer(time, orders * speed) + rng.uniform(
            0.0, 2.0 * np.pi, orders.size
        )
        angle, exact = (
            speed * time - np.sin(phases) @ (swings / (orders * speed) ** 2),
            np.sin(phases) @ swings,
        )
        own, read = 0.005 * np.std(exact), angle + noise * rng.standard_normal(time.size)
        if resolution:
            read = resolution * np.round(angle / resolution + rng.uniform())
        samples = sample_grid(time, read, speed, None, resolution, constant=False)
        drive = measured_drive(samples, resolution, noise or None, back=2)

        def acceleration(item):
            return PPoly(item.table[:, 1:].T, np.append(item.table[:, 0], np.inf))(
                item.begin + time, 2
            )

        errors = np.transpose(
            [acceleration(item) - acceleration(drive) for item in drive.perturbed]
        )
        root = np.linalg.cholesky(own**2 * np.eye(time.size) + errors @ errors.T)
        residual = acceleration(drive) - exact + own * rng.standard_normal(time.size)
        squares.append(np.mean(np.linalg.solve(root, residual) ** 2))
    # the draws give 0.9 to 1.3, by the smoothness that cross-validation chooses; without orders
    # above 4: 16 to 19
    assert 0.7 < np.mean(squares) < 1.6


@pytest.mark.parametrize("swing", [0.1, 0.3, 0.6])
def test_beyond_a_record_the_crank_continues_at_its_slow_speed(swing):
    time = np.linspace(0.0, 2.0, 400)
    angle = 20.0 * time + swing * np.sin(20.0 * time)
    for end, away in ((0, -1.0), (-1, 1.0)):
        slow = SlowRotation(time, angle, 4.0 * np.pi, end)
        turned = away * 2.0 * np.pi * np.arange(1.0, 3.0)
        assert slow.time_at(turned) == pytest.approx(time[end] + turned / 20.0, abs=2e-3)
