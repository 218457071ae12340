"""Sensitivity of a motion to its start: up to which crank angle samples are reproducible."""

import math

import numpy as np

from jointgap.config import Mechanism, Simulate
from jointgap.core.errors import InputError
from jointgap.motion.parallel import Run, simulate_runs
from jointgap.motion.slider_crank import clearance_vectors, perturbed_start

PERTURBATION = 1e-11  # [m] of the start: typical difference between two accurate codes
SAME_MOTION = 1e-3  # [smallest clearance] distance below which two motions are the same
_DIRECTIONS = 5  # random directions of the perturbation
_TOLERANCE_RATIO = 1000.0  # of the perturbation to the solver's local error


def samples_repeat_until(
    mechanism: Mechanism, options: Simulate, workers: int | None = None
) -> float:
    """Crank angle [rad], from the start, up to which samples of a motion are reproducible; infinite
    where all are.

    Beyond it a perturbation of the start by `PERTURBATION` exceeds `SAME_MOTION`, so other codes
    and machines give other samples, and only statistics can be compared.
    """
    angle, growth = perturbation_growth(mechanism, options, workers=workers)
    applied = mechanism.applied()
    limit = SAME_MOTION * min(map(applied.clearance, applied.loose)) / PERTURBATION
    beyond = np.flatnonzero(growth.max(axis=0) > limit)
    return float(angle[beyond[0]] - angle[0]) if len(beyond) else math.inf


def perturbation_growth(
    mechanism: Mechanism,
    options: Simulate,
    perturbation: float = PERTURBATION,
    workers: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Crank angles (n,) [rad], and the growth (directions, n) of a perturbation of the start, as
    distance over the distance at the start."""
    applied = mechanism.applied()
    if not applied.loose:
        raise InputError(
            "growth of a perturbation: all joints are ideal, so the start cannot be perturbed; make"
            " a joint loose"
        )
    directions = np.random.default_rng(0).normal(size=(_DIRECTIONS, 6))
    directions = perturbed_start(directions, applied.loose)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # the solver's error must not contribute to the growth
    tolerance = min(options.tolerance, perturbation / _TOLERANCE_RATIO)
    accurate = options.model_copy(update={"tolerance": tolerance})
    starts = np.vstack([np.zeros(6), perturbation * directions])
    motions = []
    for outcome in simulate_runs((Run(applied, accurate, start) for start in starts), workers):
        if outcome.error is not None:
            raise outcome.error
        motions.append(clearance_vectors(outcome.model, outcome.result.states))
    distance = np.linalg.norm(np.array(motions[1:]) - motions[0], axis=2)
    return outcome.crank_angle, distance / perturbation
