"""A cycloidal gear with a locked output: the motor twists it to and fro."""

import numpy as np

from jointgap.axis import Axis, effect, parameter


class CycloidalGear(Axis):
    """The rotor, with angle and torque at the output; the locked gear is a spring."""

    inertia = parameter(0.05, "kg*m**2", low=0.02, high=0.2)
    damping = parameter(2.0, "N*m*s", low=0.0, high=20.0)
    stiffness = parameter(1500.0, "N*m/rad", low=300.0, high=5000.0)
    centre = parameter(-0.03, "rad", low=-0.1, high=0.1)
    play = effect("rad", low=0.0, high=0.1, step=1e-3, guesses=(0.02, 0.04))

    def mass(self):
        """Moment of inertia [kg m^2] of the rotor, reduced to the output."""
        return self.inertia

    def force(self, position, velocity):
        """Torque [N m] of gear and bearings on the rotor."""
        angle = position - self.centre
        twist = np.sign(angle) * np.maximum(np.abs(angle) - 0.5 * self.play, 0.0)
        return -self.stiffness * twist - self.damping * velocity
