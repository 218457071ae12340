"""The map shows where model and data disagree, and nothing where they do not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from jointgap.identification.disagreement import (
    bin_correlations,
    circular_spans,
    dominant_orders,
    flag_bins,
    ljung_box,
    map_disagreement,
    order_spectrum,
    speed_scaling,
)
from jointgap.identification.problem import Noise, Problem, unwhiten, whiten
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.identification.toy import coloured as noise_of
from tests.identification.toy import stated_noise, toy


def mapped(model, memory: float = 0.0, order: int = 0):
    """Map of the nominal model's residual."""
    problem = Problem(model, stated_noise(model, memory, order))
    return map_disagreement(problem, problem.residual({p.key: p.nominal for p in problem.nuisances}))


def with_bump(model, key: tuple[str, str], begin: float, end: float, height: float):
    """The model with what a channel reads raised by `height` standard deviations between two angles [deg]."""
    series = []
    for one in model.series:
        if one.key == key:
            place = np.mod(np.degrees(one.angle) - begin, 360.0) < np.mod(end - begin, 360.0)
            one = replace(one, value=one.value + place * height * one.stated_noise)
        series.append(one)
    return replace(model, series=tuple(series))


@pytest.mark.parametrize(("memory", "order"), [(0.0, 0), (0.8, 1)])
def test_noise_alone_makes_windows_as_rarely_as_stated(memory, order):
    maps = [mapped(toy(seed=seed, autocorrelation=memory, cycles=2.0), memory, order) for seed in range(25)]
    assert sum(len(one.windows) > 0 for one in maps) <= 2  # 0.25 expected at a rate of 1 %
    p = np.concatenate([one.bins["p"] for one in maps])
    assert np.mean(p < 0.05) < 0.06
    assert 0.02 < np.mean(np.concatenate([one.tests["p_chi2"] for one in maps]) < 0.05) < 0.09


@pytest.mark.parametrize(("memory", "order"), [(0.0, 0), (0.8, 1)])
@pytest.mark.parametrize(("begin", "end"), [(352.0, 15.0), (100.0, 140.0)])
def test_a_bump_is_found_within_a_bin_of_its_place_and_nowhere_else(memory, order, begin, end):
    for seed in range(3):
        model = with_bump(toy(seed=seed, autocorrelation=memory), ("slow", "torque"), begin, end, 5.0)
        windows = mapped(model, memory, order).windows
        assert list(zip(windows["run"], windows["channel"], strict=True)) == [("slow", "torque")]
        found = windows.iloc[0]
        assert abs(np.mod(found["start_deg"] - begin + 180.0, 360.0) - 180.0) <= 10.0
        assert abs(np.mod(found["end_deg"] - end + 180.0, 360.0) - 180.0) <= 10.0
        width = np.mod(found["end_deg"] - found["start_deg"], 360.0)
        assert found["mean"] == pytest.approx(5.0 * min(1.0, np.mod(end - begin, 360.0) / width), abs=1.5)


def test_what_a_bump_leaves_in_the_memory_of_noise_does_not_widen_its_window():
    # From one sample to the next a long memory expects the bump to go on: the sample after it looks like -8 standard
    # deviations.
    model = with_bump(toy(seed=1, autocorrelation=0.95, samples=360), ("slow", "torque"), 100.0, 140.0, 10.0)
    windows = mapped(model, 0.95, 1).windows
    assert (windows["start_deg"].tolist(), windows["end_deg"].tolist()) == ([100.0], [140.0])


def test_hardly_a_window_is_shown_where_data_without_noise_would_agree():
    heights, windows, wrong = (0.5, 1.0, 2.0, 4.0), 0, 0
    for seed, height in enumerate(heights * 3):
        model = with_bump(toy(seed=seed, autocorrelation=0.5), ("mid", "torque"), 205.0, 255.0, height)
        found = mapped(model, 0.5, 1).windows
        windows += len(found)
        there = (found["channel"] == "torque") & (found["run"] == "mid") & found["start_deg"].between(200, 250)
        wrong += int((~there).sum())
    assert windows >= 6  # all of the larger two
    assert wrong <= 0.05 * windows


def test_a_bias_without_end_is_one_window_around_the_circle():
    windows = mapped(with_bump(toy(seed=2), ("mid", "torque"), 0.0, 359.9999, 6.0)).windows
    assert windows[["run", "channel", "start_deg", "end_deg"]].to_numpy().tolist() == [["mid", "torque", 0.0, 360.0]]


