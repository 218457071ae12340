"""Motion of linkages with clearance joints: events, integration, samples.

`simulate` returns one motion with all quantities; `simulate_ensemble` many motions from different
starts.
"""

from jointgap.contact.normal_force import LAWS, delivered_restitution
from jointgap.motion.parallel import simulate_ensemble
from jointgap.motion.simulation import Trajectory
from jointgap.motion.slider_crank import simulate

__all__ = ["LAWS", "Trajectory", "delivered_restitution", "simulate", "simulate_ensemble"]
