"""Tables of the noise and the residuals; axes and signs of the measured files."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import pandas as pd

from jointgap.config.campaign import Campaign
from jointgap.core import schema
from jointgap.core.candidates import Parameter
from jointgap.identification.confirmation import root_mean_square
from jointgap.identification.fit import LEVELS, Fit, nuisance_estimates
from jointgap.identification.noise import NoiseEstimate

JOINED = " + "
"""Separator of the effects of an explanation."""

BETWEEN_TEXTS = "; "
"""Separator of several texts in a cell."""

_ANGLE = "crank_angle"


# ---- runs with a clockwise crank are simulated mirrored, and mirrored back in tables and verdicts


def clockwise(campaign: Campaign) -> frozenset[str]:
    """Runs with a clockwise crank."""
    return frozenset(
        run.id for run in campaign.runs if getattr(run, "direction", "") == "clockwise"
    )


def spans_in_file_convention(spans: pd.DataFrame, clockwise_runs: Collection[str]) -> pd.DataFrame:
    """Bins or windows of the map of disagreement."""
    mirrored = spans["run"].isin(clockwise_runs)
    start, end = spans["start_deg"], spans["end_deg"]
    return spans.assign(
        start_deg=start.where(~mirrored, 360.0 - end),
        end_deg=end.where(~mirrored, 360.0 - start),
        mean=np.where(mirrored & (spans["channel"] == _ANGLE), -1.0, 1.0) * spans["mean"],
    )


def residuals_in_file_convention(
    residuals: pd.DataFrame, clockwise_runs: Collection[str]
) -> pd.DataFrame:
    """Table `RESIDUALS`."""
    mirrored = residuals["run"].isin(clockwise_runs)
    sign = np.where(mirrored & (residuals["channel"] == _ANGLE), -1.0, 1.0)
    names = ("measured", "base", "augmented", "whitened_base", "whitened_augmented")
    angle = np.where(mirrored, -1.0, 1.0) * residuals[_ANGLE]
    return residuals.assign(crank_angle=angle, **{name: sign * residuals[name] for name in names})


def nuisances_in_file_convention(
    fit: Fit, clockwise_runs: Collection[str] = ()
) -> list[tuple[Parameter, dict[str, Any]]]:
    """Nuisances with their estimates."""
    estimates = nuisance_estimates(fit)
    for parameter, estimate in estimates:
        if parameter.name == "first_angle" and parameter.run in clockwise_runs:
            estimate["value"] = -estimate["value"]
            for key in (f"interval_{level}" for level in LEVELS):
                estimate[key] = [None if end is None else -end for end in reversed(estimate[key])]
    return estimates


# ---- noise and errors of the channels


def noise_frame(noise: Mapping[tuple[str, str], NoiseEstimate]) -> pd.DataFrame:
    """Table `NOISE`."""
    rows = [
        {
            "run": run,
            "channel": channel,
            "source": series.source,
            "sd": root_mean_square(series.sd),
            "numerics": root_mean_square(series.numerics),
            "estimated_sd": series.estimated_sd,
            "effective_samples": series.effective_samples,
            "remarks": BETWEEN_TEXTS.join(series.remarks),
        }
        for (run, channel), series in noise.items()
    ]
    return pd.DataFrame(rows, columns=schema.NOISE.names)


def channel_errors(residuals: pd.DataFrame, campaign: Campaign) -> pd.DataFrame:
    """Table `CHANNEL_ERRORS`: root mean square errors by run, channel and whether held out; runs by
    speed."""
    speeds, rows = {run.id: getattr(run, "speed", np.nan) for run in campaign.runs}, []
    by_series = residuals.groupby(["run", "channel", "held_out"], sort=False)
    for (run, name, held_out), samples in by_series:
        channel = name.partition(" ")[0]  # the name of a statistic begins with its channel
        # a model of another mechanism may have its own channels, in SI
        unit, factor = campaign.shown_unit(channel) if channel in campaign.channels else ("", 1.0)
        errors = {"noise": samples["spread"], "before": samples["measured"] - samples["base"]}
        errors["after"] = samples["measured"] - samples["augmented"]
        row = {"run": run, "speed": speeds[run], "channel": name, "held_out": held_out}
        row |= {"samples": len(samples), "unit": unit, "si_per_unit": factor}
        for column, error in errors.items():
            row[column] = float(np.sqrt(np.mean(error.to_numpy(float) ** 2))) / factor
        rows.append(row)
    table = pd.DataFrame(rows, columns=schema.CHANNEL_ERRORS.names)
    return table.sort_values("speed", kind="stable", ignore_index=True)
