"""What is seen of a motion at its samples: clearances, accelerations, forces and reactions, from states alone."""

import math

import numpy as np

from jointgap.dynamics.compiled import compiled
from jointgap.dynamics.equations import joint_force
from jointgap.dynamics.integrator import hystereses, instant
from jointgap.dynamics.motion import relative_motion, resolution


@compiled
def polar_rates(vector, direction, least):
    """Length of a clearance vector with two time derivatives, and two time derivatives of its direction.

    Up to the length `least` it counts as zero: the length's derivatives are then those just after, the direction's NaN.
    """
    ex, ey, vx, vy, ax, ay = vector
    r = math.sqrt(ex * ex + ey * ey)
    if r <= least:
        speed = math.sqrt(vx * vx + vy * vy)
        onward = math.sqrt(ax * ax + ay * ay) if speed == 0.0 else (vx * ax + vy * ay) / speed
        return 0.0, speed, onward, math.nan, math.nan, math.nan
    nx, ny = ex / r, ey / r
    r_dot, swing = vx * nx + vy * ny, vy * nx - vx * ny
    turning = swing / r
    r_ddot = ax * nx + ay * ny + swing * turning
    return r, r_dot, r_ddot, direction, turning, (ay * nx - ax * ny - 2.0 * r_dot * turning) / r


@compiled
def never_pulling(force):
    """A joint's force, or none where rounding has left a pull at the very end of a contact."""
    return force if force[0] > 0.0 else (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


COLUMNS = (
    *(f"{symbol}{joint}{dots}" for joint in (2, 3) for symbol in ("r", "gamma") for dots in ("", "_dot", "_ddot")),
    "rod_acceleration_x",
    "rod_acceleration_y",
    "rod_angular_acceleration",
    "slider_acceleration",
    *(
        f"{joint}_{force}"
        for joint in ("crank_pin", "piston_pin")
        for force in ("normal_force", "friction_force", "force_x", "force_y")
    ),
    "crank_torque",
    "guide_force",
    "guide_moment",
    "frame_force_x",
    "frame_force_y",
)
"""What the columns of `observe` hold."""


@compiled
def observe(p, times, states, modes_at, approaches_at, directions_at):
    """Everything that follows from the samples of a march, as an (n, 29) array with `COLUMNS`.

    Parameters
    ----------
    p : Parameters
    times, states, modes_at, approaches_at, directions_at
        Samples as `jointgap.dynamics.march.march` leaves them.
    """
    seen = np.empty((times.size, 29))
    least = resolution(p)
    for i in range(times.size):
        y, row = states[i], seen[i]
        modes = (modes_at[i, 0], modes_at[i, 1])
        approaches = (approaches_at[i, 0], approaches_at[i, 1])
        here = instant(p, times[i], (y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7]), modes, approaches)
        pin, piston = relative_motion(p, here)
        row[0], row[1], row[2], row[3], row[4], row[5] = polar_rates(pin, directions_at[i, 0], least)
        row[6], row[7], row[8], row[9], row[10], row[11] = polar_rates(piston, directions_at[i, 1], least)
        row[12], row[13], row[14], row[15] = here.slope[4], here.slope[5], here.slope[6], here.slope[7]
        drags = hystereses(p, approaches)
        on_pin = never_pulling(joint_force(p.crank_pin, modes[0], drags[0], pin[:4], y[6], p.speed))
        on_piston = never_pulling(joint_force(p.piston_pin, modes[1], drags[1], piston[:4], y[6], 0.0))
        row[16], row[17], row[18], row[19] = on_pin[0], on_pin[1], on_pin[2], on_pin[3]
        row[20], row[21], row[22], row[23] = on_piston[0], on_piston[1], on_piston[2], on_piston[3]

        # Crank: the rod's force acts on its pin turned round, with the friction's moment about the pin's centre.
        crank_cos, crank_sin, length = here.crank_cos, here.crank_sin, p.crank_length
        arm, weight_x, weight_y = p.crank_mass_centre, p.crank_mass * p.gravity_x, p.crank_mass * p.gravity_y
        centripetal = p.crank_mass * arm * p.speed**2
        row[24] = (
            length * (crank_cos * on_pin[3] - crank_sin * on_pin[2])
            - on_pin[5]
            - arm * (crank_cos * weight_y - crank_sin * weight_x)
        )
        row[25] = on_piston[3] - p.slider_mass * p.gravity_y
        row[26] = -on_piston[5]
        row[27] = weight_x - on_pin[2] + centripetal * crank_cos
        row[28] = weight_y - on_pin[3] + centripetal * crank_sin
    return seen
