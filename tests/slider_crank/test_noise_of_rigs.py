"""The noise of a rig's sensors is found where its model misses a lot: a loose pin, the weight, and joined loggers."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from jointgap.config import Simulate
from jointgap.config.scenario import MotorDrive
from jointgap.core.candidates import Series
from jointgap.dynamics.simulation import simulate
from jointgap.identification.noise import estimate_noise, noise_of_model
from jointgap.identification.problem import Problem
from jointgap.rig.model import build_model
from tests.identification.toy import toy
from tests.rows import each
from tests.slider_crank.campaigns import model_of, samples, written
from tests.slider_crank.rigs import campaign, mechanism, recorded, seen

SHARE = 0.01  # of a channel's standard deviation: noise


@pytest.fixture(scope="module")
def loose_pin():
    """Settled revolutions of a rig with a loose piston pin, and those of its model without."""
    motions = []
    for loose in (("piston_pin",), ()):
        content = mechanism(loose)
        for joint in content["joints"].values():
            joint["bearing_radius"] = joint["journal_radius"] + 0.3e-3
        content["contacts"]["steel"]["restitution"] = 0.3
        options = Simulate(speed=40.0, revolutions=12, samples_per_revolution=1373, tolerance=4e-9)
        motions.append(simulate(campaign(content).mechanism, options).samples.iloc[4 * 1373 :])
    return motions


def rung(motions, channel: str, every: int, seed: int, stated: bool = False):
    """Noise found in a channel of the rig, read at every so many samples, over the true one."""
    rig, model = (motion.iloc[::every] for motion in motions)
    sd = SHARE * rig[channel].std()
    value = rig[channel].to_numpy() + sd * np.random.default_rng(seed).standard_normal(len(rig))
    time, angle = rig["time"].to_numpy(), rig["crank_angle"].to_numpy()
    known = np.full(value.size, sd) if stated else None
    one = Series("run", channel, "SI", value, time, angle, np.zeros(value.size, bool), known)
    noise = estimate_noise(replace(toy(), series=[one]), {one.key: value - model[channel].to_numpy()})[one.key]
    return noise.estimated_sd / sd, noise.remarks


@each("channel", ["crank_torque", "slider_acceleration"])
def test_ringing_between_the_samples_of_a_loose_pin_is_no_noise(loose_pin, channel):
    for every in (5, 10):  # 274.6 and 137.3 samples a turn: phases do not repeat
        found = [rung(loose_pin, channel, every, seed)[0] for seed in range(3)]
        assert np.mean(found) == pytest.approx(1.0, abs=0.05)
    assert not rung(loose_pin, channel, 10, 0, stated=True)[1]  # a true stated noise is not called too small


def test_each_channel_of_loggers_that_were_joined_has_its_own_rate_noise_and_memory():
    own = campaign(mechanism(), ("time", "crank_angle", "slider_acceleration", "crank_torque"))
    rng, measurements = np.random.default_rng(5), recorded(own, kept=8, per_turn=180)
    loggers = {  # every so many rows, sd and memory of the noise
        "crank_torque": (4, 0.2, 0.7),
        "slider_acceleration": (1, 1.0, 0.0),
        "crank_angle": (2, np.deg2rad(0.05), 0.0),
    }
    for one in measurements.runs.values():
        for name, (rows, sd, memory) in loggers.items():
            values, noise = (one.channels | {"crank_angle": one.crank_angle})[name], rng.standard_normal(one.time.size)
            values += sd * np.repeat(lfilter([np.sqrt(1 - memory**2)], [1, -memory], noise[::rows]), rows)[: noise.size]
            values[np.arange(noise.size) % rows > 0] = np.nan
    model = build_model(own, measurements)
    noise = noise_of_model(model)
    for (_, channel), found in noise.items():
        rows, sd, memory = loggers[channel]
        assert found.sd.size == (8 * 180 + rows) // rows
        assert found.sd[0] == pytest.approx(sd, rel=0.15)
        assert (found.autocorrelation or (0.0,))[0] == pytest.approx(memory, abs=0.15)
    problem = Problem(model, noise)
    assert problem.gap(problem.residual({p.key: p.nominal for p in problem.nuisances})) == pytest.approx(1.0, abs=0.06)


@each("missing, count", [(slice(0), 121), (slice(60, 90), 111)])
def test_errors_of_a_driving_angle_are_told_and_gaps_stay_at_the_own_rows_of_each_channel(missing, count):
    own = campaign(mechanism(), ("time", "crank_angle", "crank_torque"), drive="measured_angle")
    rng, measurements = np.random.default_rng(5), recorded(own, kept=4, per_turn=90)
    for one in measurements.runs.values():
        one.channels["crank_torque"][np.arange(one.time.size) % 3 > 0] = np.nan
        one.channels["crank_torque"][missing] = np.nan
        one.crank_angle[:] += np.deg2rad(0.05) * rng.standard_normal(one.time.size)
    model = build_model(own, measurements)
    known = np.isfinite(seen(model)["crank_torque"])
    assert known.sum() == count and known[:20].all() and known.all() == (count == 121)
    assert model.drive_errors("slow", model.nominal("slow"))["crank_torque"].shape[0] == known.size


def test_the_noise_of_a_motor_rig_is_found_although_the_weight_is_not_in_its_model(tmp_path):
    content = {
        "crank": {"length": 0.06, "mass": 1.0, "inertia": 2e-3, "mass_centre": 1e-3},
        "rod": {"length": 0.21, "mass": 0.1, "inertia": 4e-4, "mass_centre": 0.1},
        "slider": {"mass": 0.3, "offset": -0.09},
        "joints": {"crank_pivot": "ideal", "crank_pin": "ideal", "piston_pin": "ideal"},
        "gravity_direction": 0.0,
    }
    drive = MotorDrive(kind="motor", stall_torque=0.9, no_load_speed=20.9, inertia=4e-3)
    options = {"speed": 17.8, "revolutions": 20, "samples_per_revolution": 360, "drive": drive}
    seen = samples({"name": "gravity"}, mechanism=content, **options)
    rng, time = np.random.default_rng(0), np.arange(seen["time"].iloc[0] + 2.0, seen["time"].iloc[-1], 0.02)
    angle = np.interp(time, seen["time"], seen["crank_angle"])
    position = 0.06 * np.cos(angle) + np.sqrt(0.21**2 - (-0.09 - 0.06 * np.sin(angle)) ** 2)
    table, sd = pd.DataFrame({"time": time}), {"crank_angle": np.deg2rad(0.06), "slider_position": 3e-4}
    for (channel, own), true in zip(sd.items(), (angle, position), strict=True):
        table[channel] = true + own * rng.standard_normal(time.size)
    keys = {
        "drive": "motor",
        "motor": {"stall_torque": 1.5, "no_load_speed": 24.1, "inertia": 4e-3},
        "nuisance": {"stall_torque": [0.3, 3.0], "no_load_speed": [18.0, 60.0], "slider_mass": "20 %"},
    }
    noise = noise_of_model(model_of(written(tmp_path, {"v": (20.9, table)}, content, **keys)))
    for channel, true in sd.items():
        assert noise["v", channel].sd[0] == pytest.approx(true, rel=0.2)
