"""Networks that learn the motion in the loose joints, trained with Levenberg-Marquardt."""

from jointgap.core.schema import FIT, FIT_ERRORS, FIT_HISTORY

OF_NETWORKS = (FIT, FIT_HISTORY, FIT_ERRORS)
"""Tables of a scenario with networks."""
