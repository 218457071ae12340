"""Tables of what the paper did not say: which printed numbers come out, for which settings, and trainings there."""

from collections.abc import Iterable

from jointgap.tables.columns import Column, Table
from jointgap.tables.sweep_tables import BEST_LENGTHS, PRINTED_OPTIMA

INFERRED_NUMBERS = Table(
    "infer_settings_numbers",
    "The paper's printed numbers, a row each: for which share of the designs it comes out, and how far it ranges",
    (
        Column("number", "", "column of the sweep's designs", "text"),
        Column("printed", "1", "what the paper prints"),
        Column("share", "1", "share of the designs in which it comes out"),
        Column("low", "1", "5 % quantile over the designs"),
        Column("median", "1", "median over the designs"),
        Column("high", "1", "95 % quantile over the designs"),
        Column("nearest", "1", "its value in the design that is nearest to all numbers"),
    ),
    "infer_settings/numbers.parquet",
)

INFERRED_SETTINGS = Table(
    "infer_settings_settings",
    "How likely each value of a setting is once the printed numbers are known, a row a value or a bin of a range",
    (
        Column("setting", "", "parameter of the sweep", "text"),
        Column("from", "1", "lower end of the bin in the setting's unit; null for a value of a list", nullable=True),
        Column("to", "1", "upper end of the bin", nullable=True),
        Column("value", "", "value of a list; null for a bin", "text", nullable=True),
        Column("unit", "", "SI unit of the setting; empty for numbers and words", "text"),
        Column("prior", "1", "share of the designs that were drawn there"),
        Column("posterior", "1", "share of the weight there"),
        Column("posterior_low", "1", "lower end of its 90 % interval, of other draws of designs"),
        Column("posterior_high", "1", "upper end of that interval"),
        Column("together", "1", "share of the designs there in which all printed numbers come out", nullable=True),
    ),
    "infer_settings/settings.parquet",
)

INFERRED_TRAINING = Table(
    "infer_settings_training",
    "The paper's networks trained at some designs: a row a design and network",
    (
        Column("design", "1", "number of the design", "int"),
        Column("drawn", "", "nearest: one of the nearest to all printed numbers; random: drawn from all", "category"),
        Column("output", "", "what the network learns", "text"),
        Column("training_mse", "1", "mean squared error in training, on data normalised to 0 to 1"),
        Column("held_out_mse", "1", "the same between the training points"),
        Column("paper_mse", "1", "the paper's training error"),
        Column("iterations", "1", "of the training", "int"),
    ),
    "infer_settings/training.parquet",
)

INFERRED_DESIGNS_PATH = "infer_settings/designs.parquet"
"""Place of the table `inferred_designs` in the folder of a scenario."""


def inferred_designs(swept: Iterable[Column]) -> Table:
    """The table of all designs with their weight, with a column for each setting that is `swept`."""
    return Table(
        "infer_settings_designs",
        "Designs that did not fail, the nearest to all printed numbers first",
        (
            Column("design", "1", "number of the design, from 0", "int"),
            *swept,
            *PRINTED_OPTIMA,
            *(column for column in BEST_LENGTHS if column.name == "best_ratio_in_window"),
            Column("farthest", "1", "departure of the printed number that is farthest off, as a share of it"),
            Column("together", "", "whether all printed numbers come out", "bool"),
            Column("weight", "1", "weight in the posterior; all add up to 1"),
        ),
        INFERRED_DESIGNS_PATH,
    )


INFERRED_TABLES = (INFERRED_NUMBERS, INFERRED_SETTINGS, INFERRED_TRAINING)
"""Those whose columns do not depend on what is swept."""
