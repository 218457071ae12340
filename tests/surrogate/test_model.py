"""Derivatives of the batch of networks, against automatic differentiation and finite differences."""

import numpy as np
import pytest
import torch

from jointgap.networks.levenberg_marquardt import NetworkModel
from jointgap.networks.network import Layout, nguyen_widrow

LAYOUTS = [Layout((10, 10, 10, 10)), Layout((5,)), Layout((3, 7))]
INPUTS = np.linspace(0.0, 1.0, 31)
torch.set_num_threads(1)  # as training does: sums of several threads hang on how many there are


def start(layout, seeds):
    return torch.tensor(np.stack([nguyen_widrow(layout, seed) for seed in seeds]))


def plain_outputs(layout, parameters, inputs):
    """The network in plain torch operations, for automatic differentiation."""
    signal = torch.as_tensor(inputs)[None]
    matrices = layout.split(parameters)
    for matrix in matrices[:-1]:
        signal = torch.tanh(matrix[:, :-1] @ signal + matrix[:, -1:])
    return (matrices[-1][:, :-1] @ signal + matrices[-1][:, -1:])[0]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_outputs_and_jacobian_agree_with_automatic_differentiation(layout):
    parameters = start(layout, (0, 1))
    evaluation = NetworkModel(layout, INPUTS).evaluate(parameters)
    for member in (0, 1):
        expected = torch.func.jacrev(lambda p: plain_outputs(layout, p, INPUTS))(parameters[member])
        torch.testing.assert_close(evaluation.jacobian()[member], expected, rtol=1e-12, atol=1e-12)
        torch.testing.assert_close(
            evaluation.outputs[member], plain_outputs(layout, parameters[member], INPUTS), rtol=1e-13, atol=1e-13
        )


def test_the_jacobian_agrees_with_central_differences():
    layout = LAYOUTS[0]
    model, parameters = NetworkModel(layout, INPUTS), start(layout, (2,))
    steps = 1e-6 * torch.eye(layout.size, dtype=torch.float64)
    quotient = (model.evaluate(parameters + steps).outputs - model.evaluate(parameters - steps).outputs) / 2e-6
    torch.testing.assert_close(model.evaluate(parameters).jacobian()[0], quotient.T, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_products_with_the_jacobian_need_no_jacobian(layout):
    evaluation = NetworkModel(layout, INPUTS).evaluate(start(layout, (0, 1, 2)))
    jacobian = evaluation.jacobian()
    weights = torch.randn(3, len(INPUTS), dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(evaluation.pull_back(weights), torch.einsum("bnp,bn->bp", jacobian, weights))
    for member in range(3):
        out, *work = (np.zeros((len(INPUTS),) * 2, order="F") for _ in range(3))
        evaluation.products_of_rows(member, out, tuple(work))
        expected = (jacobian[member] @ jacobian[member].T).numpy()
        np.testing.assert_allclose(np.tril(out), np.tril(expected), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_derivatives_along_a_step_agree_with_automatic_differentiation(layout):
    parameters = start(layout, (4, 5))
    step = 0.3 * start(layout, (6, 7))
    first, second = NetworkModel(layout, INPUTS).evaluate(parameters).along(step)
    for member in (0, 1):

        def curve(t, p=parameters[member], v=step[member]):
            return plain_outputs(layout, p + t * v, INPUTS)

        zero = torch.zeros((), dtype=torch.float64)
        expected_first = torch.func.jacrev(curve)(zero)
        expected_second = torch.func.jacrev(torch.func.jacrev(curve))(zero)
        torch.testing.assert_close(first[member], expected_first, rtol=1e-11, atol=1e-11)
        torch.testing.assert_close(second[member], expected_second, rtol=1e-11, atol=1e-11)


def test_a_members_numbers_do_not_depend_on_the_batch():
    layout = LAYOUTS[0]
    model = NetworkModel(layout, np.linspace(0, 1, 361))
    together = model.evaluate(start(layout, range(5)))
    weights = torch.sin(torch.arange(5 * 361, dtype=torch.float64)).reshape(5, 361)
    step = start(layout, range(5, 10))
    for member in range(5):
        alone = model.evaluate(start(layout, (member,)))
        one = slice(member, member + 1)
        assert torch.equal(alone.outputs, together.outputs[one])
        assert torch.equal(alone.pull_back(weights[one]), together.pull_back(weights)[one])
        for single, batch in zip(alone.along(step[one]), together.along(step), strict=True):
            assert torch.equal(single, batch[one])
