"""Contact, learning, optimisation and diagnosis of slider-cranks with clearance in their joints."""

__version__ = "0.1.0"
