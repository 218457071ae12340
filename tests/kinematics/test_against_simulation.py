"""The equations, fed by the clearance vectors of the real simulation, must say what the simulation says of the
links.
"""

from pathlib import Path

import pytest

from jointgap.config import Mechanism, Simulate, read_yaml
from jointgap.core.joints import PINS
from jointgap.dynamics.simulation import simulate
from jointgap.scenario.kinematics import kinematics

ALL = ("crank_pivot", *PINS)
MOTOR = {"kind": "motor", "stall_torque": 60.0, "no_load_speed": "700 rpm", "inertia": 0.02}
CASES = {
    "friction": (PINS, 0.2, 0.0, {}),
    "all three, offset": (ALL, 0.05, -0.02, {"start_angle": 1.0}),
    "motor": (PINS, 0.05, 0.0, {"drive": MOTOR}),
}


def mechanism_with(loose, friction, offset):
    data = read_yaml(Path("config/mechanisms/erkaya2009.yaml"))
    data["contacts"]["steel"]["friction"] = friction
    data["slider"]["offset"] = offset
    data["joints"] = {
        name: {
            "journal": body,
            "journal_radius": 0.007,
            "bearing_radius": 0.008,
            "contact": "steel",
            "loose": name in loose,
        }
        for name, body in zip(ALL, ("frame", "crank", "slider"), strict=True)
    }
    return Mechanism.model_validate(data)


@pytest.fixture(scope="module", params=list(CASES))
def result(request):
    loose, friction, offset, more = CASES[request.param]
    mechanism, options = mechanism_with(loose, friction, offset), Simulate(revolutions=1, **more)
    return kinematics(mechanism, options, 361, simulate(mechanism, options).samples, {})


def test_the_exact_form_agrees_with_the_simulation_to_rounding(result):
    errors = result["kinematics_errors"].query("source == 'simulation_exact' and region == 'first_revolution'")
    assert len(errors) == 13
    # In flight r can be a few nm with gamma' of 1e5 rad/s, where rounding of the vectors' direction weighs more.
    assert (errors["peak"] <= 1e-12 * errors["range"]).all(), errors[["quantity", "peak", "range"]]


def test_the_paper_form_agrees_in_position_only(result):
    errors = (
        result["kinematics_errors"]
        .query("source == 'simulation_paper_form' and region == 'first_revolution'")
        .set_index("quantity")
    )
    for quantity in ("rod_position_x", "rod_position_y", "rod_angle", "slider_position", "transmission_angle"):
        assert errors.loc[quantity, "rms_over_range"] < 1e-14
    for quantity in ("slider_velocity", "slider_acceleration", "rod_acceleration_x"):
        assert errors.loc[quantity, "rms_over_range"] > 1e-4
