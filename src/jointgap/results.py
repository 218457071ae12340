"""A scenario's results folder: where each table lies. One list for the rules and the command line."""

from collections.abc import Iterable
from functools import partial
from pathlib import Path

import pandas as pd

from jointgap import tables
from jointgap.mechanism import Fit
from jointgap.surrogate.clearance import ClearanceNetwork
from jointgap.surrogate.evaluate import values_and_slopes
from jointgap.surrogate.network import Network
from jointgap.tables import OUTPUTS, Table

PLACES = {
    "trajectory": "simulate/trajectory.parquet",
    "events": "simulate/events.parquet",
    "fit": "surrogate/{output}/fit.parquet",
    "fit_history": "surrogate/{output}/history.parquet",
    "fit_errors": "surrogate/{output}/errors.parquet",
    "clearance_fit": "surrogate/clearance/fit.parquet",
    "kinematics": "kinematics/motion.parquet",
    "kinematics_errors": "kinematics/errors.parquet",
    "kinematics_contradictions": "kinematics/contradictions.parquet",
    "optimise_optima": "optimise/optima.parquet",
    "optimise_population": "optimise/population.parquet",
    "optimise_paths": "optimise/paths.parquet",
    "optimise_tolerance": "optimise/tolerance.parquet",
    "optimise_valley": "optimise/valley.parquet",
    "optimise_floor": "optimise/floor.parquet",
    "optimise_resimulated": "optimise/resimulated.parquet",
    "optimise_worth": "optimise/worth.parquet",
    "comparison": "comparison.parquet",
}
"""Path of each table within ``results/{scenario}``; ``{output}`` stands for one of the eight outputs."""

CLEARANCE = "clearance"
"""Stands for an output where the second surrogate has all of them in one file."""

TABLES = {table.name: table for table in vars(tables).values() if isinstance(table, Table)}


def parts(table: str) -> tuple[str, ...]:
    """What ``{output}`` stands for in the place of `table`."""
    return (*OUTPUTS, CLEARANCE) if table == "fit_errors" else OUTPUTS


def tables_of(stage: str) -> dict[str, str]:
    """The tables that `stage` writes, by name, and their paths within the scenario's folder."""
    return {name: place for name, place in PLACES.items() if place.startswith(f"{stage}/")}


class Results:
    """Tables of one scenario, read from and written to their places.

    Parameters
    ----------
    folder : Path
        ``results/{scenario}``.
    """

    def __init__(self, folder: Path):
        self.folder = folder

    def read(self, table: Table) -> pd.DataFrame:
        """The frame of `table`; where there is a file per output, all below each other, with a column output.

        Raises
        ------
        InputError
            A file is missing or is not that table.
        """
        place = PLACES[table.name]
        if "{output}" not in place:
            return tables.read(table, self.folder / place)
        frames = []
        for output in parts(table.name):
            frame = tables.read(table, self.folder / place.format(output=output))
            frames.append(frame if "output" in frame else frame.assign(output=output))
        return pd.concat(frames, ignore_index=True)

    def frames(self, names: Iterable[str]) -> dict[str, pd.DataFrame]:
        """The frames of the tables `names`."""
        return {name: self.read(TABLES[name]) for name in names}

    def write(self, table: Table, frame: pd.DataFrame) -> None:
        """Write `frame` to the table's place."""
        tables.write(table, frame, self.folder / PLACES[table.name])

    def files(self) -> dict[str, Path]:
        """The tables' files that exist, by table, or ``table/output`` where there is one per output."""
        found = {}
        for name, place in PLACES.items():
            if "{output}" in place:
                found |= {f"{name}/{output}": self.folder / place.format(output=output) for output in parts(name)}
            else:
                found[name] = self.folder / place
        return {name: path for name, path in found.items() if path.is_file()}

    def surrogates(self) -> dict[str, dict[str, Fit]]:
        """The trained surrogates as functions of the crank angle: ``networks`` (default seed) and ``clearance``, by output."""
        fits = self.read(tables.FIT)
        networks = {output: Network.from_frame(fit) for output, fit in fits.groupby("output", sort=False)}
        fit = self.read(tables.CLEARANCE_FIT)
        joints = {joint: ClearanceNetwork.from_frame(fit, joint) for joint in (2, 3)}
        return {
            "networks": {output: partial(values_and_slopes, network) for output, network in networks.items()},
            CLEARANCE: {output: partial(joints[2 if "2" in output else 3].output, output) for output in OUTPUTS},
        }
