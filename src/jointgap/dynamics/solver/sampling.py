"""What is seen of a motion at its samples: clearances, bodies, forces and reactions, from states alone."""

import math

import numpy as np

from jointgap.dynamics.compilation import compiled
from jointgap.dynamics.model.bodies import rod_accelerations
from jointgap.dynamics.model.effect_laws import crank_losses
from jointgap.dynamics.model.equations import accelerations, pose
from jointgap.dynamics.model.joint_forces import NOTHING, reaction
from jointgap.dynamics.model.relative_motion import relative_motion
from jointgap.dynamics.solver.runge_kutta import hystereses, instant
from jointgap.joints import JOINTS

COLUMNS = (
    *(f"{symbol}{joint}{dots}" for joint in (2, 3, 1) for symbol in ("r", "gamma") for dots in ("", "_dot", "_ddot")),
    *(f"{joint}_{force}" for joint in JOINTS for force in ("normal_force", "friction_force", "force_x", "force_y")),
    "crank_angle",
    "crank_speed",
    "crank_acceleration",
    "rod_position_x",
    "rod_position_y",
    "rod_velocity_x",
    "rod_velocity_y",
    "rod_acceleration_x",
    "rod_acceleration_y",
    "rod_angle",
    "rod_angular_velocity",
    "rod_angular_acceleration",
    "rod_deflection",
    "slider_position",
    "slider_velocity",
    "slider_acceleration",
    "crank_torque",
    "guide_force",
    "guide_moment",
    "frame_force_x",
    "frame_force_y",
)
"""What the columns of `observe` hold."""

_WIDTH = len(COLUMNS)


@compiled
def polar_rates(vector, direction):
    """Length of a clearance vector with two time derivatives, and two time derivatives of its direction.

    Where the length is zero its derivatives are those just after, the direction's NaN.
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
def never_pulling(joint, force):
    """A joint's force, or none where rounding has left a pull at the very end of a contact."""
    return NOTHING if joint.loose and joint.film_viscosity == 0.0 and force[0] <= 0.0 else force


@compiled
def observe(p, times, states, further, modes_at, approaches_at, directions_at):
    """Everything that follows from the samples of a march, as an (n, 51) array with `COLUMNS`.

    Parameters
    ----------
    p : Parameters
    times, states, further, modes_at, approaches_at, directions_at
        Samples as `jointgap.dynamics.solver.integrate.march` leaves them.
    """
    seen, b = np.empty((times.size, _WIDTH)), p.bodies
    for n in range(times.size):
        y, x, row = states[n], further[n], seen[n]
        modes = (modes_at[n, 0], modes_at[n, 1], modes_at[n, 2])
        approaches = (approaches_at[n, 0], approaches_at[n, 1], approaches_at[n, 2])
        y = (y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7])
        x = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10])
        here = instant(p, times[n], y, x, modes, approaches)
        motion, crank = relative_motion(here), here.crank
        for joint in range(3):
            polar = polar_rates(motion[joint], directions_at[n, joint])
            for i in range(6):
                row[6 * joint + i] = polar[i]

        place = pose(b, crank, y, x)
        drags = hystereses(p, approaches)
        a, pin, piston, pivot, _, force, _ = accelerations(p, times[n], here.crank_angle, crank, y, x, modes, drags)
        pin, piston = never_pulling(p.crank_pin, pin), never_pulling(p.piston_pin, piston)
        pivot, alpha = never_pulling(p.crank_pivot, pivot), a[6]
        # The crank as a free body: m a + alpha z x h - w^2 h = force,  I alpha + h x a = moment about its pivot end.
        hx = b.crank_moment_x * crank.cosine - b.crank_moment_y * crank.sine
        hy = b.crank_moment_x * crank.sine + b.crank_moment_y * crank.cosine
        if not p.crank_pivot.loose:
            fx = pin[2] - b.crank_mass * b.gravity_x - alpha * hy - crank.speed**2 * hx
            fy = pin[3] - b.crank_mass * b.gravity_y + alpha * hx - crank.speed**2 * hy
            pivot = reaction(fx, fy, 0.0)
        torque = b.crank_inertia * alpha + hx * (a[5] - b.gravity_y) - hy * (a[4] - b.gravity_x) - pivot[4] - pin[5]
        torque += b.crank_length * (crank.cosine * pin[3] - crank.sine * pin[2])
        torque -= crank_losses(p, place.slider, place.slider_speed, crank.speed, here.crank_angle, times[n])
        for i in range(4):
            row[18 + i], row[22 + i], row[26 + i] = pin[i], piston[i], pivot[i]

        c, s, speed, arm = place.rod_cos, place.rod_sin, place.rod_speed, b.rod_centre
        moment = pin[4] + piston[4] - arm * (c * pin[3] - s * pin[2])
        moment += (b.rod_length - arm) * (c * piston[3] - s * piston[2])
        rod = rod_accelerations(b, c, s, speed, x[3], x[7], pin[2] + piston[2], pin[3] + piston[3], moment)
        row[30], row[31], row[32] = here.crank_angle, crank.speed, alpha
        row[33] = b.crank_length * crank.cosine + y[0] + x[0] + arm * c
        row[34] = b.crank_length * crank.sine + y[1] + x[1] + arm * s
        row[35] = y[4] + x[4] - b.crank_length * crank.speed * crank.sine - arm * speed * s
        row[36] = y[5] + x[5] + b.crank_length * crank.speed * crank.cosine + arm * speed * c
        row[37], row[38] = rod[0], rod[1]
        row[39], row[40], row[41], row[42] = math.atan2(s, c), speed, rod[2], x[3]
        row[43], row[44] = place.slider, place.slider_speed
        row[45] = b.gravity_x + (force - piston[2]) * b.slider_inverse_mass
        row[46], row[47], row[48] = torque, piston[3] - b.slider_mass * b.gravity_y, -piston[5]
        row[49], row[50] = -pivot[2], -pivot[3]
    return seen
