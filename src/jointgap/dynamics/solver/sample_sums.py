"""Sums and extremes over the samples of a motion, in one pass and without the columns of the table ``trajectory``.

A sweep takes these numbers of each of its designs: a hundredth of a millisecond counts.
"""

import math

import numpy as np

from jointgap.dynamics.compilation import compiled
from jointgap.dynamics.model.equations import accelerations, pose
from jointgap.dynamics.solver.contact_episodes import EVENT
from jointgap.dynamics.solver.runge_kutta import crank_at, damping_factors
from jointgap.dynamics.solver.sampling import joint_forces_at

ROUNDING = 1e-9
"""Crank angles closer than this are the same [rad]."""

_TIME, _JOINT, _BEGINS, _PEAK_FORCE = (EVENT.index(name) for name in ("time", "joint", "begins", "peak_force"))


@compiled
def angle_errors(p, angles, states, auxiliary_states, low, high):
    """How far the transmission angle lies from that of the same lengths without clearance, equations (10) and (17)."""
    b, everywhere = p.bodies, low <= 0.0 and high >= 2.0 * math.pi - ROUNDING
    count, squares, total, peak, steepest = 0, 0.0, 0.0, 0.0, 0.0
    for n in range(angles.size):
        rise = b.crank_length * math.sin(angles[n])
        end = rise + states[n, 1] + auxiliary_states[n, 1]
        rod, ideal = (b.slider_offset + states[n, 3] - end) / b.rod_length, (b.slider_offset - rise) / b.rod_length
        steepest = max(steepest, abs(rod))
        # A sample at the beginning of a later revolution may lie short of it by rounding.
        turned = angles[n] + ROUNDING
        if not 0.0 <= turned < 2.0 * math.pi:  # a remainder takes longer than all else here
            turned %= 2.0 * math.pi
        if everywhere or low <= turned <= high + 2.0 * ROUNDING:
            # The difference of two angles by their sines: one inverse sine instead of two.
            size = abs(math.asin(ideal * math.sqrt(1.0 - rod * rod) - rod * math.sqrt(1.0 - ideal * ideal)))
            count += 1
            squares += size * size
            total += size
            peak = max(peak, size)
    least = math.pi / 2 - math.asin(steepest)
    if not count:
        return math.nan, math.nan, math.nan, least
    return math.sqrt(squares / count), total / count, peak, least


@compiled
def slider_and_forces(p, times, states, auxiliary_states, modes_at, approaches_at, begins_at):
    """The slider's motion, and the sizes of the normal forces as `jointgap.dynamics.solver.sampling` has them."""
    b, count = p.bodies, times.size
    position, acceleration = np.empty(count), np.empty(count)
    peaks, squares = np.zeros(3), np.zeros(3)
    for n in range(count):
        y, x = states[n], auxiliary_states[n]
        modes = (modes_at[n, 0], modes_at[n, 1], modes_at[n, 2])
        approaches = (approaches_at[n, 0], approaches_at[n, 1], approaches_at[n, 2])
        begins = (begins_at[n, 0], begins_at[n, 1], begins_at[n, 2])
        y = (y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7])
        x = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10])
        angle, crank = crank_at(p, times[n], x)
        damping = damping_factors(p, approaches, begins, times[n])
        a, pin, piston, pivot, _, force, _ = accelerations(p, times[n], angle, crank, y, x, modes, damping)
        pin, piston, pivot = joint_forces_at(p, crank, a[6], pin, piston, pivot)
        position[n] = pose(b, crank, y, x).slider
        acceleration[n] = b.gravity_x + (force - piston[2]) * b.slider_inverse_mass
        for joint, normal in enumerate((pin[0], piston[0], pivot[0])):
            peaks[joint] = max(peaks[joint], normal)
            squares[joint] += normal * normal if n < count - 1 else 0.0
    return position, acceleration, peaks, np.sqrt(squares / (count - 1))


@compiled
def largest_change(states, auxiliary_states, apart):
    """Largest distance of the clearance vectors of samples from those `apart` samples earlier [m]."""
    largest = 0.0
    for n in range(apart, len(states)):
        square = 0.0
        for column in range(4):
            square += (states[n, column] - states[n - apart, column]) ** 2
        for column in range(2):
            square += (auxiliary_states[n, column] - auxiliary_states[n - apart, column]) ** 2
        largest = max(largest, square)
    return math.sqrt(largest)


@compiled
def contact_sums(events, begin, end):
    """How long the joints are in contact between two times, how often they come into it, and how hard."""
    touching, impacts, peaks = np.zeros(3), np.zeros(3), np.zeros(3)
    begun = np.full(3, math.inf)  # of contacts that have not ended
    for n in range(len(events)):
        time, joint = events[n, _TIME], int(events[n, _JOINT])
        if events[n, _BEGINS] == 1.0:
            begun[joint] = time
            impacts[joint] += 1.0 if begin <= time <= end else 0.0
        else:
            touching[joint] += max(min(time, end) - max(begun[joint], begin), 0.0)
            if begin <= begun[joint] and time <= end:
                peaks[joint] = max(peaks[joint], events[n, _PEAK_FORCE])
            begun[joint] = math.inf
    for joint in range(3):
        touching[joint] += max(end - max(begun[joint], begin), 0.0)
    return touching, impacts, peaks
