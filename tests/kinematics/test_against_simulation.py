"""The equations, fed by the clearance vectors of the real simulation, must say what the simulation says of the links."""

import numpy as np
import pytest

from jointgap.config import Simulate, load_mechanism
from jointgap.dynamics import simulate
from jointgap.kinematics import kinematics
from jointgap.tables import KINEMATICS, KINEMATICS_ERRORS, to_arrow

OPTIONS = Simulate(revolutions=1)


def mechanism_with(friction, offset):
    mechanism = load_mechanism("config/mechanisms/erkaya2009.yaml")
    contact = mechanism.joint("crank_pin").contact.model_copy(update={"friction": friction})
    pins = {name: mechanism.joint(name).model_copy(update={"contact": contact}) for name in ("crank_pin", "piston_pin")}
    parts = {
        "joints": mechanism.joints.model_copy(update=pins),
        "slider": mechanism.slider.model_copy(update={"offset": offset}),
    }
    return mechanism.model_copy(update=parts)


@pytest.fixture(scope="module", params=[(0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.05, 0.03, 2.0)], ids=str)
def result(request):
    friction, offset, start = request.param
    mechanism = mechanism_with(friction, offset)
    options = OPTIONS.model_copy(update={"start_angle": start})
    return kinematics(mechanism, options, 361, simulate(mechanism, options).samples, {})


def test_the_exact_form_agrees_with_the_simulation_to_rounding(result):
    errors = result.errors.query("source == 'simulation_exact' and region == 'first_revolution'")
    assert len(errors) == 13
    # In flight r can be a few nm with gamma' of 1e5 rad/s, where rounding of the vectors' direction weighs more.
    assert (errors["peak"] <= 1e-12 * errors["range"]).all(), errors[["quantity", "peak", "range"]]


def test_the_paper_form_agrees_in_position_only(result):
    errors = result.errors.query("source == 'simulation_paper_form' and region == 'first_revolution'").set_index(
        "quantity"
    )
    for quantity in ("rod_position_x", "rod_position_y", "rod_angle", "slider_position", "transmission_angle"):
        assert errors.loc[quantity, "rms_over_range"] < 1e-14
    for quantity in ("slider_velocity", "slider_acceleration", "rod_acceleration_x"):
        assert errors.loc[quantity, "rms_over_range"] > 1e-3


def test_only_the_start_is_undefined_and_the_tables_take_it(result):
    undefined = result.motion[result.motion.isna().any(axis=1)]
    assert set(undefined["source"]) <= {"simulation_exact", "simulation_paper_form"}
    first = result.motion["crank_angle"].min()
    assert np.array_equal(undefined["crank_angle"], np.full(2, first))
    assert to_arrow(KINEMATICS, result.motion).num_rows == len(result.motion)
    assert to_arrow(KINEMATICS_ERRORS, result.errors).num_rows == len(result.errors)
