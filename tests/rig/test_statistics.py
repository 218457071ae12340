"""Statistics that replace the samples of chaotic runs."""

import warnings

import numpy as np
import pytest

from jointgap.core.joints import PINS
from jointgap.rig.drives import RunPlan
from jointgap.rig.model import build_model
from jointgap.rig.recording import Measurements, Recording
from jointgap.rig.sampling import sample_grid
from jointgap.rig.simulate_run import channels_read
from jointgap.rig.statistics import CycleStatistics
from tests.rig.rigs import campaign, mechanism, read, seen

TURN = 2 * np.pi
NOISE = {"slider_position": 1e-3, "slider_acceleration": 2.0, "crank_torque": 0.1}


def angles(cycles, per_turn=96):
    return np.arange(round(cycles * per_turn)) * (TURN / per_turn)


def test_noise_is_the_excess_spread_over_the_simulation():
    random, angle = np.random.default_rng(4), angles(100)
    wild = np.where(np.sin(angle) > 0, 1.0, 0.02)  # half of every cycle is quiet
    clean, second = (np.cos(angle) + wild * random.normal(size=angle.size) for _ in range(2))
    learnt = CycleStatistics.of(("position",), angle, [clean])
    result = learnt.noise(angle, [second + 0.1 * random.normal(size=angle.size)], angle, [clean])
    assert result == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize("cycles", [1, 1.4, 2.2, 3.6])
def test_noise_is_estimated_from_few_cycles(cycles):
    random, angle, few = np.random.default_rng(6), angles(100), angles(cycles)
    clean = np.cos(angle) + 0.5 * random.normal(size=angle.size)
    seen = np.cos(few) + np.hypot(0.5, 0.4) * random.normal(size=few.size)
    seen[np.mod(few, TURN) < 0.5] = np.nan
    learnt = CycleStatistics.of(("position",), angle, [clean])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = learnt.noise(few, [seen], angle, [clean])
    assert result == pytest.approx(0.4, abs=0.2)


def measured(own, cycles=30, per_turn=120):
    """Recordings of chaotic runs from other starts than the model's, with the noise stated."""
    random, runs = np.random.default_rng(0), {}
    for run in own.runs:
        time = angles(cycles, per_turn) / run.speed
        channels = tuple(name for name in own.channels if name != "time")
        plan = RunPlan(run, sample_grid(time, 1.0 + run.speed * time, run.speed, None), channels)
        start = np.append(random.uniform(-1e-4, 1e-4, 4), [0.0, 0.0])
        result = channels_read(own, plan, {}, (), 0, start)
        angle, sd = (
            result.pop("crank_angle"),
            {name: own.channels[name].noise for name in own.channels},
        )
        noisy = {
            name: values + sd[name] * random.normal(size=values.size)
            for name, values in result.items()
        }
        stated = {name: sd[name] for name in result}
        runs[run.id] = Recording(
            run.id, time, angle, noisy, stated, np.full(time.size, run.role == "confirm")
        )
    return Measurements(runs)


@pytest.fixture(scope="module")
def chaotic():
    rig_campaign = campaign(
        mechanism(PINS, friction=0.0),
        ("time", "crank_angle", "slider_position", "slider_acceleration", "crank_torque"),
        speeds=(25.0, 30.0),
        sensors={name: {"noise": sd} for name, sd in NOISE.items()},
    )
    return rig_campaign, build_model(rig_campaign, measured(rig_campaign))


def missed(model, run="slow", *effects):
    """Differences of the statistics of a run from those of a model, over their standard errors."""
    result = read(model, *effects, run=run)
    assert result.keys() == seen(model, run).keys()
    own = [s for s in model.series if s.run == run and s.statistic]
    return np.concatenate([(s.value - result[s.channel]) / s.stated_noise for s in own])


def test_only_chaotic_channels_are_compared_by_statistics(chaotic):
    _, model = chaotic
    assert model.chaotic("slow") == ("slider_acceleration", "crank_torque")
    statistics = {
        f"{channel} {kind}" for channel in model.chaotic("slow") for kind in ("mean", "spread")
    }
    assert seen(model).keys() == {"slider_position"} | statistics
    for series in model.series:
        assert series.statistic == (" " in series.channel)
        assert series.held_out.all() == (series.run == "fast")


def test_statistics_of_the_true_model_agree_within_standard_errors(chaotic):
    _, model = chaotic
    true = np.concatenate([missed(model, run) for run in model.plans])
    assert np.mean(np.square(true)) == pytest.approx(1.0, abs=0.45) and np.max(np.abs(true)) < 5.0
    assert (
        np.mean(np.square(missed(model, "slow", ("slider_constant_force", {"force_N": 5.0})))) > 2.0
    )


def test_a_preflight_expects_the_scatter_of_the_cycles_it_plans(chaotic):
    own, model = chaotic
    # of one run the 30 revolutions are known, for the other 4 are planned
    known, planned = (
        {s.key: s.stated_noise for s in item.series if s.statistic}
        for item in (model, build_model(own, None, {"slow": 30.0}))
    )
    assert planned.keys() == known.keys()
    for key, ratio in ((key, {"slow": 1.0, "fast": 2.1}[key[0]]) for key in known):
        assert np.median(planned[key] / known[key]) == pytest.approx(ratio, rel=0.4), key


def test_friction_prevents_chaos():
    rig_campaign = campaign(
        mechanism(PINS, friction=0.1), ("time", "crank_angle", "slider_acceleration")
    )
    model = build_model(rig_campaign, None, {"slow": 30.0})
    assert model.chaotic("slow") == ()
    # a motion that repeats is not planned for longer
    assert model.plans["slow"].samples.turned < 4 * TURN
