"""What every channel of a rig would read of rigid links without clearance and friction, at a steadily turning crank."""

from math import tau

import numpy as np

from jointgap.config import Mechanism
from jointgap.mechanism.linkage import linkage_motion
from jointgap.mechanism.motion import Motion

SPEED_POWERS = {
    "slider_position": 0,
    "rod_angle": 0,
    "slider_velocity": 1,
    "rod_angular_velocity": 1,
    "slider_acceleration": 2,
    "rod_acceleration_x": 2,
    "rod_acceleration_y": 2,
    "crank_torque": 2,
    "guide_force": 2,
    "frame_force_x": 2,
    "frame_force_y": 2,
}
"""With which power of the crank's speed each channel of the ideal motion grows."""

FORCES = ("crank_torque", "guide_force", "frame_force_x", "frame_force_y")
"""Channels that loads and friction change; the others follow from the geometry."""


def ideal_channels(mechanism: Mechanism, angle: np.ndarray, speed: float) -> dict[str, np.ndarray]:
    """Channels of the ideal motion by inverse dynamics of the rigid links, without gravity and other loads."""
    crank, rod, slider = mechanism.crank, mechanism.rod, mechanism.slider
    still = np.zeros(np.shape(angle))
    motion = linkage_motion(mechanism, Motion.of(angle, still + speed, still))
    turning = motion.rod_angle
    along = np.cos(turning.position), np.sin(turning.position)
    back, ahead = rod.mass_centre, rod.length - rod.mass_centre  # from the rod's mass centre to its pins
    inertia_x, inertia_y = rod.mass * motion.rod_x.acceleration, rod.mass * motion.rod_y.acceleration
    # forces on the rod: (head_x, head_y) at the piston pin, (foot_x, foot_y) at the crank pin
    head_x = -slider.mass * motion.slider_x.acceleration
    foot_x = inertia_x - head_x
    # moment about the mass centre, with foot_y = inertia_y - head_y
    moment = rod.inertia * turning.acceleration
    head_y = (moment + along[1] * (ahead * head_x - back * foot_x) + back * along[0] * inertia_y) / (
        rod.length * along[0]
    )
    foot_y = inertia_y - head_y
    power = (
        inertia_x * motion.rod_x.velocity
        + inertia_y * motion.rod_y.velocity
        + moment * turning.velocity
        - head_x * motion.slider_x.velocity
    )
    return {
        "slider_position": motion.slider_x.position,
        "rod_angle": turning.position,
        "slider_velocity": motion.slider_x.velocity,
        "rod_angular_velocity": turning.velocity,
        "slider_acceleration": motion.slider_x.acceleration,
        "rod_acceleration_x": motion.rod_x.acceleration,
        "rod_acceleration_y": motion.rod_y.acceleration,
        "crank_torque": power / speed,
        "guide_force": head_y,
        "frame_force_x": -(crank.mass * motion.crank_x.acceleration + foot_x),
        "frame_force_y": -(crank.mass * motion.crank_y.acceleration + foot_y),
    }


def ideal_orders(mechanism: Mechanism, speed: float, orders: int, points: int = 360) -> dict[str, np.ndarray]:
    """The low orders of `ideal_channels` over a turn: (orders,) complex C, the channel being Re sum C_k exp(i k
    angle).
    """
    angle = np.arange(points) * (tau / points)
    channels = ideal_channels(mechanism, angle, speed)
    return {name: 2.0 * np.fft.rfft(values)[1 : orders + 1] / points for name, values in channels.items()}
