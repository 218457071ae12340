"""The paper's network: layout, Nguyen-Widrow start, scaling, long form, evaluation."""

import numpy as np
import pytest

from jointgap.core import parquet, schema
from jointgap.networks.network import Layout, Network, Scaling, nguyen_widrow

PAPER = Layout((10, 10, 10, 10))
SMALL = Layout((4, 3))


def network(layout=PAPER, seed=0):
    return Network(
        layout, nguyen_widrow(layout, seed), Scaling(0.3, 0.3 + 2 * np.pi), Scaling(-2e3, 5e3)
    )


def test_evaluation_is_the_formula_of_the_paper_written_out_by_hand():
    net = network(SMALL, 3)
    first, second, last = SMALL.split(net.parameters)
    angle = 1.7
    x = (angle - 0.3) / (2 * np.pi)
    tansig = [2 / (1 + np.exp(-2 * (w * x + b))) - 1 for w, b in first]
    deeper = [2 / (1 + np.exp(-2 * (row[:-1] @ tansig + row[-1]))) - 1 for row in second]
    expected = -2e3 + 7e3 * (last[0, :-1] @ deeper + last[0, -1])
    assert net.values(angle) == pytest.approx(expected, rel=1e-13)


def test_the_slope_is_the_derivative_of_the_values():
    net = network(seed=5)
    angle = np.linspace(0.5, 6.0, 50)
    step = 1e-5
    value, slope = net.values_and_slopes(angle)
    stencil = [net.values(angle + k * step) for k in (-2, -1, 1, 2)]
    quotient = (stencil[0] - 8 * stencil[1] + 8 * stencil[2] - stencil[3]) / (12 * step)
    np.testing.assert_array_equal(value, net.values(angle))
    np.testing.assert_allclose(slope, quotient, rtol=1e-7, atol=1e-7 * np.abs(slope).max())


def test_nguyen_widrow_covers_the_range_of_the_input_evenly():
    first = Layout((10, 10)).split(nguyen_widrow(Layout((10, 10)), 4))[0]
    centres = np.sort(-first[:, 1] / first[:, 0])
    np.testing.assert_allclose(centres, np.linspace(0, 1, 10), atol=1e-12)
    np.testing.assert_allclose(np.abs(first[:, 0]), 7.0 * 2)  # 0.7 S^(1/1), for an input 2 wide
    overlap = 2 / np.abs(first[0, 0])  # width over which a neuron's sum goes from -1 to 1
    assert overlap > np.diff(centres).max()


def test_a_network_comes_back_from_parquet_the_same_to_the_last_bit(tmp_path):
    import pandas as pd

    nets = {seed: network(seed=seed) for seed in (3, 0)}
    frame = pd.concat([net.to_frame(seed) for seed, net in nets.items()], ignore_index=True)
    parquet.write(schema.FIT, frame, tmp_path / "fit.parquet")
    back = parquet.read(schema.FIT, tmp_path / "fit.parquet")
    angle = np.linspace(0.3, 6.5, 101)
    for seed, net in nets.items():
        np.testing.assert_array_equal(
            Network.from_frame(back, seed).values(angle), net.values(angle)
        )
    np.testing.assert_array_equal(Network.from_frame(back).values(angle), nets[3].values(angle))


def test_values_without_a_range_cannot_be_scaled():
    with pytest.raises(ValueError, match="no range"):
        Scaling.of([2.0, 2.0, 2.0])
