"""Checks of random rates at a false-alarm rate of 1e-4."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import binom, kstest

CHANCE = 1e-4


def check_rate(happened: ArrayLike, rate: float, most: float | None = None) -> None:
    """The rate of `happened` (n,) bool is `rate`, or between `rate` and `most`."""
    happened = np.asarray(happened, bool)
    lowest, most = (
        binom.ppf(0.5 * CHANCE, happened.size, rate),
        binom.isf(0.5 * CHANCE, happened.size, rate if most is None else most),
    )
    assert lowest <= happened.sum() <= most, (
        f"{happened.sum()} of {happened.size}, not {lowest:g} to {most:g}"
    )


def check_uniform(p: ArrayLike) -> None:
    """Probabilities or ranks (n,) are uniform from 0 to 1."""
    assert kstest(np.asarray(p), "uniform").pvalue > CHANCE
