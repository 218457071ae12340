"""A scenario's results folder: where each table lies. One list for the rules and the command line."""

from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from jointgap import tables
from jointgap.mechanism import Fit
from jointgap.tables import OUTPUTS, Table

PLACES = {
    "trajectory": "simulate/trajectory.parquet",
    "events": "simulate/events.parquet",
    "fit": "surrogate/{output}/fit.parquet",
    "fit_history": "surrogate/{output}/history.parquet",
    "fit_errors": "surrogate/{output}/errors.parquet",
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

TABLES = {table.name: table for table in vars(tables).values() if isinstance(table, Table)}


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
        """The frame of `table`; where there is a file per output, all of them below each other with a column output.

        Raises
        ------
        InputError
            A file is missing or is not that table.
        """
        place = PLACES[table.name]
        if "{output}" not in place:
            return tables.read(table, self.folder / place)
        frames = [tables.read(table, self.folder / place.format(output=output)) for output in OUTPUTS]
        return pd.concat(
            [frame.assign(output=output) for frame, output in zip(frames, OUTPUTS, strict=True)], ignore_index=True
        )

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
                found |= {f"{name}/{output}": self.folder / place.format(output=output) for output in OUTPUTS}
            else:
                found[name] = self.folder / place
        return {name: path for name, path in found.items() if path.is_file()}

    def surrogates(self) -> dict[str, dict[str, Fit]]:
        """The trained surrogates as functions of the crank angle, by surrogate and output; the default seed's networks."""
        from functools import partial

        from jointgap.surrogate.evaluate import values_and_slopes
        from jointgap.surrogate.network import Network

        fits = self.read(tables.FIT)
        networks = {output: Network.from_frame(fit) for output, fit in fits.groupby("output", sort=False)}
        return {"networks": {output: partial(values_and_slopes, network) for output, network in networks.items()}}
