"""The state a simulation starts from."""

import math

import numpy as np

from jointgap.dynamics.parameters import Parameters
from jointgap.errors import InputError


def start_state(p: Parameters, perturbation=None) -> np.ndarray:
    """State with given clearance vectors whose rates are zero: by default the ideal mechanism's positions and velocities.

    Parameters
    ----------
    p : Parameters
    perturbation : (4,) array_like, optional
        Clearance vectors r2 x, r2 y, r3 x, r3 y [m]; zero by default.

    Returns
    -------
    (8,) array
        See `jointgap.dynamics.equations`.

    Raises
    ------
    InputError
        Clearance vectors of another shape, not finite or as long as the clearance; a rod that does not reach the slide.
    """
    vectors = np.zeros(4) if perturbation is None else np.asarray(perturbation, dtype=float)
    if vectors.shape != (4,) or not np.isfinite(vectors).all():
        raise InputError(f"perturbation {vectors.tolist()} must be four finite lengths: r2 x, r2 y, r3 x, r3 y in m")
    pin_x, pin_y, piston_x, piston_y = (float(component) for component in vectors)
    for joint, length, clearance in (
        ("crank pin", math.hypot(pin_x, pin_y), p.crank_pin.clearance),
        ("piston pin", math.hypot(piston_x, piston_y), p.piston_pin.clearance),
    ):
        if length >= clearance:
            raise InputError(
                f"perturbation of the {joint}: {length:g} m is not within its clearance of {clearance:g} m; "
                "a simulation starts out of contact"
            )
    rod_length = p.rod_to_crank_end + p.rod_to_piston_end
    crank_cos, crank_sin = math.cos(p.start_angle), math.sin(p.start_angle)
    end_x, end_y = p.crank_length * crank_cos + pin_x, p.crank_length * crank_sin + pin_y
    rise = p.slider_offset + piston_y - end_y
    if abs(rise) >= rod_length:
        raise InputError(
            f"the rod of {rod_length:g} m does not reach the slide {abs(rise):g} m away at crank angle "
            f"{math.degrees(p.start_angle):g} deg; lengthen the rod or shorten the crank"
        )
    rod_angle = math.asin(rise / rod_length)
    rod_cos, rod_sin = math.cos(rod_angle), math.sin(rod_angle)
    end_vx, end_vy = -p.crank_length * p.speed * crank_sin, p.crank_length * p.speed * crank_cos
    rate = -end_vy / (rod_length * rod_cos)
    arm = p.rod_to_crank_end
    return np.array(
        [
            end_x + arm * rod_cos,
            end_y + arm * rod_sin,
            rod_angle,
            end_x + rod_length * rod_cos - piston_x,
            end_vx - arm * rate * rod_sin,
            end_vy + arm * rate * rod_cos,
            rate,
            end_vx - rod_length * rate * rod_sin,
        ]
    )
