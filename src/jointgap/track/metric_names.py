"""What a metric is called that stands for a column of a table, and in which unit: MLflow shows two decimals."""

import re

import numpy as np

from jointgap.core.words import reading_unit
from jointgap.tables.columns import Column

MDEG = 1e3 * 180.0 / np.pi
"""Thousandths of a degree in a radian."""


def name_and_factor(column: Column) -> tuple[str, float]:
    """Name of a metric, with the unit behind it, and how many of these one SI unit is; errors of an angle in mdeg."""
    unit, factor = reading_unit(column.unit)
    if unit == "deg" and "error" in column.name:
        unit, factor = "mdeg", MDEG
    ending = re.sub(r"[*/]", "_", unit).replace("^", "")
    return (column.name if ending in ("1", "") else f"{column.name}_{ending}"), factor
