"""Samples of the motion, and sums over them."""

import math

import numpy as np

from jointgap.contact.joints import FLIGHT, joint_force
from jointgap.core.numba_cache import compiled
from jointgap.motion.integrate import EVENT
from jointgap.motion.rates import run, set_crank_at, set_damping, slopes, torque_on_crank
from jointgap.motion.workspace import CORNERS


@compiled
def polar_rates(vector, direction):
    """Length and direction of a clearance vector with two time derivatives each.

    At length zero its derivatives are the right-sided ones; the direction and its derivatives are
    NaN.
    """
    ex, ey, vx, vy, ax, ay = vector
    r = math.sqrt(ex * ex + ey * ey)
    if r == 0.0:
        speed = math.sqrt(vx * vx + vy * vy)
        onward = math.sqrt(ax * ax + ay * ay) if speed == 0.0 else (vx * ax + vy * ay) / speed
        return 0.0, speed, onward, math.nan, math.nan, math.nan
    nx, ny = ex / r, ey / r
    r_dot, swing = vx * nx + vy * ny, vy * nx - vx * ny
    turning = swing / r
    r_ddot = ax * nx + ay * ny + swing * turning
    return r, r_dot, r_ddot, direction, turning, (ay * nx - ax * ny - 2.0 * r_dot * turning) / r


@compiled
def take_row(p, k, found, n):
    """Set the state, time and modes of sample `n`, and evaluate everything there."""
    for i in range(2 * k.rubbing + k.pushed):
        k.assumed[i] = 0.0
    for i in range(k.states):
        k.z[i] = found.states[n, i]
    for j in range(k.contacts):
        k.modes[j], k.approaches[j], k.begins[j] = (
            found.modes[n, j],
            found.approaches[n, j],
            found.begins[n, j],
        )
    k.now = found.times[n]
    set_crank_at(p, k)
    set_damping(k, k.now)
    slopes(p, k)


@compiled
def _force_in(k, n):
    """Normal and friction force of a loose revolute joint, not attractive by rounding."""
    x, v, joint = 2 * n, k.half + 2 * n, k.joints[n]
    normal, tangential, _, _, _, _ = joint_force(
        joint,
        k.modes[n],
        k.damping[n],
        k.z[x],
        k.z[x + 1],
        k.z[v],
        k.z[v + 1],
        k.turning[x],
        k.turning[x + 1],
        k.z[2 * k.half + n] if k.bristles else 0.0,
    )
    if joint.film_viscosity == 0.0 and normal <= 0.0:
        for i in range(4):
            k.forces[4 * n + i] = 0.0
        return 0.0, 0.0
    return normal, tangential


@compiled
def fill_samples(p, k, found, bodies, numbers, accelerations):
    """Compute all quantities of the samples `found`, into `numbers` (n, columns): see
    `jointgap.motion.model.Model.columns`; `bodies` is the number of those with a direction.

    Second rates of the positions go into `accelerations` (n, a), as many as it has room for.
    """
    h, loose = k.half, k.loose
    bends = h - 2 * loose - k.is_free
    others = numbers.shape[1] - 3 - bodies - 8 * loose - bends
    for n in range(found.times.size):
        take_row(p, k, found, n)
        for i in range(accelerations.shape[1]):
            accelerations[n, i] = k.slope[h + i]
        numbers[n, 0], numbers[n, 1], numbers[n, 2] = k.now, k.turned, k.crank[2]
        at = 3 + bodies + others
        for j in range(loose):
            x, v = 2 * j, h + 2 * j
            ex, ey, vx, vy = k.z[x], k.z[x + 1], k.z[v], k.z[v + 1]
            ax, ay = k.slope[v], k.slope[v + 1]
            if j >= k.pins:
                touching, first = 0.0, k.pins + CORNERS * (j - k.pins)
                for corner in range(first, first + CORNERS):
                    touching += 1.0 if k.modes[corner] != FLIGHT else 0.0
                numbers[n, at], numbers[n, at + 1] = touching, k.forces[4 * j]
                values = (ex, vx, ax, ey, vy, ay)
            else:
                numbers[n, at], numbers[n, at + 1] = _force_in(k, j)
                values = polar_rates((ex, ey, vx, vy, ax, ay), found.directions[n, j])
            for i in range(6):
                numbers[n, at + 2 + i] = values[i]
            at += 8
        for i in range(bends):
            numbers[n, at + i] = k.z[2 * loose + k.is_free + i]
        run(k.sample, k.place)
        for i in range(bodies):
            numbers[n, 3 + i] = math.atan2(k.channels[2 * i + 1], k.channels[2 * i])
        for i in range(others):
            numbers[n, 3 + bodies + i] = k.channels[2 * bodies + i]
        # of the drive: without its rotor's inertia and the crank's friction
        losses = torque_on_crank(p, k)
        numbers[n, 3 + bodies] -= losses + p.drive.rotor_inertia * numbers[n, 4 + bodies]


ROUNDING = 1e-9
"""[rad] Crank angles closer than this are equal."""

_TIME, _JOINT, _BEGINS, _PEAK_FORCE = (
    EVENT.index(name) for name in ("time", "joint", "begins", "peak_force")
)


@compiled
def angle_errors(rods, ideals, angles, low, high):
    """Difference of the transmission angle from that of the same lengths without clearance,
    equations (10) and (17), from sines of the rod's angle (n,) with and without clearance."""
    everywhere = low <= 0.0 and high >= 2.0 * math.pi - ROUNDING
    count, squares, total, peak, steepest = 0, 0.0, 0.0, 0.0, 0.0
    for n in range(angles.size):
        rod, ideal = rods[n], ideals[n]
        steepest = max(steepest, abs(rod))
        # rounding may put the first sample of a later revolution before its beginning
        turned = angles[n] + ROUNDING
        if not 0.0 <= turned < 2.0 * math.pi:  # the remainder is slow
            turned %= 2.0 * math.pi
        if everywhere or low <= turned <= high + 2.0 * ROUNDING:
            # difference of two angles from their sines: one inverse sine instead of two
            size = abs(
                math.asin(ideal * math.sqrt(1.0 - rod * rod) - rod * math.sqrt(1.0 - ideal * ideal))
            )
            count += 1
            squares += size * size
            total += size
            peak = max(peak, size)
    least = math.pi / 2 - math.asin(steepest)
    if not count:
        return math.nan, math.nan, math.nan, least
    return math.sqrt(squares / count), total / count, peak, least


@compiled
def largest_change(vectors, apart):
    """Largest distance of the clearance vectors (n, ...) from those `apart` samples earlier [m]."""
    largest = 0.0
    for n in range(apart, len(vectors)):
        square = 0.0
        for column in range(vectors.shape[1]):
            square += (vectors[n, column] - vectors[n - apart, column]) ** 2
        largest = max(largest, square)
    return math.sqrt(largest)


@compiled
def contact_sums(events, count, begin, end):
    """Duration, number and largest force of the joints' contacts between two times."""
    touching, impacts, peaks = np.zeros(count), np.zeros(count), np.zeros(count)
    begun = np.full(count, math.inf)  # of contacts that have not ended
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
    for joint in range(count):
        touching[joint] += max(end - max(begun[joint], begin), 0.0)
    return touching, impacts, peaks
