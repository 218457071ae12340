"""Motion of a slider-crank with clearance joints: contact, friction, equations of motion, events, integration.

`simulate` gives one motion with everything there is to see of it.
"""

from jointgap.dynamics.contact import LAWS, delivered_restitution
from jointgap.dynamics.simulate import Trajectory, simulate

__all__ = ["LAWS", "Trajectory", "delivered_restitution", "simulate"]
