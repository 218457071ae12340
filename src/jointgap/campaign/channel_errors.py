"""How far measured and predicted are apart, in the units in which the campaign file states the channels."""

import numpy as np
import pandas as pd

from jointgap.config.campaign_file import Campaign
from jointgap.tables import CHANNEL_ERRORS


def channel_errors(residuals: pd.DataFrame, campaign: Campaign) -> pd.DataFrame:
    """Root mean square errors by run and channel, held-out samples apart."""
    speeds = {run.id: run.speed for run in campaign.runs}
    rows = []
    for (run, name, held_out), own in residuals.groupby(["run", "channel", "held_out"], sort=False):
        channel = name.partition(" ")[0]  # a statistic is of the channel that its name begins with
        # A model of another mechanism may have channels of its own, in SI.
        unit, factor = campaign.shown_unit(channel) if channel in campaign.channels else ("", 1.0)
        row = {"run": run, "speed": speeds[run], "channel": name, "held_out": held_out, "samples": len(own)}
        row |= {
            "unit": unit,
            "si_per_unit": factor,
            "noise": _rms(own["spread"]) / factor,
        }
        for when, model in (("before", "base"), ("after", "augmented")):
            row[when] = _rms(own["measured"] - own[model]) / factor
        rows.append(row)
    return pd.DataFrame(rows, columns=CHANNEL_ERRORS.names)


def _rms(values: pd.Series) -> float:
    return float(np.sqrt(np.mean(values.to_numpy(dtype=float) ** 2)))
