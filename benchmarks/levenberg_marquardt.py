"""One Levenberg-Marquardt iteration on the paper's network at 361 points, compared with other codes
on one core. All get the same points, network, start and Jacobian."""

import json
import os
import statistics
import subprocess
import sys
import time

import numpy as np

from benchmarks.project import ROOT, row

REACH_MS = 2.0
ITERATIONS = 40
REPEATS = 7
GOAL = 1.1352e-6  # the smallest mean square error that the paper prints for a second derivative
LIMIT = 3000  # iterations after which a method has not got there


def measure() -> list[dict]:
    """Rows of the table; measured in a process of its own, whose libraries start with one
    thread."""
    one_thread = {
        name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    }
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.levenberg_marquardt"],
        cwd=ROOT,
        env={**os.environ, **one_thread},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"the measurement failed:\n{done.stderr[-4000:]}")
    return json.loads(done.stdout)


def signal() -> tuple[np.ndarray, np.ndarray]:
    """361 points that look like gamma'': three impacts, each with a decaying ring of about a
    degree."""
    x = np.linspace(0.0, 1.0, 361)
    y = 0.3 * np.sin(2 * np.pi * x)
    for place, height, rate in ((0.017, 1.0, 90.0), (0.05, -0.7, 60.0), (0.12, 0.4, 30.0)):
        after = np.clip(x - place, 0.0, None)
        y += height * (x > place) * np.exp(-rate * after) * np.cos(2 * np.pi * 300 * after)
    return x, (y - y.min()) / np.ptp(y)


def per_iteration(run) -> float:
    """Median of the milliseconds per iteration; `run()` trains from the start and returns the
    iterations it did."""
    run()
    taken = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        iterations = run()
        taken.append(1e3 * (time.perf_counter() - begin) / iterations)
    return statistics.median(taken)


def rows() -> list[dict]:
    from scipy.optimize import least_squares

    from jointgap.networks.levenberg_marquardt import NetworkModel, Settings, minimise
    from jointgap.networks.network import Layout, nguyen_widrow

    inputs, targets = signal()
    layout = Layout((10, 10, 10, 10))
    model, start = NetworkModel(layout, inputs), nguyen_widrow(layout, 0)

    def ours():
        return minimise(model, targets, start, Settings(iterations=ITERATIONS)).iterations

    def residual(parameters):
        return model.evaluate(parameters).outputs - targets

    def jacobian(parameters):
        return model.evaluate(parameters).jacobian()

    def scipy(method, evaluations=ITERATIONS):
        limits = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "max_nfev": evaluations}
        return least_squares(residual, start, jacobian, method=method, **limits)

    peers = {
        "scipy trf, our Jacobian": per_iteration(lambda: scipy("trf").nfev),
        "MINPACK, our Jacobian": per_iteration(lambda: scipy("lm").nfev),
        "plain torch (vmap, jacrev)": per_iteration(
            lambda: plain_torch(layout, inputs, targets, start)
        ),
    }
    found = [row("one Levenberg-Marquardt iteration", REACH_MS, per_iteration(ours), "ms", **peers)]
    begin = time.perf_counter()
    result = minimise(model, targets, start, Settings(iterations=LIMIT))
    seconds = (time.perf_counter() - begin) / result.iterations
    steps = int(np.sum(result.errors > GOAL))
    others = {}
    for method, name in (("trf", "scipy trf"), ("lm", "MINPACK")):
        begin = time.perf_counter()
        peer = scipy(method, 1000)
        error = 2 * peer.cost / len(inputs)
        others[f"{name}: mean square error {error:.1e} after {peer.nfev} evaluations,"] = (
            time.perf_counter() - begin
        )
    measured = steps * seconds if steps <= result.iterations else None
    what = f"training to a mean square error of {GOAL:g} ({steps} iterations)"
    found.append(row(what, None, measured, "s", **others))
    return found


def plain_torch(layout, inputs, targets, start, iterations=ITERATIONS) -> int:
    """What one writes first: Jacobian by vmap and jacrev, J^T J, Cholesky, damping up and down by
    ten."""
    import torch

    x, y = torch.tensor(inputs), torch.tensor(targets)
    parameters, damping = torch.tensor(start), 1e-3
    identity = torch.eye(layout.size, dtype=torch.float64)

    def output(p, point):
        value = point[None]
        matrices = layout.split(p)
        for matrix in matrices[:-1]:
            value = torch.tanh(matrix[:, :-1] @ value + matrix[:, -1])
        return (matrices[-1][:, :-1] @ value + matrices[-1][:, -1])[0]

    outputs = torch.vmap(output, in_dims=(None, 0))
    rows_of_jacobian = torch.vmap(torch.func.jacrev(output), in_dims=(None, 0))
    residual = y - outputs(parameters, x)
    fresh = True
    for _ in range(iterations):
        if fresh:
            jacobian = rows_of_jacobian(parameters, x)
            normal, gradient = jacobian.T @ jacobian, jacobian.T @ residual
        factor = torch.linalg.cholesky(normal + damping * identity)
        trial = parameters + torch.cholesky_solve(gradient[:, None], factor)[:, 0]
        trial_residual = y - outputs(trial, x)
        fresh = bool(trial_residual @ trial_residual < residual @ residual)
        if fresh:
            parameters, residual, damping = trial, trial_residual, damping / 10
        else:
            damping *= 10
    return iterations


if __name__ == "__main__":
    print(json.dumps(rows()))
