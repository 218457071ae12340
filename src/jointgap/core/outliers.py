"""Samples far from their neighbours."""

import numpy as np

_BEYOND = (
    5.0  # distance of an outlier from its neighbours, over the largest step between the other rows
)
_MOST_SHARE = 0.01  # of the rows, at least three, that can be outliers


def off_the_line(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Distance of each sample except the ends from the line between its two neighbours, shape (n -
    2,)."""
    share = (x[1:-1] - x[:-2]) / (x[2:] - x[:-2])
    return np.abs(y[1:-1] - (1.0 - share) * y[:-2] - share * y[2:])


def spikes(y: np.ndarray) -> np.ndarray:
    """Indices of the outliers of one period, at most two in a row.

    Such a value is much farther from the median of five neighbours than any step between the other
    rows.
    """
    from scipy.ndimage import median_filter  # slow to load

    away = np.abs(y - median_filter(y, 5, mode="wrap"))
    order, number = np.argsort(-away, kind="stable"), 0
    for count in range(1, max(3, int(_MOST_SHARE * y.size)) + 1):
        remaining = np.delete(y, order[:count])
        if away[order[count - 1]] > _BEYOND * np.abs(np.diff(remaining, append=remaining[0])).max():
            number = count
    return np.sort(order[:number])
