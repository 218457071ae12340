"""A campaign's results folder: where each table lies. One list for the rules and the command line."""

from pathlib import Path

import pandas as pd

from jointgap import tables
from jointgap.errors import InputError
from jointgap.tables import Table, check_writable

Frames = dict[str, pd.DataFrame]
"""Frames of several tables, by name."""

PLACES = {
    "measured": "measure/measured.parquet",
    "remarks": "measure/remarks.parquet",
    "look": "measure/look.parquet",
    "stated": "measure/stated.parquet",
    "detectable": "preflight/detectable.parquet",
    "confusability": "preflight/confusability.parquet",
    "advice": "preflight/advice.parquet",
    "noise": "{stage}/noise.parquet",
    "noise_memory": "{stage}/noise_memory.parquet",
    "map_bins": "locate/bins.parquet",
    "map_windows": "locate/windows.parquet",
    "map_tests": "locate/tests.parquet",
    "map_orders": "locate/orders.parquet",
    "map_scaling": "locate/scaling.parquet",
    "signatures": "screen/signatures.parquet",
    "signature_shapes": "screen/shapes.parquet",
    "screened": "screen/screened.parquet",
    "thresholds": "screen/thresholds.parquet",
    "fits": "{stage}/fits.parquet",
    "fit_values": "{stage}/values.parquet",
    "fit_curvature": "{stage}/curvature.parquet",
    "fit_residuals": "{stage}/residuals.parquet",
    "ranking": "{stage}/ranking.parquet",
    "decision": "{stage}/decision.parquet",
    "fit_parameters": "{stage}/parameters.parquet",
    "residuals": "confirm/residuals.parquet",
    "gaps": "confirm/gaps.parquet",
    "missing_force": "augment/force.parquet",
    "campaign_optimum": "rechain/optimum.parquet",
}
"""Path of each table within ``results/campaigns/{campaign}``; ``{stage}`` where several stages write one."""

MECHANISM, VERDICT = "mechanism.yaml", "verdict.json"
SUMMARIES = ("summary.md", "summary.html")

OF_FITS = ("fits", "fit_values", "fit_curvature", "fit_residuals")
"""Tables that together hold fits."""

OF_NOISE = ("noise", "noise_memory")
"""Tables that together hold the noise."""

OF_OUTCOME = (*OF_FITS, "ranking", "decision", "fit_parameters")
"""Tables of a verdict as far as the fits carry it."""

_FURTHER = {
    "noise": ((OF_NOISE, "noise"),),
    "recalibrate": ((OF_NOISE, "recalibrate"), (OF_FITS, "recalibrate/nominal"), (OF_FITS, "recalibrate/base")),
    "decide": ((OF_OUTCOME, "decide"), (OF_FITS, "decide/base")),
    "regress": ((OF_OUTCOME, "regress"),),
}
"""Tables of a stage among those that several stages write, and under which name."""

_FILES = {"augment": (MECHANISM,), "conclude": (VERDICT, *SUMMARIES, "figures/gaps.png")}
"""What a stage writes besides tables, or the first of many files in a folder."""

_TABLES = {table.name: table for table in vars(tables).values() if isinstance(table, Table)}


def tables_of(stage: str) -> list[str]:
    """Paths within the campaign's folder of the tables that `stage` writes; ``fit/0`` for the first part of a stage that has parts."""
    own = [place for place in PLACES.values() if place.startswith(f"{stage}/")]
    further = ((OF_FITS, stage),) if stage.startswith(("fit/", "pair/")) else _FURTHER.get(stage, ())
    return own + [PLACES[name].format(stage=under) for names, under in further for name in names]


class Folder:
    """Tables of one campaign, read from and written to their places.

    Parameters
    ----------
    path : Path
        ``results/campaigns/{campaign}``.
    """

    def __init__(self, path: Path):
        self.path = path

    def place(self, name: str, stage: str = "") -> Path:
        """Where the table `name` lies; `stage` for one that several stages write."""
        return self.path / PLACES[name].format(stage=stage)

    def check_writable(self, *stages: str) -> None:
        """Make sure that what stages write finds a place, before hours of work; errors as `jointgap.tables.check_writable`."""
        check_writable(
            *(self.path / place for stage in stages for place in (*tables_of(stage), *_FILES.get(stage, ())))
        )

    def check_apart(self, *inputs: Path | str) -> None:
        """Make sure that no result is written over what it is made from.

        Raises
        ------
        InputError
            One of the `inputs` has the place of a result.
        """
        places = (*PLACES.values(), MECHANISM, VERDICT, *SUMMARIES)
        written = {(self.path / place).resolve() for place in places if "{" not in place}
        for path in inputs:
            if Path(path).resolve() in written:
                raise InputError(
                    f"{path}: is read by the campaign, and a result of it would be written there; copy the file elsewhere and name the "
                    "copy, or give another --folder"
                )

    def read(self, name: str, stage: str = "") -> pd.DataFrame:
        """The frame of a table; errors as `jointgap.tables.read`."""
        return tables.read(_TABLES[name], self.place(name, stage))

    def write(self, name: str, frame: pd.DataFrame, stage: str = "") -> None:
        """Write the frame of a table; errors as `jointgap.tables.write`."""
        tables.write(_TABLES[name], frame, self.place(name, stage))

    def read_all(self, names: tuple[str, ...], stage: str) -> Frames:
        """Frames of several tables that one stage wrote, by name."""
        return {name: self.read(name, stage) for name in names}

    def write_all(self, frames: Frames, stage: str) -> None:
        """Write several tables of one stage."""
        for name, frame in frames.items():
            self.write(name, frame, stage)
