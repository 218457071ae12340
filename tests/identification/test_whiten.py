"""Whitening: what is noise comes out white, with nothing lost at gaps."""

import numpy as np
import pytest

from jointgap.identification.problem import Noise, autoregression, whiten


def autoregressive(weights, size, seed):
    """A process of variance 1 about, and its innovations."""
    generator = np.random.default_rng(seed)
    drawn = generator.standard_normal(size + 500)
    values = np.zeros(drawn.size)
    for i in range(len(weights), drawn.size):
        values[i] = drawn[i] + sum(w * values[i - k] for k, w in enumerate(weights, 1))
    return values[500:], drawn[500:]


def exact_autocorrelation(weights):
    """Of a process of order two, by the Yule-Walker equations."""
    a, b = weights
    first = a / (1 - b)
    return first, a * first + b


def test_white_noise_is_only_scaled():
    residual = np.array([1.0, -2.0, np.nan, 4.0])
    np.testing.assert_array_equal(whiten(residual, Noise(np.full(4, 2.0))), [0.5, -1.0, np.nan, 2.0])


def test_numerics_widen_the_spread():
    noise = Noise(np.full(2, 3.0), numerics=np.array([0.0, 4.0]))
    np.testing.assert_allclose(whiten(np.array([3.0, 5.0]), noise), [1.0, 1.0])


def test_the_innovations_of_an_autoregressive_process_are_found():
    weights = (0.6, -0.3)
    values, drawn = autoregressive(weights, 400, 1)
    rho = exact_autocorrelation(weights)
    sd = np.sqrt(1 / (1 - weights[0] * rho[0] - weights[1] * rho[1]))  # of the process, innovations of variance 1
    found = whiten(values, Noise(np.full(values.size, sd), rho))
    np.testing.assert_allclose(found[2:], drawn[2:], rtol=1e-9, atol=1e-9)


def test_whitening_is_exact_from_the_first_sample_and_after_gaps():
    """The squared length is that of the inverse covariance, as the likelihood has it."""
    rho = exact_autocorrelation((0.5, 0.2))
    orders = [1.0, *rho]
    while len(orders) < 6:
        orders.append(0.5 * orders[-1] + 0.2 * orders[-2])
    values = np.array([0.3, -1.0, 0.2, np.nan, 1.5, 0.1, -0.4])
    found = whiten(values, Noise(np.ones(values.size), rho))
    expected = 0.0
    for piece in (values[:3], values[4:]):
        covariance = np.array([[orders[abs(i - j)] for j in range(piece.size)] for i in range(piece.size)])
        expected += piece @ np.linalg.solve(covariance, piece)
    assert np.nansum(found**2) == pytest.approx(expected, rel=1e-12)


def test_columns_are_whitened_alike():
    values = np.random.default_rng(2).standard_normal((50, 3))
    noise = Noise(np.full(50, 1.3), (0.4,))
    together = whiten(values, noise)
    for column in range(3):
        np.testing.assert_allclose(together[:, column], whiten(values[:, column], noise))


def test_an_impossible_autocorrelation_is_refused():
    with pytest.raises(ValueError, match="not positive definite"):
        autoregression((0.9, -0.9))
