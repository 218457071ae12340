"""The ideal motion of a mechanism: without clearance, gravity and other loads, at constant crank
speed."""

from dataclasses import replace
from math import pi, tau

import numpy as np

from jointgap.config import Mechanism
from jointgap.config.channels import channel_kinds
from jointgap.config.linkage_file import LinkageFile
from jointgap.linkage.assembly import ON_ARRAYS, signs_of
from jointgap.linkage.compiled import channels_of
from jointgap.linkage.equations import Crank, Dynamics, Pose
from jointgap.linkage.from_file import linkage_of_file, linkage_of_slider_crank
from jointgap.linkage.topology import linkage_of


def ideal_channels(
    mechanism: Mechanism | LinkageFile, angle: np.ndarray, speed: float
) -> dict[str, np.ndarray]:
    """Channels (n,) of the ideal motion at crank angles (n,) [rad], by inverse dynamics of rigid
    bodies; angles of bodies between -pi and pi."""
    is_linkage = isinstance(mechanism, LinkageFile)
    linkage = (linkage_of_file if is_linkage else linkage_of_slider_crank)(mechanism)
    joints = [replace(joint, loose=False) for joint in linkage.joints.values()]
    linkage = linkage_of([*linkage.bodies.values()], joints, linkage.drive)
    crank = Crank(np.cos(angle), np.sin(angle), speed, 0.0)
    signs = signs_of(linkage, 0.0)
    motion = Dynamics(Pose(linkage, signs, crank, {}, ON_ARRAYS), {})
    numbers = channels_of(motion, {}, {}, {})
    found = {name: value + np.zeros(np.shape(angle)) for name, (value, _) in numbers.items()}
    for name in [name for name in found if name.endswith("_cosine")]:
        body = name.removesuffix("_cosine")
        found[f"{body}_angle"] = np.arctan2(found.pop(f"{body}_sine"), found.pop(name))
    return {name: found[name] for name in channel_kinds(mechanism.sites) if name in found}


def ideal_orders(
    mechanism: Mechanism | LinkageFile, speed: float, orders: int, points: int = 360
) -> dict[str, np.ndarray]:
    """The low orders of `ideal_channels`: (orders,) complex C, where the channel is Re sum C_k
    exp(i k angle); without angles that pass pi, as readings of them may begin anywhere."""
    angle = np.arange(points) * (tau / points)
    channels = ideal_channels(mechanism, angle, speed)
    return {
        name: 2.0 * np.fft.rfft(values)[1 : orders + 1] / points
        for name, values in channels.items()
        if not name.endswith("_angle") or np.abs(np.diff(values, append=values[0])).max() < pi
    }
