"""Networks that learn the motion in the loose joints, trained with Levenberg-Marquardt."""

from jointgap.core.schema import CLEARANCE_FIT, FIT, FIT_ERRORS, FIT_HISTORY

OF_NETWORKS = (FIT, FIT_HISTORY, FIT_ERRORS, CLEARANCE_FIT)
"""Tables of a scenario with networks."""
