"""The missing force follows the law of the effect along the motion."""

import numpy as np

from jointgap.campaign.augment import force_difference
from jointgap.core import parquet, schema
from tests.config.mechanisms import effect, mechanism, paper

SPEEDS = {"slow": 20.0, "fast": 60.0}
IDEAL = {"crank_pin": "ideal", "piston_pin": "ideal"}


def missing(after=(), before=(), speeds=SPEEDS, joints=IDEAL):
    return force_difference(
        mechanism(*before, joints=joints), mechanism(*after, joints=joints), speeds
    )


def test_a_force_follows_its_law_along_each_run():
    found = missing([effect("slider_coulomb_friction", force_N=21.0)])
    parquet.to_arrow(schema.MISSING_FORCE, found)
    assert list(found["run"].unique()) == ["slow", "fast"] and {*found["body"]} == {"slider"}
    assert np.allclose(found["force"], -21.0 * np.tanh(found["velocity"] / 0.01))
    assert found["torque"].isna().all()


def test_only_missing_forces_and_torques_are_shown():
    before, after = (effect("slider_viscous_friction", damping_N_s_m=size) for size in (5.0, 8.0))
    found = missing([after], [before])
    assert {*found["body"]} == {"slider"}
    assert np.allclose(found["force"], -3.0 * found["velocity"])
    found = missing([effect("crank_viscous_friction", damping_N_m_s=0.1)])
    assert {*found["body"]} == {"crank"}
    assert np.allclose(found["torque"].astype(float), -0.1 * found["run"].map(SPEEDS))
    assert missing([effect("added_slider_mass", mass_kg=0.1)]).empty


def test_thin_gaps_are_simulated_as_finely_as_the_fits_were():
    thin = {
        "crank_pin": "ideal",
        "piston_pin": {"bearing_radius": paper().joint("piston_pin").journal_radius + 5e-6},
    }
    found = missing(
        [effect("slider_constant_force", force_N=3.0)], speeds={"slow": 5.0}, joints=thin
    )
    assert {*found["body"]} == {"slider"} and np.allclose(found["force"], 3.0)