def test_the_whole_residual_and_every_channel_are_tested():
    model = toy({"coulomb": {"force_N": 0.5}}, seed=3)
    found = mapped(model)
    assert found.p < 1e-6
    assert found.chi2 == pytest.approx(found.tests["chi2"].sum())
    assert found.samples == found.tests["samples"].sum() == 2 * 3 * 360
    clean = found.tests.set_index("channel").loc["acceleration"]  # a force does not change a prescribed motion
    assert (clean["p_chi2"] > 1e-3).all()
    assert (clean["p_ljung_box"] > 1e-3).all()
    assert (found.tests.set_index("channel").loc["guide_force"]["p_ljung_box"] < 1e-6).all()


def test_ljung_box_is_flat_for_independent_numbers_with_gaps_and_sees_memory():
    p = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        index = np.flatnonzero(rng.random(300) < 0.8)
        p.append(ljung_box(rng.standard_normal(index.size), index))
    assert np.mean(np.array(p) < 0.1) == pytest.approx(0.1, abs=0.06)
    assert ljung_box(noise_of(300, 0.5, np.random.default_rng(0)), np.arange(300)) < 1e-6


def bins_with(p: dict[int, float], size: float = 1.0) -> pd.DataFrame:
    """Bins of one channel, of probability 0.5 and without size but for those numbered in `p`."""
    rows = pd.DataFrame({"run": "slow", "channel": "torque", "start_deg": 10.0 * np.arange(36), "p": 0.5, "size": 0.0})
    rows.loc[list(p), "p"], rows.loc[list(p), "size"] = list(p.values()), size
    return rows


def flagged(bins: pd.DataFrame) -> list[int]:
    found = flag_bins(bins, DEFAULT_SETTINGS.disagreement, 0.01)
    return np.flatnonzero(found["flagged"]).tolist()


def test_what_is_small_over_many_bins_is_sure_for_these_together():
    weak = dict.fromkeys(range(5, 14), 0.02)
    assert flagged(bins_with(weak)) == list(range(5, 14))
    assert flagged(bins_with({7: 0.02, 20: 0.02})) == []
    assert flagged(bins_with(weak, size=0.05)) == []  # too small for anyone to look for its cause


def test_a_weak_bin_between_others_belongs_to_their_window_and_one_beside_them_does_not():
    many = dict.fromkeys([4, 5, 6, 7, 9, 10, 11, 12], 1e-3)
    assert flagged(bins_with(many | {8: 0.4, 13: 0.4})) == list(range(4, 13))
    few = bins_with(many | {8: 0.4, 13: 0.4}).drop(index=[0, 1, 20, 21])  # bins without samples, before and after
    assert few.index[np.array(flagged(few))].tolist() == list(range(4, 13))


def test_statistics_in_fewer_bins_are_windows_too():
    rows = bins_with(dict.fromkeys(range(6, 18), 1e-3) | {9: 0.4})
    rows = rows[rows["start_deg"].isin(10.0 * np.floor(1.5 * np.arange(24)))]  # of 15 deg each
    found = flag_bins(rows, DEFAULT_SETTINGS.disagreement, 0.01)
    assert found.loc[found["flagged"], "start_deg"].tolist() == [60.0, 70.0, 90.0, 100.0, 120.0, 130.0, 150.0, 160.0]


def test_windows_of_channels_that_agree_are_rare_beside_channels_that_are_off_everywhere():
    windows, false = 0, 0
    for seed in range(20):
        model = toy(seed=seed)
        off = [series.key for series in model.series][:2]
        for key in off:
            model = with_bump(model, key, 0.0, 359.9999, 2.0)
        found = mapped(model).windows
        windows += len(found)
        false += sum(key not in off for key in zip(found["run"], found["channel"], strict=True))
    assert windows >= 40
    assert false <= 1


def test_the_memory_of_noise_makes_neighbours_count_for_fewer():
    weak = bins_with(dict.fromkeys(range(5, 14), 0.02))
    alike = {("slow", "torque"): 0.9 ** np.arange(1, 36)}
    assert not flag_bins(weak, DEFAULT_SETTINGS.disagreement, 0.01, alike)["flagged"].any()
    maps = [mapped(toy(seed=seed, autocorrelation=0.95, cycles=2.0), 0.95, 1) for seed in range(40)]
    assert sum(len(one.windows) > 0 for one in maps) <= 3  # 0.4 expected at a rate of 1 %


