"""Intervals of rates hold the rate as often as they say."""

import numpy as np
import pandas as pd
import pytest

from tests.draws import check_rate
from validation.score import _quantile, ratio_row, share_row


@pytest.mark.parametrize("trials, share", [(6, 0.95), (17, 0.8), (17, 0.95), (60, 0.5)])
def test_intervals_of_shares_and_of_ratios_hold_them_at_least_as_often_as_they_say(trials, share):
    """Of shares those of Clopper and Pearson; of ratios also if some trials have many finds that go
    together."""
    random, many = np.random.default_rng(trials), np.resize([1, 1, 2, 5], trials)

    def holds(row):
        return row["low"] <= share <= row["high"]

    found = random.random((200, trials)) < share
    check_rate([holds(share_row(own.sum(), trials)) for own in found], 0.95, 1.0 - 1e-9)
    alike = [
        pd.DataFrame({"n_hit": own * 1, "n_false": ~own * 1, "n_missed": ~own * 1}) for own in found
    ]
    check_rate([holds(ratio_row(one, "n", "F1")) for one in alike], 0.95, 1.0 - 1e-9)
    groups = [one.mul(many, axis=0) for one in alike]
    check_rate([holds(ratio_row(one, "n", "precision")) for one in groups], 0.9, 1.0 - 1e-9)


@pytest.mark.parametrize("trials, share", [(6, 0.5), (15, 0.5), (40, 0.9)])
def test_intervals_of_quantiles_hold_them_at_least_as_often_as_they_say(trials, share):
    values = np.random.default_rng(trials).exponential(size=(200, trials))
    rows = [_quantile(pd.Series(own), share) for own in values]
    check_rate(
        [row["low"] <= -np.log(1.0 - share) <= row["high"] for row in rows], 0.94, 1.0 - 1e-9
    )
