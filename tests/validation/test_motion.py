"""Motion of blind trials by the package and by Exudyn, and sensor faults."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointgap.config import Mechanism, Simulate
from jointgap.dynamics.simulation import simulate as package_motion
from jointgap.rig.sensors import FAULTS
from tests.independent.cases import friction, mechanism
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
    for name in (
        "slider_position",
        "slider_acceleration",
        "crank_torque",
        "guide_force",
        "frame_force_x",
    ):
        assert np.abs(seen[name] - ours[name]).max() < 1e-4 * ours[name].std(), name
    for angle, settling in ((0.0, 4), (5.0, 4), (2.0, 6)):
        late = simulate(pin, Run(SPEED, 1.0, REVOLUTION, angle, settling), Numerics())
        assert late["crank_angle"] == pytest.approx(1.0 + SPEED * REVOLUTION, abs=1e-9)


EFFECTS = [
    {"name": "gravity", "parameters": {"acceleration_m_s2": 9.8}},
    {"name": "slider_coulomb_friction", "parameters": {"force_N": 5.0}},
    {"name": "slider_viscous_friction", "parameters": {"damping_N_s_m": 5.0}},
    {"name": "slider_quadratic_drag", "parameters": {"drag_N_s2_m2": 1.0}},
    {"name": "slider_constant_force", "parameters": {"force_N": 7.0}},
    {"name": "slider_spring", "parameters": {"stiffness_N_m": 200.0, "rest_position_m": 0.6}},
    {"name": "crank_coulomb_friction", "parameters": {"torque_N_m": 0.3}},
    {"name": "crank_viscous_friction", "parameters": {"damping_N_m_s": 0.02}},
    {"name": "added_slider_mass", "parameters": {"mass_kg": 0.05}},
    {"name": "link_length_error", "parameters": {"crank_m": 0.002, "rod_m": -0.001}},
]
LOOSER = {
    "name": "piston_pin_clearance",
    "parameters": {"clearance_m": 5e-4, "restitution": 0.7, "friction": 0.2},
}


# The slider's dry friction turns over 1 mm/s there, over 10 mm/s here: where pins are loose the
# motion shows it.
@pytest.mark.parametrize(
    ("loose", "effects", "bound"),
    [
        ((), EFFECTS, 2e-4),
        (("crank_pin",), [], 1e-4),
        (("piston_pin",), [], 2e-4),
        (("crank_pin", "piston_pin"), [], 1e-3),
        (("crank_pin",), [*EFFECTS[:1], *EFFECTS[2:], LOOSER], 2e-3),
        (("crank_pin",), [EFFECTS[1], LOOSER], 5e-3),
    ],
    ids=[
        "ideal",
        "crank pin",
        "piston pin",
        "both pins",
        "effects and a clearance",
        "dry friction",
    ],
)
def test_exudyn_gives_the_same_readings_with_every_effect(loose, effects, bound):
    pytest.importorskip("exudyn", reason="needs Exudyn: scripts/set-up peers")
    assert {effect["name"] for effect in EFFECTS} == set(RECIPE["exudyn"])
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
        ("tests/dynamics/laws.py", ["jointgap.dynamics.parameters"]),
    ):
        imported = re.findall(
            r"^\s*(?:from|import) (\S+)", (ROOT / path).read_text(encoding="utf-8"), re.M
        )
        assert [
            name for name in imported if name.startswith(("jointgap.dynamics", "validation"))
        ] == shared


def faulty(name: str, value: float, channel="slider_position", speed=20.0):
    """Readings of a slow motion with a fault, and without."""
    run = Run(speed, 1.0, np.linspace(0.0, 0.3, 301), settling=1)
    effect = Hidden(name, channel, lambda size: {"value": size}, value, value, sensor=channel)
    seen, true = (
        read(mechanism(()), run, Numerics(), effects)[channel]
        for effects in ([(effect, value)], [])
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
    seen, true, _ = faulty("sensor_delay", 2e-3)
    assert seen[2:] == pytest.approx(true[:-2], rel=1e-6, abs=1e-6)
    late = 1e-4  # the lag of a signal much slower than it is a delay, to the second order
    seen, true, run = faulty("sensor_lag", late)
    delayed = simulate(mechanism(()), replace(run, times=run.times - late), Numerics())[
        "slider_position"
    ]
    assert np.abs(seen - delayed).max() < 0.02 * np.abs(seen - true).max()
