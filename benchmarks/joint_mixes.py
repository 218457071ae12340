"""Cost of a stage of the integration and of a revolution, by which joints are loose.

The case is that of `benchmarks.simulate`, with a journal of 10 mm in the crank pivot. A stage's time is a revolution's
at a tolerance of 1e-9 m over its steps' stages, so that what a step takes beside them is in it. A revolution's time is
that at the loosest tolerance from which on positions at 90 degrees are within 1e-9 m of those at 1e-14.
"""

import time

import numpy as np

from benchmarks.project import row
from benchmarks.simulate import SPEED, case, distance
from jointgap.config import Mechanism, Simulate
from jointgap.core.joints import JOINTS, PINS
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.runge_kutta import COUNT
from jointgap.dynamics.simulation import integrate_to_angles, start_state

STEP_TOLERANCE, ERROR, REPEATS = 1e-9, 1e-9, 21
IDEAL, WITH_SLIDER_FORCES = 90.0, 110.0  # nanoseconds of a stage where a joint is ideal
MIXES = {  # loose joints -> nanoseconds of a stage to reach without forces on the slider
    PINS: 60.0,
    tuple(JOINTS): 127.0,
    ("crank_pin",): IDEAL,
    ("piston_pin",): IDEAL,
    ("crank_pivot", "crank_pin"): IDEAL,
    ("crank_pivot", "piston_pin"): IDEAL,
    ("crank_pivot",): IDEAL,
}
FORCES = [
    {"name": "slider_coulomb_friction", "parameters": {"force_N": 2.0}},
    {"name": "slider_viscous_friction", "parameters": {"damping_N_s_m": 1.0}},
]


def mix(loose: tuple[str, ...], effects: list[dict]) -> Mechanism:
    """The case with these joints loose and effects."""
    tree = case().model_dump()
    pivot = {**tree["joints"]["crank_pin"], "journal": "frame", "journal_radius": 0.010}
    pivot["bearing_radius"] = pivot["journal_radius"] + case().clearance("crank_pin")
    joints = {**tree["joints"], "crank_pivot": pivot}
    joints = {name: {**joints[name], "loose": name in loose} for name in JOINTS}
    return Mechanism.model_validate({**tree, "joints": joints, "effects": effects})


def nanoseconds_and_milliseconds(mechanism: Mechanism) -> tuple[float, float]:
    """Of a stage; of a revolution with an error of at most `ERROR`."""
    p = parameters(mechanism, Simulate(speed=SPEED))
    start = start_state(p)

    def quarter(tolerance):
        run = integrate_to_angles(p, start, np.array([0.0, 0.5 * np.pi]), tolerance)
        seen = run.observed(p)
        return np.array([seen[name][-1] for name in ("rod_position_x", "rod_position_y", "slider_position")])

    def revolution(tolerance):
        best = np.inf
        for _ in range(REPEATS):
            begin = time.process_time()
            steps = integrate_to_angles(p, start, np.array([0.0, 2 * np.pi]), tolerance).steps
            best = min(best, time.process_time() - begin)
        return best, steps

    exact, loosest = quarter(1e-14), 1e-12
    for tolerance in 10.0 ** np.arange(-12, -6.9, 0.25):
        if distance(quarter(tolerance), exact) > ERROR:
            break
        loosest = tolerance
    seconds, steps = revolution(STEP_TOLERANCE)
    return 1e9 * seconds / (steps * COUNT), 1e3 * revolution(loosest)[0]


def measure() -> list[dict]:
    """Rows of what, reach, measured and unit."""
    rows = []
    for loose, reach in MIXES.items():
        words = " and ".join(name.replace("_", " ") for name in loose) + " loose"
        for effects, with_forces, bound in (
            ([], "", reach),
            (FORCES, ", forces on the slider", WITH_SLIDER_FORCES if reach == IDEAL else None),
        ):
            stage, revolution = nanoseconds_and_milliseconds(mix(loose, effects))
            rows.append(row(f"one stage, {words}{with_forces}", bound, stage, "ns"))
            what = f"one revolution, error at most {ERROR:g} m at 90 deg, {words}{with_forces}"
            rows.append(row(what, None, revolution, "ms"))
    return rows
