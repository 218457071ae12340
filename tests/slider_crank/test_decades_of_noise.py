"""However good the sensors of a slider-crank are, its fits end at the truth."""

from dataclasses import replace

import numpy as np

from jointgap.identification.baseline import probed_differences
from jointgap.identification.confirmation import fit_run_parameters
from jointgap.identification.fit import CONVERGED, fit_hypothesis
from jointgap.identification.problem import Noise, Problem
from jointgap.rig.model import build_model
from jointgap.rig.recording import Measurements
from tests.rows import each
from tests.slider_crank.rigs import campaign, chosen, mechanism, recorded

CHANNELS = ("time", "slider_acceleration", "crank_torque", "guide_force")
TRUTH = {"slider_mass": 0.4623, "crank_length": 0.1503}  # kg, m; nominal 0.4482 and 0.15
SPEEDS = {"slow": 30.04, "fast": 44.93}  # rad/s; nominal 30 and 45
FRICTION = 7.0  # N


def measured(noise):
    """A model of a short campaign with ideal joints, the friction in it, and the noise: a share of each channel."""
    nuisance = {"slider_mass": "10%", "crank_length": "1%", "speed": "0.5%"}
    own = campaign(mechanism(), CHANNELS, nuisance=nuisance, run={"first_angle": 0.0})
    recordings = recorded(own, dropped=0, per_turn=45).runs
    model, random, noises = build_model(own, Measurements(recordings)), np.random.default_rng(3), {}
    friction = chosen(model, "slider_coulomb_friction")
    acting = [(friction, {"force_N": FRICTION})]
    for run, recording in recordings.items():
        read = model.simulate(run, model.nominal(run) | TRUTH | {"speed": SPEEDS[run]}, acting)
        for channel, value in read.items():
            sd = noise * float(np.std(value))
            noises[run, channel] = Noise(np.full(value.size, sd))
            read[channel] = value + sd * random.standard_normal(value.size)
        recordings[run] = replace(recording, channels=read)
    return build_model(own, Measurements(recordings)), (friction,), noises


@each("decade", (2, 5, 8))
def test_fits_of_runs_for_fitting_and_of_those_held_out_end_at_the_truth(decade):
    model, hypothesis, noises = measured(10.0**-decade)
    here = Problem(model, noises)
    differences = probed_differences(here, {p.key: p.nominal for p in here.nuisances})
    found = fit_hypothesis(here, hypothesis, differences=differences, refresh=True)
    assert found.status == CONVERGED
    assert found.chi2 < 1.3 * here.size
    truth = TRUTH | {"speed@slow": SPEEDS["slow"], "slider_coulomb_friction.force_N": FRICTION}
    errors = dict(zip((p.key for p in found.parameters), np.sqrt(np.diag(found.covariance())), strict=True))
    assert {key for key, value in truth.items() if abs(found.mapping[key] - value) > 4 * errors[key]} == set()

    held = Problem(model, noises, held_out=True)
    values = fit_run_parameters(held, found)
    left = held.residual(values, hypothesis)
    assert left @ left < 1.3 * held.size
