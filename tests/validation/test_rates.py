"""Coverage of the intervals of rates."""

import numpy as np
import pandas as pd
import pytest

from tests.draws import check_rate
from validation.score import quantile_row, ratio_row, share_row


@pytest.mark.parametrize("trials, share", [(6, 0.95), (17, 0.8), (17, 0.95), (60, 0.5)])
def test_intervals_of_shares_and_ratios_have_their_coverage(trials, share):
    """Clopper-Pearson for shares; ratios also if some trials have many correlated items."""
    random, many = np.random.default_rng(trials), np.resize([1, 1, 2, 5], trials)

    def holds(row):
        return row["low"] <= share <= row["high"]

    found = random.random((100, trials)) < share
    check_rate([holds(share_row(own.sum(), trials)) for own in found], 0.95, 1.0 - 1e-9)
    alike = [
        pd.DataFrame({"n_hit": own * 1, "n_false": ~own * 1, "n_missed": ~own * 1}) for own in found
    ]
    check_rate([holds(ratio_row(one, "n", "F1")) for one in alike], 0.95, 1.0 - 1e-9)
    groups = [one.mul(many, axis=0) for one in alike]
    check_rate([holds(ratio_row(one, "n", "precision")) for one in groups], 0.9, 1.0 - 1e-9)


@pytest.mark.parametrize("trials, share", [(6, 0.5), (15, 0.5), (40, 0.9)])
def test_intervals_of_quantiles_have_their_coverage(trials, share):
    values = np.random.default_rng(trials).exponential(size=(100, trials))
    rows = [quantile_row(pd.Series(own), share) for own in values]
    check_rate(
        [row["low"] <= -np.log(1.0 - share) <= row["high"] for row in rows], 0.94, 1.0 - 1e-9
    )
