"""Motion of blind trials by the package and by Exudyn, and sensor faults."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointgap.config import Mechanism, Simulate
from jointgap.motion.slider_crank import simulate as package_motion
from jointgap.rig.sensors import FAULTS
from tests.independent.cases import friction, mechanism
from tests.motion.cases import effect
from validation import exudyn
from validation.rig import RECIPE, UNLISTED_FAULTS, Hidden, Numerics, Run, read, simulate

ROOT = Path(__file__).parents[2]
SPEED = 40.0
REVOLUTION = np.linspace(0.0, 2 * math.pi / SPEED, 61)


def test_a_run_is_the_simulated_motion_from_its_phase():
    pin = mechanism(("piston_pin",), friction=0.1, memory="fading")
    options = Simulate(speed=SPEED, revolutions=2, samples_per_revolution=60, tolerance=1e-13)
    ours = package_motion(pin, options).samples.iloc[60:]
    seen = simulate(pin, Run(SPEED, 0.0, REVOLUTION, settling=1), Numerics(1e-13))
    names = "slider_position slider_acceleration crank_torque guide_force frame_force_x"
    for name in names.split():
        assert np.abs(seen[name] - ours[name]).max() < 1e-4 * ours[name].std(), name
    for angle, settling in ((0.0, 4), (5.0, 4), (2.0, 6)):
        late = simulate(pin, Run(SPEED, 1.0, REVOLUTION, angle, settling), Numerics())
        assert late["crank_angle"] == pytest.approx(1.0 + SPEED * REVOLUTION, abs=1e-9)


EFFECTS = [
    effect("gravity", acceleration_m_s2=9.8),
    effect("slider_coulomb_friction", force_N=5.0),
    effect("slider_viscous_friction", damping_N_s_m=5.0),
    effect("slider_quadratic_drag", drag_N_s2_m2=1.0),
    effect("slider_constant_force", force_N=7.0),
    effect("slider_spring", stiffness_N_m=200.0, rest_position_m=0.6),
    effect("crank_coulomb_friction", torque_N_m=0.3),
    effect("crank_viscous_friction", damping_N_m_s=0.02),
    effect("added_slider_mass", mass_kg=0.05),
    effect("link_length_error", crank_m=0.002, rod_m=-0.001),
]
LOOSER = effect("piston_pin_clearance", clearance_m=5e-4, restitution=0.7, friction=0.2)
# The slider's dry friction turns over 1 mm/s there, over 10 mm/s here: where pins are loose the
# motion shows it.
CASES = {
    "ideal": ((), EFFECTS, 2e-4),
    "crank pin": (("crank_pin",), [], 1e-4),
    "piston pin": (("piston_pin",), [], 2e-4),
    "both pins": (("crank_pin", "piston_pin"), [], 1e-3),
    "effects and a clearance": (("crank_pin",), [*EFFECTS[:1], *EFFECTS[2:], LOOSER], 2e-3),
    "dry friction": (("crank_pin",), [EFFECTS[1], LOOSER], 5e-3),
}


@pytest.mark.parametrize(("loose", "effects", "bound"), CASES.values(), ids=CASES)
def test_exudyn_gives_the_same_readings_with_every_effect(loose, effects, bound):
    pytest.importorskip("exudyn", reason="needs Exudyn: scripts/set-up peers")
    assert {entry["name"] for entry in EFFECTS} == set(RECIPE["exudyn"])
    given = mechanism(loose, **friction(speed=1e-3)).model_dump() | {"effects": effects}
    made = Mechanism.model_validate(given)
    run = Run(SPEED, 1.0, REVOLUTION, start_angle=2.0, settling=2)
    ours = simulate(made, run, Numerics(1e-11, "ambrosio"))
    model = exudyn.SliderCrank(made, SPEED, run.start_angle)
    for name, values in model.readings(run.times + run.lead).items():
        if name != "crank_angle":
            assert np.sqrt(np.mean((values - ours[name]) ** 2)) < bound * ours[name].std(), name


def test_the_second_models_share_no_code_with_the_dynamics():
    for path, shared in (
        ("validation/exudyn.py", []),
        ("tests/motion/laws.py", ["jointgap.contact.parameters"]),
    ):
        text = (ROOT / path).read_text(encoding="utf-8")
        imported = re.findall(r"^\s*(?:from|import) (\S+)", text, re.M)
        own = ("jointgap.contact", "jointgap.linkage", "jointgap.motion", "validation")
        assert [name for name in imported if name.startswith(own)] == shared


def faulty(name: str, value: float, channel="slider_position", speed=20.0, **more: float):
    """Readings of a slow motion with a fault, and without; `more` parameters of the fault."""
    run = Run(speed, 1.0, np.arange(300) / 300 * 2 * math.pi / speed, settling=1)
    key = FAULTS[name].parameter if name in FAULTS else "size"
    fault = Hidden(name, channel, lambda size: {key: size, **more}, value, value, sensor=channel)
    seen, true = (
        read(mechanism(()), run, Numerics(), effects)[channel] for effects in ([(fault, value)], [])
    )
    return seen, true, run


def test_sensor_faults_change_readings():
    seen, true, _ = faulty("sensor_bias", 2.0)
    assert seen == pytest.approx(true + 2.0)
    seen, true, _ = faulty("sensor_gain", 0.1)
    assert seen == pytest.approx(1.1 * true)
    seen, true, _ = faulty("encoder_offset", 0.2, "crank_angle")
    assert seen == pytest.approx(true + 0.2)
    seen, true, _ = faulty("saturation", 0.3)
    assert np.ptp(seen) == pytest.approx(0.7 * np.ptp(true))
    assert {"saturation"} < set(UNLISTED_FAULTS)
    assert not set(UNLISTED_FAULTS) & set(FAULTS)


def test_delay_and_lag_shift_readings():
    seen, true, _ = faulty("sensor_delay", 2 * math.pi / 20.0 / 150)  # two samples
    assert seen[2:] == pytest.approx(true[:-2], rel=1e-6, abs=1e-6)
    late = 1e-4  # the lag of a signal much slower than it is a delay, to the second order
    seen, true, run = faulty("sensor_lag", late)
    delayed = simulate(mechanism(()), replace(run, times=run.times - late), Numerics())[
        "slider_position"
    ]
    assert np.abs(seen - delayed).max() < 0.02 * np.abs(seen - true).max()


def test_encoder_faults_follow_the_angle_and_the_torque():
    angle, run = faulty("encoder_offset", 0.0, "crank_angle")[1:]
    torque = simulate(mechanism(()), run, Numerics())["crank_torque"]
    assert torque.min() < 0.0 < torque.max()
    seen, *_ = faulty("encoder_windup", 50.0, "crank_angle")
    assert seen - angle == pytest.approx(torque / 50.0, abs=1e-12)
    seen, *_ = faulty("encoder_backlash", 0.02, "crank_angle")
    assert seen[torque > 0.0] - angle[torque > 0.0] == pytest.approx(0.01)
    assert seen[torque < 0.0] - angle[torque < 0.0] == pytest.approx(-0.01)
    seen, *_ = faulty("encoder_eccentricity", 0.03, "crank_angle", phase_rad=2.0)
    error = seen - angle
    assert error.max() == pytest.approx(0.03, rel=1e-3)
    assert np.cos(angle[np.argmax(error)] - 2.0) == pytest.approx(1.0, abs=1e-3)


def test_the_angle_of_an_eccentric_encoder_can_drive_a_simulation():
    run = Run(20.0, 1.0, np.linspace(0.0, 0.9, 301), settling=3)
    true = simulate(mechanism(()), run, Numerics())["crank_angle"]
    seen = simulate(mechanism(()), run.as_read(0.03, 2.0), Numerics())["crank_angle"]
    assert seen == pytest.approx(true + 0.03 * np.cos(true - 2.0), abs=1e-7)


@pytest.mark.parametrize("corner", [0.4, 5.0])
def test_a_high_pass_obeys_its_differential_equation(corner):
    """dy/dt + 2 pi corner y = du/dt, without a mean."""
    seen, true, run = faulty("sensor_high_pass", corner)
    rate = np.gradient(true - seen, run.times, edge_order=2)
    expected = 2 * math.pi * corner * seen
    assert np.abs(rate - expected)[2:-2].max() < 1e-3 * np.abs(expected).max()
    assert abs(seen.mean()) < 1e-6 * np.ptp(true)
