"""Candidate effects of the slide; their laws are in the step of `examples.emps.model`."""

import math
from collections.abc import Mapping

from jointgap.core.candidates import Candidate, Parameter

STROKE = 0.25  # m, from 0
MOST_FREQUENCY = 9.0  # Hz, the most that averages over 52 ms can follow

_amplitudes = tuple(Parameter(part, 0.0, step=0.5, unit="N") for part in ("cosine_N", "sine_N"))


def _harmonic(at: Mapping[str, float]) -> dict[str, float]:
    """Amplitude and phase of f cos(2 pi nu t + phase)."""
    return {
        "force_N": math.hypot(at["cosine_N"], at["sine_N"]),
        "frequency_Hz": at["frequency_Hz"],
        "phase_rad": math.atan2(-at["sine_N"], at["cosine_N"]),
    }


def _one(name: str, coordinate: str, step: float, unit: str, low: float = 0.0, **more) -> Candidate:
    site = more.pop("site", "slider")
    return Candidate(
        name, site, (Parameter(coordinate, 0.0, low, step=step, unit=unit),), (coordinate,), **more
    )


CANDIDATES = (
    _one("slider_coulomb_friction", "force_N", 0.5, "N"),
    _one("slider_constant_force", "force_N", 0.5, "N", low=-math.inf),
    _one("slider_quadratic_drag", "drag_N_s2_m2", 50.0, "N*s**2/m**2"),
    # At rest within its stroke: from farther away a spring would be a constant force by another
    # name.
    Candidate(
        "slider_spring",
        "slider",
        (
            Parameter("stiffness_N_m", 0.0, 0.0, step=5.0, unit="N/m"),
            Parameter("rest_position_m", STROKE / 2, 0.0, STROKE, step=0.01, unit="m"),
        ),
        ("stiffness_N_m",),
        tuple({"rest_position_m": share * STROKE} for share in (0.0, 0.5, 1.0)),
    ),
    Candidate(
        "harmonic_force",
        "slider",
        (*_amplitudes, Parameter("frequency_Hz", 1.0, 0.02, MOST_FREQUENCY, step=0.005, unit="Hz")),
        ("cosine_N", "sine_N"),
        ({"frequency_Hz": 1.0},),
        _harmonic,
        carrier="slider_constant_force",
    ),
    _one("sensor_lag", "lag_s", 5e-4, "s", site="force", sensor=True, has_site=True),
)
