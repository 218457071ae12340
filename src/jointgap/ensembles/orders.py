"""What a quantity holds at the orders of the crank's speed."""

import math

import numpy as np

from jointgap.tables.study_tables import NOISE_ORDER, ORDERS


def orders(values: np.ndarray, revolutions: int) -> np.ndarray:
    """Amplitudes of a quantity at orders 0 to `ORDERS` of the crank's speed, shape (ORDERS + 1,)."""
    amplitudes = 2.0 * np.abs(np.fft.rfft(values)) / len(values)
    amplitudes[0] /= 2.0
    return amplitudes[: ORDERS * revolutions + 1 : revolutions]


def high_order_rms(values: np.ndarray, revolutions: int) -> float:
    """RMS of what a quantity holds above order `NOISE_ORDER`; `values` and `revolutions` as for `orders`."""
    spectrum = np.fft.rfft(values)
    spectrum[: NOISE_ORDER * revolutions + 1] = 0.0
    squares = 2.0 * np.sum(spectrum.real**2 + spectrum.imag**2)  # Parseval: each order stands for its mirror image too,
    if len(values) % 2 == 0:
        squares -= abs(spectrum[-1]) ** 2  # but for the highest, which is its own
    return math.sqrt(squares) / len(values)
