"""The map of disagreement."""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from jointgap.identification.disagreement import (
    dominant_orders,
    flag_bins,
    ljung_box,
    map_disagreement,
    order_spectrum,
    speed_scaling,
)
from jointgap.identification.problem import Noise, Problem, unwhiten, whiten
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.draws import check_rate, check_uniform
from tests.identification.toy import coloured, stated_noise, toy

SETTINGS = DEFAULT_SETTINGS.disagreement
MEMORIES = (0.0, 0), (0.8, 1)
"""Of the noise, and over how many samples it is known."""


def mapped(model, memory: float = 0.0, order: int = 0):
    """Map of the nominal model's residual."""
    problem = Problem(model, stated_noise(model, memory, order))
    return map_disagreement(
        problem, problem.residual({p.key: p.nominal for p in problem.nuisances})
    )


def with_bump(model, key: tuple[str, str], begin: float, end: float, height: float):
    """The model with a channel raised by `height` standard deviations between two angles [deg]."""
    series = []
    for one in model.series:
        if one.key == key:
            place = np.mod(np.degrees(one.angle) - begin, 360.0) < np.mod(end - begin, 360.0)
            one = replace(one, value=one.value + place * height * one.stated_noise)
        series.append(one)
    return replace(model, series=tuple(series))


def noise_alone(count: int, memory: float, order: int):
    return [
        mapped(toy(seed=seed, autocorrelation=memory, cycles=2.0), memory, order)
        for seed in range(count)
    ]


# Windows


@pytest.mark.parametrize("memory, order", MEMORIES)
def test_noise_makes_windows_as_rarely_as_specified(memory, order):
    maps = noise_alone(15, memory, order)
    assert sum(len(one.windows) > 0 for one in maps) <= 1  # 0.15 expected at a rate of 1 %
    assert np.mean(np.concatenate([one.bins["p"] for one in maps]) < 0.05) < 0.06
    assert 0.01 < np.mean(np.concatenate([one.tests["p_chi2"] for one in maps]) < 0.05) < 0.11


def test_a_bump_is_located_within_one_bin():

    places = (352.0, 15.0), (100.0, 140.0)
    for begin, end, memory, order, seed in [
        (*place, *memory, seed) for place, memory, seed in product(places, MEMORIES, range(2))
    ]:
        model = with_bump(
            toy(seed=seed, autocorrelation=memory), ("slow", "torque"), begin, end, 5.0
        )
        windows = mapped(model, memory, order).windows
        assert list(zip(windows["run"], windows["channel"], strict=True)) == [("slow", "torque")]
        found = windows.iloc[0]
        assert abs(np.mod(found["start_deg"] - begin + 180.0, 360.0) - 180.0) <= 10.0
        assert abs(np.mod(found["end_deg"] - end + 180.0, 360.0) - 180.0) <= 10.0
        width = np.mod(found["end_deg"] - found["start_deg"], 360.0)
        assert found["mean"] == pytest.approx(
            5.0 * min(1.0, np.mod(end - begin, 360.0) / width), abs=1.5
        )
    # one window around the circle
    bias = with_bump(toy(seed=2), ("mid", "torque"), 0.0, 359.9999, 6.0)
    windows = mapped(bias).windows[["run", "channel", "start_deg", "end_deg"]]
    assert windows.to_numpy().tolist() == [["mid", "torque", 0.0, 360.0]]


def test_consistent_channels_are_rarely_flagged_next_to_biased_ones():
    windows, false = 0, 0
    for seed in range(10):
        model = toy(seed=seed)
        off = [series.key for series in model.series][:2]
        for key in off:
            model = with_bump(model, key, 0.0, 359.9999, 2.0)
        found = mapped(model).windows
        windows += len(found)
        false += sum(key not in off for key in zip(found["run"], found["channel"], strict=True))
    assert windows >= 20 and false <= 1


def test_channels_without_crank_angle_are_tested_but_not_mapped():
    model = toy(seed=6)
    blind = replace(
        model, series=tuple(replace(s, angle=np.full(s.angle.size, np.nan)) for s in model.series)
    )
    problem = Problem(model, stated_noise(model))
    residual = problem.residual({p.key: p.nominal for p in problem.nuisances})
    found = map_disagreement(Problem(blind, stated_noise(model)), residual)
    assert len(found.tests) == 6
    assert found.bins.empty and found.windows.empty and found.orders.empty and found.scaling.empty


# Bins


