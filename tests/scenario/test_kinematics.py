"""Motion of the links from clearance vectors: of the real simulation and of waves that are
known."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jointgap.config import Mechanism, Simulate, load_mechanism, read_yaml
from jointgap.core.joints import PINS
from jointgap.dynamics.kinematics import ClearanceMotion, Motion, linkage_motion
from jointgap.dynamics.simulation import simulate
from jointgap.scenario.kinematics import UNITS, clearance_motions, kinematics

MECHANISM = load_mechanism("config/mechanisms/erkaya2009.yaml")
OPTIONS = Simulate(samples_per_revolution=1800, revolutions=1)
SPEED = OPTIONS.speed

# Analytic outputs over the crank angle: value and derivatives one to three by the angle.
WAVES = {"r2": (1e-3, 0.0, 4e-5, 9.0), "r3": (9e-4, 0.0, 6e-5, 7.0)}
LOOSE = ("crank_pin", "piston_pin")
WAVES |= {"gamma2": (0.3, 1.0, 0.5, 5.0), "gamma3": (-0.8, 0.0, 1.5, 2.0)}


def wave(name, angle, order):
    mean, slope, size, rate = WAVES[name]
    return (
        mean + slope * angle + size * np.sin(rate * angle),
        slope + size * rate * np.cos(rate * angle),
        -size * rate**2 * np.sin(rate * angle),
        -size * rate**3 * np.cos(rate * angle),
    )[order]


def fit(name, order=0, error=0.0):
    """A fit of the order-th time derivative, wrong by a constant error."""

    def evaluate(angle):
        return (
            wave(name, angle, order) * SPEED**order + error,
            wave(name, angle, order + 1) * SPEED**order,
        )

    return evaluate


def fits(**errors):
    named = {name: fit(name, 0, errors.get(name, 0.0)) for name in WAVES}
    for order, suffix in ((1, "_dot"), (2, "_ddot")):
        named |= {
            f"gamma{j}{suffix}": fit(f"gamma{j}", order, errors.get(f"gamma{j}{suffix}", 0.0))
            for j in (2, 3)
        }
    return named


@pytest.fixture(scope="module")
def trajectory():
    """A trajectory whose clearances are the waves; what it says of the links it knows from
    differentiated positions."""
    angle = np.linspace(0.0, 2 * np.pi, 1801)
    frame = pd.DataFrame(
        {
            "crank_angle": angle,
            "time": angle / SPEED,
            "crank_speed": SPEED,
            "crank_acceleration": 0.0,
        }
    )
    for name in WAVES:
        for order, suffix in enumerate(("", "_dot", "_ddot")):
            frame[name + suffix] = wave(name, angle, order) * SPEED**order
    motion = linkage_motion(
        MECHANISM, Motion.of(angle, SPEED), ClearanceMotion.from_table(frame, LOOSE)
    )
    parts = ("position", "velocity", "acceleration")
    for part in parts:
        frame[f"rod_{part}_x"] = getattr(motion.rod_x, part)
        frame[f"rod_{part}_y"] = getattr(motion.rod_y, part)
        frame[f"slider_{part}"] = getattr(motion.slider_x, part)
    for column, part in zip(
        ("rod_angle", "rod_angular_velocity", "rod_angular_acceleration"), parts, strict=True
    ):
        frame[column] = getattr(motion.rod_angle, part)
    return frame.assign(transmission_angle=motion.transmission_angle.position)


def error_of(result, source, quantity, region="first_revolution"):
    keys = {"source": source, "quantity": quantity, "region": region}
    rows = result["kinematics_errors"].loc[
        (result["kinematics_errors"][list(keys)] == pd.Series(keys)).all(axis=1)
    ]
    assert len(rows) == 1
    return rows.iloc[0]


def contradiction_of(result, quantity, region="first_revolution"):
    rows = result["kinematics_contradictions"].query("quantity == @quantity and region == @region")
    assert len(rows) == 1
    return rows.iloc[0]


def test_perfect_fits_agree_with_the_simulation_and_with_each_other(trajectory):
    result = kinematics(MECHANISM, OPTIONS, 361, trajectory, {"networks": fits()})
    for quantity in UNITS:
        scale = error_of(result, "ideal", quantity)["range"]
        assert error_of(result, "simulation_exact", quantity)["peak"] <= 1e-12 * scale
        # r' and r'' of the fits come from a quotient of fourth order over 1e-4 rad
        assert error_of(result, "networks_exact", quantity)["peak"] <= 1e-9 * scale
        for form in ("own_rates", "integrated"):
            ours, papers = (
                error_of(result, f"networks_{which}", quantity) for which in (form, "paper_form")
            )
            assert abs(ours["peak"] - papers["peak"]) <= 1e-6 * scale
    assert (result["kinematics_contradictions"]["rms_over_range"] < 1e-6).all()


def test_a_fit_that_contradicts_another_is_found_with_its_size(trajectory):
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
    crank = Motion.of(angle, speed, speed * by_angle)

    def rate(name, angle):
        return wave(name, angle, 1) * speed

    def second(name, angle):
        return wave(name, angle, 2) * speed**2 + wave(name, angle, 1) * speed * by_angle

    given = {
        name: lambda angle, name=name: (wave(name, angle, 0), wave(name, angle, 1))
        for name in WAVES
    }
    given |= {
        f"gamma{joint}_dot": lambda angle, joint=joint: (rate(f"gamma{joint}", angle), None)
        for joint in (2, 3)
    }
    given |= {
        f"gamma{joint}_ddot": lambda angle, joint=joint: (second(f"gamma{joint}", angle), None)
        for joint in (2, 3)
    }
    forms = clearance_motions(given, crank, LOOSE)
    assert forms["exact"].r3.acceleration == pytest.approx(second("r3", angle), abs=1e-9 * SPEED**2)
    for form in ("paper_form", "own_rates"):
        assert forms[form].gamma3.velocity == pytest.approx(rate("gamma3", angle), rel=1e-12)
        assert forms[form].gamma3.acceleration == pytest.approx(
            second("gamma3", angle), abs=1e-7 * SPEED**2
        )
    assert forms["integrated"].gamma2.position == pytest.approx(wave("gamma2", angle, 0), abs=1e-9)
    assert forms["integrated"].gamma2.velocity == pytest.approx(rate("gamma2", angle), rel=1e-7)


def test_errors_count_held_out_samples_only(trajectory):
    result = kinematics(MECHANISM, OPTIONS, 361, trajectory, {})
    assert error_of(result, "ideal", "slider_position")["samples"] == 1800 - 360
    assert error_of(result, "ideal", "slider_position", "past_60_deg")["samples"] == 1500 - 300
    assert result["kinematics_contradictions"].empty


def test_samples_without_a_direction_stay_undefined_and_out_of_the_errors(trajectory):
    start = trajectory.copy()
    hit = [1, 2]  # held-out samples
    start.loc[hit, ["r2", "r2_dot", "r2_ddot"]] = 0.0
    start.loc[hit, ["gamma2", "gamma2_dot", "gamma2_ddot"]] = np.nan
    result = kinematics(MECHANISM, OPTIONS, 361, start, {})
    exact = result["kinematics"].query("source == 'simulation_exact'")
    assert exact["slider_velocity"].isna().sum() == 2 and exact["slider_position"].notna().all()
    assert error_of(result, "simulation_exact", "slider_velocity")["samples"] == 1440 - 2


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
    errors = result["kinematics_errors"].query(
        "source == 'simulation_exact' and region == 'first_revolution'"
    )
    assert len(errors) == 13
    # In flight r can be a few nm with gamma' of 1e5 rad/s, where rounding of the vectors' direction
    # weighs more.
    assert (errors["peak"] <= 1e-12 * errors["range"]).all(), errors[["quantity", "peak", "range"]]


def test_the_paper_form_agrees_in_position_only(result):
    errors = (
        result["kinematics_errors"]
        .query("source == 'simulation_paper_form' and region == 'first_revolution'")
        .set_index("quantity")
    )
    for quantity in (
        "rod_position_x",
        "rod_position_y",
        "rod_angle",
        "slider_position",
        "transmission_angle",
    ):
        assert errors.loc[quantity, "rms_over_range"] < 1e-14
    for quantity in ("slider_velocity", "slider_acceleration", "rod_acceleration_x"):
        assert errors.loc[quantity, "rms_over_range"] > 1e-4
