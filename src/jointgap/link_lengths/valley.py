"""The objective over the plane of lengths, and the valley's floor for each measure.

With the clearance motion frozen the error hangs almost only on the ratio L2/L3; along its lowest line (1 - R) L3 stays
constant for measures that are linear in the angle, and (1 - R) L3^2 for the sum of squares, R being the reduction.
"""

import numpy as np
import pandas as pd
from scipy.optimize import minimize_scalar

from jointgap.link_lengths.objective import MEASURES, Objective
from jointgap.link_lengths.region import Region

CRANK_LENGTHS, ROD_LENGTHS = 61, 37  # points of the grid: every 0.1 mm by 0.25 mm in the paper's box


def grid(objective: Objective, region: Region) -> pd.DataFrame:
    """The four measures over the box."""
    rods, cranks = np.meshgrid(
        np.linspace(region.lower[1], region.upper[1], ROD_LENGTHS),
        np.linspace(region.lower[0], region.upper[0], CRANK_LENGTHS),
        indexing="ij",
    )
    lengths = np.stack([cranks, rods], axis=-1)
    rows = [objective.measures(line) for line in lengths]
    return pd.DataFrame(
        {
            "crank_length": cranks.ravel(),
            "rod_length": rods.ravel(),
            "allowed": region.contains(lengths, slack=1e-12).ravel(),
            **{name: np.concatenate([getattr(row, name) for row in rows]) for name in MEASURES},
        }
    )


def invariant(reduction: float, rod_length: float, name: str) -> float:
    """(1 - R) L3 [m], or (1 - R) L3^2 [m^2] for the sum of squares: constant along the valley's floor."""
    return (1.0 - reduction) * rod_length ** (2 if name == "sum_of_squares" else 1)


def best_cranks(objective: Objective, region: Region) -> pd.DataFrame:
    """The best crank length for each rod length and measure; the crank's bounds and the inequality are not looked
    at.
    """
    rows = []
    for rod in np.linspace(region.lower[1], region.upper[1], ROD_LENGTHS):
        best = {name: _best_crank(objective, region, rod, name) for name in MEASURES[:3]}
        best["sum_of_squares"] = best["rms"]  # each grows with the other
        for name, crank in best.items():
            value = float(getattr(objective.measures((crank, rod)), name))
            reduction = float(getattr(objective.reductions((crank, rod)), name))
            rows.append((name, crank, rod, crank / rod, value, reduction, invariant(reduction, rod, name)))
    columns = ["measure", "crank_length", "rod_length", "ratio", "value", "reduction", "invariant"]
    return pd.DataFrame(rows, columns=columns)


def _best_crank(objective: Objective, region: Region, rod_length: float, name: str) -> float:
    """Crank length with the smallest measure; each is a norm of an error nearly affine in L2, so it has one minimum."""
    result = minimize_scalar(
        lambda crank: float(getattr(objective.measures((crank, rod_length)), name)),
        bounds=(region.lower[0] - region.size[0], region.upper[0] + region.size[0]),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return float(result.x)