def bins_with(p: dict[int, float], size: float = 1.0) -> pd.DataFrame:
    """Bins of one channel, of probability 0.5 and without size but for those numbered in `p`."""
    rows = pd.DataFrame({"run": "slow", "channel": "torque", "start_deg": 10.0 * np.arange(36)})
    rows = rows.assign(p=0.5, size=0.0)
    rows.loc[list(p), "p"], rows.loc[list(p), "size"] = list(p.values()), size
    return rows


def flagged(bins: pd.DataFrame, *correlations) -> list[int]:
    found = flag_bins(bins, SETTINGS, 0.01, *correlations)
    return bins.index[found["flagged"].to_numpy(bool)].tolist()


WEAK = dict.fromkeys(range(5, 14), 0.02)
WEAK_BETWEEN = dict.fromkeys([4, 5, 6, 7, 9, 10, 11, 12], 1e-3) | {8: 0.4, 13: 0.4}


def test_small_deviations_over_many_bins_are_significant_together():

    fewer = bins_with(dict.fromkeys(range(6, 18), 1e-3) | {9: 0.4})
    for bins, expected in [
        (bins_with(WEAK), list(range(5, 14))),
        (bins_with({7: 0.02, 20: 0.02}), []),
        (bins_with(WEAK, size=0.05), []),  # too small for anyone to look for its cause
        # a weak bin between others belongs to their window, one at the edge does not
        (bins_with(WEAK_BETWEEN), list(range(4, 13))),
        # bins without samples around
        (bins_with(WEAK_BETWEEN).drop(index=[0, 1, 20, 21]), list(range(4, 13))),
        # of 15 deg, of statistics
        (fewer[fewer.index.isin(np.arange(24) * 3 // 2)], [6, 7, 9, 10, 12, 13, 15, 16]),
        # one sure bin does not make others sure
        (bins_with({7: 1e-30, 10: 0.03, 13: 0.03}), [7]),
        (bins_with({35: 1e-9, 0: 1e-9}), [0, 35]),  # across the beginning of the circle
    ]:
        assert flagged(bins) == expected
    adjusted = flag_bins(bins_with({7: 1e-9}), SETTINGS, 0.01)["p_adjusted"]
    # of the surest span
    assert adjusted[7] == pytest.approx(1e-9 * 36 * (1 + len(SETTINGS.spans)), rel=1e-9)
    assert adjusted.drop(7).min() > 0.01


def test_correlated_noise_lowers_the_significance_of_neighbouring_bins():
    assert flagged(bins_with(WEAK), {("slow", "torque"): 0.9 ** np.arange(1, 36)}) == []
    # 0.15 expected at a rate of 1 %
    assert sum(len(one.windows) > 0 for one in noise_alone(15, 0.95, 1)) <= 1


# Tests of a channel


@pytest.mark.parametrize("samples, kept", [(60, 1.0), (300, 0.8)])
def test_the_ljung_box_p_value_is_uniform_for_white_noise_with_gaps(samples, kept):
    random, p = np.random.default_rng(samples), []
    for _ in range(600):
        index = np.flatnonzero(random.random(samples) < kept)
        p.append(ljung_box(random.standard_normal(index.size), index))
    check_rate(np.array(p) < 0.1, 0.09, 0.11)
    check_rate(np.array(p) < 0.01, 0.01, 0.02)
    assert ljung_box(coloured(300, 0.5, np.random.default_rng(0)), np.arange(300)) < 1e-6


@pytest.mark.parametrize(
    "memory, turns", [((), 2), pytest.param((0.8,), 4, marks=pytest.mark.integration)]
)
def test_p_values_of_noise_are_uniform(memory, turns):
    """Of runs, bins of the crank angle (two tests each, the smaller doubled) and orders."""
    random, angle = np.random.default_rng(turns), 2 * np.pi * np.arange(120 * turns) / 120.0
    problem = problem_of(*((run, angle, angle) for run in ("slow", "mid", "fast")))
    for part in problem.parts:
        part.noise = Noise(np.ones(angle.size), memory)
        part.series.key = (part.series.run, "torque")
    maps = [map_disagreement(problem, random.standard_normal(3 * angle.size)) for _ in range(25)]
    check_uniform([one.p for one in maps])
    check_uniform(np.concatenate([one.tests["p_chi2"] for one in maps]))
    check_rate(np.concatenate([one.bins["p"] for one in maps]) < 0.05, 0.03, 0.05)
    check_rate(np.concatenate([one.orders["p"] for one in maps]) < 0.05, 0.045, 0.055)
    check_rate([len(one.windows) > 0 for one in maps], 0.0, 0.01)
    check_rate([len(one.standout) > 0 for one in maps], 0.0, 0.03)  # of three channels


def test_unwhitening_inverts_whitening():
    residual = np.random.default_rng(0).standard_normal(50)
    residual[[7, 8, 20, 22]] = np.nan
    noise = Noise(np.full(50, 2.0), (0.6, 0.5, 0.2))
    assert unwhiten(whiten(residual, noise), noise) == pytest.approx(residual / 2.0, nan_ok=True)


# Orders of the crank and growth with speed


def test_the_spectrum_shows_the_order_of_a_disagreement():
    model = toy(seed=4)
    series = [
        replace(s, value=s.value + 2.0 * s.stated_noise * np.cos(3.0 * s.angle + 0.4))
        for s in model.series
    ]
    orders = mapped(replace(model, series=tuple(series))).orders
    first = orders.loc[orders.groupby(["run", "channel"])["amplitude"].idxmax()]
    assert first["order"].to_numpy() == pytest.approx(np.full(6, 3.0))
    assert first["amplitude"].to_numpy() == pytest.approx(np.full(6, 2.0), abs=0.3)
    assert np.mean(orders.loc[~np.isclose(orders["order"], 3.0), "p"] < 0.05) == pytest.approx(
        0.05, abs=0.03
    )


def problem_of(*runs) -> SimpleNamespace:
    """A problem of one channel with noise of 1, of runs by name, crank angle and time."""
    parts, place = [], 0
    for run, angle, time in runs:
        series = SimpleNamespace(run=run, channel="torque", unit="N*m", angle=angle, time=time)
        used, noise = np.ones(angle.size, bool), Noise(np.ones(angle.size))
        samples = slice(place, place + angle.size)
        parts.append(SimpleNamespace(series=series, used=used, noise=noise, place=samples))
        place += angle.size
    return SimpleNamespace(parts=parts, settings=DEFAULT_SETTINGS)


@pytest.mark.parametrize(
    "turns, order", list(product([1, 7, 10, 22, 44, 49, 98, 107], [3, 7, 16, 24]))
)
def test_a_ripple_of_integer_order_is_dominant_at_any_record_length(turns, order):
    angle = 2 * np.pi * np.arange(60 * turns + 1) / 60.0
    given = problem_of(("slow", angle, None)), 3.0 * np.cos(order * angle)
    orders = order_spectrum(*given)["order"]
    assert (len(orders), orders.iloc[-1]) == (24 * turns, pytest.approx(24.0))
    (row,) = dominant_orders(*given, rate=0.01).to_dict("records")
    assert (row["order"], row["amplitude"]) == (order, pytest.approx(3.0))
    assert row["share"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    "effect, exponent",
    [
        ({"coulomb": {"force_N": 3.0}}, 0.0),
        ({"viscous": {"damping_N_s_m": 3.0}}, 1.0),
        ({"centrifugal": {"mass_kg": 0.1}}, 2.0),
    ],
)
def test_the_growth_with_speed_identifies_the_kind_of_force(effect, exponent):
    scaling = mapped(toy(effect, seed=5, held_out=())).scaling.set_index("channel")
    assert set(scaling.index) == {"torque", "guide_force"}
    assert scaling["exponent"].to_numpy() == pytest.approx([exponent, exponent], abs=0.05)
    assert (scaling["low"] < scaling["high"]).all() and (scaling["runs"] == 3).all()


@pytest.mark.parametrize(
    "speeds, scatter",
    [((10.0, 40.0), 0.0), ((10.0, 20.0, 40.0), 0.0), ((10.0, 14.0, 20.0, 40.0), 0.3)],
)
def test_90_percent_intervals_of_the_speed_exponent_cover_90_percent(speeds, scatter):
    """The residual grows with speed, with a random factor in each run."""
    random, time, speeds = np.random.default_rng(1), np.linspace(0.0, 10.0, 50), np.array(speeds)
    problem, held = problem_of(*((str(speed), speed * time, time) for speed in speeds)), []
    for _ in range(400):
        sizes = 0.4 * speeds * np.exp(scatter * random.standard_normal(speeds.size))
        residual = np.repeat(sizes, 50) + random.standard_normal(50 * speeds.size)
        (row,) = speed_scaling(problem, residual).to_dict("records")
        held.append(row["low"] < 1.0 < row["high"])
    check_rate(held, 0.9)
