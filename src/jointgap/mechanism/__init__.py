"""Geometry and kinematics of the slider-crank with and without clearance: pure functions of arrays.

The frame and the signs: origin at the crank pivot, +x along the slide towards the slider, angles counter-clockwise,
rod angle from +x seen from the crank end. Equation numbers are those of Erkaya and Uzmay, Struct Multidisc Optim 37
(2009) 493-508. Joint 2 is the crank pin, joint 3 the piston pin.
"""

from jointgap.mechanism.clearance import ClearanceMotion, Fit
from jointgap.mechanism.cycle import IdealCycle, ideal_cycle
from jointgap.mechanism.linkage import LinkageMotion, linkage_motion
from jointgap.mechanism.motion import Motion, rotating_vector
from jointgap.mechanism.transmission import clearance_lift, transmission_angle

__all__ = [
    "ClearanceMotion",
    "Fit",
    "IdealCycle",
    "LinkageMotion",
    "Motion",
    "clearance_lift",
    "ideal_cycle",
    "linkage_motion",
    "rotating_vector",
    "transmission_angle",
]
