"""Motion of the links from clearance vectors: simulated ones and analytic waves."""

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Mechanism, Simulate, load_mechanism, read_yaml
from jointgap.core.joints import PINS
from jointgap.motion.kinematics import ClearanceMotion, Motion, linkage_motion
from jointgap.motion.slider_crank import simulate
from jointgap.scenario.kinematics import UNITS, clearance_motions, kinematics

MECHANISM = load_mechanism("config/mechanisms/erkaya2009.yaml")
OPTIONS = Simulate(samples_per_revolution=1800, revolutions=1)
SPEED = OPTIONS.speed
WAVES = {  # mean, slope, amplitude and rate over the crank angle
    "r2": (1e-3, 0.0, 4e-5, 9.0),
    "r3": (9e-4, 0.0, 6e-5, 7.0),
    "gamma2": (0.3, 1.0, 0.5, 5.0),
    "gamma3": (-0.8, 0.0, 1.5, 2.0),
}
ORDERS = {"": 0, "_dot": 1, "_ddot": 2}


def wave(name, angle, order):
    """A wave or its derivatives by the crank angle."""
    mean, slope, size, rate = WAVES[name]
    return (
        mean + slope * angle + size * np.sin(rate * angle),
        slope + size * rate * np.cos(rate * angle),
        -size * rate**2 * np.sin(rate * angle),
        -size * rate**3 * np.cos(rate * angle),
    )[order]


def fits(**errors):
    """Exact fits at constant speed, except constant errors by output."""

    def fit(name, ending):
        order, error = ORDERS[ending], errors.get(name + ending, 0.0)
        return lambda angle: (
            wave(name, angle, order) * SPEED**order + error,
            wave(name, angle, order + 1) * SPEED**order,
        )

    outputs = [(name, "") for name in WAVES]
    outputs += [(name, ending) for name in ("gamma2", "gamma3") for ending in ("_dot", "_ddot")]
    return {name + ending: fit(name, ending) for name, ending in outputs}


@pytest.fixture(scope="module")
def trajectory():
    """A trajectory with the waves as clearances."""
    angle = np.linspace(0.0, 2 * np.pi, 1801)
    frame = pd.DataFrame({"crank_angle": angle, "time": angle / SPEED})
    frame = frame.assign(crank_speed=SPEED, crank_acceleration=0.0)
    for name in WAVES:
        for ending, order in ORDERS.items():
            frame[name + ending] = wave(name, angle, order) * SPEED**order
    clearances = ClearanceMotion.from_table(frame, PINS)
    motion = linkage_motion(MECHANISM, Motion.of(angle, SPEED), clearances)
    turn = ("rod_angle", "rod_angular_velocity", "rod_angular_acceleration")
    for part, rod_angle in zip(("position", "velocity", "acceleration"), turn, strict=True):
        frame[f"rod_{part}_x"] = getattr(motion.rod_x, part)
        frame[f"rod_{part}_y"] = getattr(motion.rod_y, part)
        frame[f"slider_{part}"] = getattr(motion.slider_x, part)
        frame[rod_angle] = getattr(motion.rod_angle, part)
    return frame.assign(transmission_angle=motion.transmission_angle.position)


def error_of(result, source, quantity, region="first_revolution"):
    errors = result["kinematics_errors"].set_index(["source", "quantity", "region"])
    return errors.loc[(source, quantity, region)]


def contradiction_of(result, quantity):
    differences = result["kinematics_contradictions"].set_index(["quantity", "region"])
    return differences.loc[(quantity, "first_revolution")]


def test_perfect_fits_agree_with_the_simulation_and_with_each_other(trajectory):
    result = kinematics(MECHANISM, OPTIONS, 361, trajectory, {"networks": fits()})
    for quantity in UNITS:
        scale = error_of(result, "ideal", quantity)["range"]
        assert error_of(result, "simulation_exact", quantity)["peak"] <= 1e-12 * scale
        # r' and r'' of the fits come from a quotient of fourth order over 1e-4 rad
        assert error_of(result, "networks_exact", quantity)["peak"] <= 1e-9 * scale
        papers = error_of(result, "networks_paper_form", quantity)["peak"]
        for form in ("own_rates", "integrated"):
            ours = error_of(result, f"networks_{form}", quantity)["peak"]
            assert abs(ours - papers) <= 1e-6 * scale
    assert (result["kinematics_contradictions"]["rms_over_range"] < 1e-6).all()


def test_a_fit_that_contradicts_another_has_the_size_of_its_error(trajectory):
    errors = {"gamma2_dot": 2.0, "gamma3_ddot": 30.0}
    result = kinematics(MECHANISM, OPTIONS, 361, trajectory, {"networks": fits(**errors)})
    assert contradiction_of(result, "gamma2_dot")["rms"] == pytest.approx(2.0, rel=1e-9)
    assert contradiction_of(result, "gamma3_ddot")["peak"] == pytest.approx(30.0, rel=1e-4)
    assert contradiction_of(result, "gamma3_dot")["rms"] < 1e-9
    drift = 2.0 * 0.1 * (1799 / 1800)  # over a revolution of 0.1 s, up to the last held-out sample
    assert contradiction_of(result, "gamma2")["peak"] == pytest.approx(drift, rel=1e-9)
    assert contradiction_of(result, "slider_position")["peak"] > 1e-5
    assert contradiction_of(result, "slider_acceleration")["peak"] > 1e-2


