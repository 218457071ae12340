"""Motion of a crank that is prescribed, over time: constant speed, speed fluctuating over the angle, measured angle."""

import math

import numpy as np

from jointgap.dynamics.compilation import compiled
from jointgap.dynamics.model.parameters import CONSTANT, FLUCTUATING, MEASURED, MOTOR


@compiled
def fluctuation(ratio, anomaly):
    """Angle u of u' = n (1 + ratio cos u), of mean rate sqrt(1 - ratio^2) n, when a steady one would be at `anomaly`.

    From tan(u/2) = sqrt((1 + ratio) / (1 - ratio)) tan(anomaly/2), written so that it runs on over the turns; `ratio`
    with its sign turned solves for the anomaly.
    """
    b = ratio / (1.0 + math.sqrt(1.0 - ratio * ratio))
    return anomaly + 2.0 * math.atan2(b * math.sin(anomaly), 1.0 - b * math.cos(anomaly))


@compiled
def crank_motion(p, time):
    """Angle [rad], speed [rad/s] and acceleration [rad/s^2] of a prescribed crank at `time` [s].

    Beyond the ends of a measured angle its first and last pieces go on.
    """
    d = p.drive
    if d.kind == CONSTANT:
        return d.start_angle + d.speed * time, d.speed, 0.0
    if d.kind == FLUCTUATING:
        begin = fluctuation(-d.ratio, d.order * d.start_angle - d.phase)
        rate = d.order * d.speed * math.sqrt(1.0 - d.ratio * d.ratio)
        u = fluctuation(d.ratio, begin + rate * time)
        speed = d.speed * (1.0 + d.ratio * math.cos(u))
        return (u + d.phase) / d.order, speed, -d.speed * d.ratio * d.order * speed * math.sin(u)
    low, high = 0, p.knots.count
    while high - low > 1:
        middle = (low + high) // 2
        if p.knots.pieces[middle, 0] <= time:
            low = middle
        else:
            high = middle
    t = time - p.knots.pieces[low, 0]
    angle = speed = bend = 0.0
    for i in range(1, 7):
        bend = bend * t + 2.0 * speed
        speed = speed * t + angle
        angle = angle * t + p.knots.pieces[low, i]
    return angle, speed, bend


@compiled
def crank_times(p, angles):
    """Times [s] at which a prescribed crank passes `angles` (n,) [rad], growing, the first at the start.

    The end of a measured angle, `p.knots.end`, for those that it does not reach. When a motor's crank passes them only
    the integration can tell: zeros.
    """
    times = np.zeros(angles.size)
    if p.drive.kind == MOTOR:
        return times
    if p.drive.kind == CONSTANT:
        for i in range(angles.size):
            times[i] = (angles[i] - p.drive.start_angle) / p.drive.speed
        return times
    time, longest = 0.0, p.knots.end if p.drive.kind == MEASURED else math.inf
    for i in range(angles.size):
        low, high = time, longest
        for _ in range(200):
            angle, speed, _ = crank_motion(p, time)
            if angle < angles[i]:
                low = time
            else:
                high = time
            following = time - (angle - angles[i]) / speed
            if not low <= following <= high:
                following = 0.5 * (low + high)
            if abs(following - time) <= 4e-16 * abs(time) or following == time:
                break
            time = following
        times[i] = time
    return times
