"""Samples of the motion, and sums over them."""

import math

import numpy as np

from jointgap.core.schema import TRAJECTORY
from jointgap.dynamics.bodies import crank_moment, rod_accelerations
from jointgap.dynamics.equations import accelerations, crank_losses, pose
from jointgap.dynamics.integrate import EVENT
from jointgap.dynamics.joints import NOTHING, clearances, reaction
from jointgap.dynamics.numba_cache import compiled, inlined
from jointgap.dynamics.runge_kutta import crank_at, damping_factors

SAMPLE = np.dtype(
    (np.record, [(column.name, "f8") for column in TRAJECTORY.columns if column.kind == "float"])
)
"""Record of one sample in compiled code."""


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
def _never_pulling(joint, force):
    """A joint's force, or zero where rounding makes it attractive at the end of a contact."""
    return NOTHING if joint.loose and joint.film_viscosity == 0.0 and force[0] <= 0.0 else force


@inlined
def joint_forces_at(p, crank, alpha, pin, piston, pivot) -> tuple:
    """Forces in the joints for samples, without attractive ones, including those of an ideal crank
    pivot."""
    pin, piston = _never_pulling(p.crank_pin, pin), _never_pulling(p.piston_pin, piston)
    if p.crank_pivot.loose:
        return pin, piston, _never_pulling(p.crank_pivot, pivot)
    # The crank as a free body: m a + alpha z x h - w^2 h = force,  I alpha + h x a = moment about
    # its pivot end.
    b = p.bodies
    hx, hy = crank_moment(b, crank)
    fx = pin[2] - b.crank_mass * b.gravity_x - alpha * hy - crank.speed**2 * hx
    fy = pin[3] - b.crank_mass * b.gravity_y + alpha * hx - crank.speed**2 * hy
    return pin, piston, reaction(fx, fy, 0.0)


@inlined
def _at_sample(p, found, n) -> tuple:
    """Crank angle, crank, states and `accelerations` at sample `n` of an integration."""
    y, x, time = found.states[n], found.auxiliary_states[n], found.times[n]
    mode, approach, begin = found.modes[n], found.approaches[n], found.begins[n]
    y = (y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7])
    x = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10])
    modes = (mode[0], mode[1], mode[2])
    approaches, begins = (approach[0], approach[1], approach[2]), (begin[0], begin[1], begin[2])
    angle, crank = crank_at(p, time, x)
    damping = damping_factors(p, approaches, begins, time)
    return angle, crank, y, x, accelerations(p, time, angle, crank, y, x, modes, damping)


