"""Networks that know the design: from crank angle and design to the motion in the joints."""
