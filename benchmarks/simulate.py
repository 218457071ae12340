"""Cost of one revolution against its accuracy, beside general-purpose integrators on the same compiled right-hand side.

The case: the paper's mechanism, Lankarani-Nikravesh with e = 0.46, no friction, no gravity, first revolution, no output.
Errors are those of the rod's mass centre and of the slider at 90 degrees, before chaos, against independent code in
80-bit numbers.

The general-purpose integrators are scipy's. They too need the approach speed at the start of each contact: they run from
event to event (`solve_ivp` with terminal events, contact begins and ends), with the same frozen modes in between.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numba
import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.extended import Extended
from jointgap.config import Mechanism, load_mechanism
from jointgap.dynamics.equations import CONTACT, FLIGHT
from jointgap.dynamics.integrator import instant
from jointgap.dynamics.motion import relative_motion
from jointgap.dynamics.parameters import Parameters, parameters
from jointgap.dynamics.simulate import run_march
from jointgap.dynamics.start import start_state

SPEED = 20 * np.pi
REVOLUTION, QUARTER = 2 * np.pi / SPEED, 0.5 * np.pi / SPEED
POSITIONS = [0, 1, 3]
TARGETS = {1e-9: 5.0, 1e-11: None, 1e-13: None}  # error [m] -> milliseconds to reach


def case() -> tuple[Mechanism, Parameters]:
    paper = load_mechanism(Path(__file__).resolve().parent.parent / "config/mechanisms/erkaya2009.yaml")
    contact = paper.joint("crank_pin").contact.model_copy(
        update={"law": "lankarani_nikravesh", "restitution": 0.46, "friction": 0.0}
    )
    joints = paper.joints.model_copy(
        update={
            name: getattr(paper.joints, name).model_copy(update={"contact": contact})
            for name in ("crank_pin", "piston_pin")
        }
    )
    mechanism = paper.model_copy(update={"joints": joints, "effects": ()})
    return mechanism, parameters(mechanism, SPEED, 0.0)


def ours(p: Parameters, end: float, tolerance: float) -> np.ndarray:
    return run_march(p, start_state(p), np.array([0.0, end]), tolerance).states[-1]


def right_hand_side(p: Parameters):
    """The package's own equations of motion and penetrations, compiled as scipy calls them: (t, y, frozen modes).

    `frozen` holds the modes of both joints and the approach speeds of their contacts. The parameters are compiled in,
    for to pass so many numbers from Python at every call would cost more than the equations.
    """

    @numba.njit(error_model="numpy")
    def slope(t, y, frozen):
        state = (y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7])
        modes, approaches = (int(frozen[0]), int(frozen[1])), (frozen[2], frozen[3])
        return np.array(instant(p, t, state, modes, approaches).slope)

    @numba.njit(error_model="numpy")
    def gap(t, y, frozen, joint):
        """Penetration [m] of a joint and its rate [m/s]."""
        state = (y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7])
        modes, approaches = (int(frozen[0]), int(frozen[1])), (frozen[2], frozen[3])
        ex, ey, vx, vy, _, _ = relative_motion(p, instant(p, t, state, modes, approaches))[joint]
        r = math.hypot(ex, ey)
        return r - (p.crank_pin.clearance if joint == 0 else p.piston_pin.clearance), (ex * vx + ey * vy) / r

    return slope, gap


def general_purpose(p: Parameters, compiled, end: float, tolerance: float, method: str) -> np.ndarray:
    """State at `end` [s] by scipy's `method`, with `tolerance` [m] as absolute tolerance of the positions."""
    slope, gap = compiled
    y, t, frozen = start_state(p), 0.0, np.array([FLIGHT, FLIGHT, np.inf, np.inf])
    events = [lambda t, y, frozen, joint=joint: gap(t, y, frozen, joint)[0] for joint in range(2)]
    scale = np.array([1, 1, 2, 1, 3e4, 3e4, 6e4, 3e4])
    while t < end:
        for joint, event in enumerate(events):
            event.terminal, event.direction = True, 1 if frozen[joint] == FLIGHT else -1
        part = solve_ivp(
            slope, (t, end), y, method, args=(frozen,), events=events, rtol=3e-14, atol=tolerance * scale,
            first_step=min(1e-7, end - t), max_step=1e-3,
        )  # fmt: skip
        t, y = part.t[-1], part.y[:, -1]
        if part.status == 1:
            joint = 0 if part.t_events[0].size else 1
            if frozen[joint] == FLIGHT:
                frozen[joint], frozen[2 + joint] = CONTACT, gap(t, y, frozen, joint)[1]
            else:
                frozen[joint] = FLIGHT
    return y


def distance(one, other) -> float:
    return float(np.abs(np.asarray(one - other, float)[POSITIONS]).max())


def cost(run, exact, target: float, tolerances, repeats: int) -> float | None:
    """Median milliseconds of a revolution at the loosest tolerance from which on the error stays within `target` [m]."""
    good = None
    for tolerance in sorted(tolerances):
        if distance(run(QUARTER, tolerance), exact) > target:
            break
        good = tolerance
    if good is None:
        return None
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        run(REVOLUTION, good)
        seconds.append(time.perf_counter() - begin)
    return 1e3 * median(seconds)


def first_and_later_call() -> tuple[float, float]:
    """Seconds of a simulation in a new process, with an empty cache of compiled code and with a full one."""
    code = (
        "import time; begin = time.perf_counter();"
        "from benchmarks.simulate import case; from jointgap.config import Simulate; from jointgap.dynamics import simulate;"
        "mechanism = case()[0]; begin = time.perf_counter(); simulate(mechanism, Simulate(revolutions=1));"
        "print(time.perf_counter() - begin)"
    )
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
        first, later = (
            float(
                subprocess.run([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, check=True).stdout
            )
            for _ in range(2)
        )
    return first, later


def measure() -> list[dict]:
    """Rows of what, reach, measured, unit and peers."""
    mechanism, p = case()
    joints = (p.crank_pin, p.piston_pin)
    extended = Extended(mechanism, SPEED, [one.stiffness for one in joints], [one.damping for one in joints])
    exact = extended.state_at(QUARTER, 1e-17)
    compiled = right_hand_side(p)
    rows = [
        {
            "what": "simulate: least error at 90 deg, tolerance 1e-15 m",
            "reach": None,
            "measured": distance(ours(p, QUARTER, 1e-15), exact),
            "unit": "m",
            "peers": {
                "80-bit code against itself at a tighter tolerance": distance(extended.state_at(QUARTER, 1e-18), exact)
            },
        }
    ]
    fine, coarse = 10.0 ** np.arange(-16, -6.9, 0.25), 10.0 ** np.arange(-15, -6.9, 1.0)
    for target, reach in TARGETS.items():
        peers = {
            f"scipy {method}": cost(
                lambda end, tolerance, method=method: general_purpose(p, compiled, end, tolerance, method),
                exact,
                target,
                coarse,
                3,
            )
            for method in ("DOP853", "LSODA")
        }
        measured = cost(lambda end, tolerance: ours(p, end, tolerance), exact, target, fine, 101)
        what = f"simulate: one revolution, error at most {target:g} m at 90 deg"
        rows.append({"what": what, "reach": reach, "measured": measured, "unit": "ms", "peers": peers})
    first, later = first_and_later_call()
    for what, reach, seconds in (("first", 30.0, first), ("later", 1.0, later)):
        row = {"what": f"simulate: {what} call after installation", "reach": reach, "measured": seconds}
        rows.append({**row, "unit": "s", "peers": {}})
    return rows


if __name__ == "__main__":
    print(json.dumps(measure(), indent=2))
