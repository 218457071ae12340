"""Whitening: what is noise comes out white, with nothing lost at gaps."""

import numpy as np
import pytest

from jointgap.identification.problem import Noise, autoregression, whiten


def exact_autocorrelation(a, b):
    """Of a process of order two with these weights, by the Yule-Walker equations."""
    first = a / (1 - b)
    return first, a * first + b


def test_white_noise_is_only_scaled_numerics_widen_the_spread_and_columns_are_whitened_alike():
    residual = np.array([1.0, -2.0, np.nan, 4.0])
    np.testing.assert_array_equal(whiten(residual, Noise(np.full(4, 2.0))), [0.5, -1.0, np.nan, 2.0])
    noise = Noise(np.full(2, 3.0), numerics=np.array([0.0, 4.0]))
    np.testing.assert_allclose(whiten(np.array([3.0, 5.0]), noise), [1.0, 1.0])
    values, noise = np.random.default_rng(2).standard_normal((50, 3)), Noise(np.full(50, 1.3), (0.4,))
    for column, together in zip(values.T, whiten(values, noise).T, strict=True):
        np.testing.assert_allclose(together, whiten(column, noise))


def test_the_innovations_of_an_autoregressive_process_are_found():
    weights, drawn = (0.6, -0.3), np.random.default_rng(1).standard_normal(900)
    values = np.zeros(drawn.size)
    for i in range(2, drawn.size):
        values[i] = drawn[i] + weights[0] * values[i - 1] + weights[1] * values[i - 2]
    rho = exact_autocorrelation(*weights)
    sd = np.sqrt(1 / (1 - weights[0] * rho[0] - weights[1] * rho[1]))  # of the process, innovations of variance 1
    found = whiten(values[500:], Noise(np.full(400, sd), rho))
    np.testing.assert_allclose(found[2:], drawn[502:], rtol=1e-9, atol=1e-9)


def test_whitening_is_exact_from_the_first_sample_and_after_gaps():
    """The squared length is that of the inverse covariance, as the likelihood has it."""
    rho = exact_autocorrelation(0.5, 0.2)
    orders = [1.0, *rho, 0.5 * rho[1] + 0.2 * rho[0]]
    values, expected = np.array([0.3, -1.0, 0.2, np.nan, 1.5, 0.1, -0.4]), 0.0
    for piece in (values[:3], values[4:]):
        covariance = np.array([[orders[abs(i - j)] for j in range(piece.size)] for i in range(piece.size)])
        expected += piece @ np.linalg.solve(covariance, piece)
    assert np.nansum(whiten(values, Noise(np.ones(values.size), rho)) ** 2) == pytest.approx(expected, rel=1e-12)


def test_an_impossible_autocorrelation_is_refused():
    with pytest.raises(ValueError, match="not that of any process"):
        autoregression((0.9, -0.9))
