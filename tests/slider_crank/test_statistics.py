"""Chaotic runs: what stands for their samples."""

import numpy as np
import pytest

from jointgap.core.joints import PINS
from jointgap.rig.drives import RunPlan
from jointgap.rig.model import build_model
from jointgap.rig.recording import Measurements, Recording
from jointgap.rig.sampling import sample_grid
from jointgap.rig.simulate_run import channels_read
from jointgap.rig.statistics import BINS, ChaoticRun, CycleStatistics, cycle_variance, measured_statistics, persistence
from tests.slider_crank.rigs import campaign, mechanism

TURN = 2 * np.pi
NOISE = {"slider_position": 1e-3, "slider_acceleration": 2.0, "crank_torque": 0.1}


def noisy_cycles(cycles, seed, per_turn=96):
    random = np.random.default_rng(seed)
    angle = np.arange(cycles * per_turn) * (TURN / per_turn)
    return angle, [np.cos(angle) + random.normal(0.0, 0.1, angle.size), random.normal(0.0, 2.0, angle.size)]


def test_statistics_of_a_periodic_motion_are_its_own_beside_the_usual_course():
    angle, values = noisy_cycles(200, 0)
    learnt = CycleStatistics.of(("position", "force"), angle, values)
    clean = np.cos(angle[: 96 * 3]) + 0.02
    rows = learnt.cycles(angle[: 96 * 3], [clean, np.full(96 * 3, 0.0)])
    assert rows.shape == (3, 2 * 2 * BINS)
    assert rows == pytest.approx(np.tile(rows[0], (3, 1)))
    means = rows[0].reshape(2, 2, BINS)[0, 0]
    assert means == pytest.approx(0.02, abs=0.015)  # less the median of 200 cycles, bent a little


def test_a_smooth_course_counts_alike_however_densely_it_is_sampled():
    # 27 samples lie unevenly in 24 bins, at the same angles in every revolution
    coarse, dense = (np.arange(40 * many) * (TURN / many) for many in (27, 27 * 12))
    learnt = CycleStatistics.of(("position",), dense, [np.cos(dense)], finer=12)
    means = [learnt.cycles(angle, [np.cos(angle) + 0.01]).mean(axis=0)[:BINS] for angle in (coarse, dense)]
    assert means[0] == pytest.approx(means[1], abs=1e-3)


def test_gaps_leave_the_other_bins_as_they_are():
    angle, values = noisy_cycles(40, 1)
    learnt = CycleStatistics.of(("position", "force"), angle, values)
    whole = learnt.cycles(angle, values)
    values[0][10:30] = np.nan
    holes = learnt.cycles(angle, values)
    same = np.isclose(whole, holes, rtol=0, atol=1e-12)
    assert np.flatnonzero(~same.all(axis=0)).max() < 2 * BINS  # of the first channel
    assert np.flatnonzero(~same.all(axis=1)).tolist() == [0]


