"""Measured data: from the files of a campaign to samples in SI, checked, and their numbers and figures."""

from jointgap.recordings.inspection import inspect
from jointgap.recordings.limits import RecordingLimits
from jointgap.recordings.read_campaign import read_measurements
from jointgap.recordings.recording import Measurements, Recording, from_frame, to_frame

__all__ = ["Measurements", "Recording", "RecordingLimits", "from_frame", "inspect", "read_measurements", "to_frame"]
