"""A band brake: a drum that slips in a band, held by a spring with play."""

import numpy as np
from numba import njit

from jointgap.axis import Axis, effect, parameter


class BandBrake(Axis):
    """The band slips at the friction force; until then it stretches like a spring."""

    friction = parameter(1e4, "N", low=1e3, high=5e4)
    stiffness = parameter(5e6, "N/m", low=5e5, high=5e7)
    load_cell_zero = parameter(0.0, "N", low=-5e3, high=5e3)
    play = effect("m", low=0.0, high=0.02, step=1e-4, guesses=(2e-3, 6e-3))

    def force(self, position):
        """Force [N] of the band on the drum."""
        half = 0.5 * self.play
        shift = before_slip(position, half + self.friction / self.stiffness)
        stretch = np.sign(shift) * np.maximum(np.abs(shift) - half, 0.0)
        return -self.stiffness * stretch - self.load_cell_zero


@njit
def before_slip(position, most):
    """Shift (n,) [m] between drum and band, at most `most`: beyond it the band slips."""
    shift = np.zeros(position.size)
    for k in range(1, position.size):
        shift[k] = min(max(shift[k - 1] + position[k] - position[k - 1], -most), most)
    return shift
