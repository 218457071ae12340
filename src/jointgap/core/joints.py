"""The three revolute joints of a slider-crank: the only list of them, and what their contacts have by default.

A joint's clearance vector r points from the centre of its partner to the centre of its body; the joint's force acts on
its body, and the opposite one on its partner."""

from collections.abc import Iterable
from typing import NamedTuple


class RevoluteJoint(NamedTuple):
    """One joint."""

    name: str  # Its key in mechanism files and its prefix in names of columns
    number: int  # The paper's number: its clearance vector has the length r<number> and the direction gamma<number>
    index: int  # Its place in everything compiled, and in the clearance vectors of a start
    partner: str  # The bodies at which its clearance vector begins and ends
    body: str  # The bodies at which its clearance vector begins and ends

    @property
    def words(self) -> str:
        """Its name in a sentence: crank pin."""
        return self.name.replace("_", " ")

    @property
    def components(self) -> slice:
        """Where the start of a simulation, r2 x, r2 y, r3 x, r3 y, r1 x, r1 y, holds its clearance vector."""
        return slice(2 * self.index, 2 * self.index + 2)


JOINT = {
    joint.name: joint
    for joint in (
        RevoluteJoint("crank_pin", 2, 0, "crank", "rod"),
        RevoluteJoint("piston_pin", 3, 1, "slider", "rod"),
        RevoluteJoint("crank_pivot", 1, 2, "frame", "crank"),
    )
}
"""The joints by name, in compiled order."""

JOINTS = tuple(JOINT)
"""Names in compiled order: the pins, whose clearances are always states, come first."""

FROM_FRAME = tuple(sorted(JOINTS, key=lambda name: JOINT[name].number))
"""Names by the paper's numbers, which is from the frame to the slider."""

PINS = tuple(name for name in JOINTS if JOINT[name].body == "rod")
"""Names of the two joints at the ends of the rod."""

JOINT_NUMBERS = {name: JOINT[name].number for name in FROM_FRAME}
"""The paper's numbers, which name the columns of tables: r2 is the clearance of the crank pin."""

REFERENCE_APPROACH_SPEED = 0.05
"""Approach speed [m/s] as whose impact a contact that lasts is damped where nothing else is said."""


def outputs(loose: Iterable[str]) -> tuple[str, ...]:
    """What networks learn of the joints `loose`, by column of the trajectory, in the paper's order."""
    numbers = sorted(JOINT_NUMBERS[joint] for joint in loose)
    names = ("r{}", "gamma{}", "gamma{}_dot", "gamma{}_ddot")
    return tuple(name.format(number) for name in names for number in numbers)


def number_of(output: str) -> int:
    """Number of the joint that an output belongs to: 2 for gamma2_dot."""
    return int(output.partition("_")[0][-1])


OUTPUTS = outputs(PINS)
"""The eight outputs of the paper, whose pins are loose."""
