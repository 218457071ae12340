"""The three revolute joints of a slider-crank and defaults of their contacts.

A joint's clearance vector r points from the centre of its partner to the centre of its body. The
joint's force acts on its body, and the opposite force on its partner."""

from collections.abc import Iterable
from typing import NamedTuple


class RevoluteJoint(NamedTuple):
    name: str  # Key in mechanism files and prefix of column names
    # The paper's number: its clearance vector has the length r<number> and the direction
    # gamma<number>
    number: int
    index: int  # In the clearance vectors of a start
    partner: str  # Body at the beginning of its clearance vector
    body: str  # Body at the end of its clearance vector

    @property
    def words(self) -> str:
        """Label: crank pin."""
        return self.name.replace("_", " ")

    @property
    def components(self) -> slice:
        """Its components in a start r2 x, r2 y, r3 x, r3 y, r1 x, r1 y."""
        return slice(2 * self.index, 2 * self.index + 2)


JOINT = {
    joint.name: joint
    for joint in (
        RevoluteJoint("crank_pin", 2, 0, "crank", "rod"),
        RevoluteJoint("piston_pin", 3, 1, "slider", "rod"),
        RevoluteJoint("crank_pivot", 1, 2, "frame", "crank"),
    )
}
"""The joints by name, in the order of a start."""

JOINTS = tuple(JOINT)
"""Their names in this order: first the pins."""

FROM_FRAME = tuple(sorted(JOINTS, key=lambda name: JOINT[name].number))
"""Names by the paper's numbers, from the frame to the slider."""

PINS = tuple(name for name in JOINTS if JOINT[name].body == "rod")
"""Names of the two joints at the ends of the rod."""

JOINT_NUMBERS = {name: JOINT[name].number for name in FROM_FRAME}
"""The paper's numbers, used in column names: r2 is the clearance of the crank pin."""

REFERENCE_APPROACH_SPEED = 0.05
"""Default approach speed [m/s] that determines the damping of a lasting contact."""


def outputs(loose: Iterable[str]) -> tuple[str, ...]:
    """Outputs of the networks for the joints `loose`: columns of the trajectory, in the paper's
    order; none for joints of general linkages."""
    numbers = sorted(JOINT_NUMBERS[joint] for joint in loose if joint in JOINT)
    names = ("r{}", "gamma{}", "gamma{}_dot", "gamma{}_ddot")
    return tuple(name.format(number) for name in names for number in numbers)


def number_of(output: str) -> int:
    """Number of the joint of an output: 2 for gamma2_dot."""
    return int(output.partition("_")[0][-1])


OUTPUTS = outputs(PINS)
"""The eight outputs of the paper, with loose pins."""
