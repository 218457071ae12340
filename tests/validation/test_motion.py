"""Data of blind trials come from another integrator; where the motion repeats it agrees with the package's."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from jointgap.config import Simulate
from jointgap.dynamics.simulation import simulate
from tests.independent.cases import mechanism
from validation.rig import CrankRun, Numerics, simulate_signals

ROOT = Path(__file__).parents[2]
SPEED = 40.0
SEEN = ("slider_position", "slider_acceleration", "crank_torque", "guide_force", "frame_force_x")


def content(loose=(), **contact) -> dict:
    made = mechanism(loose, friction=0.1).model_dump()
    steel = {"law": "lankarani_nikravesh", "youngs_modulus": 207e9, "poisson_ratio": 0.3, "restitution": 0.46}
    made["contacts"] = {"steel": steel | {"friction": 0.1, **contact}}
    made["joints"] = {name: joint | {"contact": "steel"} for name, joint in made["joints"].items()}
    return made


@pytest.mark.parametrize("loose", [(), ("piston_pin",), ("crank_pin", "piston_pin")], ids=["ideal", "one pin", "both"])
def test_both_integrators_give_the_same_motion(loose):
    ours = simulate(
        mechanism(loose, friction=0.1, memory="fading"),
        Simulate(speed=SPEED, revolutions=2, samples_per_revolution=60, tolerance=1e-13),
    ).samples.iloc[60:]
    times = ours["time"].to_numpy() - 2 * math.pi / SPEED
    other = simulate_signals(content(loose), CrankRun(SPEED, 0.0, times, settling=1), Numerics(1e-12))
    for name in SEEN:
        spread = float(ours[name].std())
        assert np.abs(other[name] - ours[name]).max() < 2e-3 * spread, name
    assert other["crank_angle"] == pytest.approx(ours["crank_angle"] - 2 * math.pi, abs=1e-9)


def test_a_smaller_tolerance_changes_the_motion_less():
    times = np.linspace(0.0, 2 * math.pi / SPEED, 60)

    def slider_velocity(tolerance: float) -> np.ndarray:
        run = CrankRun(SPEED, 0.0, times, settling=0)
        return simulate_signals(content(("piston_pin",)), run, Numerics(tolerance))["slider_velocity"]

    exact = slider_velocity(1e-13)
    off = [np.abs(slider_velocity(tolerance) - exact).max() for tolerance in (1e-8, 1e-10, 1e-12)]
    assert off[0] > off[1] > off[2]


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


def test_exudyn_gives_the_same_readings_with_every_effect_that_it_is_asked_for():
    pytest.importorskip("exudyn", reason="needs Exudyn: scripts/set-up peers")
    from validation.exudyn import readings
    from validation.plan import EXUDYN_EFFECTS

    assert {effect["name"] for effect in EFFECTS} == set(EXUDYN_EFFECTS)
    made = content() | {"effects": EFFECTS}
    times = np.linspace(0.0, 2 * math.pi / SPEED, 61)
    run = CrankRun(SPEED, 1.0, times, settling=1)
    ours = simulate_signals(made, run, Numerics())
    for name, values in readings(made, run)[0].items():
        assert np.abs(values - ours[name]).max() < 1e-4 * ours[name].std(), name


def of_loose_pins(made) -> dict[str, float]:
    """RMS difference of Exudyn's readings from ours with the same friction law, over their standard deviation."""
    pytest.importorskip("exudyn", reason="needs Exudyn: scripts/set-up peers")
    from validation.exudyn import FRICTION_SPEED, readings

    run = CrankRun(SPEED, 1.0, np.linspace(0.0, 2 * math.pi / SPEED, 61), start_angle=2.0, settling=2)
    straight = {"steel": made["contacts"]["steel"] | {"dead_band_speed": 0.0}}
    ours = simulate_signals(made | {"contacts": straight}, run, Numerics(1e-11, "ambrosio", FRICTION_SPEED))
    return {
        name: float(np.sqrt(np.mean((values - ours[name]) ** 2)) / ours[name].std())
        for name, values in readings(made, run)[0].items()
    }


@pytest.mark.parametrize("loose", [("crank_pin",), ("piston_pin",), ("crank_pin", "piston_pin")], ids=" ".join)
def test_exudyn_moves_loose_pins_alike_with_contacts_of_its_own(loose):
    assert max(of_loose_pins(content(loose, reference_approach_speed=0.1)).values()) < 1e-4


# The slider's dry friction turns over a speed of 1 mm/s there, of 10 mm/s here: the motion shows it.
@pytest.mark.parametrize(("dry", "bound"), [(False, 1e-3), (True, 3e-3)], ids=["all but dry friction", "dry friction"])
def test_loose_pins_move_alike_with_every_effect_too(dry, bound):
    contact = {"restitution": 0.7, "friction": 0.2, "stiffness_factor": 0.5, "damping_factor": 2.0}
    clearance = {"name": "piston_pin_clearance", "parameters": {"clearance_m": 5e-4, **contact}}
    effects = [effect for effect in EFFECTS if (effect["name"] == "slider_coulomb_friction") == dry]
    made = content(("crank_pin",)) | {"effects": [*effects, clearance]}
    assert max(of_loose_pins(made).values()) < bound


def test_the_second_models_share_no_code_with_the_dynamics():
    """These stand twice on purpose: the model in Exudyn, and the laws restated in tests/dynamics."""
    for path, shared in (
        ("validation/exudyn.py", []),
        ("tests/dynamics/laws.py", ["jointgap.dynamics.parameters"]),
    ):
        imported = re.findall(r"^\s*(?:from|import) (\S+)", (ROOT / path).read_text(encoding="utf-8"), re.M)
        assert [name for name in imported if name.startswith(("jointgap.dynamics", "validation"))] == shared
