"""The model and the start of a mechanism's motion, whichever kind of file describes it."""

import math
from collections.abc import Mapping

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.core.errors import InputError
from jointgap.core.joints import JOINTS
from jointgap.motion import linkage, slider_crank
from jointgap.motion.model import Model, corner_names

Vectors = Mapping[str, np.ndarray]
"""Clearance vectors (2,) [m] by joint; of a slide the first component, across it, counts."""


def model_of(mechanism: Mechanism | LinkageFile, options: Simulate) -> Model:
    """The model of a `mechanism` under the drive of `options`; the stated angles of a linkage's
    bodies are those at crank angle 0.

    Raises
    ------
    InputError
        The drive, the tolerance or a contact does not suit the mechanism.
    """
    if isinstance(mechanism, LinkageFile):
        return linkage.linkage_model(mechanism, options, drawn_at=0.0)
    return slider_crank.model_of(mechanism, options)


def simulated_samples(mechanism: Mechanism | LinkageFile, options: Simulate) -> pd.DataFrame:
    """Samples of a simulated motion."""
    is_linkage = isinstance(mechanism, LinkageFile)
    simulate = linkage.simulate_linkage if is_linkage else slider_crank.simulate
    return simulate(mechanism, options).samples


def check_linkage(mechanism: Mechanism | LinkageFile, source: str) -> None:
    """InputError, with its `source`, where a linkage cannot be built or does not turn fully."""
    if isinstance(mechanism, LinkageFile):
        try:
            linkage.linkage_model(mechanism, Simulate())
        except InputError as error:
            raise InputError(f"{source}: {error}") from error


def start_state(model: Model, vectors: Vectors | np.ndarray | None = None) -> np.ndarray:
    """State (states,) of a `model` with given clearance vectors and zero rates; by default with
    coincident joint centres. A slider-crank's may be one array, see `slider_crank.start_state`."""
    if model.completed is slider_crank.short_form:
        if isinstance(vectors, Mapping):
            vectors = np.concatenate([vectors.get(name, np.zeros(2)) for name in JOINTS])
        return slider_crank.start_state(model, vectors)
    y = model.start()
    for name, vector in (vectors or {}).items():
        if name in model.pins:
            clearance = model.bearings[name].clearance
        else:
            corner, vector = model.bearings[corner_names(name)[0]], (vector[0], 0.0)
            clearance = corner.clearance - abs(corner.corner_y)
        length = math.hypot(*vector)
        if length >= clearance:
            raise InputError(
                f"perturbation of {name}: {length:g} m is not less than its clearance of"
                f" {clearance:g} m; a simulation starts without contact"
            )
        model.vector(y, name)[0][:] = vector
    return y
