"""Levenberg-Marquardt on problems with known solutions and against scipy; derivatives of networks
that it uses."""

import numpy as np
import pytest
import torch
from scipy.optimize import least_squares

from jointgap.networks.levenberg_marquardt import NetworkModel, Settings, Status, minimise
from jointgap.networks.network import Layout, nguyen_widrow

LAYOUT = Layout((6, 5))
INPUTS = np.linspace(0.0, 1.0, 60)


class FunctionModel:
    """Outputs f(parameters) written in torch, its derivatives by automatic differentiation."""

    def __init__(self, function, points, size):
        self.function, self.points, self.size = function, points, size

    def evaluate(self, parameters):
        return FunctionEvaluation(self, parameters)


class FunctionEvaluation:
    def __init__(self, model, parameters):
        self.function, self.at = model.function, torch.tensor(parameters)
        self.outputs = self.function(self.at).numpy()

    def jacobian(self):
        return torch.func.jacrev(self.function)(self.at).numpy()

    def pull_back(self, weights):
        return self.jacobian().T @ weights

    def row_products(self, out, work):
        out[...] = self.jacobian() @ self.jacobian().T

    def along(self, step):
        zero = torch.zeros((), dtype=torch.float64)

        def slope(t):
            return torch.func.jacrev(lambda t: self.function(self.at + t * torch.tensor(step)))(t)

        return slope(zero).numpy(), torch.func.jacrev(slope)(zero).numpy()


def powell(p):
    """Powell's singular function: the Jacobian loses rank at the solution."""
    sums = p[0] + 10 * p[1], 5**0.5 * (p[2] - p[3])
    return torch.stack([*sums, (p[1] - 2 * p[2]) ** 2, 10**0.5 * (p[0] - p[3]) ** 2])


def decay(p):
    """A sum of two exponentials at 40 points: more points than parameters, the primal form."""
    x = torch.linspace(0, 3, 40, dtype=torch.float64)
    return p[0] * torch.exp(-p[1] * x) + p[2] * torch.exp(-p[3] * x)


PRECISE = Settings(iterations=500, minimum_gradient=0.0)


@pytest.mark.parametrize(
    "function, points, size, start, truth, within",
    [
        (powell, 4, 4, [3.0, -1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0], 1e-6),
        (decay, 40, 4, [1.0, 0.5, 1.0, 3.0], [2.0, 0.3, 1.5, 4.0], 1e-10),
    ],
)
def test_an_exact_solution_is_found(function, points, size, start, truth, within):
    model = FunctionModel(function, points, size)
    targets = function(torch.tensor(truth, dtype=torch.float64)).numpy()
    result = minimise(model, targets, np.array(start), PRECISE)
    np.testing.assert_allclose(result.parameters, truth, atol=within)
    assert result.status is Status.EXACT


def test_convergence_to_a_regular_solution_without_residual_is_quadratic():
    truth = np.array([2.0, 0.3, 1.5, 4.0])
    start, settings = truth + [0.1, 0.02, -0.1, 0.1], Settings(200, 0.0, initial_damping=1e-12)
    targets = decay(torch.tensor(truth)).numpy()
    result = minimise(FunctionModel(decay, 40, 4), targets, start, settings)
    residual = np.sqrt(result.errors[result.errors > 1e-28])  # until rounding dominates
    orders = np.diff(np.log(residual[1:])) / np.diff(np.log(residual[:-1]))
    assert len(residual) < 8 and orders[-1] > 1.8


def test_dual_and_primal_form_take_the_same_steps():
    def errors(extra):  # points without influence: with enough of them the primal form is used
        def padded(p):
            return torch.cat([powell(p), torch.zeros(extra, dtype=p.dtype)])

        model, points = FunctionModel(padded, 4 + extra, 4), 4 + extra
        start = np.array([3.0, -1.0, 0.0, 1.0])
        return minimise(model, np.zeros(points), start, Settings(12, 0.0)).errors * points

    np.testing.assert_allclose(errors(0), errors(10), rtol=1e-8)


