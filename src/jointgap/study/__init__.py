"""The study: what clearance, speed and friction do to a mechanism.

`points` simulates the map, `figures` draws it, `summary` says it in words. Importing this package imports none of them.
"""

FIGURES = {
    "study_peak_force": "Peak force",
    "study_angle_error_rms": "Error of the transmission angle",
    "study_contact_share": "Time in contact",
    "study_noise_share": "High orders of the acceleration",
    "study_jerk_rms": "Jerk",
    "study_orders": "Acceleration by order",
}
"""Titles of the figures by name."""
