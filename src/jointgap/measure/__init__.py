"""Measured data: from the files of a campaign to samples in SI, checked, and a look at them."""

from jointgap.measure.look import look
from jointgap.measure.read import read_measurements
from jointgap.measure.recording import Measurements, Recording, from_frame, to_frame

__all__ = ["Measurements", "Recording", "from_frame", "look", "read_measurements", "to_frame"]
