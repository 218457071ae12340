"""The state a simulation starts from."""

import math
from collections.abc import Collection

import numpy as np

from jointgap.dynamics.model.equations import AUXILIARY_STATES, STATES
from jointgap.dynamics.model.parameters import Parameters
from jointgap.errors import InputError
from jointgap.joints import JOINT, JOINTS


def perturbed_start(vectors: np.ndarray, loose: Collection[str]) -> np.ndarray:
    """Clearance vectors at the start, one start or several: those of `vectors` in loose joints, zero in ideal ones."""
    return np.where(np.repeat([joint in loose for joint in JOINTS], 2), vectors, 0.0)


def start_state(p: Parameters, perturbation=None) -> tuple[np.ndarray, np.ndarray]:
    """State with given clearance vectors, their rates zero; by default the ideal mechanism's positions and
    velocities.
    """
    vectors = np.zeros(4) if perturbation is None else np.asarray(perturbation, dtype=float)
    if vectors.shape not in ((4,), (6,)) or not np.isfinite(vectors).all():
        raise InputError(
            f"perturbation {vectors.tolist()} must be four or six finite lengths in m: r2 x, r2 y, r3 x, r3 y, r1 x, "
            "r1 y"
        )
    vectors = np.append(vectors, np.zeros(6 - vectors.size))
    for joint in JOINT.values():
        length, numbers = math.hypot(*vectors[joint.components]), getattr(p, joint.name)
        if length > 0 and not numbers.loose:
            raise InputError(
                f"perturbation of the {joint.words}: r{joint.number} is {length:g} m, but the joint is ideal; set it "
                "to 0"
            )
        if length >= numbers.clearance:
            raise InputError(
                f"perturbation of the {joint.words}: {length:g} m is not within its clearance of {numbers.clearance:g} "
                "m; a simulation starts out of contact"
            )
    b, d = p.bodies, p.drive
    rise = b.slider_offset + vectors[3] - b.crank_length * math.sin(d.start_angle) - vectors[1] - vectors[5]
    if abs(rise) >= b.rod_length:
        raise InputError(
            f"the rod of {b.rod_length:g} m does not reach the slide {abs(rise):g} m away at crank angle "
            f"{math.degrees(d.start_angle):g} deg; lengthen the rod or shorten the crank"
        )
    y, x = np.zeros(STATES), np.zeros(AUXILIARY_STATES)
    y[:4], x[:2] = vectors[:4], vectors[4:]
    x[2], x[6] = d.start_angle, d.speed
    return y, x