def test_a_speed_that_changes_enters_every_derivative_and_every_integral():
    angle = np.linspace(0.0, 2 * np.pi, 3601)
    speed, by_angle = SPEED * (1.0 + 0.2 * np.cos(angle)), -0.2 * SPEED * np.sin(angle)
    rate = {name: wave(name, angle, 1) * speed for name in WAVES}
    acceleration = {
        name: wave(name, angle, 2) * speed**2 + wave(name, angle, 1) * speed * by_angle
        for name in WAVES
    }
    functions = {name: lambda x, name=name: (wave(name, x, 0), wave(name, x, 1)) for name in WAVES}
    for name in ("gamma2", "gamma3"):
        functions[f"{name}_dot"] = lambda x, name=name: (rate[name], None)
        functions[f"{name}_ddot"] = lambda x, name=name: (acceleration[name], None)
    forms = clearance_motions(functions, Motion.of(angle, speed, speed * by_angle), PINS)
    length = forms["exact"].r3.acceleration
    assert length == pytest.approx(acceleration["r3"], abs=1e-9 * SPEED**2)
    for form in ("paper_form", "own_rates"):
        gamma = forms[form].gamma3
        assert gamma.velocity == pytest.approx(rate["gamma3"], rel=1e-12)
        assert gamma.acceleration == pytest.approx(acceleration["gamma3"], abs=1e-7 * SPEED**2)
    gamma = forms["integrated"].gamma2
    assert gamma.position == pytest.approx(wave("gamma2", angle, 0), abs=1e-9)
    assert gamma.velocity == pytest.approx(rate["gamma2"], rel=1e-7)


def test_errors_count_held_out_and_defined_samples_only(trajectory):
    result = kinematics(MECHANISM, OPTIONS, 361, trajectory, {})
    assert error_of(result, "ideal", "slider_position")["samples"] == 1800 - 360
    assert error_of(result, "ideal", "slider_position", "past_60_deg")["samples"] == 1500 - 300
    assert result["kinematics_contradictions"].empty
    coincident = trajectory.copy()  # centres in two held-out samples: no direction
    coincident.loc[[1, 2], ["r2", "r2_dot", "r2_ddot"]] = 0.0
    coincident.loc[[1, 2], ["gamma2", "gamma2_dot", "gamma2_ddot"]] = np.nan
    result = kinematics(MECHANISM, OPTIONS, 361, coincident, {})
    exact = result["kinematics"].query("source == 'simulation_exact'")
    assert exact["slider_velocity"].isna().sum() == 2 and exact["slider_position"].notna().all()
    assert error_of(result, "simulation_exact", "slider_velocity")["samples"] == 1440 - 2


JOINTS = ("crank_pivot", *PINS)
MOTOR = {"kind": "motor", "stall_torque": 60.0, "no_load_speed": "700 rpm", "inertia": 0.02}
CASES = {
    "friction": (PINS, 0.2, 0.0, {}),
    "all three, offset": (JOINTS, 0.05, -0.02, {"start_angle": 1.0}),
    "motor": (PINS, 0.05, 0.0, {"drive": MOTOR}),
}


@pytest.fixture(scope="module", params=list(CASES))
def errors(request):
    """Errors of a simulated motion over the first revolution."""
    loose, friction, offset, options = CASES[request.param]
    content = read_yaml("config/mechanisms/erkaya2009.yaml")
    content["contacts"]["steel"]["friction"] = friction
    content["slider"]["offset"] = offset
    for name, body in zip(JOINTS, ("frame", "crank", "slider"), strict=True):
        radii = {"journal_radius": 0.007, "bearing_radius": 0.008, "contact": "steel"}
        content["joints"][name] = {"journal": body, "loose": name in loose} | radii
    mechanism, options = Mechanism.model_validate(content), Simulate(revolutions=1, **options)
    result = kinematics(mechanism, options, 361, simulate(mechanism, options).samples, {})
    return result["kinematics_errors"].query("region == 'first_revolution'")


def test_the_exact_form_agrees_with_the_simulation_to_rounding(errors):
    errors = errors.query("source == 'simulation_exact'")
    assert len(errors) == 13
    # In flight r can be a few nm with gamma' of 1e5 rad/s, where rounding of the vectors' direction
    # weighs more.
    assert (errors["peak"] <= 1e-12 * errors["range"]).all(), errors[["quantity", "peak", "range"]]


def test_the_paper_form_agrees_in_position_only(errors):
    error = errors.query("source == 'simulation_paper_form'").set_index("quantity")[
        "rms_over_range"
    ]
    positions = ["rod_position_x", "rod_position_y", "rod_angle", "slider_position"]
    assert (error[[*positions, "transmission_angle"]] < 1e-14).all()
    assert (error[["slider_velocity", "slider_acceleration", "rod_acceleration_x"]] > 1e-4).all()
