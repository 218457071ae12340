"""Every table that stages hand on: columns with unit, description and type, and the only way to and from files.

One module per stage names its tables: ``tables.write(tables.TRAJECTORY, frame, path)``.
"""

from jointgap.tables.campaign_tables import (
    ADVICE,
    CONFUSABILITY,
    DETECTABLE,
    GAPS,
    LOOK,
    MAP_BINS,
    MAP_ORDERS,
    MAP_SCALING,
    MAP_TESTS,
    MAP_WINDOWS,
    MEASURED,
    MISSING_FORCE,
    NOISE,
    NOISE_MEMORY,
    OPTIMUM,
    REMARKS,
    RESIDUALS,
    STATED,
    TIMES,
)
from jointgap.tables.columns import Column, Table
from jointgap.tables.compare_tables import COMPARISON, OVERVIEW
from jointgap.tables.ensemble_tables import ENSEMBLE_EVENTS, ENSEMBLE_SAMPLES, GROWTH, ensemble_runs
from jointgap.tables.figures_tables import PLOTTED
from jointgap.tables.kinematics_tables import KINEMATICS, KINEMATICS_CONTRADICTIONS, KINEMATICS_ERRORS
from jointgap.tables.naming_tables import (
    DECISION,
    FIT_CURVATURE,
    FIT_PARAMETERS,
    FIT_RESIDUALS,
    FIT_VALUES,
    FITS,
    RANKING,
    SCREENED,
    SIGNATURE_SHAPES,
    SIGNATURES,
    THRESHOLDS,
)
from jointgap.tables.optimise_tables import FLOOR, OPTIMA, PATHS, POPULATION, RESIMULATED, TOLERANCE, VALLEY, WORTH
from jointgap.tables.simulate_tables import EVENTS, OUTPUTS, number_of, outputs
from jointgap.tables.statistics_tables import ECCENTRICITY, IMPACT_DISTRIBUTION, JOINT_REVOLUTIONS, POINCARE_SECTION
from jointgap.tables.store import check_writable, describe, read, to_arrow, write, write_text, write_whole
from jointgap.tables.study_tables import STUDY
from jointgap.tables.surrogate_tables import CLEARANCE_FIT, FIT, FIT_ERRORS, FIT_HISTORY

__all__ = [
    "ADVICE",
    "CLEARANCE_FIT",
    "COMPARISON",
    "CONFUSABILITY",
    "DECISION",
    "DETECTABLE",
    "ECCENTRICITY",
    "ENSEMBLE_EVENTS",
    "ENSEMBLE_SAMPLES",
    "EVENTS",
    "FIT",
    "FITS",
    "FIT_CURVATURE",
    "FIT_ERRORS",
    "FIT_HISTORY",
    "FIT_PARAMETERS",
    "FIT_RESIDUALS",
    "FIT_VALUES",
    "FLOOR",
    "GAPS",
    "GROWTH",
    "IMPACT_DISTRIBUTION",
    "JOINT_REVOLUTIONS",
    "KINEMATICS",
    "KINEMATICS_CONTRADICTIONS",
    "KINEMATICS_ERRORS",
    "LOOK",
    "MAP_BINS",
    "MAP_ORDERS",
    "MAP_SCALING",
    "MAP_TESTS",
    "MAP_WINDOWS",
    "MEASURED",
    "MISSING_FORCE",
    "NOISE",
    "NOISE_MEMORY",
    "OPTIMA",
    "OPTIMUM",
    "OUTPUTS",
    "OVERVIEW",
    "PATHS",
    "PLOTTED",
    "POINCARE_SECTION",
    "POPULATION",
    "RANKING",
    "REMARKS",
    "RESIDUALS",
    "RESIMULATED",
    "SCREENED",
    "SIGNATURES",
    "SIGNATURE_SHAPES",
    "STATED",
    "STUDY",
    "THRESHOLDS",
    "TIMES",
    "TOLERANCE",
    "TRAJECTORY",
    "VALLEY",
    "WORTH",
    "Column",
    "Table",
    "check_writable",
    "describe",
    "ensemble_runs",
    "number_of",
    "outputs",
    "read",
    "to_arrow",
    "write",
    "write_text",
    "write_whole",
]


def __getattr__(name: str) -> Table:
    """The table whose columns stand with the compiled code that fills them, which most users need not load."""
    if name != "TRAJECTORY":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from jointgap.dynamics.solver.sampling import TRAJECTORY

    return TRAJECTORY
