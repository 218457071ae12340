"""Motion of a slider-crank with clearance joints: contact, friction, equations of motion, events, integration.

`simulate` gives one motion with everything there is to see of it; `simulate_ensemble` many, states alone.
"""

from jointgap.dynamics.contact import LAWS, delivered_restitution
from jointgap.dynamics.simulate import Ensemble, Trajectory, simulate, simulate_ensemble

__all__ = ["LAWS", "Ensemble", "Trajectory", "delivered_restitution", "simulate", "simulate_ensemble"]
