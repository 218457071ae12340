"""Every table that stages hand on: columns with unit, description and type, and the only way to and from files.

One module per stage names its tables: ``tables.write(tables.TRAJECTORY, frame, path)``.
"""

from jointgap.tables.campaign import (
    DECISION,
    FIT_CURVATURE,
    FIT_PARAMETERS,
    FIT_RESIDUALS,
    FIT_VALUES,
    FITS,
    GAPS,
    MEASURED,
    MISSING_FORCE,
    NOISE,
    NOISE_MEMORY,
    OPTIMUM,
    RANKING,
    RESIDUALS,
    SCREENED,
    SIGNATURE_SHAPES,
    SIGNATURES,
    THRESHOLDS,
    TIMES,
)
from jointgap.tables.columns import Column, Table
from jointgap.tables.compare import COMPARISON, OVERVIEW
from jointgap.tables.ensemble import ENSEMBLE_EVENTS, ENSEMBLE_SAMPLES, GROWTH, ensemble_runs
from jointgap.tables.figures import PLOTTED
from jointgap.tables.kinematics import KINEMATICS, KINEMATICS_CONTRADICTIONS, KINEMATICS_ERRORS
from jointgap.tables.optimise import FLOOR, OPTIMA, PATHS, POPULATION, RESIMULATED, TOLERANCE, VALLEY, WORTH
from jointgap.tables.simulate import EVENTS, JOINT_NUMBERS, OUTPUTS, TRAJECTORY, number_of, outputs
from jointgap.tables.statistics import ECCENTRICITY, IMPACT_DISTRIBUTION, JOINT_REVOLUTIONS, POINCARE_SECTION
from jointgap.tables.store import check_writable, describe, read, to_arrow, write, write_text, write_whole
from jointgap.tables.study import STUDY
from jointgap.tables.surrogate import CLEARANCE_FIT, FIT, FIT_ERRORS, FIT_HISTORY

__all__ = [
    "CLEARANCE_FIT",
    "COMPARISON",
    "DECISION",
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
    "JOINT_NUMBERS",
    "JOINT_REVOLUTIONS",
    "KINEMATICS",
    "KINEMATICS_CONTRADICTIONS",
    "KINEMATICS_ERRORS",
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
    "RESIDUALS",
    "RESIMULATED",
    "SCREENED",
    "SIGNATURES",
    "SIGNATURE_SHAPES",
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
