"""Magnitudes of the motion of a mechanism, which set the steps of a fit."""

import math
from typing import Any

import numpy as np

from jointgap.config import Mechanism
from jointgap.effects.base import DETECTABLE_SHARE, MotionScale
from jointgap.linkage.assembly import ideal_pose, signs_of
from jointgap.linkage.from_file import linkage_of_file
from jointgap.motion.effects import crank_radius

_ANGLES = 360  # Per revolution
_GUIDE_SHARE = 0.3  # [1] Force across a slide over the inertia force along it


def motion_scales(mechanism: Any, turning: float) -> tuple[MotionScale, dict[str, MotionScale]]:
    """Magnitudes of the motion at the crank speed `turning` [rad/s]: of the mechanism, and by body
    where they differ.

    Of a slider-crank in closed form; else from the kinetic energy over one ideal revolution, whose
    power is that of the inertia forces.
    """
    if isinstance(mechanism, Mechanism):
        return MotionScale.of(mechanism, turning), {}
    file = mechanism.applied()
    linkage, sites = linkage_of_file(file), file.sites
    angles = np.arange(_ANGLES) * (math.tau / _ANGLES)
    pose = ideal_pose(linkage, signs_of(linkage, 0.0), angles)  # speeds over that of the crank
    energy = np.zeros(_ANGLES)
    for name in linkage.moving:
        body, (vx, vy) = linkage.bodies[name], pose.point(name, None)[1]
        energy += 0.5 * (body.mass * (vx**2 + vy**2) + body.inertia * pose.speeds[name] ** 2)
    orders = np.fft.rfft(energy)
    torque = np.fft.irfft(1j * np.arange(orders.size) * orders, _ANGLES) * turning**2
    inertial, radius = _rms(torque), crank_radius(linkage)
    barely = DETECTABLE_SHARE * inertial
    crank = MotionScale(
        radius, radius * turning / math.sqrt(2.0), turning, barely / radius, inertial / radius, 0.0
    )
    scales = {}
    slides = {**sites.slides, **{name: name for name in sites.tracks}}
    for body, name in {**slides, **sites.pivots}.items():
        place, rate = (np.broadcast_to(x, angles.shape) for x in pose.travel(linkage.joints[name]))
        speed, half = _rms(rate), 0.5 * float(np.ptp(place))
        middle = float(np.min(place)) + half
        if body in sites.pivots:
            force = barely / max(speed, 1e-9) / radius
            scales[body] = MotionScale(
                radius, crank.speed, speed * turning, force, force, middle, half
            )
        else:
            force = inertial / max(speed, 1e-9)
            scales[body] = MotionScale(
                half,
                speed * turning,
                turning,
                DETECTABLE_SHARE * force,
                _GUIDE_SHARE * force,
                middle,
            )
    return crank, scales


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
