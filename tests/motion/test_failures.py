"""Failed simulations report time, crank angle, state and advice."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointgap.core import numba_cache
from jointgap.core.errors import SimulationError
from jointgap.motion.simulation import integrate_to_angles
from jointgap.motion.slider_crank import model_of, simulate, start_state
from tests.motion.cases import ALL, CRANK, ROD, effect, mechanism, options

TURN = np.linspace(0.0, 2 * np.pi, 10)
WHERE = r"time \S+ s, crank angle \S+ deg \(state in SI: crank.speed"


def as_stiff_as_can_be(model):
    model.bearings["crank_pin"].stiffness = 1e308
    return model


def of_unknown_weight(model):
    return replace(model, linkage=replace(model.linkage, gravity=(0.0, np.nan)))


@pytest.mark.parametrize("changed", [as_stiff_as_can_be, of_unknown_weight])
def test_extreme_numbers_end_in_an_error(changed):
    model = changed(model_of(mechanism(gravity=True), options()))
    with pytest.raises(SimulationError, match=WHERE):
        integrate_to_angles(model, start_state(model), TURN, 1e-12)


def test_a_formula_without_a_value_ends_in_an_error():
    rooted = effect("discovered_slider_force", formula="sqrt(x - 0.6)")
    with pytest.raises(SimulationError, match=f"not finite.*{WHERE}.*formulas") as error:
        simulate(mechanism(rooted), options())
    angle = float(str(error.value).split("crank angle ")[1].split(" deg")[0])
    slider = CRANK * np.cos(np.radians(angle)) + np.sqrt(
        ROD**2 - (CRANK * np.sin(np.radians(angle))) ** 2
    )
    assert slider == pytest.approx(0.6, abs=3e-3)  # within the clearances of where the root ends


def test_a_stalled_motor_is_reported_with_advice(monkeypatch):
    weak = {"kind": "motor", "stall_torque": 0.5, "no_load_speed": 100.0}
    for loose in ((), ALL):
        made = mechanism(effect("slider_constant_force", force_N=-500.0), loose=loose)
        with pytest.raises(SimulationError, match=f"stalls.*{WHERE}.*more torque"):
            simulate(made, options(drive=weak, start_angle=3.3, revolutions=2))
    # smooth friction lets the crank creep
    monkeypatch.setattr(sys.modules[integrate_to_angles.__module__], "STEPS_PER_REVOLUTION", 2000)
    weak = {"kind": "motor", "stall_torque": 0.001, "no_load_speed": 150.0, "inertia": 0.05}
    held = mechanism(effect("slider_coulomb_friction", force_N=50.0))
    with pytest.raises(
        SimulationError, match=f"more than 2000 steps.*{WHERE}.*stands still.*more torque"
    ):
        simulate(held, options(drive=weak, speed=0.0))


def test_too_many_steps_are_reported_with_the_joint(monkeypatch):
    """Friction makes the journal of a tight pivot whirl: 50 000 steps a revolution."""
    monkeypatch.setattr(sys.modules[integrate_to_angles.__module__], "STEPS_PER_REVOLUTION", 10_000)
    whirling = mechanism(loose=("crank_pivot",), friction=0.3, clearance=2e-5)
    with pytest.raises(
        SimulationError, match=r"more than 30000 steps.*friction that makes a journal whirl"
    ) as error:
        simulate(whirling, options(revolutions=3, tolerance=1e-9))
    whirl = r"crank pivot: \d+ contacts, in contact, circling its clearance (\S+) times"
    turns = re.search(whirl, str(error.value))
    assert abs(float(turns[1])) > 50
    assert "crank pin:" not in str(error.value)


def test_every_source_of_compiled_code_invalidates_the_cache():
    package = Path(numba_cache.__file__).parent.parent
    sources = {
        path
        for path in package.rglob("*.py")
        if "jointgap.core.numba_cache import" in path.read_text()
    }
    assert len(sources) > 10
    assert sources <= set(numba_cache.SOURCES)
