"""Small bounded least squares, of which every fit and every screening is made."""

import numpy as np
from scipy.optimize import lsq_linear


def compress_rows(*blocks: np.ndarray) -> list[np.ndarray]:
    """The blocks' columns in fewer rows, with all inner products between them kept.

    Parameters
    ----------
    blocks : (n, k) or (n,) arrays

    Returns
    -------
    list of arrays
        As many, with at most as many rows as there are columns in all.
    """
    wide = [block[:, None] if block.ndim == 1 else block for block in blocks]
    small = np.linalg.qr(np.hstack(wide), mode="r")
    ends = np.cumsum([block.shape[1] for block in wide])[:-1]
    return [
        part[:, 0] if block.ndim == 1 else part
        for part, block in zip(np.split(small, ends, axis=1), blocks, strict=True)
    ]


def bounded_step(jacobian, residual, low, high, damping: float = 0.0) -> tuple[np.ndarray, float]:
    """The step within bounds that makes ``residual + jacobian @ step`` smallest, and what is left of its square.

    Parameters
    ----------
    jacobian : (n, k) array
    residual : (n,) array
    low, high : (k,) array
        Bounds of the step; 0 lies between them.
    damping : float
        Weight of the squared step, measured by the columns' lengths.

    Returns
    -------
    step : (k,) array
        0 where a column is empty.
    chi2 : float
        ``|residual + jacobian @ step|^2``, without the damping.
    """
    length = np.linalg.norm(jacobian, axis=0)
    live = (length > 0) & (high > low)
    step = np.zeros(jacobian.shape[1])
    if not live.any():
        return step, float(residual @ residual)
    small, rest = compress_rows(jacobian[:, live] / length[live], residual)
    # A touch of damping keeps directions that nothing tells apart from running off to the bounds.
    ridge = np.sqrt(damping + 1e-10) * np.eye(small.shape[1])
    scale = length[live]
    bounds = np.minimum(low[live], 0.0) * scale, np.maximum(high[live], 0.0) * scale
    matrix, target = np.vstack([small, ridge]), np.concatenate([-rest, np.zeros(small.shape[1])])
    free = np.linalg.lstsq(matrix, target, rcond=None)[0]
    if (free < bounds[0]).any() or (free > bounds[1]).any():
        free = lsq_linear(matrix, target, bounds, method="bvls").x
    step[live] = free / scale
    left = rest + small @ free
    return step, float(left @ left + max(residual @ residual - rest @ rest, 0.0))
