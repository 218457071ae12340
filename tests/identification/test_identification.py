"""The identification as one object, from data to verdict."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.identification import identification
from jointgap.identification.fit import effect_estimates
from jointgap.identification.identification import Identification
from jointgap.identification.noise import noise_of_model
from jointgap.identification.search import STEPS, SingleEffects
from tests.identification.toy import candidate_of, toy

FRICTION = {"coulomb": {"force_N": 0.3}}


def interval(identified, label, key):
    """The 90 % interval of a parameter of the named effect."""
    return effect_estimates(identified.decision.chosen, candidate_of(label))[key]["interval_90"]


def test_an_effect_is_named_and_confirmed_on_held_out_data():
    identified = Identification(toy(FRICTION, stated=False, seed=2)).fit()
    decision = identified.decision
    assert (decision.verdict, decision.chosen.label) == ("named", "coulomb")
    assert identified.prediction.test.outcome == "falls"
    low, high = interval(identified, "coulomb", "force_N")
    assert low < 0.3 < high


def test_steps_that_are_left_out_are_not_searched():
    two = FRICTION | {"spring": {"stiffness_N_m": 5.0}}
    singles = tuple(step for step in STEPS if isinstance(step, SingleEffects))
    for steps, size in ((STEPS, 2), (singles, 1), ((), 0)):
        search = Identification(toy(two, seed=3), steps=steps).fit().search
        assert max(len(labels) for labels in search.fits) == size


@pytest.mark.parametrize("stated", [False, True])
def test_noise_that_is_not_stated_is_estimated_again_from_the_residual(monkeypatch, stated):
    """The first estimate is five times too large, as by impacts that come at other phases."""

    def too_large(*given):
        return {
            key: replace(noise, sd=5.0 * noise.sd) for key, noise in noise_of_model(*given).items()
        }

    model = toy(FRICTION, stated=stated, seed=2)
    known = Identification(model).fit()
    monkeypatch.setattr(identification, "noise_of_model", too_large)
    identified = Identification(model).fit()
    assert identified.decision.chosen.label == "coulomb"
    ratios = [
        np.mean(noise.sd) / np.mean(known.noise[key].sd) for key, noise in identified.noise.items()
    ]
    assert ratios == pytest.approx([5.0 if stated else 1.0] * len(ratios), rel=0.1)
    widths = [np.ptp(interval(each, "coulomb", "force_N")) for each in (identified, known)]
    assert widths[0] / widths[1] == pytest.approx(5.0 if stated else 1.0, rel=0.1)
