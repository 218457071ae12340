"""What cannot be simulated says so, soon, with time, crank angle and state; the compiled code needs no home."""

import os
import subprocess
import sys

import numpy as np
import pytest

from jointgap.dynamics import simulate
from jointgap.dynamics.parameters import parameters
from jointgap.dynamics.simulate import run_march
from jointgap.dynamics.start import start_state
from jointgap.errors import InputError, SimulationError
from tests.dynamics.cases import SPEED, mechanism, options

WHERE = r"time \S+ s, crank angle \S+ deg \(state in SI: rod_position_x .*slider_velocity"


@pytest.mark.parametrize("stiffness", (1e30, 1e200, 1e308))
def test_a_contact_stiff_beyond_reason_ends_in_an_error(stiffness):
    with pytest.raises(SimulationError, match=WHERE):
        simulate(mechanism(stiffness=stiffness), options())


def test_a_tolerance_below_rounding_ends_in_an_error():
    with pytest.raises(SimulationError, match=WHERE):
        simulate(mechanism(), options(tolerance=1e-30))


def test_a_number_that_is_not_finite_ends_in_an_error():
    p = parameters(mechanism(), SPEED, 0.0)
    start = start_state(p)
    with pytest.raises(SimulationError, match=f"not finite.*{WHERE}"):
        run_march(p._replace(gravity_y=np.nan), start, np.array([0.0, 0.1]), 1e-12)


def test_the_bound_on_steps_is_named(monkeypatch):
    monkeypatch.setattr(sys.modules[run_march.__module__], "STEPS_PER_REVOLUTION", 100)
    with pytest.raises(SimulationError, match=f"more than 100 steps.*{WHERE}"):
        simulate(mechanism(), options())


def test_a_rod_that_does_not_reach_the_slide_is_refused():
    p = parameters(mechanism(), SPEED, np.pi / 2)
    with pytest.raises(InputError, match="does not reach the slide"):
        start_state(p._replace(slider_offset=-0.5))


def test_compiled_code_is_kept_where_neither_home_nor_sources_may_be_written(tmp_path):
    code = "from jointgap.dynamics.compiled import *; print(cache_folder(beside=Path('/proc/none')))"
    environment = {"PATH": os.environ["PATH"], "HOME": "/proc", "TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.startswith(str(tmp_path))
