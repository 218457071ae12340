"""Where effects can act in a mechanism: its bodies and joints by name."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Sites:
    """Bodies and joints of a mechanism.

    Attributes
    ----------
    crank : str
        The driven body.
    drive : str
        Its joint with the frame.
    bodies : tuple of str
        Moving bodies, in the order of the file.
    slides, pivots : mapping of str to str
        Bodies on a slide of the frame, and on a pivot of the frame apart from the crank, with their
        joint.
    tracks : mapping of str to (str, str)
        Slides between moving bodies: carrier and body.
    revolutes : mapping of str to (str, str)
        Revolute joints, with their two bodies.
    links : tuple of str
        Bodies with a length.
    """

    crank: str
    drive: str
    bodies: tuple[str, ...]
    slides: Mapping[str, str] = field(default_factory=dict)
    pivots: Mapping[str, str] = field(default_factory=dict)
    tracks: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    revolutes: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    links: tuple[str, ...] = ()

    def __hash__(self) -> int:
        return hash(repr(self))

    @property
    def output(self) -> str:
        """The output body: the last one on a slide or pivot of the frame, else the last one."""
        held = [body for body in self.bodies if body in self.slides or body in self.pivots]
        return [*self.bodies, *held][-1]

    @property
    def pins(self) -> tuple[str, ...]:
        """Revolute joints of two moving bodies."""
        return tuple(name for name, bodies in self.revolutes.items() if FRAME not in bodies)

    @property
    def bearings(self) -> tuple[str, ...]:
        """Revolute joints whose contact effects may change: of a slider-crank the two pins."""
        return self.pins if self == SLIDER_CRANK else tuple(self.revolutes)


FRAME = "frame"

SLIDER_CRANK = Sites(
    crank="crank",
    drive="crank_pivot",
    bodies=("crank", "rod", "slider"),
    slides={"slider": "guide"},
    revolutes={
        "crank_pivot": (FRAME, "crank"),
        "crank_pin": ("crank", "rod"),
        "piston_pin": ("rod", "slider"),
    },
    links=("crank", "rod"),
)
"""The sites of the short form."""
