"""A pendulum: a rod with a weight, swung up by a geared motor."""

import numpy as np

from jointgap.axis import Axis, parameter


class Pendulum(Axis):
    """A rod with a weight; the motor torque is measured."""

    inertia = parameter(0.15, "kg*m**2", low=0.02, high=1.0)
    gravity_torque = parameter(3.0, "N*m", low=0.3, high=20.0)  # when horizontal
    damping = parameter(0.05, "N*m*s", low=0.0, high=1.0)

    def mass(self):
        """Moment of inertia [kg m^2]."""
        return self.inertia

    def force(self, position, velocity):
        """Torque [N m] of weight and bearings."""
        return -self.gravity_torque * np.sin(position) - self.damping * velocity
