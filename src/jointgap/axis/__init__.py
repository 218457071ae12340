"""Models of your own: a mechanism with one degree of freedom, written as a small class."""

from jointgap.axis.axis import Axis, effect, parameter

__all__ = ["Axis", "effect", "parameter"]
