"""Noise is found from what cycles do not repeat, and nothing that moves is taken for noise."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.candidates import Series
from jointgap.core.errors import InputError
from jointgap.identification.baseline import recalibrate
from jointgap.identification.fit import FAILED, Fit
from jointgap.identification.noise import effective_samples, estimate_noise, numerics_noise
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.identification.toy import Toy, toy

HARMONIC = {"harmonic_force": {"cosine_N": 1.0, "sine_N": 0.0, "frequency_Hz": 5.3}}


def residuals(model: Toy) -> dict:
    """Measured minus predicted by the nominal model."""
    found = {}
    for run in model.speeds:
        predicted = model.simulate(run, {p.name: p.nominal for p in model.nuisances if p.run in (None, run)})
        found |= {s.key: s.value - predicted[s.channel] for s in model.series if s.run == run}
    return found


def found(**options) -> tuple[list, np.ndarray]:
    """Noise of every series, and its true standard deviation."""
    model, told = toy(**options), toy(**{**options, "stated": True})
    noise = estimate_noise(model, residuals(model))
    return [noise[s.key] for s in model.series], np.array([s.stated_noise[0] for s in told.series])


@pytest.mark.parametrize("memory", [0.0, 0.7])
@pytest.mark.parametrize("samples", [72, 71.37])
def test_noise_that_nobody_states_is_found_from_its_cycles(memory, samples):
    # The model misses friction: what it misses repeats from cycle to cycle.
    ratios, first = [], []
    for seed in range(8):
        noise, true = found(
            effects={"coulomb": {"force_N": 3.0}}, autocorrelation=memory, samples=samples, stated=False, seed=seed
        )
        ratios += [one.sd[0] / sd for one, sd in zip(noise, true, strict=True)]
        first += [one.autocorrelation[0] if one.autocorrelation else 0.0 for one in noise]
        assert {one.source for one in noise} == {"differences between neighbouring cycles"}
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.03)
    assert np.std(ratios) < 0.1
    assert np.mean(first) == pytest.approx(memory, abs=0.03)


def test_white_noise_counts_every_sample_and_noise_with_memory_fewer():
    white, _ = found(seed=1)
    slow, _ = found(autocorrelation=0.7, seed=1)
    assert np.median([one.effective_samples for one in white]) == pytest.approx(360)
    assert max(one.effective_samples for one in slow) < 180
    assert effective_samples(360, (0.7,)) == pytest.approx(360 * 0.3 / 1.7)  # (1 - rho) / (1 + rho) of them
    assert effective_samples(360, (-0.7,)) == 360


@pytest.mark.parametrize("stated", [True, False])
def test_the_held_out_part_of_a_run_tells_nothing_of_its_noise(stated):
    model = toy(seed=4, stated=stated, held_out=())
    late = np.arange(360) >= 240
    quiet = replace(model, series=[replace(s, held_out=late) for s in model.series])
    loud = replace(
        model,
        series=[
            replace(s, held_out=late, value=s.value + 5.0 * late * np.random.default_rng(0).standard_normal(360))
            for s in model.series
        ],
    )
    one, other = (estimate_noise(each, residuals(each)) for each in (quiet, loud))
    for series in quiet.series:
        np.testing.assert_array_equal(one[series.key].sd, other[series.key].sd)
        assert one[series.key].autocorrelation == other[series.key].autocorrelation
        assert one[series.key].effective_samples == other[series.key].effective_samples <= 240


def test_a_stated_noise_wins_and_is_told_where_cycles_differ_by_far_more():
    model = toy(seed=2)
    claimed = replace(model, series=[replace(s, stated_noise=s.stated_noise / 3) for s in model.series])
    for series, one in zip(claimed.series, estimate_noise(claimed, residuals(model)).values(), strict=True):
        assert one.source == "stated"
        assert (one.sd == series.stated_noise).all()
        assert one.estimated_sd == pytest.approx(3 * series.stated_noise[0], rel=0.2)
        assert "larger noise" in one.remarks[0]


@pytest.mark.parametrize("stated", [True, False])
def test_a_force_out_of_step_with_the_crank_is_not_taken_for_noise(stated):
    ratios, first = [], []
    for seed in range(5):
        noise, true = found(effects=HARMONIC, seed=seed, stated=stated)  # some ten times the noise
        ratios += [one.estimated_sd / sd for one, sd in zip(noise, true, strict=True)]
        first += [abs(one.autocorrelation[0]) if one.autocorrelation else 0.0 for one in noise]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.06)
    assert np.mean(first) < 0.05


def test_a_drift_is_no_memory_of_stated_noise():
    model = toy(seed=3)
    drifting = {
        key: value + np.linspace(-1, 1, value.size) * 8 * value.std() for key, value in residuals(model).items()
    }
    memories = [one.autocorrelation[:1] or (0.0,) for one in estimate_noise(model, drifting).values()]
    assert np.mean(memories) < 0.2


def test_wild_samples_and_gaps_do_not_change_the_noise():
    model, rng = toy(seed=4, stated=False), np.random.default_rng(0)
    clean, damaged = residuals(model), {}
    for key, value in clean.items():
        value = value.copy()
        value[rng.choice(value.size, 4, replace=False)] += 100 * value.std()
        value[rng.choice(value.size, 40, replace=False)] = np.nan
        damaged[key] = value
    before, after = estimate_noise(model, clean), estimate_noise(model, damaged)
    ratios = [after[key].sd[0] / before[key].sd[0] for key in clean]
    assert ratios == pytest.approx(np.ones(len(ratios)), abs=0.15)


def test_an_angle_that_steps_back_by_its_own_noise_tells_the_cycles_as_well():
    model, rng = toy(seed=6, samples=300), np.random.default_rng(1)
    read = [replace(s, angle=s.angle + np.deg2rad(0.5) * rng.standard_normal(s.angle.size)) for s in model.series]
    assert (np.diff(read[0].angle) < 0).any()
    noise = estimate_noise(replace(model, series=read), residuals(model))
    for series in model.series:
        assert noise[series.key].estimated_sd == pytest.approx(series.stated_noise[0], rel=0.1)
        assert not noise[series.key].remarks


def test_a_single_cycle_tells_the_noise_by_its_roughness_but_not_its_memory():
    ratios = []
    for seed in range(8):
        noise, true = found(cycles=1.0, samples=144, stated=False, seed=seed)
        ratios += [one.sd[0] / sd for one, sd in zip(noise, true, strict=True)]
        assert all(one.autocorrelation == () and "too few cycles" in one.remarks[0] for one in noise)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.05)


def test_a_channel_without_any_noise_gets_the_least_that_a_sensor_has():
    model = toy(noise=0.0, stated=False)
    for series, one in zip(model.series, estimate_noise(model, residuals(model)).values(), strict=True):
        assert one.sd[0] == pytest.approx(1e-4 * series.value.std())
        assert "no visible noise" in one.remarks[0]


def test_too_few_samples_to_find_a_noise_are_refused():
    model = toy(samples=3, cycles=1, stated=False)
    with pytest.raises(InputError, match=r"run slow, channel torque: 3 samples are too few.*state it as `noise`"):
        estimate_noise(model, residuals(model))


def encoder(samples: float, step: float, sd: float, seed: int, cycles: int = 12) -> tuple[Series, np.ndarray]:
    """A crank angle [rad] that is read in steps, of a crank that turns evenly, and its true course."""
    true = 0.317 + 2 * np.pi / samples * np.arange(int(cycles * samples))
    read = step * np.round((true + sd * np.random.default_rng(seed).standard_normal(true.size)) / step)
    return series("crank_angle", "rad", read, true, resolution=step), true


def series(channel: str, unit: str, value: np.ndarray, angle: np.ndarray, **known) -> Series:
    return Series("run", channel, unit, value, angle / 20.0, angle, np.zeros(value.size, bool), **known)


def noise_of(one: Series, predicted: np.ndarray):
    return estimate_noise(replace(toy(), series=[one]), {one.key: one.value - predicted})[one.key]


@pytest.mark.parametrize("samples", [250, 250.37])  # of 250 a turn each is rounded as in the cycle before
@pytest.mark.parametrize("share", [0.1, 0.2, 0.6])
def test_rounding_and_scatter_add_up_whether_or_not_cycles_repeat_the_rounding(samples, share):
    step = np.deg2rad(0.25)
    found = [noise_of(*encoder(samples, step, share * step, seed)).sd[0] for seed in range(4)]
    assert np.mean(found) == pytest.approx(step * np.hypot(share, 1 / np.sqrt(12)), rel=0.07)


def test_an_angle_that_drifts_between_cycles_does_not_scatter():
    angle = 0.4 * np.arange(600)
    away = 2e-6 * (angle - 100.0) ** 2 + 1e-3 * np.random.default_rng(0).standard_normal(angle.size)
    one = series("crank_angle", "rad", angle + 40.0 * away, angle)
    assert noise_of(one, angle).sd[0] == pytest.approx(0.04, rel=0.1)


@pytest.mark.parametrize(
    ("channel", "unit", "size"), [("crank_angle", "rad", 0.5), ("slider_position", "m", 0.05)], ids=["turn", "signal"]
)
def test_a_noise_that_is_a_large_part_of_a_turn_or_of_the_signal_is_refused(channel, unit, size):
    angle = 0.4 * np.arange(600)
    true = angle if unit == "rad" else 0.05 * np.cos(angle)
    one = series(channel, unit, true + size * np.random.default_rng(0).standard_normal(angle.size), angle)
    with pytest.raises(InputError, match=rf"run run, channel {channel}: .*does not follow the motion.*`noise`"):
        noise_of(one, true)


def test_so_is_one_that_is_stated():
    angle = 0.4 * np.arange(600)
    one = series("crank_angle", "rad", angle + 1e-3 * np.random.default_rng(0).standard_normal(angle.size), angle)
    with pytest.raises(InputError, match=r"channel crank_angle: the stated noise of 400 deg .*at most 10 deg"):
        noise_of(replace(one, stated_noise=np.full(angle.size, np.radians(400.0))), angle)


def test_a_channel_that_should_stand_still_may_hold_nothing_but_noise():
    angle = 0.1 * np.arange(600)
    one = series("crank_speed", "rad/s", 20.0 + np.random.default_rng(0).standard_normal(angle.size), angle)
    assert noise_of(one, np.full(angle.size, 20.0)).sd[0] == pytest.approx(1.0, rel=0.1)


def test_of_a_fit_that_failed_nothing_is_known():
    model = toy()
    values = np.array([p.nominal for p in model.nuisances])
    nothing = np.full(360, np.nan), np.empty((360, 0))  # as it is read from its tables
    failed = Fit((), tuple(model.nuisances), values, *nothing, 0, FAILED, "the rod does not reach")
    assert not failed.distribution.covariance.any()
    assert not failed.covariance().any()


def test_statistics_have_the_noise_that_is_stated_and_need_one():
    model = toy()
    statistics = replace(model, series=[replace(s, statistic=True) for s in model.series])
    for series, one in zip(statistics.series, estimate_noise(statistics, residuals(model)).values(), strict=True):
        assert (one.sd == series.stated_noise).all()
        assert one.autocorrelation == ()
    unstated = replace(model, series=[replace(s, statistic=True, stated_noise=None) for s in model.series])
    with pytest.raises(InputError, match="statistics require a stated noise"):
        estimate_noise(unstated, residuals(model))


class Disagreeing(Toy):
    """Other numerics predict 0.5 N m more of the torque."""

    def simulate(self, run, values, effects=(), numerics=0):
        read = super().simulate(run, values, effects, numerics)
        return {key: value + (0.5 if numerics and key == "torque" else 0.0) for key, value in read.items()}


def test_numerics_that_predict_the_same_add_nothing_and_others_their_difference():
    model = toy()
    noise = estimate_noise(model, residuals(model))
    assert all(np.all(one.numerics == 0.0) for one in numerics_noise(model, {}, noise).values())
    other = Disagreeing(model.series, model.nuisances, model.candidates, model.speeds)
    added = numerics_noise(other, {}, noise)
    assert added["mid", "torque"].numerics == pytest.approx(np.full(360, 0.5))
    assert (added["mid", "guide_force"].numerics == 0.0).all()
    statistics = replace(other, series=[replace(s, statistic=True) for s in model.series])
    wide = {key: replace(one, sd=np.full(360, 0.4)) for key, one in noise.items()}
    assert numerics_noise(statistics, {}, wide)["mid", "torque"].numerics == pytest.approx(np.full(360, 0.3))
    assert added["mid", "torque"].effective_samples == noise["mid", "torque"].effective_samples


def test_numerics_that_the_settings_call_negligible_add_nothing_to_the_noise_of_the_baseline():
    model = toy()
    other = Disagreeing(model.series, model.nuisances, model.candidates, model.speeds)
    noise = estimate_noise(model, residuals(model))
    deaf = replace(DEFAULT_SETTINGS, noise=replace(DEFAULT_SETTINGS.noise, negligible_numerics=1e9))
    largest = [
        max(np.max(part.noise.numerics) for part in recalibrate(other, noise, settings).problem.parts)
        for settings in (DEFAULT_SETTINGS, deaf)
    ]
    assert largest == [pytest.approx(0.5), 0.0]
