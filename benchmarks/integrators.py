"""One mechanism with two loose pins simulated by several codes, each from the same start to a crank
angle.

Every code is a function `(end, tolerance) -> (positions, seconds)`: end time [s] and absolute
tolerance [m]; rod's mass centre x, y and slider position [m] at the end, and processor time on one
core. One-time costs of a mechanism (compilation, Exudyn's model) do not count. A code that cannot
keep a tolerance raises RuntimeError.

scipy's integrators and LSODA need the approach speed at the start of each contact too: they run
from event to event with the modes frozen in between, on the package's own compiled right-hand side.
"""

import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.compiled_lsoda import compiled_lsoda
from benchmarks.right_hand_side import right_hand_side
from jointgap.config import Mechanism, Simulate
from jointgap.contact.joints import CONTACT, FLIGHT
from jointgap.motion.model import Model
from jointgap.motion.simulation import integrate_to_angles
from jointgap.motion.slider_crank import lengths_of, model_of, rod_and_slider, start_state
from validation.exudyn import SliderCrank

Code = Callable[[float, float], tuple[np.ndarray, float]]


def codes(mechanism: Mechanism, speed: float) -> dict[str, Code | None]:
    """All codes by name, ours first; None where one is not installed."""
    model = model_of(mechanism, Simulate(speed=speed))
    workspace = model.workspace()
    slope, gap = right_hand_side(model, workspace)
    found: dict[str, Code | None] = {"jointgap": ours(model)}
    try:
        found["compiled LSODA"] = lsoda(model, compiled_lsoda(slope, gap))
    except ImportError:
        found["compiled LSODA"] = None
    try:
        SliderCrank(mechanism, speed)
        found["Exudyn"] = exudyn(mechanism, speed)
    except ImportError:
        found["Exudyn"] = None
    for method in ("DOP853", "LSODA"):
        found[f"scipy {method}"] = scipy(model, slope, gap, method)
    return found


def positions(model: Model, end: float, states) -> np.ndarray:
    """Rod's mass centre x, y and slider's position [m] at the time `end` [s] for the clearance
    vectors `states` (4+,).
    """
    crank_angle = np.array([model.drive.start_angle + model.drive.speed * end])
    angle, slider = rod_and_slider(model, crank_angle, np.reshape(states, (1, -1)))
    _, length, offset = lengths_of(model)
    back = length - model.linkage.bodies["rod"].centre[0]
    piston = slider[0] + states[2], offset + states[3]
    return np.array(
        [piston[0] - back * np.cos(angle[0]), piston[1] - back * np.sin(angle[0]), slider[0]]
    )


def ours(model: Model) -> Code:
    start = start_state(model)

    def run(end, tolerance):
        angles = model.drive.start_angle + model.drive.speed * np.array([0.0, end])
        begin = time.process_time()
        states = integrate_to_angles(model, start, angles, tolerance).states
        return positions(model, end, states[-1]), time.process_time() - begin

    return run


def lsoda(model: Model, march) -> Code:
    def run(end, tolerance):
        begin = time.process_time()
        z = march(start_state(model), end, tolerance)
        return positions(model, end, z), time.process_time() - begin

    return run


def exudyn(mechanism: Mechanism, speed: float) -> Code:
    """Exudyn's DOPRI5: its ODE23, the other explicit integrator with step size control, takes a
    thousand times as long.
    """

    def run(end, tolerance):
        model = SliderCrank(mechanism, speed)
        begin = time.process_time()
        found = model.advance(end, tolerance)
        return found[[0, 1, 3]], time.process_time() - begin

    return run


def scipy(model: Model, slope, gap, method: str) -> Code:
    """scipy's `solve_ivp`, which ends at each event."""
    out = np.empty(8)

    def rates(t, z, modes, approaches):
        slope(t, z, out, tuple(modes), tuple(approaches))
        return out.copy()

    events = [lambda t, z, modes, approaches, joint=joint: gap(z, joint)[0] for joint in range(2)]

    def run(end, tolerance):
        begin = time.process_time()
        z, t, modes, approaches = start_state(model), 0.0, [FLIGHT, FLIGHT], [np.inf, np.inf]
        while t < end:
            for joint, event in enumerate(events):
                event.terminal, event.direction = True, 1 if modes[joint] == FLIGHT else -1
            part = solve_ivp(
                rates,
                (t, end),
                z,
                method,
                args=(modes, approaches),
                events=events,
                rtol=3e-14,
                atol=tolerance,
                first_step=min(1e-7, end - t),
                max_step=1e-3,
            )
            t, z = part.t[-1], part.y[:, -1]
            if part.status == 1:
                joint = 0 if part.t_events[0].size else 1
                if modes[joint] == FLIGHT:
                    modes[joint], approaches[joint] = CONTACT, gap(z, joint)[1]
                else:
                    modes[joint], approaches[joint] = FLIGHT, np.inf
        return positions(model, end, z), time.process_time() - begin

    return run
