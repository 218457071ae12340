"""A surrogate of the scalar error over lengths and design: the chaos expansion or kriging of `jointgap.designs`.

Trained on the mean square error of simulated designs, which about its valley is nearly a parabola of the lengths; the
error itself has a kink there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointgap.design_networks.design_space import Design, DesignSpace
from jointgap.designs.robust import LENGTHS
from jointgap.designs.sensitivity import SETTINGS as OF_SENSITIVITY
from jointgap.designs.sensitivity import Input, Inputs, Surrogate, Training
from jointgap.length_searches.settings import SearchSettings


@dataclass(frozen=True)
class ErrorSurrogate:
    """A trained surrogate."""

    space: DesignSpace
    inputs: Inputs
    surrogate: Surrogate  # Of the mean square error [rad^2]

    def squares(self, design: Design, lengths: np.ndarray) -> np.ndarray:
        """Mean square error of a design at other lengths, (m,) [rad^2]; not kept above 0, so that it has a slope
        there.
        """
        standard = self.inputs.standard(_columns([design] * len(lengths), lengths))
        return self.inputs.evaluated(self.surrogate.terms, standard) @ self.surrogate.coefficients


def train_surrogate(
    space: DesignSpace, designs: Sequence[Design], errors: np.ndarray, seed: int, settings: SearchSettings
) -> ErrorSurrogate:
    """Train a surrogate of the error."""
    of_training = replace(
        OF_SENSITIVITY,
        held_out=1.0 / len(designs),  # held-out designs judge all ways alike, so none is kept back here
        replicates=1,
        kriging_designs=settings.kriging_designs,
        selection_designs=settings.selection_designs,
    )
    inputs = Inputs(tuple(Input(axis) for axis in space.axes), of_training.norm)
    lengths = np.array([each.lengths for each in designs])
    training = Training(inputs, inputs.standard(_columns(designs, lengths)), seed, of_training)
    return ErrorSurrogate(space, inputs, training.surrogate(errors**2))


def _columns(designs: Sequence[Design], lengths: np.ndarray) -> dict[str, np.ndarray]:
    """Values of each parameter, (n,) each, by key."""
    others = {key: np.array([each.values[key] for each in designs]) for key in designs[0].values}
    return dict(zip(LENGTHS, lengths.T, strict=True)) | others
