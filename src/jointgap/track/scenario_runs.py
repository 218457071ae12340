"""What is worth tracking of each stage: from tables to records, one module a stage."""

from collections.abc import Sequence
from pathlib import Path

from jointgap.track import comparison_runs as compare
from jointgap.track import figure_runs as pictures
from jointgap.track import kinematics_runs as kinematics
from jointgap.track import optimise_runs as optimise
from jointgap.track import simulate_runs as simulate
from jointgap.track import surrogate_runs as surrogate
from jointgap.track.finished_tables import Given, Tables
from jointgap.track.run_record import Record
from jointgap.track.stage_costs import read_costs


def records(options, tables: Tables, figures: Sequence[Path], benchmarks: Sequence[Path]) -> list[Record]:
    """The runs that one scenario's finished tables make, a stage's own run before those nested in it.

    Parameters
    ----------
    options : Scenario
    tables : mapping of str to Path
        Parquet files by ``table`` or ``table/output``. A stage whose tables are missing makes no run.
    figures, benchmarks : sequence of Path

    Raises
    ------
    InputError
        A file that cannot be read as what it is said to be.
    """
    given = Given(options, dict(tables), read_costs(benchmarks))
    found = [
        record for stage in (simulate, surrogate, kinematics, optimise, compare) for record in stage.records(given)
    ]
    return found + pictures.records(given, figures)
