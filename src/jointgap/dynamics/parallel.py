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
from jointgap.core.joints import JOINTS
from jointgap.core.progress import with_progress
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.drive import crank_motion
from jointgap.dynamics.numba_cache import compiled
from jointgap.dynamics.parameters import MOTOR, Parameters
from jointgap.dynamics.simulation import (
    IntegrationResult,
    crank_angles,
    integrate_to_angles,
    start_state,
)

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
    parameters: Parameters | None  # None for an infeasible mechanism
    crank_angle: np.ndarray  # Of the samples [rad]
    result: IntegrationResult | None  # Samples and events; None where the run failed
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

    def with_numbers() -> Iterator[tuple[Run, Parameters | InputError]]:
        nonlocal known
        for run in runs:
            if (
                known is None
                or known[0].mechanism is not run.mechanism
                or known[0].options is not run.options
            ):
                known = run, numbers_of(run)
            yield run, known[1]

    return side_by_side(lambda given: simulate_run(*given), with_numbers(), workers)


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


def numbers_of(run: Run) -> Parameters | InputError:
    """The parameters of a run; an InputError for an infeasible mechanism."""
    try:
        return parameters(run.mechanism, run.options)
    except InputError as error:
        return error


def simulate_run(run: Run, numbers: Parameters | InputError) -> Outcome:
    """Simulate one run with the result of `numbers_of`; the outcome of a failed run contains its
    error."""
    angles = crank_angles(run.options) if run.crank_angle is None else run.crank_angle
    if isinstance(numbers, InputError):
        return Outcome(run, None, angles, None, numbers)
    try:
        result = integrate_to_angles(
            numbers, start_state(numbers, run.perturbation), angles, run.options.tolerance
        )
    except (InputError, SimulationError) as error:
        return Outcome(run, numbers, angles, None, error)
    return Outcome(run, numbers, angles, result)


def rod_and_slider(
    p: Parameters, crank_angle, states, auxiliary_states
) -> tuple[np.ndarray, np.ndarray]:
    """Rod angle [rad] and slider position [m] of samples."""
    b = p.bodies
    end_x = b.crank_length * np.cos(crank_angle) + states[:, 0] + auxiliary_states[:, 0]
    end_y = b.crank_length * np.sin(crank_angle) + states[:, 1] + auxiliary_states[:, 1]
    sine = (b.slider_offset + states[:, 3] - end_y) / b.rod_length
    return np.arcsin(sine), end_x + b.rod_length * np.sqrt(1.0 - sine**2) - states[:, 2]


@compiled
def prescribed_speeds(p, times):
    """Speeds [rad/s] of a prescribed crank at `times` (n,) [s]."""
    speeds = np.empty(times.size)
    for i in range(times.size):
        speeds[i] = crank_motion(p, times[i])[1]
    return speeds


def crank_speeds(p: Parameters, times, auxiliary_states) -> np.ndarray:
    """Crank speeds [rad/s] at samples, (n,)."""
    return auxiliary_states[:, 6] if p.drive.kind == MOTOR else prescribed_speeds(p, times)


def simulate_ensemble(
    mechanism: Mechanism, options: Simulate, perturbations, workers: int | None = None
) -> Ensemble:
    """Simulate one mechanism from several starts."""
    rows = []
    outcomes = simulate_runs((Run(mechanism, options, one) for one in perturbations), workers)
    for outcome in with_progress(outcomes, "simulated starts", len(perturbations)):
        if outcome.error is not None:
            raise outcome.error
        p, result = outcome.parameters, outcome.result
        rod_angle, position = rod_and_slider(
            p, outcome.crank_angle, result.states, result.auxiliary_states
        )
        seen = result.observed(p)
        forces = [np.hypot(seen[f"{joint}_force_x"], seen[f"{joint}_force_y"]) for joint in JOINTS]
        normal = [seen[f"{joint}_normal_force"] for joint in JOINTS]
        loads = np.array(forces), np.array(normal), seen["crank_torque"]
        rows.append((result.times, result.states, rod_angle, position, *loads))
    times, states, rod_angle, position, forces, normal, torque = map(
        np.array, zip(*rows, strict=True)
    )
    by_joint = (
        {joint: each[:, n].copy() for n, joint in enumerate(JOINTS)} for each in (forces, normal)
    )
    return Ensemble(crank_angles(options), times, states, rod_angle, position, *by_joint, torque)
