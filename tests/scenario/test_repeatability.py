"""Growth of a perturbation of the start."""

import math

import numpy as np
import pytest

from jointgap.core.errors import InputError
from jointgap.scenario import repeatability
from jointgap.scenario.repeatability import perturbation_growth, samples_repeat_until
from tests.motion.cases import mechanism, options

COARSE = options(revolutions=3, samples_per_revolution=180)


def test_a_perturbation_decays_with_friction_and_grows_in_proportion_to_its_size_without():
    _, with_friction = perturbation_growth(mechanism(friction=0.2), COARSE)
    np.testing.assert_allclose(with_friction[:, 0], 1.0, rtol=1e-12)
    assert np.median(with_friction, axis=0)[-180:].max() < 1
    assert math.isinf(samples_repeat_until(mechanism(friction=0.2), COARSE))
    _, small = perturbation_growth(mechanism(), COARSE)
    _, large = perturbation_growth(mechanism(), COARSE, 1e-10)
    assert np.median(small, axis=0)[-180:].min() > 100
    np.testing.assert_allclose(small[:, :45], large[:, :45], rtol=0.02)
    with pytest.raises(InputError, match="all joints are ideal"):
        perturbation_growth(mechanism(loose=()), COARSE)


def test_samples_repeat_until_the_perturbation_reaches_a_thousandth_of_the_clearance(monkeypatch):
    loose = mechanism()
    limit = 1e-3 * loose.clearance("crank_pin") / repeatability.PERTURBATION
    angle = np.linspace(0.5, 9.0, 1001)
    growth = np.exp(2.0 * (angle - 0.5))
    monkeypatch.setattr(
        repeatability, "perturbation_growth", lambda *_, **__: (angle, np.array([growth]))
    )
    assert samples_repeat_until(loose, COARSE) == pytest.approx(math.log(limit) / 2.0, abs=0.01)
