"""The transmission angle of a dyad, and the geometry of a linkage as a function of its lengths.

The transmission angle is 90 deg where the dyad drives best, and 0 or 180 deg in its dead points. Of
two bodies joined by a revolute joint it is the angle between their lines at this joint; of a body
whose end slides, that between the body and the normal of the slide; of a block on a pivoted body,
that between the slide and the velocity of the pivoted body's point at the block's pin.
"""

from jointgap.core.errors import InputError, did_you_mean
from jointgap.linkage.topology import Dyad, Linkage


def transmitting(linkage: Linkage, joint: str | None = None) -> Dyad:
    """The dyad with the inner joint of this name; by default the last one."""
    if joint is None:
        return linkage.dyads[-1]
    inner = {dyad.inner.name: dyad for dyad in linkage.dyads}
    if joint not in inner:
        raise InputError(
            f"transmission: '{joint}' does not join two bodies that are driven together;"
            f" {did_you_mean(joint, inner)}"
        )
    return inner[joint]
