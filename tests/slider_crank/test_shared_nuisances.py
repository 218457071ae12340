"""Friction of both pins beyond the range that a campaign states is found, named and told with its value."""

from dataclasses import replace

import numpy as np
import pytest

from jointgap.core.joints import PINS
from jointgap.identification.baseline import recalibrate
from jointgap.identification.evidence import row_of
from jointgap.identification.fit import Fit
from jointgap.identification.hypothesis_fits import fit_pairs, fit_singles
from jointgap.identification.model_selection import refit_and_decide
from jointgap.identification.problem import Noise
from jointgap.identification.thresholds import screen_candidates
from jointgap.rig.model import build_model
from jointgap.rig.recording import Measurements
from tests.rows import each
from tests.slider_crank.rigs import campaign, chosen, mechanism, read, recorded

CHANNELS = ("time", "crank_angle", "crank_torque", "slider_acceleration")
RANGES = {"joint_friction": [0.05, 0.15], "restitution": [0.3, 0.9]}


@pytest.mark.integration
def test_friction_of_both_pins_beyond_its_range_is_one_effect():
    value, label = 0.21, "common_pin_friction"
    own = campaign(mechanism(PINS), CHANNELS, nuisance=RANGES)
    recordings, random, noises = recorded(own).runs, np.random.default_rng(8), {}
    model = build_model(own, Measurements(recordings))
    for run, recording in recordings.items():
        channels = {name: read(model, run=run, joint_friction=value)[name] for name in CHANNELS[2:]}
        for name, true in channels.items():
            sd = 0.005 * float(np.std(true))
            noises[run, name] = Noise(np.full(true.size, sd))
            channels[name] = true + sd * random.standard_normal(true.size)
        recordings[run] = replace(recording, channels=channels)
    model = build_model(own, Measurements(recordings))
    for series in model.series:
        noises.setdefault(series.key, Noise(np.full(series.value.size, 1e-3)))
    kept = ("common_pin_restitution", "common_pin_friction", "pin_friction")
    model.candidates = tuple(one for one in model.candidates if one.name in kept)
    base = recalibrate(model, noises)
    sensitivities, limits = screen_candidates(base, 0.01)
    singles = fit_singles(base, sensitivities, limits)[0]
    fits = [*singles, *fit_pairs(base, sensitivities, limits, singles)[0]]
    decision = refit_and_decide(base, sensitivities, fits, limits)
    assert (decision.verdict, decision.chosen.label) == ("named", label)
    found = decision.chosen.hypothesis[0].parameters({"change": decision.chosen.mapping[f"{label}.change"]})
    assert found["coefficient"] == pytest.approx(value, abs=0.02)


@each("label", ["common_pin_friction", "common_pin_restitution"])
def test_that_nothing_is_left_of_what_both_pins_share_is_a_size_like_others(label):
    """Frictionless pins are named as those of one pin are; only the upper bound says that something else is meant."""
    candidate = chosen(build_model(campaign(mechanism(PINS, friction=0.1), nuisance=RANGES)), label)
    (change,) = candidate.coordinates
    ranges = {"joint_friction": (0.1, 0.05, 0.15), "restitution": (0.46, 0.3, 0.9)}
    drawn = []
    for end in (change.low, change.high):
        parameters = (replace(change, name=f"{label}.change"),)
        fit = Fit((candidate,), parameters, np.array([end]), np.zeros(100), np.ones((100, 1)), 1, "converged")
        drawn.append("at the bound" in row_of(fit, ranges).objection)
    assert drawn == [False, True]
