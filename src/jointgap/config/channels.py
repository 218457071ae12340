"""The quantities that a rig can measure: one record a channel in `channels.yaml`."""

from dataclasses import dataclass
from pathlib import Path

import yaml


@dataclass(frozen=True)
class ChannelKind:
    """A measurable quantity. All but time and pressures are columns of a simulated trajectory."""

    unit: str  # SI
    words: str = ""  # Of column headings, to recognise the channel
    required_words: str = ""  # A heading needs one of these
    speed_power: int | None = None  # To which it scales in the ideal motion; 0: a position
    mirrored: bool = False  # Whether the mirror image of the mechanism changes its sign
    force: bool = False  # Whether loads and friction change it
    # Share of gravity along an accelerometer: cos or sin of the angle of `gravity_direction`
    gravity: str = ""
    piston_side: str = ""  # On which a pressure acts; a pressure is a load and not compared


_KINDS = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
CHANNEL_KINDS = {name: ChannelKind(**keys) for name, keys in _KINDS.items()}
"""Every channel, in the order of files and figures."""

CHANNELS = {name: kind.unit for name, kind in CHANNEL_KINDS.items()}
"""SI unit of each channel."""

PRESSURES = {name: kind.piston_side for name, kind in CHANNEL_KINDS.items() if kind.piston_side}
"""Channels of known loads on the slider, and the side of the slider on which they act."""

MIRRORED = tuple(name for name, kind in CHANNEL_KINDS.items() if kind.mirrored)
"""Channels that change their sign in the mirror image of the mechanism."""

FORCES = tuple(name for name, kind in CHANNEL_KINDS.items() if kind.force)
"""Channels that loads and friction change; the others are geometric."""
