"""Clockwise runs as their files have them.

Recordings and simulations of a clockwise crank are mirror images, in which it turns counter-clockwise. What a user
reads has the axes and signs of the file: there the crank angle is the opposite, whatever is said of it.
"""

from collections.abc import Collection
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config.campaign_file import Campaign
from jointgap.identification.estimates import LEVELS, nuisance_estimates
from jointgap.identification.fit import Fit
from jointgap.identification.protocol import Parameter

_ANGLE = "crank_angle"


def clockwise(campaign: Campaign) -> frozenset[str]:
    """The runs whose crank turns clockwise."""
    return frozenset(run.id for run in campaign.runs if run.direction == "clockwise")


def map_as_read(spans: pd.DataFrame, runs: Collection[str]) -> pd.DataFrame:
    """Bins or windows of the map of disagreement, of which those in clockwise `runs` are mirrored back."""
    turned = spans["run"].isin(runs)
    sign = np.where(turned & (spans["channel"] == _ANGLE), -1.0, 1.0)
    return spans.assign(
        start_deg=spans["start_deg"].where(~turned, 360.0 - spans["end_deg"]),
        end_deg=spans["end_deg"].where(~turned, 360.0 - spans["start_deg"]),
        mean=sign * spans["mean"],
    )


def residuals_as_read(residuals: pd.DataFrame, runs: Collection[str]) -> pd.DataFrame:
    """Table `jointgap.tables.RESIDUALS`, of which the angles in clockwise `runs` are mirrored back."""
    turned = residuals["run"].isin(runs)
    sign = np.where(turned & (residuals["channel"] == _ANGLE), -1.0, 1.0)
    signed = ("measured", "base", "augmented", "whitened_base", "whitened_augmented")
    angle = np.where(turned, -1.0, 1.0) * residuals[_ANGLE]
    return residuals.assign(crank_angle=angle, **{name: sign * residuals[name] for name in signed})


def parameter_as_read(parameter: Parameter, estimate: dict[str, Any], runs: Collection[str]) -> dict[str, Any]:
    """A fitted parameter with its interval, as `jointgap.identification.estimates.estimate_with_interval` says it: the
    first angle of clockwise `runs` is mirrored back.
    """
    if parameter.name != "first_angle" or parameter.run not in runs:
        return estimate
    mirrored = {"value": -estimate["value"]}
    for key in (f"interval_{level}" for level in LEVELS):
        mirrored[key] = [None if end is None else -end for end in reversed(estimate[key])]
    return estimate | mirrored


def nuisances_as_read(fit: Fit, runs: Collection[str] = ()) -> list[tuple[Parameter, dict[str, Any]]]:
    """`jointgap.identification.estimates.nuisance_estimates`, of which the first angles of clockwise `runs` are
    mirrored back.
    """
    return [(p, parameter_as_read(p, estimate, runs)) for p, estimate in nuisance_estimates(fit)]