def test_correlations_of_bins_are_those_of_means_over_as_many_samples():
    turn, rng = 72, np.random.default_rng(0)
    noise = noise_of(turn * 4000, 0.8, rng)
    part = SimpleNamespace(
        series=SimpleNamespace(angle=2 * np.pi * np.arange(noise.size) / turn),
        used=np.ones(noise.size, bool),
        noise=Noise(np.ones(noise.size), (0.8,)),
    )
    means = noise.reshape(-1, 2).mean(axis=1)
    seen = [np.corrcoef(means[:-apart], means[apart:])[0, 1] for apart in (1, 2, 5)]
    assert bin_correlations(part, 36)[[0, 1, 4]] == pytest.approx(seen, abs=0.02)
    white = SimpleNamespace(noise=Noise(np.ones(3)))
    assert bin_correlations(white, 36).size == 0
    part.series.angle = np.full(noise.size, np.nan)
    assert bin_correlations(part, 36).size == 0


def test_one_sure_bin_does_not_make_what_is_around_it_sure():
    assert flagged(bins_with({7: 1e-30, 10: 0.03, 13: 0.03})) == [7]


def test_a_window_runs_across_the_beginning_of_the_circle():
    assert flagged(bins_with({35: 1e-9, 0: 1e-9})) == [0, 35]


def test_the_adjusted_probability_of_a_bin_is_that_of_the_surest_span_that_holds_it():
    found = flag_bins(bins_with({7: 1e-9}), DEFAULT_SETTINGS.disagreement, 0.01)["p_adjusted"]
    spans = 36 * (1 + len(DEFAULT_SETTINGS.disagreement.spans))
    assert found[7] == pytest.approx(1e-9 * spans, rel=1e-9)
    assert found.drop(7).min() > 0.01


def test_rows_on_a_circle_run_across_its_beginning():
    assert circular_spans(np.array([True, False, True, True, False, True])) == [(2, 2), (5, 2)]
    assert circular_spans(np.ones(4, bool)) == [(0, 4)]
    assert circular_spans(np.zeros(4, bool)) == []


def test_whitened_residuals_are_turned_back_exactly():
    residual = np.random.default_rng(0).standard_normal(50)
    residual[[7, 8, 20, 22]] = np.nan
    noise = Noise(np.full(50, 2.0), (0.6, 0.5, 0.2))
    assert unwhiten(whiten(residual, noise), noise) == pytest.approx(residual / 2.0, nan_ok=True)


def test_the_spectrum_shows_the_order_of_a_disagreement():
    model = toy(seed=4)
    series = [replace(s, value=s.value + 2.0 * s.stated_noise * np.cos(3.0 * s.angle + 0.4)) for s in model.series]
    orders = mapped(replace(model, series=tuple(series))).orders
    first = orders.loc[orders.groupby(["run", "channel"])["amplitude"].idxmax()]
    assert first["order"].to_numpy() == pytest.approx(np.full(6, 3.0))
    assert first["amplitude"].to_numpy() == pytest.approx(np.full(6, 2.0), abs=0.3)
    assert np.mean(orders.loc[~np.isclose(orders["order"], 3.0), "p"] < 0.05) == pytest.approx(0.05, abs=0.03)


def rippled(turns: int, order: int) -> tuple[SimpleNamespace, np.ndarray]:
    """A problem of one channel with noise of 1, and a residual that is a ripple of one order alone, three times as
    high."""
    angle = 2 * np.pi * np.arange(60 * turns + 1) / 60.0
    series = SimpleNamespace(run="slow", channel="torque", unit="N*m", angle=angle)
    used, noise = np.ones(angle.size, bool), Noise(np.ones(angle.size))
    part = SimpleNamespace(series=series, used=used, noise=noise, place=slice(0, angle.size))
    return SimpleNamespace(parts=[part], settings=DEFAULT_SETTINGS), 3.0 * np.cos(order * angle)


@pytest.mark.parametrize("turns", [1, 7, 10, 22, 44, 49, 98, 107])
def test_the_spectrum_of_a_record_of_any_length_ends_with_the_highest_order(turns):
    orders = order_spectrum(*rippled(turns, order=3))["order"]
    assert len(orders) == 24 * turns
    assert orders.iloc[-1] == pytest.approx(24.0)


