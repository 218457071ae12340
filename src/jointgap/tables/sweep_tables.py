"""Table of a sweep: a row a design."""

from collections.abc import Iterable

from jointgap.joints import JOINT
from jointgap.tables.columns import Column, Table
from jointgap.tables.study_tables import NOISE_ORDER

_ERROR = "of the ideal transmission angle less the simulated one"
_SIZES = {"rms": "root of the mean square", "mean": "mean size", "peak": "largest size"}
_SPANS = {"": "the last revolution", "_in_window": "the window of the first revolution"}

MEASURES = (
    *(
        Column(f"angle_error_{size}{suffix}", "rad", f"{words} {_ERROR}, over {span}", nullable=True)
        for suffix, span in _SPANS.items()
        for size, words in _SIZES.items()
    ),
    Column(
        "least_transmission_angle",
        "rad",
        "smallest angle between the rod and the direction across the slide, in the last revolution",
        nullable=True,
    ),
    Column("stroke", "m", "largest less smallest slider position in the last revolution", nullable=True),
    Column("outer_dead_centre", "rad", "crank angle at which the slider is farthest out", nullable=True),
    Column("inner_dead_centre", "rad", "crank angle at which the slider is nearest", nullable=True),
    Column("acceleration_rms", "m/s^2", "RMS of the slider's acceleration in the last revolution", nullable=True),
    Column(
        "noise_share",
        "1",
        f"RMS of the slider's acceleration above order {NOISE_ORDER}, over its whole RMS",
        nullable=True,
    ),
    Column(
        "repeat_distance",
        "1",
        "largest distance of the clearance vectors in the last revolution from those in the one before, as a share of "
        "the smallest clearance: 0 where the motion repeats",
        nullable=True,
    ),
    *(
        column
        for name, joint in JOINT.items()
        for column in (
            Column(f"{name}_peak_force", "N", f"largest normal force in the {joint.words}", nullable=True),
            Column(f"{name}_rms_force", "N", f"RMS of the normal force in the {joint.words}", nullable=True),
            Column(
                f"{name}_contact_share",
                "1",
                f"share of the time in which the journal of the {joint.words} touches its bearing; null where ideal",
                nullable=True,
            ),
            Column(
                f"{name}_impacts",
                "1",
                f"contacts that begin in the {joint.words} in the last revolution; null where ideal",
                nullable=True,
            ),
        )
    ),
)
"""What is measured of each design; over the last revolution unless it says otherwise."""


def sweep_designs(swept: Iterable[Column]) -> Table:
    """The table of designs, with a column for each parameter that is swept."""
    return Table(
        "sweep_designs",
        "Designs of a sweep: what they differ in, what was measured of them, and why some failed",
        (
            Column("design", "1", "number of the design, from 0", "int"),
            *swept,
            *MEASURES,
            Column("steps", "1", "integration steps, rejected ones included; 0 where it failed", "int"),
            Column("reason", "", "why the design failed; null where it did not", "text", nullable=True),
        ),
    )