@compiled
def fill_samples(p, found, samples):
    """Compute all quantities of the samples `found` by an integration."""
    b, times, states, auxiliary_states = p.bodies, found.times, found.states, found.auxiliary_states
    modes_at, approaches_at, begins_at = found.modes, found.approaches, found.begins
    directions_at = found.directions
    for n in range(times.size):
        y, x, row = states[n], auxiliary_states[n], samples[n]
        modes = (modes_at[n, 0], modes_at[n, 1], modes_at[n, 2])
        approaches = (approaches_at[n, 0], approaches_at[n, 1], approaches_at[n, 2])
        begins = (begins_at[n, 0], begins_at[n, 1], begins_at[n, 2])
        y = (y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7])
        x = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10])
        angle, crank = crank_at(p, times[n], x)
        damping = damping_factors(p, approaches, begins, times[n])
        a, pin, piston, pivot, _, force, _ = accelerations(
            p, times[n], angle, crank, y, x, modes, damping
        )
        motion, at = clearances(y, x), directions_at[n]
        row.r2, row.r2_dot, row.r2_ddot, row.gamma2, row.gamma2_dot, row.gamma2_ddot = polar_rates(
            (*motion[0], a[0], a[1]), at[0]
        )
        row.r3, row.r3_dot, row.r3_ddot, row.gamma3, row.gamma3_dot, row.gamma3_ddot = polar_rates(
            (*motion[1], a[2], a[3]), at[1]
        )
        row.r1, row.r1_dot, row.r1_ddot, row.gamma1, row.gamma1_dot, row.gamma1_ddot = polar_rates(
            (*motion[2], a[4], a[5]), at[2]
        )

        place = pose(b, crank, y, x)
        alpha = a[6]
        pin, piston, pivot = joint_forces_at(p, crank, alpha, pin, piston, pivot)
        hx, hy = crank_moment(b, crank)
        torque = (
            b.crank_inertia * alpha
            + hx * (a[5] - b.gravity_y)
            - hy * (a[4] - b.gravity_x)
            - pivot[4]
            - pin[5]
        )
        torque += b.crank_length * (crank.cosine * pin[3] - crank.sine * pin[2])
        torque -= crank_losses(p, place.slider, place.slider_speed, crank.speed, angle, times[n])
        row.crank_pin_normal_force, row.crank_pin_friction_force = pin[0], pin[1]
        row.crank_pin_force_x, row.crank_pin_force_y = pin[2], pin[3]
        row.piston_pin_normal_force, row.piston_pin_friction_force = piston[0], piston[1]
        row.piston_pin_force_x, row.piston_pin_force_y = piston[2], piston[3]
        row.crank_pivot_normal_force, row.crank_pivot_friction_force = pivot[0], pivot[1]
        row.crank_pivot_force_x, row.crank_pivot_force_y = pivot[2], pivot[3]

        c, s, speed, arm = place.rod_cos, place.rod_sin, place.rod_speed, b.rod_centre
        moment = pin[4] + piston[4] - arm * (c * pin[3] - s * pin[2])
        moment += (b.rod_length - arm) * (c * piston[3] - s * piston[2])
        rod = rod_accelerations(
            b, c, s, speed, x[3], x[7], pin[2] + piston[2], pin[3] + piston[3], moment
        )
        row.time, row.crank_angle, row.crank_speed, row.crank_acceleration = (
            times[n],
            angle,
            crank.speed,
            alpha,
        )
        row.rod_position_x = b.crank_length * crank.cosine + y[0] + x[0] + arm * c
        row.rod_position_y = b.crank_length * crank.sine + y[1] + x[1] + arm * s
        row.rod_velocity_x = (
            y[4] + x[4] - b.crank_length * crank.speed * crank.sine - arm * speed * s
        )
        row.rod_velocity_y = (
            y[5] + x[5] + b.crank_length * crank.speed * crank.cosine + arm * speed * c
        )
        row.rod_acceleration_x, row.rod_acceleration_y, row.rod_angular_acceleration = (
            rod[0],
            rod[1],
            rod[2],
        )
        row.rod_angle, row.rod_angular_velocity, row.rod_deflection = math.atan2(s, c), speed, x[3]
        row.transmission_angle = math.pi / 2 + row.rod_angle
        row.slider_position, row.slider_velocity = place.slider, place.slider_speed
        row.slider_acceleration = b.gravity_x + (force - piston[2]) * b.slider_inverse_mass
        row.crank_torque, row.guide_moment = torque, -piston[5]
        row.guide_force = piston[3] - b.slider_mass * b.gravity_y
        row.frame_force_x, row.frame_force_y = -pivot[2], -pivot[3]


ROUNDING = 1e-9
"""[rad] Crank angles closer than this are equal."""

_TIME, _JOINT, _BEGINS, _PEAK_FORCE = (
    EVENT.index(name) for name in ("time", "joint", "begins", "peak_force")
)


@compiled
def angle_errors(p, angles, states, auxiliary_states, low, high):
    """Difference of the transmission angle from that of the same lengths without clearance,
    equations (10) and (17)."""
    b, everywhere = p.bodies, low <= 0.0 and high >= 2.0 * math.pi - ROUNDING
    count, squares, total, peak, steepest = 0, 0.0, 0.0, 0.0, 0.0
    for n in range(angles.size):
        rise = b.crank_length * math.sin(angles[n])
        end = rise + states[n, 1] + auxiliary_states[n, 1]
        rod, ideal = (
            (b.slider_offset + states[n, 3] - end) / b.rod_length,
            (b.slider_offset - rise) / b.rod_length,
        )
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
def slider_and_forces(p, found):
    """The slider's motion at the samples `found`, and the normal forces."""
    b, count = p.bodies, found.times.size
    position, acceleration = np.empty(count), np.empty(count)
    peaks, squares = np.zeros(3), np.zeros(3)
    for n in range(count):
        _, crank, y, x, (a, pin, piston, pivot, _, force, _) = _at_sample(p, found, n)
        pin, piston, pivot = joint_forces_at(p, crank, a[6], pin, piston, pivot)
        position[n] = pose(b, crank, y, x).slider
        acceleration[n] = b.gravity_x + (force - piston[2]) * b.slider_inverse_mass
        for joint, normal in enumerate((pin[0], piston[0], pivot[0])):
            peaks[joint] = max(peaks[joint], normal)
            squares[joint] += normal * normal if n < count - 1 else 0.0
    return position, acceleration, peaks, np.sqrt(squares / (count - 1))


@compiled
def largest_change(states, auxiliary_states, apart):
    """Largest distance of the clearance vectors from those `apart` samples earlier [m]."""
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
    """Duration, number and largest force of the joints' contacts between two times."""
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
