"""Every table that stages hand on: columns with unit, description and type, its place, and the only way to and from
files.

A table is written in one place, the module of its subject: ``tables.write(tables.TRAJECTORY, frame, path)`` finds it
there. Importing this package loads neither pandas nor pyarrow; reading and writing do.
"""

from importlib import import_module
from typing import Any

from jointgap.tables.campaign_tables import *
from jointgap.tables.columns import Column, Table
from jointgap.tables.compare_tables import *
from jointgap.tables.ensemble_tables import *
from jointgap.tables.figures_tables import *
from jointgap.tables.infer_settings_tables import *
from jointgap.tables.kinematics_tables import *
from jointgap.tables.naming_tables import *
from jointgap.tables.optimise_tables import *
from jointgap.tables.robust_tables import *
from jointgap.tables.sensitivity_tables import *
from jointgap.tables.simulate_tables import *
from jointgap.tables.statistics_tables import *
from jointgap.tables.surrogate_tables import *
from jointgap.tables.sweep_tables import *
from jointgap.tables.trend_tables import *

TABLES = {table.name: table for table in list(globals().values()) if isinstance(table, Table)}
"""All of them by name."""


def __getattr__(name: str) -> Any:
    """What `jointgap.core.parquet` has: read, write, describe ... It is loaded when it is first asked for."""
    if name.startswith("__"):
        raise AttributeError(name)
    return getattr(import_module("jointgap.core.parquet"), name)
