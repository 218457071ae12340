"""The EMPS axis: a slide that a motor drives through a ball screw."""

from jointgap.axis import Axis, parameter


class Emps(Axis):
    """A mass with viscous friction."""

    slide_mass = parameter(100.0, "kg", low=20.0, high=500.0)
    damping = parameter(200.0, "N*s/m", low=0.0, high=2000.0)

    def mass(self):
        """Mass [kg] of slide and screw."""
        return self.slide_mass

    def force(self, velocity):
        """Force [N] of the bearings."""
        return -self.damping * velocity
