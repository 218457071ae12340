"""A servo that swings an arm with a weight."""

import numpy as np

from jointgap.axis import Axis, parameter

MASS = 0.49  # kg
LENGTH = 0.1  # m
GRAVITY = 9.81  # m/s^2


class Servo(Axis):
    """The motor's torque is proportional to its voltage; back-EMF and bearings damp it."""

    weight_torque = MASS * GRAVITY * LENGTH  # N m, arm horizontal
    arm_inertia = MASS * LENGTH**2  # kg m^2
    rotor_inertia = parameter(0.002, "kg*m**2", low=0.0, high=0.02)
    torque_per_volt = parameter(0.1, "N*m/V", low=0.02, high=0.3)
    damping = parameter(0.04, "N*m*s", low=0.0, high=0.3)

    def mass(self):
        """Moment of inertia [kg m^2]."""
        return self.arm_inertia + self.rotor_inertia

    def force(self, position, velocity, voltage):
        """Torque [N m] of motor, back-EMF, bearings and weight."""
        motor = self.torque_per_volt * voltage - self.damping * velocity
        return motor - self.weight_torque * np.sin(position)

    def load(self, voltage):
        """Torque [N m] that presses the teeth of the gear together."""
        return self.torque_per_volt * voltage
