"""The speed of a crank without encoder, from the period of the channels."""

import numpy as np
import pytest

from jointgap.rig.sampling import speed_from_periodicity

ELAPSED = np.linspace(0.0, 6.0, 1500)


def read(speed, seed, spikes=0.0):
    generator = np.random.default_rng(seed)
    angle = speed * ELAPSED + 0.7
    course = np.cos(angle) + 0.3 * np.cos(2 * angle + 1.0)
    return course + 0.05 * generator.standard_normal(1500) + spikes * generator.standard_t(2, 1500)


@pytest.mark.parametrize("true", [29.92, 30.0, 30.07])
def test_the_speed_at_which_channels_repeat_is_found(true):
    values = [read(true, 1), read(true, 2, spikes=0.2)]
    # 0.04 rad over the record; spikes without a variance cause no more
    assert speed_from_periodicity(ELAPSED, values, 29.9, 30.1) == pytest.approx(true, abs=6e-3)


def test_gaps_do_not_matter_and_the_speed_stays_within_its_bounds():
    value = read(30.05, 3)
    value[400:700] = np.nan
    assert speed_from_periodicity(ELAPSED, [value], 29.9, 30.1) == pytest.approx(30.05, abs=2e-3)
    assert speed_from_periodicity(ELAPSED, [read(31.0, 4)], 29.9, 30.1) <= 30.1