def test_what_is_left_of_statistics_that_scatter_together_is_independent():
    random = np.random.default_rng(2)
    angle = np.arange(400 * 96) * (TURN / 96)
    slow = np.repeat(random.normal(0.0, 1.0, angle.size // 8), 8)
    values = [slow + 1.0 * random.normal(size=angle.size), 3.0 * slow + 3.0 * random.normal(size=angle.size)]
    learnt = CycleStatistics.of(("one", "other"), angle, values)
    rows = learnt.cycles(angle, values)
    left = learnt.independent(rows)
    before, after = (np.corrcoef(one.T)[np.triu_indices(rows.shape[1], 1)] for one in (rows, left))
    chance = 1.0 / np.sqrt(len(rows))
    strong = [int(np.sum(np.abs(one) > 4 * chance)) for one in (before, after)]  # of 4560 pairs
    assert strong[1] < strong[0] / 3


def test_cycles_that_persist_count_for_less():
    random = np.random.default_rng(3)
    rows = random.normal(size=(600, 2 * BINS))
    rows[:, BINS:] = np.repeat(rows[::3, BINS:], 3, axis=0)
    found = persistence(rows, 12)
    assert found[:BINS] == pytest.approx(1.0, abs=0.15)
    assert found[BINS:] == pytest.approx(3.0, rel=0.2)
    assert cycle_variance(rows) == pytest.approx(1.0, abs=0.3)


def test_noise_is_told_from_what_bins_spread_beyond_the_simulation():
    random = np.random.default_rng(4)
    angle = np.arange(100 * 96) * (TURN / 96)
    wild = np.where(np.sin(angle) > 0, 1.0, 0.02)  # half of every cycle is quiet
    clean, other = (np.cos(angle) + wild * random.normal(size=angle.size) for _ in range(2))
    learnt = CycleStatistics.of(("position",), angle, [clean])
    found = learnt.noise(angle, [other + 0.1 * random.normal(size=angle.size)], angle, [clean])
    assert found == pytest.approx(0.1, rel=0.1)


def with_flat_courses(k=(0.3, 2.0)):
    """Statistics of two channels whose median courses are zero, with nothing to predict one bin from another."""
    none = [(np.empty(0, dtype=int), np.empty(0))] * (2 * 2 * BINS)
    return CycleStatistics(("position", "force"), np.array([0.0, TURN]), np.zeros((2, 2)), np.array(k), none)


def test_a_deviation_stands_in_its_own_bin_of_its_own_channel_and_kind():
    own = with_flat_courses()
    angle = 5 * TURN + (np.arange(2 * 96) + 0.5) * (TURN / 96)  # four samples a bin, two cycles
    values = [np.zeros(angle.size) for _ in range(2)]
    values[0][8:12] = [0.4, 0.4, -0.1, -0.1]  # bin 2 of the first cycle
    values[1][96 + 20 : 96 + 24] = -3.0  # bin 5 of the second cycle
    rows = own.cycles(angle, values)
    assert rows.shape == (2, 4 * BINS)
    large, small = 0.3 * np.tanh(0.4 / 0.3), 0.3 * np.tanh(0.1 / 0.3)
    expected = np.zeros((2, 4 * BINS))
    expected[0, 2], expected[0, BINS + 2] = (large - small) / 2, (large + small) / 2
    expected[1, 2 * BINS + 5], expected[1, 3 * BINS + 5] = -2.0 * np.tanh(1.5), 2.0 * np.tanh(1.5)
    assert rows == pytest.approx(expected, abs=1e-15)
    parts = own.split(rows[1])
    assert list(parts) == ["position mean", "position spread", "force mean", "force spread"]
    assert parts["force mean"][5] == -2.0 * np.tanh(1.5) and not parts["position mean"].any()


@pytest.mark.parametrize("cycles", [2, 5])
def test_errors_of_measured_statistics_are_those_of_a_mean_of_cycles_and_of_the_simulation(cycles):
    own, count = with_flat_courses(k=(1e9, 1e9)), 2 * 2 * BINS
    random = np.random.default_rng(0)
    simulated, persistent, error = random.uniform(1.0, 2.0, (3, count))
    chaotic = ChaoticRun(None, own, simulated, persistent, 3, error, {})
    angle = (np.arange(cycles * 96) + 0.5) * (TURN / 96)
    measured = {name: random.normal(size=angle.size) for name in own.channels}
    rows = own.cycles(angle, list(measured.values()))
    variance = simulated.copy()
    if cycles >= 3:  # as much as 60 cycles counts what the simulation scatters
        ratio = rows.var(axis=0, ddof=1) / simulated
        variance *= (cycles * ratio + 60 * np.median(ratio)) / (cycles + 60)
    expected = own.split(np.sqrt(persistent * variance / cycles + error**2))
    means = own.split(rows.mean(axis=0))
    for name, (mean, sd) in measured_statistics(chaotic, angle, measured).items():
        assert mean == pytest.approx(means[name], rel=1e-12, abs=1e-14)
        assert sd == pytest.approx(expected[name], rel=1e-12)


def measured(own, seed=0, cycles=30, per_turn=120, effects=()):
    """Recordings of chaotic runs from other starts than the model's, with the noise stated."""
    random, runs = np.random.default_rng(seed), {}
    for run in own.runs:
        time = np.arange(cycles * per_turn) * (TURN / run.speed / per_turn)
        channels = tuple(name for name in own.channels if name != "time")
        plan = RunPlan(run, sample_grid(time, 1.0 + run.speed * time, run.speed, None), channels)
        start = np.append(random.uniform(-1e-4, 1e-4, 4), [0.0, 0.0])
        found = channels_read(own, plan, {}, effects, 0, start)
        angle = found.pop("crank_angle")
        sd = {name: own.channels[name].noise for name in found}
        noisy = {name: values + sd[name] * random.normal(size=values.size) for name, values in found.items()}
        runs[run.id] = Recording(run.id, time, angle, noisy, sd, np.full(time.size, run.role == "confirm"))
    return Measurements(runs)


@pytest.fixture(scope="module")
def chaotic():
    own = campaign(
        mechanism(PINS, friction=0.0),
        ("time", "crank_angle", "slider_position", "slider_acceleration", "crank_torque"),
        speeds=(25.0, 30.0),
        sensors={name: {"noise": sd} for name, sd in NOISE.items()},
    )
    return own, build_model(own, measured(own))


def test_chaotic_channels_alone_are_compared_by_statistics(chaotic):
    _, model = chaotic
    channels = {series.channel for series in model.series if series.run == "slow"}
    assert model.chaotic("slow") == ("slider_acceleration", "crank_torque")
    assert channels == {
        "slider_position",
        "crank_angle",
        *(f"{channel} {kind}" for channel in model.chaotic("slow") for kind in ("mean", "spread")),
    }
    for series in model.series:
        assert series.statistic == (" " in series.channel)
        assert series.held_out.all() == (series.run == "fast")


def test_statistics_of_the_true_model_miss_by_their_standard_errors(chaotic):
    _, model = chaotic
    missed = []
    for run in model.plans:
        found = model.simulate(run, model.nominal(run))
        assert found.keys() == {series.channel for series in model.series if series.run == run}
        missed += [(s.value - found[s.channel]) / s.stated_noise for s in model.series if s.run == run and s.statistic]
    assert np.mean(np.square(missed)) == pytest.approx(1.0, abs=0.45)
    assert np.max(np.abs(missed)) < 5.0


def test_the_same_values_give_the_same_statistics(chaotic):
    _, model = chaotic
    once, again = (model.simulate("slow", model.nominal("slow")) for _ in range(2))
    assert all((once[channel] == again[channel]).all() for channel in once)


def test_a_missing_force_stands_out_of_the_statistics(chaotic):
    _, model = chaotic
    candidate = next(one for one in model.candidates if one.name == "slider_constant_force")
    found = model.simulate("slow", model.nominal("slow"), [(candidate, {"force_N": 5.0})])
    missed = [(s.value - found[s.channel]) / s.stated_noise for s in model.series if s.run == "slow" and s.statistic]
    assert np.mean(np.square(missed)) > 2.0


def test_a_preflight_expects_the_scatter_of_the_cycles_it_plans(chaotic):
    own, model = chaotic
    # of one run the 30 revolutions are known, for the other 4 are planned
    planned = {s.key: s.stated_noise for s in build_model(own, None, {"slow": 30.0}).series if s.statistic}
    known = {s.key: s.stated_noise for s in model.series if s.statistic}
    assert planned.keys() == known.keys()
    for run, ratio in (("slow", 1.0), ("fast", 2.1)):
        for key in (key for key in known if key[0] == run):
            assert np.median(planned[key] / known[key]) == pytest.approx(ratio, rel=0.4)


def test_friction_keeps_samples_comparable():
    own = campaign(mechanism(PINS, friction=0.1), ("time", "crank_angle", "slider_acceleration"))
    model = build_model(own, None, {"slow": 30.0})
    assert model.chaotic("slow") == ()
    assert model.plans["slow"].samples.turned < 4 * TURN  # a motion that repeats is not planned for longer
