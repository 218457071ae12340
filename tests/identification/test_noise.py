"""Estimation and whitening of noise."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from jointgap.core.candidates import Series
from jointgap.core.errors import InputError
from jointgap.identification.baseline import recalibrate
from jointgap.identification.noise import effective_samples, estimate_noise, numerics_noise
from jointgap.identification.problem import Noise, autoregression, whiten
from jointgap.identification.settings import DEFAULT_SETTINGS
from tests.identification.toy import Toy, toy

ANGLE = 0.4 * np.arange(600)
SCATTER = np.random.default_rng(0).standard_normal(ANGLE.size)


def residuals(model: Toy) -> dict:
    """Measured minus predicted by the nominal model."""
    found = {}
    for run in model.speeds:
        predicted = model.simulate(
            run, {p.name: p.nominal for p in model.nuisances if p.run in (None, run)}
        )
        found |= {s.key: s.value - predicted[s.channel] for s in model.series if s.run == run}
    return found


def estimates(model: Toy, misses=None):
    """Every series and its noise."""
    noise = estimate_noise(model, residuals(model) if misses is None else misses)
    return [(series, noise[series.key]) for series in model.series]


def over_seeds(count: int, **options) -> tuple[np.ndarray, list[float], list]:
    """Of all series of toys: estimated noise over the true one, memory from one sample to the next,
    and estimates."""
    ratios, first, found = [], [], []
    for seed in range(count):
        true = [s.stated_noise[0] for s in toy(seed=seed, **options | {"stated": True}).series]
        found += (noise := [one for _, one in estimates(toy(seed=seed, **options))])
        ratios += [one.estimated_sd / sd for one, sd in zip(noise, true, strict=True)]
        first += [one.autocorrelation[0] if one.autocorrelation else 0.0 for one in noise]
    return np.array(ratios), first, found


def changed(model: Toy, change) -> Toy:
    return replace(model, series=[change(series) for series in model.series])


def test_noise_is_found_with_a_coarse_encoder():
    step, ratios = 3.0 * math.tau / 72, []
    for seed in range(6):
        model = toy(seed=seed, stated=False)
        coarse = changed(
            model, lambda series: replace(series, angle=step * np.floor(series.angle / step))
        )
        for (_, found), (_, exact) in zip(
            estimates(coarse, residuals(model)), estimates(model), strict=True
        ):
            ratios.append(found.estimated_sd / exact.estimated_sd)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.03) and np.std(ratios) < 0.1


@pytest.mark.parametrize("memory, samples", list(product([0.0, 0.7], [72, 71.37])))
def test_unstated_noise_is_estimated_from_cycles(memory, samples):
    options = {"autocorrelation": memory, "samples": samples, "stated": False}
    ratios, first, found = over_seeds(6, effects={"coulomb": {"force_N": 3.0}}, **options)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.03) and np.std(ratios) < 0.1
    assert np.mean(first) == pytest.approx(memory, abs=0.03)
    assert {one.source for one in found} == {"differences between neighbouring cycles"}
    assert all(one.sd[0] == one.estimated_sd for one in found)


def test_white_noise_counts_every_sample_and_correlated_noise_fewer():
    _, _, white = over_seeds(1)
    _, _, slow = over_seeds(1, autocorrelation=0.7)
    assert np.median([one.effective_samples for one in white]) == pytest.approx(360)
    assert max(one.effective_samples for one in slow) < 180
    # (1 - rho) / (1 + rho) of them
    assert effective_samples(360, (0.7,)) == pytest.approx(360 * 0.3 / 1.7)
    assert effective_samples(360, (-0.7,)) == 360


@pytest.mark.parametrize("stated", [True, False])
def test_the_held_out_part_does_not_affect_the_noise(stated):
    model = toy(seed=4, stated=stated, held_out=())
    late, loudness = np.arange(360) >= 240, np.random.default_rng(0).standard_normal(360)
    quiet = changed(model, lambda s: replace(s, held_out=late))
    loud = changed(quiet, lambda s: replace(s, value=s.value + 5.0 * late * loudness))
    for (_, one), (_, other) in zip(estimates(quiet), estimates(loud), strict=True):
        np.testing.assert_array_equal(one.sd, other.sd)
        assert one.autocorrelation == other.autocorrelation
        assert one.effective_samples == other.effective_samples <= 240


def test_stated_noise_wins_and_a_larger_scatter_is_remarked():
    claimed = changed(toy(seed=2), lambda s: replace(s, stated_noise=s.stated_noise / 3))
    for series, one in estimates(claimed):
        assert one.source == "stated" and (one.sd == series.stated_noise).all()
        assert one.estimated_sd == pytest.approx(3 * series.stated_noise[0], rel=0.2)
        assert one.remarks


@pytest.mark.parametrize("stated", [True, False])
def test_a_non_synchronous_force_is_not_noise(stated):
    # some ten times the noise
    harmonic = {"harmonic_force": {"cosine_N": 1.0, "sine_N": 0.0, "frequency_Hz": 5.3}}
    ratios, first, _ = over_seeds(4, effects=harmonic, stated=stated)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.06)
    assert np.mean(np.abs(first)) < 0.05


def test_drift_is_no_correlation_of_stated_noise():
    model = toy(seed=3)
    drift = {
        key: value + np.linspace(-1, 1, value.size) * 8 * value.std()
        for key, value in residuals(model).items()
    }
    assert np.mean([one.autocorrelation[:1] or (0.0,) for _, one in estimates(model, drift)]) < 0.2


def test_wild_samples_and_gaps_do_not_change_the_noise():
    model, rng = toy(seed=4, stated=False), np.random.default_rng(0)
    damaged = {key: value.copy() for key, value in residuals(model).items()}
    for value in damaged.values():
        value[rng.choice(value.size, 4, replace=False)] += 100 * value.std()
        value[rng.choice(value.size, 40, replace=False)] = np.nan
    both = zip(estimates(model), estimates(model, damaged), strict=True)
    assert [after.sd[0] / before.sd[0] for (_, before), (_, after) in both] == pytest.approx(
        np.ones(9), abs=0.15
    )


def test_a_noisy_angle_still_gives_the_cycles():
    model, rng = toy(seed=6, samples=300), np.random.default_rng(1)
    read = changed(
        model,
        lambda s: replace(s, angle=s.angle + np.deg2rad(0.5) * rng.standard_normal(s.angle.size)),
    )
    assert (np.diff(read.series[0].angle) < 0).any()
    for series, one in estimates(read, residuals(model)):
        assert one.estimated_sd == pytest.approx(series.stated_noise[0], rel=0.1)
        assert not one.remarks


def test_one_cycle_gives_the_noise_level_without_its_correlation():
    ratios, _, found = over_seeds(8, cycles=1.0, samples=144, stated=False)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.05)
    assert all(one.autocorrelation == () and one.remarks for one in found)


def test_a_noiseless_channel_gets_the_smallest_noise_of_a_sensor():
    for series, one in estimates(toy(noise=0.0, stated=False)):
        assert one.sd[0] == pytest.approx(1e-4 * series.value.std()) and one.remarks


# Single channels


def series(channel: str, unit: str, value: np.ndarray, angle: np.ndarray, **known) -> Series:
    return Series(
        "run", channel, unit, value, angle / 20.0, angle, np.zeros(value.size, bool), **known
    )


def noise_of(one: Series, predicted: np.ndarray):
    return estimate_noise(replace(toy(), series=[one]), {one.key: one.value - predicted})[one.key]


def test_rounding_and_scatter_add_up():
    step = np.deg2rad(0.25)

    def found(samples, share, seed):
        """Of a crank angle that is read in steps, of a crank that turns evenly."""
        true = 0.317 + 2 * np.pi / samples * np.arange(int(12 * samples))
        scatter = share * step * np.random.default_rng(seed).standard_normal(true.size)
        read = step * np.round((true + scatter) / step)
        return noise_of(series("crank_angle", "rad", read, true, resolution=step), true)

    for samples, share in product([250, 250.37], [0.1, 0.6]):
        noise = [found(samples, share, seed) for seed in range(4)]
        expected = step * np.hypot(share, 1 / np.sqrt(12))
        assert np.mean([one.sd[0] for one in noise]) == pytest.approx(expected, rel=0.07)
        if samples == 250:  # each is rounded as in the cycle before
            assert np.mean([one.estimated_sd for one in noise]) == pytest.approx(expected, rel=0.07)


POSITION = 0.05 * np.cos(ANGLE)
STATED_400_DEG = {"stated_noise": np.full(600, np.radians(400.0))}


@pytest.mark.parametrize(
    "channel, unit, value, predicted, stated, message",
    [
        ("crank_angle", "rad", ANGLE + 0.5 * SCATTER, ANGLE, {}, "crank_angle.*`noise`"),
        ("slider_x", "m", POSITION + 0.05 * SCATTER, POSITION, {}, "slider_x.*`noise`"),
        ("crank_angle", "rad", ANGLE, ANGLE, STATED_400_DEG, "crank_angle.*400 deg.*10 deg"),
    ],
)
def test_noise_as_large_as_the_signal_is_refused(channel, unit, value, predicted, stated, message):
    with pytest.raises(InputError, match=f"run run, channel {message}"):
        noise_of(series(channel, unit, value, ANGLE, **stated), predicted)


def test_too_few_samples_and_statistics_without_stated_noise_are_refused():
    with pytest.raises(InputError, match=r"run slow, channel torque.*3 samples.*`noise`"):
        estimates(toy(samples=3, cycles=1, stated=False))
    with pytest.raises(InputError, match=r"(?s)statistics.*noise|noise.*statistics"):
        estimates(changed(toy(), lambda s: replace(s, statistic=True, stated_noise=None)))


# Statistics and numerics


class Disagreeing(Toy):
    """Other numerics predict 0.5 N m more of the torque."""

    def simulate(self, run, values, effects=(), numerics=0):
        read = super().simulate(run, values, effects, numerics)
        return {
            key: value + (0.5 if numerics and key == "torque" else 0.0)
            for key, value in read.items()
        }


def test_numerical_differences_are_added_to_the_noise():
    model = toy()
    noise = estimate_noise(model, residuals(model))
    assert all(np.all(one.numerics == 0.0) for one in numerics_noise(model, {}, noise).values())
    other = Disagreeing(model.series, model.nuisances, model.candidates, model.speeds)
    added = numerics_noise(other, {}, noise)
    assert added["mid", "torque"].numerics == pytest.approx(np.full(360, 0.5))
    assert (added["mid", "guide_force"].numerics == 0.0).all()
    assert added["mid", "torque"].effective_samples == noise["mid", "torque"].effective_samples
    statistics = changed(other, lambda s: replace(s, statistic=True))
    wide = {key: replace(one, sd=np.full(360, 0.4)) for key, one in noise.items()}
    assert numerics_noise(statistics, {}, wide)["mid", "torque"].numerics == pytest.approx(
        np.full(360, 0.3)
    )
    # what settings call negligible adds nothing to the noise of the baseline
    deaf = replace(DEFAULT_SETTINGS, noise=replace(DEFAULT_SETTINGS.noise, negligible_numerics=1e9))
    for settings, most in ((DEFAULT_SETTINGS, 0.5), (deaf, 0.0)):
        parts = recalibrate(other, noise, settings=settings).problem.parts
        assert max(np.max(part.noise.numerics) for part in parts) == pytest.approx(most)


# Whitening


def exact_autocorrelation(a, b):
    """Of a process of order two with these weights, by the Yule-Walker equations."""
    first = a / (1 - b)
    return first, a * first + b


def test_white_noise_is_only_scaled():
    residual = np.array([1.0, -2.0, np.nan, 4.0])
    np.testing.assert_array_equal(
        whiten(residual, Noise(np.full(4, 2.0))), [0.5, -1.0, np.nan, 2.0]
    )
    noise = Noise(np.full(2, 3.0), numerics=np.array([0.0, 4.0]))
    np.testing.assert_allclose(whiten(np.array([3.0, 5.0]), noise), [1.0, 1.0])
    values = np.random.default_rng(2).standard_normal((50, 3))
    noise = Noise(np.full(50, 1.3), (0.4,))
    for column, together in zip(values.T, whiten(values, noise).T, strict=True):
        np.testing.assert_allclose(together, whiten(column, noise))


def test_whitening_is_exact_from_the_first_sample_and_after_gaps():
    """The squared length is that of the inverse covariance, as the likelihood has it."""
    rho = exact_autocorrelation(0.5, 0.2)
    orders = [1.0, *rho, 0.5 * rho[1] + 0.2 * rho[0]]
    values, expected = np.array([0.3, -1.0, 0.2, np.nan, 1.5, 0.1, -0.4]), 0.0
    for piece in (values[:3], values[4:]):
        covariance = np.array(
            [[orders[abs(i - j)] for j in range(piece.size)] for i in range(piece.size)]
        )
        expected += piece @ np.linalg.solve(covariance, piece)
    assert np.nansum(whiten(values, Noise(np.ones(values.size), rho)) ** 2) == pytest.approx(
        expected, rel=1e-12
    )


def test_an_impossible_autocorrelation_is_refused():
    with pytest.raises(ValueError, match="not positive definite"):
        autoregression((0.9, -0.9))
