"""The missing force is what the law of the effect says along the motion."""

import numpy as np
import pytest

from jointgap.campaign.augment import missing_force
from jointgap.config import Mechanism, load_mechanism
from jointgap.core import parquet, schema

SPEEDS = {"slow": 20.0, "fast": 60.0}


@pytest.fixture(scope="module")
def base():
    data = load_mechanism("config/mechanisms/erkaya2009.yaml").model_dump()
    return Mechanism.model_validate(data | {"joints": {"crank_pin": "ideal", "piston_pin": "ideal"}})


def with_effect(base, name, **parameters):
    return Mechanism.model_validate(base.model_dump() | {"effects": [{"name": name, "parameters": parameters}]})


def test_a_force_follows_its_law_along_each_run(base):
    found = missing_force(base, with_effect(base, "slider_coulomb_friction", force_N=21.0), SPEEDS)
    parquet.to_arrow(schema.MISSING_FORCE, found)
    assert list(found["run"].unique()) == ["slow", "fast"]
    assert np.allclose(found["slider_force"], -21.0 * np.tanh(found["slider_velocity"] / 0.01))
    assert (found["crank_torque"] == 0.0).all()


def test_a_force_that_the_base_has_already_is_not_missing(base):
    before = with_effect(base, "slider_viscous_friction", damping_N_s_m=5.0)
    after = with_effect(base, "slider_viscous_friction", damping_N_s_m=8.0)
    found = missing_force(before, after, SPEEDS)
    assert np.allclose(found["slider_force"], -3.0 * found["slider_velocity"])


def test_a_torque_on_the_crank_stands_beside(base):
    found = missing_force(base, with_effect(base, "crank_viscous_friction", damping_N_m_s=0.1), SPEEDS)
    speed = found["run"].map(SPEEDS)
    assert np.allclose(found["crank_torque"], -0.1 * speed)


def test_an_effect_that_is_no_force_leaves_both_at_zero(base):
    found = missing_force(base, with_effect(base, "added_slider_mass", mass_kg=0.1), SPEEDS)
    assert not found[["slider_force", "crank_torque"]].to_numpy().any()


def test_thin_gaps_are_simulated_as_finely_as_the_fits_were():
    data = load_mechanism("config/mechanisms/erkaya2009.yaml").model_dump()
    pin = data["joints"]["piston_pin"]
    pin |= {"bearing_radius": pin["journal_radius"] + 5e-6}
    thin = Mechanism.model_validate(data | {"joints": {"crank_pin": "ideal", "piston_pin": pin}})
    found = missing_force(thin, with_effect(thin, "slider_constant_force", force_N=3.0), {"slow": 5.0})
    assert np.allclose(found["slider_force"], 3.0)