@pytest.mark.parametrize("turns", [1, 7, 10, 22, 44, 49, 98, 107])
@pytest.mark.parametrize("order", [3, 6, 7, 12, 16, 23, 24])
def test_a_ripple_of_a_whole_order_stands_out_of_a_record_of_any_length(turns, order):
    (row,) = dominant_orders(*rippled(turns, order), rate=0.01).to_dict("records")
    assert row["order"] == order
    assert row["amplitude"] == pytest.approx(3.0)
    assert row["share"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("effect", "exponent"),
    [
        ({"coulomb": {"force_N": 3.0}}, 0.0),
        ({"viscous": {"damping_N_s_m": 3.0}}, 1.0),
        ({"centrifugal": {"mass_kg": 0.1}}, 2.0),
    ],
)
def test_the_growth_with_speed_tells_the_kind_of_force(effect, exponent):
    scaling = mapped(toy(effect, seed=5, held_out=())).scaling.set_index("channel")
    assert set(scaling.index) == {"torque", "guide_force"}
    assert scaling["exponent"].to_numpy() == pytest.approx([exponent, exponent], abs=0.05)
    assert (scaling["low"] < scaling["high"]).all()
    assert (scaling["runs"] == 3).all()


def test_channels_without_crank_angle_are_tested_but_not_mapped():
    model = toy(seed=6)
    blind = replace(model, series=tuple(replace(s, angle=np.full(s.angle.size, np.nan)) for s in model.series))
    problem = Problem(model, stated_noise(model))
    residual = problem.residual({p.key: p.nominal for p in problem.nuisances})
    found = map_disagreement(Problem(blind, stated_noise(model)), residual)
    assert len(found.tests) == 6
    assert found.bins.empty and found.windows.empty and found.orders.empty
    assert isinstance(found.scaling, pd.DataFrame) and found.scaling.empty


RUN_SPEEDS = {"slow": 10.0, "mid": 20.0, "fast": 40.0}  # rad/s


def scattered(excesses: dict[str, float], samples: int = 400) -> tuple[SimpleNamespace, np.ndarray]:
    """A problem of one channel with noise of 1, and a residual whose mean square exceeds it by `excesses` in each
    run.
    """
    parts, residual = [], []
    for i, (run, speed) in enumerate(RUN_SPEEDS.items()):
        time = np.linspace(0.0, 10.0, samples)
        series = SimpleNamespace(run=run, channel="torque", angle=speed * time, time=time)
        noise, place = Noise(np.ones(samples)), slice(i * samples, (i + 1) * samples)
        parts.append(SimpleNamespace(series=series, used=np.ones(samples, bool), noise=noise, place=place))
        residual.append(np.full(samples, np.sqrt(1.0 + excesses[run])))
    return SimpleNamespace(parts=parts, settings=DEFAULT_SETTINGS), np.concatenate(residual)


@pytest.mark.parametrize(
    "excesses",
    [
        {"slow": 4.0, "mid": 16.0, "fast": 64.0},  # grows exactly with the first power of the speed
        {"slow": 4.0, "mid": 400.0, "fast": 64.0},  # scatters by far more than noise lets it
    ],
)
def test_the_interval_of_the_growth_with_speed_is_that_of_a_weighted_line_through_logarithms(excesses):
    samples = 400
    square = np.array(
        list(excesses.values())
    )  # of the excess, an amplitude; its error follows from that of the mean square
    error = 0.5 * (np.sqrt(2.0 / samples) + 2.0 * np.sqrt(square / samples)) / square
    design = np.column_stack([np.ones(3), np.log(list(RUN_SPEEDS.values()))]) / error[:, None]
    aim = 0.5 * np.log(square) / error
    (_, exponent), misfit, _, _ = np.linalg.lstsq(design, aim, rcond=None)
    variance = np.linalg.inv(design.T @ design)[1, 1] * max(1.0, float(misfit[0]))  # one degree of freedom
    (row,) = speed_scaling(*scattered(excesses, samples)).to_dict("records")
    assert row["exponent"] == pytest.approx(exponent, rel=1e-9)
    assert row["high"] - row["exponent"] == pytest.approx(1.645 * np.sqrt(variance), rel=1e-9)
    assert row["exponent"] - row["low"] == pytest.approx(1.645 * np.sqrt(variance), rel=1e-9)
    assert row["runs"] == 3
