"""What the study shows: its measures and figures. Workflow rules import this module, so it imports nothing heavy."""

from typing import NamedTuple


class Shown(NamedTuple):
    """How a measure is shown: title, quantity and unit on figures, factor from SI, whether colours are logarithmic."""

    title: str
    quantity: str
    unit: str
    factor: float
    logarithmic: bool


SHOWN = {
    "peak_force": Shown("Peak force", "peak force in the joints", "N", 1.0, True),
    "angle_error_rms": Shown(
        "Error of the transmission angle", "RMS error of the transmission angle", "mdeg", 57295.779513082321, True
    ),
    "contact_share": Shown("Time in contact", "time in contact", "%", 100.0, False),
    "noise_share": Shown(
        "High orders of the acceleration", "share of the slider's acceleration above order 10", "%", 100.0, False
    ),
    "jerk_rms": Shown("Jerk", "RMS of the slider's jerk", "m/s³", 1.0, True),
}
"""What is drawn as a map, by measure of `jointgap.tables.study_tables.MEASURES`."""

FIGURES = {f"study_{measure}": shown.title for measure, shown in SHOWN.items()} | {
    "study_orders": "Acceleration by order"
}
"""Titles of the figures by name."""
