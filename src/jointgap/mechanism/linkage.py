"""Positions, velocities and accelerations of the links, equations (2)-(10) and (13)-(21).

One set of formulae serves both forms. Handed the whole clearance motion it is exact; handed
`ClearanceMotion.paper_form`, in which the lengths of the clearance vectors stand still, it is the chain rule that
equations (6)-(9) write out as sums of partial derivatives by the crank angle, gamma2 and gamma3, mixed terms included.
"""

from dataclasses import dataclass

import numpy as np

from jointgap.config import Mechanism
from jointgap.mechanism.clearance import ClearanceMotion
from jointgap.mechanism.motion import Motion, rotating_vector
from jointgap.mechanism.transmission import check_reach


@dataclass(frozen=True)
class LinkageMotion:
    """Motion of the three moving links; every array has the shape (n,) of the crank angles."""

    crank_x: Motion  # Crank's mass centre G2 [m], equation (2), moved by the clearance of the crank pivot
    crank_y: Motion  # Crank's mass centre G2 [m], equation (2), moved by the clearance of the crank pivot
    rod_x: Motion  # Rod's mass centre G3 [m], equations (3), (14)
    rod_y: Motion  # Rod's mass centre G3 [m], equations (3), (14)
    slider_x: Motion  # Slider's pin centre G4 [m], equations (4), (15); slider_y is the slide's offset up to rounding
    slider_y: Motion  # Slider's pin centre G4 [m], equations (4), (15); slider_y is the slide's offset up to rounding
    rod_angle: Motion  # theta3 [rad], equations (5), (8), (9)
    transmission_angle: Motion  # mu [rad], equation (10)


def linkage_motion(
    mechanism: Mechanism, crank_angle: Motion, clearance: ClearanceMotion | None = None
) -> LinkageMotion:
    """Motion of the slider-crank from that of its crank and its clearances."""
    crank, rod = mechanism.crank, mechanism.rod
    pin_x, pin_y = rotating_vector(Motion.of(crank.length), crank_angle)
    crank_x, crank_y = rotating_vector(Motion.of(crank.mass_centre), crank_angle)
    beside_x, beside_y = rotating_vector(Motion.of(crank.mass_centre_across), crank_angle)  # turned by 90 deg
    clearance = ClearanceMotion() if clearance is None else clearance
    pivot_x, pivot_y = clearance.crank_pivot_vector()
    step_x, step_y = clearance.crank_pin_vector()
    head_x, head_y = clearance.piston_pin_vector()
    foot_x, foot_y = pivot_x + pin_x + step_x, pivot_y + pin_y + step_y

    # The slider stays on its line: the rod comes down by its foot's height above the slider less the vector B -> B'.
    height = foot_y - head_y - Motion.of(mechanism.slider.offset)
    rod_angle = _falling_rod(height, rod.length, crank_angle.position)
    rod_length = Motion.of(rod.length)
    along_x, along_y = rotating_vector(rod_length, rod_angle)
    centre_x, centre_y = rotating_vector(Motion.of(rod.mass_centre), rod_angle)
    return LinkageMotion(
        crank_x=pivot_x + crank_x - beside_y,
        crank_y=pivot_y + crank_y + beside_x,
        rod_x=foot_x + centre_x,
        rod_y=foot_y + centre_y,
        slider_x=foot_x + along_x - head_x,
        slider_y=foot_y + along_y - head_y,
        rod_angle=rod_angle,
        transmission_angle=Motion(np.arccos(height.position / rod.length), rod_angle.velocity, rod_angle.acceleration),
    )


def _falling_rod(height: Motion, rod_length: float, crank_angle: np.ndarray) -> Motion:
    """Angle of a rod that spans a falling height: L3 sin theta3 = -height, differentiated twice."""
    check_reach(height.position / rod_length, crank_angle, rod_length)
    angle = np.arcsin(-height.position / rod_length)
    lever = rod_length * np.cos(angle)
    velocity = -height.velocity / lever
    return Motion(angle, velocity, -height.acceleration / lever + velocity**2 * np.tan(angle))
