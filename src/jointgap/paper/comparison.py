"""The stage compare: tables of a scenario in, the comparison out."""

from collections.abc import Mapping, Sequence

import pandas as pd

from jointgap.config import Scenario
from jointgap.paper.claims import claims
from jointgap.paper.looseness_variants import VariantOptimum
from jointgap.paper.printed import Row
from jointgap.paper.printed_numbers import numbers

NEEDED = (
    "trajectory",
    "kinematics",
    "fit_errors",
    "optimise_optima",
    "optimise_tolerance",
    "optimise_resimulated",
    "optimise_worth",
)


def compare(frames: Mapping[str, pd.DataFrame], scenario: Scenario, variants: Sequence[VariantOptimum]) -> pd.DataFrame:
    """Every number and claim of the paper beside ours."""
    rows: list[Row] = [*numbers(frames, scenario), *claims(frames, scenario, variants)]
    return pd.DataFrame([row.record() for row in rows])
