"""What a pair of link lengths means over a whole turn of the mechanism without clearance."""

from dataclasses import dataclass

import numpy as np

from jointgap.errors import InputError


@dataclass(frozen=True)
class IdealCycle:
    """Extremes over one turn of the crank, without clearance."""

    smallest_transmission_angle: float  # Of mu and its supplement [rad]
    largest_departure: float  # Largest distance of mu from 90 deg [rad]
    outer_dead_centre: float  # Farthest and nearest slider position [m]
    inner_dead_centre: float  # Farthest and nearest slider position [m]
    outer_dead_centre_angle: float  # Crank angles there [rad]
    inner_dead_centre_angle: float  # Crank angles there [rad]

    @property
    def stroke(self) -> float:
        """Way of the slider between its dead centres [m]."""
        return self.outer_dead_centre - self.inner_dead_centre


def ideal_cycle(crank_length: float, rod_length: float, offset: float = 0.0) -> IdealCycle:
    """Extremes of transmission angle and slider position in closed form, from equations (15) and (17)."""
    span = crank_length + abs(offset)
    if span >= rod_length:
        raise InputError(
            f"a crank of {1e3 * crank_length:g} mm with offset {1e3 * offset:g} mm cannot turn on a rod of "
            f"{1e3 * rod_length:g} mm; shorten the crank or lengthen the rod"
        )
    departure = float(np.arcsin(span / rod_length))
    return IdealCycle(
        smallest_transmission_angle=np.pi / 2 - departure,
        largest_departure=departure,
        outer_dead_centre=float(np.sqrt((rod_length + crank_length) ** 2 - offset**2)),
        inner_dead_centre=float(np.sqrt((rod_length - crank_length) ** 2 - offset**2)),
        outer_dead_centre_angle=float(np.arcsin(offset / (rod_length + crank_length))),
        inner_dead_centre_angle=float(np.pi + np.arcsin(offset / (rod_length - crank_length))),
    )
