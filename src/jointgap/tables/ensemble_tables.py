"""Tables of ensembles and of what a small change grows to."""

from collections.abc import Iterable

from jointgap.core.joints import JOINTS
from jointgap.tables.columns import Column, Table
from jointgap.tables.simulate_tables import EVENTS

_RUN = Column("run", "1", "number of the run, from 0", "int")
_VECTORS = (
    *(
        ("r2", "crank pin", "the crank's pin to the rod's end"),
        ("r3", "piston pin", "the slider's pin to the rod's end"),
    ),
    ("r1", "crank pivot", "the frame's centre to the crank's"),
)

ENSEMBLE_SAMPLES = Table(
    "ensemble_samples",
    "States of all runs at their samples; everything else follows from them",
    (
        _RUN,
        Column("time", "s", "time since the start"),
        Column("crank_angle", "rad", "crank angle theta2, running on over revolutions"),
        Column("crank_speed", "rad/s", "first time derivative of the crank angle"),
        *(
            Column(f"{symbol}_{axis}", "m", f"clearance vector of the {joint}, from {ends}, {axis}; 0 where ideal")
            for symbol, joint, ends in _VECTORS
            for axis in "xy"
        ),
        *(
            Column(f"{symbol}_{axis}_dot", "m/s", f"first time derivative of {symbol}_{axis}")
            for symbol, _, _ in _VECTORS
            for axis in "xy"
        ),
        Column("rod_deflection", "m", "deflection of the rod at midspan; 0 where it is rigid"),
        Column("rod_deflection_dot", "m/s", "first time derivative of rod_deflection"),
        *(
            Column(
                f"{joint}_bristle", "m", f"deflection of the bristles in the {joint.replace('_', ' ')}; 0 but for lugre"
            )
            for joint in JOINTS
        ),
        Column("rod_angle", "rad", "angle theta3 of the rod from +x, crank end to piston end"),
        Column("slider_position", "m", "position of the slider's pin along x"),
        *(
            Column(f"{joint}_mode", "", "ideal, flight, impact (the journal hits and rebounds) or contact", "category")
            for joint in JOINTS
        ),
    ),
)

ENSEMBLE_EVENTS = Table(
    "ensemble_events",
    "Beginnings and ends of contact in the joints of all runs",
    (
        _RUN,
        *(
            Column(column.name, column.unit, column.description, "category", column.nullable)
            if column.kind == "text"
            else column
            for column in EVENTS.columns
        ),
    ),
)


def ensemble_runs(varied: Iterable[Column]) -> Table:
    """The table of runs, with a column for each value that is varied."""
    return Table(
        "ensemble_runs",
        "Runs of an ensemble: what they differ in and what became of them",
        (
            _RUN,
            *varied,
            *(
                Column(f"start_{symbol}_{axis}", "m", f"clearance vector of the {joint} at the start, {axis}")
                for symbol, joint, _ in _VECTORS
                for axis in "xy"
            ),
            Column("samples", "1", "samples; 0 where the run failed", "int"),
            Column("events", "1", "beginnings and ends of contact", "int"),
            Column("steps", "1", "integration steps, rejected ones included", "int"),
            Column("reason", "", "why the run failed; null where it did not", "text", nullable=True),
        ),
    )


GROWTH = Table(
    "growth",
    "How a small change of the start grows",
    (
        Column("crank_angle", "rad", "crank angle theta2, running on over revolutions"),
        Column("median", "1", "distance of the clearance vectors over that at the start, median of the changes"),
        Column("low", "1", "the same, of the change that grows least at this angle"),
        Column("high", "1", "the same, of the change that grows most at this angle"),
    ),
)
