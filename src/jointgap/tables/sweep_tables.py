"""Table of a sweep: a row a design."""

from collections.abc import Iterable

from jointgap.core.joints import JOINT
from jointgap.tables.columns import Column, Table

NOISE_ORDER = 10
"""Order from which on the slider's acceleration counts as noise: the ideal mechanism's has died away far below it."""

_ERROR = "error of the transmission angle (ideal less simulated)"
_SIZES = {"rms": "RMS", "mean": "mean size", "peak": "largest size"}
_SPANS = {"": "last revolution", "_in_window": "window of the first revolution"}

MEASURES = (
    *(
        Column(f"angle_error_{size}{suffix}", "rad", f"{_ERROR}: {words}, {span}", nullable=True)
        for suffix, span in _SPANS.items()
        for size, words in _SIZES.items()
    ),
    Column(
        "least_transmission_angle",
        "rad",
        "smallest transmission angle",
        nullable=True,
    ),
    Column("stroke", "m", "stroke", nullable=True),
    Column("outer_dead_centre_angle", "rad", "outer dead centre: crank angle, -pi to pi", nullable=True),
    Column("inner_dead_centre_angle", "rad", "inner dead centre: crank angle, 0 to 2 pi", nullable=True),
    Column("acceleration_rms", "m/s^2", "RMS of the slider's acceleration", nullable=True),
    Column(
        "noise_share",
        "1",
        f"RMS of the slider's acceleration above order {NOISE_ORDER}, over its whole RMS",
        nullable=True,
    ),
    Column(
        "repeat_distance",
        "1",
        "distance of the clearance vectors from those a revolution before, largest, over the smallest clearance",
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
                f"share of the time in contact, {joint.words}; null where ideal",
                nullable=True,
            ),
            Column(
                f"{name}_impacts",
                "1",
                f"contacts that begin in a revolution, {joint.words}; null where ideal",
                nullable=True,
            ),
        )
    ),
)
"""What is measured of each design; over the last revolution unless it says otherwise."""

_BEST = "where the RMS of the transmission angle's error is least, the rod's length and the joints' motion kept"

BEST_LENGTHS = tuple(
    Column(f"{name}{suffix}", unit, f"{words}, {span}", nullable=True)
    for suffix, span in _SPANS.items()
    for name, unit, words in (
        ("best_crank_length", "m", f"crank's length {_BEST}"),
        ("best_ratio", "1", f"crank's over rod's length {_BEST}"),
        (
            "reduction_at_best",
            "1",
            "share by which the RMS of the transmission angle's error falls at the best crank length",
        ),
    )
)
"""The best lengths of a design by the paper's method: optima lie in a valley of one ratio, so its rod is kept."""

PRINTED_OPTIMA = tuple(
    Column(
        f"reduction_at_{key}",
        "1",
        f"share by which the error falls at the paper's lengths ({words}), the joints' motion kept",
        nullable=True,
    )
    for key, words in {
        "printed_genetic": "genetic algorithm",
        "printed_local": "local search, best start",
        "printed_local_other": "local search, another start",
    }.items()
)
"""What the paper's printed optima come out as; the error counted in the window, by the measure and over the revolution
of the design. Over these its best lengths in the window are sought then too.
"""

ALL_MEASURES = (*MEASURES, *BEST_LENGTHS, *PRINTED_OPTIMA)
"""What can be measured of a design."""


def measured(best_lengths: bool, printed_numbers: bool) -> tuple[Column, ...]:
    """What is measured of each design of a sweep."""
    return (
        *MEASURES,
        *(BEST_LENGTHS if best_lengths or printed_numbers else ()),
        *(PRINTED_OPTIMA if printed_numbers else ()),
    )


def sweep_designs(swept: Iterable[Column], measured: Iterable[Column]) -> Table:
    """The table of designs, with a column for each parameter that is `swept` and each of `ALL_MEASURES` that is
    `measured`.
    """
    return Table(
        "sweep_designs",
        "Designs of a sweep: what they differ in, what was measured of them, and why some failed",
        (
            Column("design", "1", "number of the design, from 0", "int"),
            *swept,
            *measured,
            Column("steps", "1", "integration steps, rejected ones included; 0 where it failed", "int"),
            Column("reason", "", "why the design failed; null where it did not", "text", nullable=True),
        ),
    )
