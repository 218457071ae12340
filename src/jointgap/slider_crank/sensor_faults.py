"""Faults of sensors as effects that could be missing."""

from collections.abc import Iterable, Mapping

import numpy as np

from jointgap.identification.protocol import Candidate, Parameter
from jointgap.slider_crank.candidates import size

_SHARE = 0.02


def sensor_candidates(spreads: Mapping[str, tuple[float, str]], encoder: bool, turning: float) -> list[Candidate]:
    """Faults that the sensors could have.

    Parameters
    ----------
    spreads : mapping of channel to (float, str)
        Standard deviation of what each channel but the crank angle reads, and its SI unit.
    encoder : bool
        Whether the crank angle is read.
    turning : float
        Crank's speed [rad/s].
    """
    found = []
    if encoder:
        found.append(
            Candidate(
                "encoder_offset",
                "sensor",
                (size("offset_rad", 2e-3, "rad", -np.pi, np.pi),),
                ("offset_rad",),
                sensor=True,
            )
        )
    for channel, (spread, unit) in spreads.items():
        if spread == 0.0:  # of a steady reading a bias is all that can be told
            found.append(_fault("sensor_bias", channel, size("bias", _SHARE, unit)))
            continue
        found.append(_fault("sensor_bias", channel, size("bias", _SHARE * spread, unit)))
        found.append(_fault("sensor_gain", channel, size("gain_error", _SHARE, "1", -0.9, 9.0)))
        found.append(_fault("sensor_lag", channel, size("lag_s", _SHARE / turning, "s", 0.0, 1.0 / turning)))
    return found


def _fault(name: str, channel: str, coordinate: Parameter) -> Candidate:
    return Candidate(name, channel, (coordinate,), (coordinate.name,), sensor=True, has_site=True)


class Faults:
    """The faults of sensors among effects: what they are by channel.

    Parameters
    ----------
    effects : iterable of (Candidate, mapping)
    mirrored : bool
        Whether the crank turns clockwise, so that angles are seen from behind.
    """

    def __init__(self, effects: Iterable[tuple[Candidate, Mapping[str, float]]], mirrored: bool = False):
        self.offset = 0.0
        self._found: dict[tuple[str, str], float] = {}
        for candidate, values in effects:
            if candidate.name == "encoder_offset":
                self.offset = -values["offset_rad"] if mirrored else values["offset_rad"]
            elif candidate.sensor:
                self._found[candidate.name, candidate.site] = values[candidate.amplitudes[0]]

    def bias(self, channel: str) -> float:
        """What is added to a reading [unit]."""
        return self._found.get(("sensor_bias", channel), 0.0)

    def gain(self, channel: str) -> float:
        """What a reading is multiplied by."""
        return 1.0 + self._found.get(("sensor_gain", channel), 0.0)

    def lag(self, channel: str) -> float:
        """Time constant [s] of a reading; 0 for none."""
        return self._found.get(("sensor_lag", channel), 0.0)
