"""Contacts as episodes, from an impact to the separation: impulse, peak of the force, maxima of the penetration.

To a user a joint is in flight, in an impact or in contact. An impact is a contact in which the penetration has one
maximum at most: the journal hits and rebounds. In a longer one it stays, swinging about its equilibrium.
"""

import math

import numpy as np

from jointgap.dynamics.compilation import compiled, inlined
from jointgap.dynamics.model.joint_forces import FLIGHT
from jointgap.dynamics.model.parameters import Parameters
from jointgap.dynamics.solver.runge_kutta import dt_ds
from jointgap.dynamics.solver.tableau import COUNT, NODES, STAGES
from jointgap.joints import JOINTS

EPISODE = 4
"""Numbers kept of a joint's contact: impulse [N s], largest normal force [N], maxima of the penetration, begin [s]."""

EVENT = ("time", "joint", "begins", "approach_speed", "impulse", "peak_force", "maxima", "crank_angle", "duration")
"""What a row of the events holds; the numbers of the episode belong to its end."""

EVENT_WIDTH = len(EVENT)

EVENT_NAMES = np.array(["separation", "impact"], dtype=object)

MODES = ("ideal", "flight", "impact", "contact")
"""What a sample may be in, by joint."""


@inlined
def follow_episodes(episodes, here, there, motion, there_motion, step_map, step_start, ds, k) -> None:
    """Carry on the episodes over an accepted step whose stages are in `k`."""
    flying = here.modes[0] == FLIGHT and here.modes[1] == FLIGHT and here.modes[2] == FLIGHT
    if flying or ds == 0.0:
        return
    for joint in range(3):
        if here.modes[joint] == FLIGHT:
            continue
        impulse, peak = 0.0, episodes[joint, 1]
        for stage in range(COUNT):
            normal = max(k.normals[joint, stage], 0.0)
            impulse += STAGES[COUNT, stage] * dt_ds(step_map, step_start + NODES[stage] * ds) * normal
            peak = max(peak, normal)
        episodes[joint, 0] += ds * impulse
        episodes[joint, 1] = peak
        ex, ey, vx, vy, _, _ = motion[joint]
        fx, fy, wx, wy, _, _ = there_motion[joint]
        if ex * vx + ey * vy > 0.0 >= fx * wx + fy * wy:
            episodes[joint, 2] += 1.0


@compiled
def begin_episode(episodes, joint, time):
    """A contact begins at `time` [s]."""
    for i in range(3):
        episodes[joint, i] = 0.0
    episodes[joint, 3] = time


@compiled
def note_event(event, episodes, there, joint, begins, approach):
    """Write a row of events: see `EVENT`."""
    event[0], event[1], event[2], event[7] = there.time, joint, 1.0 if begins else 0.0, there.crank_angle
    event[3] = approach if begins else math.nan
    for i in range(3):
        event[4 + i] = math.nan if begins else episodes[joint, i]
    event[8] = math.nan if begins else there.time - episodes[joint, 3]


def mode_numbers(p: Parameters, times: np.ndarray, modes: np.ndarray, events: np.ndarray) -> np.ndarray:
    """What each joint is in at samples, as places in `MODES`, shape (n, 3), int8."""
    found = np.zeros((times.size, 3), np.int8)
    column = {name: i for i, name in enumerate(EVENT)}
    for number, joint in enumerate(JOINTS):
        if not getattr(p, joint).loose:
            continue
        ends = events[(events[:, column["joint"]] == number) & (events[:, column["begins"]] == 0)]
        following = np.searchsorted(ends[:, column["time"]], times)  # the next separation; none: the contact goes on
        maxima = np.append(ends[:, column["maxima"]], np.inf)[following]
        found[:, number] = np.where(modes[:, number] != FLIGHT, np.where(maxima <= 1, 2, 3), 1)
    return found


def sample_modes(p: Parameters, times: np.ndarray, modes: np.ndarray, events: np.ndarray) -> dict[str, np.ndarray]:
    """Columns ``crank_pin_mode``, ... of the table ``trajectory``; parameters as `mode_numbers`."""
    numbers = mode_numbers(p, times, modes, events)
    return {f"{joint}_mode": np.array(MODES, dtype=object)[numbers[:, i]] for i, joint in enumerate(JOINTS)}
