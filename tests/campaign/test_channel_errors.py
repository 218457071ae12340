"""How far measured and predicted are apart, in the units of the campaign file."""

import pandas as pd
import pytest

from benchmarks.project import ROOT
from jointgap.campaign.tables import channel_errors
from jointgap.config.load import load_campaign
from jointgap.core import parquet, schema
from jointgap.core.words import format_unit


def test_errors_are_root_mean_squares_in_the_unit_of_the_column_held_out_samples_apart():
    campaign = load_campaign(ROOT / "config/campaigns/demonstration.yaml")
    frame = pd.DataFrame(
        {"run": "slow", "channel": "slider_acceleration mean", "held_out": [False, False, True]}
    )
    frame = frame.assign(
        measured=[3.0, 4.0, 9.80665], base=0.0, augmented=[None, None, 0.0], spread=9.80665
    )
    found = channel_errors(frame.astype({"augmented": float}), campaign)
    parquet.to_arrow(schema.CHANNEL_ERRORS, found)
    fitted, held_out = found.to_dict("records")
    assert (fitted["unit"], fitted["samples"], held_out["held_out"]) == ("g_n", 2, True)
    assert fitted["speed"] == pytest.approx(15.708, abs=1e-3)
    assert fitted["before"] == pytest.approx(12.5**0.5 / 9.80665)
    assert pd.isna(fitted["after"]) and format_unit("m/s**2") == "m/s²"
    assert (held_out["before"], held_out["noise"]) == (pytest.approx(1.0), pytest.approx(1.0))