def test_scipy_continues_from_its_end_without_gain_and_is_not_better_from_the_same_start():
    layout = Layout((3,))
    model, start = NetworkModel(layout, INPUTS), nguyen_widrow(layout, 0)
    targets = np.sin(9 * INPUTS) * np.exp(-INPUTS)

    def cost(parameters):
        result = least_squares(
            lambda p: model.evaluate(p).outputs - targets,
            parameters,
            lambda p: model.evaluate(p).jacobian(),
            method="lm",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        return 2 * result.cost / len(INPUTS)

    result = minimise(model, targets, start, Settings(5000, 1e-13, stall_iterations=5000))
    assert cost(result.parameters) == pytest.approx(result.errors[-1], rel=1e-6)
    assert result.errors[-1] <= cost(start) * (1 + 1e-6)


NOISE = np.random.default_rng(0).normal(size=60)


@pytest.mark.parametrize(
    "status, targets, settings",
    [
        (Status.BUDGET, np.sin(25 * INPUTS**2), {"iterations": 57}),
        (Status.GRADIENT, np.sin(25 * INPUTS**2), {"minimum_gradient": 1e-3}),
        (Status.STALLED, np.sin(25 * INPUTS**2), {"stall_iterations": 50, "stall_gain": 0.5}),
        (Status.DAMPING, NOISE, {"stall_iterations": 10**6, "largest_damping": 1e-1}),
    ],
)
def test_the_status_gives_the_stopping_criterion(status, targets, settings):
    model = NetworkModel(LAYOUT, INPUTS)
    result = minimise(
        model, targets, nguyen_widrow(LAYOUT, 0), Settings(**{"minimum_gradient": 0.0, **settings})
    )
    assert result.status is status
    if status is Status.BUDGET:  # rejected steps count too
        assert (result.iterations, len(result.errors)) == (57, 58)
    if status is Status.GRADIENT:
        assert result.gradient <= 1e-3


LAYOUTS = [Layout((10, 10, 10, 10)), Layout((5,)), Layout((3, 7))]
POINTS = np.linspace(0.0, 1.0, 31)


def plain_outputs(layout, parameters):
    """The network in plain torch operations, for automatic differentiation."""
    signal = torch.as_tensor(POINTS)[None]
    matrices = layout.split(parameters)
    for matrix in matrices[:-1]:
        signal = torch.tanh(matrix[:, :-1] @ signal + matrix[:, -1:])
    return (matrices[-1][:, :-1] @ signal + matrices[-1][:, -1:])[0]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_derivatives_agree_with_automatic_differentiation(layout):
    parameters, step = nguyen_widrow(layout, 4), 0.3 * nguyen_widrow(layout, 6)
    network, at = NetworkModel(layout, POINTS).evaluate(parameters), torch.tensor(parameters)
    jacobian, weights = network.jacobian(), np.random.default_rng(0).normal(size=len(POINTS))
    np.testing.assert_allclose(network.outputs, plain_outputs(layout, at), rtol=1e-13, atol=1e-13)
    expected = torch.func.jacrev(lambda p: plain_outputs(layout, p))(at)
    np.testing.assert_allclose(jacobian, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        network.pull_back(weights), jacobian.T @ weights, rtol=1e-12, atol=1e-12
    )
    out, *work = (np.zeros((len(POINTS),) * 2, order="F") for _ in range(3))
    network.row_products(out, tuple(work))
    np.testing.assert_allclose(np.tril(out), np.tril(jacobian @ jacobian.T), rtol=1e-12, atol=1e-12)

    def curve(t):
        return plain_outputs(layout, at + t * torch.tensor(step))

    zero, (first, second) = torch.zeros((), dtype=torch.float64), network.along(step)
    np.testing.assert_allclose(first, torch.func.jacrev(curve)(zero), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(
        second, torch.func.jacrev(torch.func.jacrev(curve))(zero), rtol=1e-11, atol=1e-11
    )
