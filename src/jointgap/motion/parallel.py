"""Parallel simulations."""

import math
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from jointgap.config import Mechanism, Simulate
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.joints import JOINTS, PINS
from jointgap.core.progress import with_progress
from jointgap.motion.integrate import Samples
from jointgap.motion.model import Model
from jointgap.motion.simulation import crank_angles, integrate_to_angles, observed
from jointgap.motion.slider_crank import model_of, rod_and_slider, start_state

Item, Found = TypeVar("Item"), TypeVar("Found")

_AHEAD = (
    8  # items per worker that may be finished or in progress before the first of them is consumed
)


@dataclass(frozen=True)
class Run:
    """One motion to simulate."""

    mechanism: Mechanism
    options: Simulate
    perturbation: ArrayLike | None = None
    crank_angle: np.ndarray | None = None  # Samples [rad], increasing, the first at the start
    values: Mapping[str, float | int | str | bool] = field(
        default_factory=dict
    )  # Varied values of the run, by name


@dataclass(frozen=True)
class Outcome:
    """Result of a `Run`."""

    run: Run
    model: Model | None  # None for an infeasible mechanism
    crank_angle: np.ndarray  # Of the samples [rad]
    result: Samples | None  # Samples and events; None where the run failed
    error: Exception | None = None  # Reason of a failure


@dataclass(frozen=True)
class Ensemble:
    """Motions with common samples.

    Attributes
    ----------
    crank_angle : (samples,) array
        [rad].
    times : (runs, samples) array
        [s].
    states : (runs, samples, 8) array
        Clearance vectors r2 x, r2 y, r3 x, r3 y [m] and their rates [m/s].
    rod_angle, slider_position : (runs, samples) array
        [rad], [m].
    pin_force, normal_force : dict of str to (runs, samples) array
        By joint: magnitude of the force between its bodies, and its component along the clearance
        [N].
    crank_torque : (runs, samples) array
        Torque of the drive [N m].
    """

    crank_angle: np.ndarray
    times: np.ndarray
    states: np.ndarray
    rod_angle: np.ndarray
    slider_position: np.ndarray
    pin_force: dict[str, np.ndarray]
    normal_force: dict[str, np.ndarray]
    crank_torque: np.ndarray

    @property
    def transmission_angle(self) -> np.ndarray:
        """mu [rad], equation (10), shape (runs, samples)."""
        return math.pi / 2 + self.rod_angle


def simulate_runs(runs: Iterable[Run], workers: int | None = None) -> Iterator[Outcome]:
    """Simulate runs in parallel; outcomes in order of the runs.

    Only a few runs are held in memory: `runs` may be a generator of any length. The outcome of a
    failed run contains its error; the others continue.
    """
    known = None

    def with_models() -> Iterator[tuple[Run, Model | InputError]]:
        nonlocal known
        for run in runs:
            if (
                known is None
                or known[0].mechanism is not run.mechanism
                or known[0].options is not run.options
            ):
                known = run, try_model(run)
            yield run, known[1]

    return side_by_side(lambda given: simulate_run(*given), with_models(), workers)


def side_by_side(
    function: Callable[[Item], Found], items: Iterable[Item], workers: int | None = None
) -> Iterator[Found]:
    """Results of a `function` for each of the `items`, in order, with only a few in memory."""
    workers = workers or cores()
    if workers == 1:
        yield from map(function, items)
        return
    pending: deque = deque()
    with ThreadPoolExecutor(workers) as pool:
        try:
            for item in items:
                pending.append(pool.submit(function, item))
                if len(pending) >= _AHEAD * workers:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for one in pending:
                one.cancel()


def cores() -> int:
    """Number of cores available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def try_model(run: Run) -> Model | InputError:
    """The model of a run; an InputError for an infeasible mechanism."""
    try:
        return model_of(run.mechanism, run.options)
    except InputError as error:
        return error


def simulate_run(run: Run, model: Model | InputError) -> Outcome:
    """Simulate one run with the result of `try_model`; the outcome of a failed run contains its
    error."""
    angles = crank_angles(run.options) if run.crank_angle is None else run.crank_angle
    if isinstance(model, InputError):
        return Outcome(run, None, angles, None, model)
    try:
        result = integrate_to_angles(
            model, start_state(model, run.perturbation), angles, run.options.tolerance
        )
    except (InputError, SimulationError) as error:
        return Outcome(run, model, angles, None, error)
    return Outcome(run, model, angles, result)


def simulate_ensemble(
    mechanism: Mechanism, options: Simulate, perturbations, workers: int | None = None
) -> Ensemble:
    """Simulate one mechanism from several starts."""
    rows = []
    outcomes = simulate_runs((Run(mechanism, options, one) for one in perturbations), workers)
    for outcome in with_progress(outcomes, "simulated starts", len(perturbations)):
        if outcome.error is not None:
            raise outcome.error
        model, result = outcome.model, outcome.result
        rod_angle, position = rod_and_slider(model, outcome.crank_angle, result.states)
        seen = observed(model, result)
        vectors = [model.vector(result.states, joint) for joint in PINS]
        pins = np.hstack([each for rate in (0, 1) for each in (v[rate] for v in vectors)])
        forces = [np.hypot(seen[f"{joint}_force_x"], seen[f"{joint}_force_y"]) for joint in JOINTS]
        normal = [seen[f"{joint}_normal_force"] for joint in JOINTS]
        loads = np.array(forces), np.array(normal), seen["crank_torque"]
        rows.append((result.times, pins, rod_angle, position, *loads))
    times, states, rod_angle, position, forces, normal, torque = map(
        np.array, zip(*rows, strict=True)
    )
    by_joint = (
        {joint: each[:, n].copy() for n, joint in enumerate(JOINTS)} for each in (forces, normal)
    )
    return Ensemble(crank_angles(options), times, states, rod_angle, position, *by_joint, torque)
