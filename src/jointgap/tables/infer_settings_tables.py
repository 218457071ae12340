"""Tables of the settings that the paper does not print."""

from collections.abc import Iterable

from jointgap.tables.columns import Column, Table
from jointgap.tables.sweep_tables import BEST_LENGTHS, PRINTED_OPTIMA

INFERRED_SETTINGS = Table(
    "infer_settings_settings",
    "Where the accepted designs lie: a row a range, or a value of a list",
    (
        Column("setting", "", "parameter of the sweep", "text"),
        Column("unit", "", "SI unit of the setting; empty for numbers and words", "text"),
        Column("value", "", "value of a list; null for a range", "text", nullable=True),
        Column("low", "1", "5 % quantile of the accepted designs, in the setting's unit", nullable=True),
        Column("median", "1", "median of the accepted designs, in the setting's unit", nullable=True),
        Column("high", "1", "95 % quantile of the accepted designs, in the setting's unit", nullable=True),
        Column("drawn", "1", "share of the designs with this value"),
        Column("accepted", "1", "share of the accepted designs with this value", nullable=True),
        Column("p_value", "1", "of the test that accepted and rejected designs are distributed alike", nullable=True),
    ),
    "infer_settings/settings.parquet",
)

INFERRED_DESIGNS_PATH = "infer_settings/designs.parquet"
"""Place of the table `inferred_designs` in the folder of a scenario."""


def inferred_designs(swept: Iterable[Column]) -> Table:
    """The table of all designs, with a column for each setting that is `swept`."""
    return Table(
        "infer_settings_designs",
        "Designs that did not fail, the nearest to all printed numbers first",
        (
            Column("design", "1", "number of the design, from 0", "int"),
            *swept,
            *PRINTED_OPTIMA,
            *(column for column in BEST_LENGTHS if column.name == "best_ratio_in_window"),
            Column("farthest", "1", "largest error of a printed number, as a share of it"),
            Column("together", "", "accepted: all printed numbers are reproduced", "bool"),
        ),
        INFERRED_DESIGNS_PATH,
    )
