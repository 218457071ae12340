"""The noise of a rig's sensors is found where its model misses a lot: a loose pin, the weight, and
joined loggers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from jointgap.config import Simulate
from jointgap.core.candidates import Series
from jointgap.identification.noise import estimate_noise, noise_of_model
from jointgap.identification.problem import Problem
from jointgap.motion.slider_crank import simulate
from jointgap.rig.model import build_model
from tests.identification.toy import toy
from tests.rig.rigs import campaign, mechanism, recorded

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
    item = Series("run", channel, "SI", value, time, angle, np.zeros(value.size, bool), known)
    noise = estimate_noise(
        replace(toy(), series=[item]), {item.key: value - model[channel].to_numpy()}
    )[item.key]
    return noise.estimated_sd / sd, noise.remarks


@pytest.mark.parametrize("channel", ["crank_torque", "slider_acceleration"])
def test_ringing_of_a_loose_pin_is_not_noise(loose_pin, channel):
    for every in (5, 10):  # 274.6 and 137.3 samples a turn: phases do not repeat
        result = [rung(loose_pin, channel, every, seed)[0] for seed in range(3)]
        assert np.mean(result) == pytest.approx(1.0, abs=0.05)
    # a true stated noise is not called too small
    assert not rung(loose_pin, channel, 10, 0, stated=True)[1]


def test_joined_channels_have_separate_rates_and_noise():
    rig_campaign = campaign(
        mechanism(), ("time", "crank_angle", "slider_acceleration", "crank_torque")
    )
    rng, measurements = np.random.default_rng(5), recorded(rig_campaign, kept=8, per_turn=180)
    loggers = {  # every so many rows, sd and memory of the noise
        "crank_torque": (4, 0.2, 0.7),
        "slider_acceleration": (1, 1.0, 0.0),
        "crank_angle": (2, np.deg2rad(0.05), 0.0),
    }
    for item in measurements.runs.values():
        for name, (rows, sd, memory) in loggers.items():
            values, noise = (
                (item.channels | {"crank_angle": item.crank_angle})[name],
                rng.standard_normal(item.time.size),
            )
            values += (
                sd
                * np.repeat(lfilter([np.sqrt(1 - memory**2)], [1, -memory], noise[::rows]), rows)[
                    : noise.size
                ]
            )
            values[np.arange(noise.size) % rows > 0] = np.nan
    model = build_model(rig_campaign, measurements)
    noise = noise_of_model(model)
    for (_, channel), result in noise.items():
        rows, sd, memory = loggers[channel]
        assert result.sd.size == (8 * 180 + rows) // rows
        assert result.sd[0] == pytest.approx(sd, rel=0.15)
        assert (result.autocorrelation or (0.0,))[0] == pytest.approx(memory, abs=0.15)
    problem = Problem(model, noise)
    assert problem.gap(
        problem.residual({p.key: p.nominal for p in problem.nuisances})
    ) == pytest.approx(1.0, abs=0.06)
