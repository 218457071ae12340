"""Numbers as they are read."""

import numpy as np
import pytest

from jointgap.core.words import format_size, number


@pytest.mark.parametrize(
    "value, digits, text",
    [
        (1500.0, 3, "1500"),
        (999.6, 3, "1000"),
        (12345.6, 4, "12346"),
        (2.07e11, 3, "2.07e11"),
        (1e-5, 3, "1e-5"),
    ]
    + [(0.0, 4, "0"), (-0.25, 4, "-0.25"), (np.nan, 4, "–"), (None, 4, "–"), ("a*b", 4, "a*b")],
)
def test_a_number_has_so_many_digits_and_no_exponent_below_ten_million(value, digits, text):
    assert number(value, digits) == text


@pytest.mark.parametrize(
    "value, unit, text",
    [(1.1e-3, "m", "1.1 mm"), (1.2e-5, "m", "12 µm"), (2.8e-7, "rad", "0.016 mdeg")],
)
def test_a_size_has_the_unit_that_needs_no_exponent(value, unit, text):
    assert format_size(value, unit).replace("\N{NO-BREAK SPACE}", " ") == text
    assert "nan" in format_size(np.nan, unit)
