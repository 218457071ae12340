"""LSODA (numbalsoda: `scripts/get-lsoda`) in compiled code on the package's right-hand side, from
event to event.

LSODA cannot be stopped at an event from outside. So it runs through a stretch of time and reports
on a grid; where a penetration has changed its sign between two points, it starts anew at the first
of them with the penetration in place of the time as independent variable, and ends on its zero. The
next stretch starts there. Stretches begin short after an event and grow while nothing happens.
Their lengths here are those with which a revolution took least time.
"""

import numba
import numpy as np

from jointgap.contact.joints import CONTACT, FLIGHT

POINTS = 33
FIRST_STRETCH, LONGEST_STRETCH, GROWTH = 1e-4, 4e-4, 2.0  # s
MOST_STEPS = 100_000


def compiled_lsoda(slope, gap, count=2):
    """A compiled function `(z, end, tolerance) -> z` from a scaled state (4 n,) in flight at time 0
    to the one at `end` [s].

    Parameters
    ----------
    slope, gap
        See `benchmarks.right_hand_side`.
    count : int
        Number of loose joints, n.

    Raises
    ------
    ImportError
        numbalsoda is not installed.
    """
    from numbalsoda import lsoda, lsoda_sig

    size, way_to = 4 * count, 2 * count  # places of the time, and of the joint whose event is next

    @numba.cfunc(lsoda_sig)
    def over(variable, z_at, out_at, frozen_at):
        """Rates of state and time over the time or, with frozen[2 n] = 1 + joint, over the way to
        that joint's event [m]. Before it stand modes and approach speeds."""
        z, out = numba.carray(z_at, size + 1), numba.carray(out_at, size + 1)
        frozen = numba.carray(frozen_at, way_to + 1)
        slope(z[size], z, out, frozen[:count], frozen[count:way_to])
        out[size] = 1.0
        if frozen[way_to] > 0:
            rate = abs(gap(z, int(frozen[way_to]) - 1)[1])
            for i in range(size + 1):
                out[i] /= rate

    address = over.address

    @numba.njit
    def crossing(seen, frozen):
        """First point of the grid beyond a change of sign, and the joint (-1: none)."""
        for i in range(1, len(seen)):
            found, first = -1, 2.0
            for joint in range(count):
                before, after = gap(seen[i - 1], joint)[0], gap(seen[i], joint)[0]
                crossed = after > 0 if frozen[joint] == FLIGHT else after < 0
                share = before / (before - after) if before != after else 0.0
                if crossed and share < first:
                    found, first = joint, share
            if found >= 0:
                return i, found
        return len(seen) - 1, -1

    @numba.njit
    def run(start, end, tolerance):
        z, frozen = np.zeros(size + 1), np.zeros(way_to + 1)
        z[:size] = start
        frozen[:count], frozen[count:way_to] = FLIGHT, np.inf
        stretch = FIRST_STRETCH
        while z[size] < end:
            times = np.linspace(z[size], min(z[size] + stretch, end), POINTS)
            seen, good = lsoda(address, z, times, frozen, 0.0, tolerance, MOST_STEPS)
            if not good:
                raise RuntimeError("LSODA cannot go on")
            place, joint = crossing(seen, frozen)
            if joint < 0:
                z = seen[-1].copy()
                z[size] = times[-1]
                stretch = min(GROWTH * stretch, LONGEST_STRETCH)
                continue
            z, way = seen[place - 1].copy(), abs(gap(seen[place - 1], joint)[0])
            if way > 0.0:
                frozen[way_to] = joint + 1
                seen, good = lsoda(
                    address, z, np.array([-way, 0.0]), frozen, 0.0, tolerance, MOST_STEPS
                )
                z, frozen[way_to] = seen[-1].copy(), 0.0
            if frozen[joint] == FLIGHT:
                frozen[joint], frozen[count + joint] = CONTACT, gap(z, joint)[1]
            else:
                frozen[joint], frozen[count + joint] = FLIGHT, np.inf
            stretch = FIRST_STRETCH
        return z[:size]

    return run
