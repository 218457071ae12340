"""Windows that start in states of a chaotic trajectory reproduce it."""

import math

import numpy as np

from jointgap.motion.simulation import integrate_to_angles, observed
from jointgap.motion.slider_crank import model_of, start_state
from jointgap.motion.windows import Carried, resting, rows_of, simulate_windows
from tests.config.mechanisms import mechanism
from tests.motion.cases import ALL, options

TOLERANCE = 1e-10  # m
SPEED, SETTLED, PER_TURN, TURNS, SAMPLES = 20.0, 6, 16, 2, 120


def test_windows_reproduce_the_trajectory_of_a_loose_crank_pivot(worst):
    loose = {name: {"loose": name == "crank_pivot"} for name in ALL}
    model = model_of(mechanism(joints=loose).applied(), options(speed=SPEED, tolerance=TOLERANCE))
    edges = math.tau * (SETTLED + np.arange(TURNS * PER_TURN + 1) / PER_TURN)
    angles = math.tau * (SETTLED + np.arange(TURNS * SAMPLES) / SAMPLES)
    every, places = np.unique(np.concatenate([[0.0], edges, angles]), return_inverse=True)
    motion = integrate_to_angles(model, start_state(model), every, TOLERANCE)
    true = observed(model, motion.part(places[edges.size + 1 :]))
    slow, carried = np.zeros((edges.size - 1, 2)), resting(model, edges.size - 1)
    (joint,) = model.loose
    for k, row in enumerate(places[1 : edges.size]):
        (x, y), (vx, vy) = model.vector(motion.states[row], joint)
        slow[k] = math.atan2(y, x), (x * vy - y * vx) / (x * x + y * y) / SPEED
        carried.modes[k] = motion.modes[row]
    for _ in range(3):  # further initial values come from the window before
        found, ends, after, done = simulate_windows(
            model, rows_of(model, edges, angles), slow, carried, TOLERANCE
        )
        assert done.all()
        pairs = zip(carried, after, strict=True)
        carried = Carried(*(np.concatenate([first[:1], then[:-1]]) for first, then in pairs))
    bounds = {"slider_position": 1e-6, "crank_torque": 5e-3, "frame_force_x": 5e-3}
    for channel, bound in bounds.items():
        off = np.sqrt(np.mean((found[channel] - true[channel]) ** 2)) / np.std(true[channel])
        worst(f"windows of a crank pivot: {channel}", off, bound)
    jumps = ends[:-1] - slow[1:]
    jumps[:, 0] -= math.tau * np.round(jumps[:, 0] / math.tau)
    worst("windows of a crank pivot: jumps of angle and rate", np.abs(jumps).max(), 5e-3)
