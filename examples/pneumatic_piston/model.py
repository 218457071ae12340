"""A pneumatic piston that is pushed in and out against a constant pressure."""

from jointgap.axis import Axis, parameter


class Piston(Axis):
    """The pressure pushes the piston out; the load cell holds it."""

    area = parameter(4.91e-4, "m**2", low=4.5e-4, high=5.4e-4)
    load_cell_zero = parameter(0.0, "N", low=-10.0, high=10.0)

    def force(self, pressure):
        """Force [N] of the air on the piston."""
        return -self.area * pressure - self.load_cell_zero

    def load(self, pressure):
        """Force [N] of the air, which presses the seal against the cylinder."""
        return self.area * pressure
