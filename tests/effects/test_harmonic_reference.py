"""Cosine and sine parts of a harmonic force refer to the middle of the record."""

import math
from functools import partial

import pytest

from jointgap.effects.slides import _amplitude_and_phase

MIDDLES = {"slow": 2.0, "fast": 0.7}


@pytest.mark.parametrize("run", MIDDLES)
def test_the_stated_phase_is_that_at_time_zero(run):
    stated = partial(_amplitude_and_phase, MIDDLES)
    parts = {"cosine": 3.0, "sine": -4.0, "frequency_Hz": 17.3, "middle_s": MIDDLES[run]}
    law = stated(parts)
    for time in (0.0, 0.3, 5.1):
        turned = 2 * math.pi * 17.3 * (time - MIDDLES[run])
        expected = 3.0 * math.cos(turned) - 4.0 * math.sin(turned)
        angle = 2 * math.pi * law["frequency_Hz"] * time + law["phase_rad"]
        assert law["force_N"] * math.cos(angle) == pytest.approx(expected, abs=1e-9)
    of_runs = stated({f"cosine@{run}": 3.0, f"sine@{run}": -4.0, "frequency_Hz": 17.3})
    assert of_runs == pytest.approx(law)
