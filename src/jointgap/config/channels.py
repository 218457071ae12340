"""The quantities that a rig can measure: one record a channel."""

import math
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class ChannelKind:
    """A measurable quantity. All but time and pressures are columns of a simulated trajectory."""

    unit: str  # SI
    words: str = ""  # Of column headings, to recognise the channel
    required_words: str = ""  # A heading needs one of these
    speed_power: int | None = None  # To which it scales in the ideal motion; 0: a position
    mirrored: bool = False  # Whether the mirror image of the mechanism changes its sign
    force: bool = False  # Whether loads and friction change it
    gravity: Callable[[float], float] | None = None  # Share along an accelerometer, by direction
    piston_side: str = ""  # On which a pressure acts; a pressure is a load and not compared


_ACCELERATION = {"unit": "m/s^2", "speed_power": 2}
_FORCE = {"unit": "N", "speed_power": 2, "force": True}

CHANNEL_KINDS = {
    "time": ChannelKind("s", "t time zeit clock stamp elapsed temps n nr no sample samples index"),
    "crank_angle": ChannelKind(
        "rad",
        "crank angle theta th phi alpha θ φ encoder enc count counts pulses winkel rotation"
        " position",
        speed_power=0,
        mirrored=True,
    ),
    "crank_speed": ChannelKind(
        "rad/s",
        "crank speed omega ω w n drehzahl angular velocity rotational",
        mirrored=True,
    ),
    "slider_position": ChannelKind(
        "m",
        "slider piston position pos x s weg stroke hub displacement travel lvdt",
        speed_power=0,
    ),
    "slider_velocity": ChannelKind(
        "m/s",
        "slider piston velocity vel v speed geschwindigkeit",
        speed_power=1,
    ),
    "slider_acceleration": ChannelKind(
        words="slider piston acceleration accel acc a g beschleunigung",
        gravity=math.cos,
        **_ACCELERATION,
    ),
    "rod_angle": ChannelKind("rad", "angle", "rod conrod pleuel", speed_power=0, mirrored=True),
    "rod_angular_velocity": ChannelKind(
        "rad/s", "angular velocity rate gyro", "rod conrod pleuel", speed_power=1, mirrored=True
    ),
    "rod_acceleration_x": ChannelKind(
        words="acceleration acc x",
        required_words="rod conrod pleuel",
        gravity=math.cos,
        **_ACCELERATION,
    ),
    "rod_acceleration_y": ChannelKind(
        words="acceleration acc y",
        required_words="rod conrod pleuel",
        gravity=math.sin,
        mirrored=True,
        **_ACCELERATION,
    ),
    "crank_torque": ChannelKind(
        "N*m",
        "crank torque trq tq moment m drehmoment current curr i strom",
        speed_power=2,
        mirrored=True,
        force=True,
    ),
    "guide_force": ChannelKind(
        words="force f", required_words="guide normal side", mirrored=True, **_FORCE
    ),
    "frame_force_x": ChannelKind(
        words="force f x", required_words="frame foundation base bearing", **_FORCE
    ),
    "frame_force_y": ChannelKind(
        words="force f y", required_words="frame foundation base bearing", mirrored=True, **_FORCE
    ),
    "cylinder_pressure": ChannelKind("Pa", "cylinder pressure druck indicator", piston_side="head"),
    "crank_side_pressure": ChannelKind(
        "Pa", "pressure druck", "crankside rear rod", piston_side="crank"
    ),
}
"""Every channel, in the order of files and figures."""

CHANNELS = {name: kind.unit for name, kind in CHANNEL_KINDS.items()}
"""SI unit of each channel."""

PRESSURES = {name: kind.piston_side for name, kind in CHANNEL_KINDS.items() if kind.piston_side}
"""Channels of known loads on the slider, and the side of the slider on which they act."""

MIRRORED = tuple(name for name, kind in CHANNEL_KINDS.items() if kind.mirrored)
"""Channels that change their sign in the mirror image of the mechanism."""

FORCES = tuple(name for name, kind in CHANNEL_KINDS.items() if kind.force)
"""Channels that loads and friction change; the others are geometric."""
