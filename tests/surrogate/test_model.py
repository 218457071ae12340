"""Derivatives of networks, against automatic differentiation and finite differences."""

import numpy as np
import torch

from jointgap.networks.levenberg_marquardt import NetworkModel
from jointgap.networks.network import Layout, nguyen_widrow
from tests.rows import each

LAYOUTS = [Layout((10, 10, 10, 10)), Layout((5,)), Layout((3, 7))]
INPUTS = np.linspace(0.0, 1.0, 31)


def plain_outputs(layout, parameters):
    """The network in plain torch operations, for automatic differentiation."""
    signal = torch.as_tensor(INPUTS)[None]
    matrices = layout.split(parameters)
    for matrix in matrices[:-1]:
        signal = torch.tanh(matrix[:, :-1] @ signal + matrix[:, -1:])
    return (matrices[-1][:, :-1] @ signal + matrices[-1][:, -1:])[0]


@each("layout", LAYOUTS)
def test_outputs_jacobian_products_and_derivatives_along_a_step_agree_with_automatic_differentiation(layout):
    parameters, step = nguyen_widrow(layout, 4), 0.3 * nguyen_widrow(layout, 6)
    found, at = NetworkModel(layout, INPUTS).evaluate(parameters), torch.tensor(parameters)
    jacobian, weights = found.jacobian(), np.random.default_rng(0).normal(size=len(INPUTS))
    np.testing.assert_allclose(found.outputs, plain_outputs(layout, at), rtol=1e-13, atol=1e-13)
    expected = torch.func.jacrev(lambda p: plain_outputs(layout, p))(at)
    np.testing.assert_allclose(jacobian, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.pull_back(weights), jacobian.T @ weights, rtol=1e-12, atol=1e-12)
    out, *work = (np.zeros((len(INPUTS),) * 2, order="F") for _ in range(3))
    found.row_products(out, tuple(work))
    np.testing.assert_allclose(np.tril(out), np.tril(jacobian @ jacobian.T), rtol=1e-12, atol=1e-12)

    def curve(t):
        return plain_outputs(layout, at + t * torch.tensor(step))

    zero, (first, second) = torch.zeros((), dtype=torch.float64), found.along(step)
    np.testing.assert_allclose(first, torch.func.jacrev(curve)(zero), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(second, torch.func.jacrev(torch.func.jacrev(curve))(zero), rtol=1e-11, atol=1e-11)
