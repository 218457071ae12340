"""The quantities that a rig can measure: by rule from the bodies and slides of its mechanism, one
record a quantity in `channels.yaml`."""

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from jointgap.core.sites import SLIDER_CRANK, Sites


@dataclass(frozen=True)
class ChannelKind:
    """A measurable quantity. All but time and pressures are columns of a simulated trajectory."""

    unit: str  # SI
    words: str = ""  # Of column headings, to recognise the channel
    required_words: str = ""  # A heading needs one of these
    speed_power: int | None = None  # To which it scales in the ideal motion; 0: a position
    mirrored: bool = False  # Whether the mirror image of the mechanism changes its sign
    force: bool = False  # Whether loads and friction change it
    axis: str = ""  # Of an accelerometer: x, y, or slide, along that of its body
    piston_side: str = ""  # On which a pressure acts; a pressure is a load and not compared
    part: str = ""  # The body or slide that it is of; empty for the crank and the frame


_KINDS = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
_SYNONYMS = _KINDS.pop("synonyms")


def groups_of(sites: Sites, loose: Collection[str] = ()) -> dict[str, Sequence[str]]:
    """Names of the bodies, slides and joints by which channels and nuisances are grouped, '' for
    what has no part; a body on a `loose` slide can turn."""
    moving = [body for body in sites.bodies if body != sites.crank]
    sliding = [body for body in moving if body in sites.slides and sites.slides[body] not in loose]
    turning = [body for body in moving if body not in sliding]
    is_short = sites is SLIDER_CRANK
    return {
        "any": [""],
        "crank": [""],
        "moving": moving,
        "sliding": sliding,
        "turning": turning,
        "rotating": [sites.crank, *turning],
        "links": sites.links,
        "drive": [""],
        "joints": joints_of(sites),
        "slides": [*sites.slides.values()],
        "frame": [""],
        "slider": ["slider"] if is_short else [],
        "slider_crank": [""] if is_short else [],
    }


def joints_of(sites: Sites) -> tuple[str, ...]:
    """Revolute joints whose clearance and contact may be uncertain: all but the drive."""
    return tuple(name for name in sites.revolutes if name != sites.drive)


def channel_kinds(sites: Sites, loose: Collection[str] = ()) -> dict[str, ChannelKind]:
    """Every channel of a mechanism with the `sites` and `loose` joints, in the order of files and
    figures."""
    groups = groups_of(sites, loose)
    return dict(kind for group in _KINDS for kind in _kinds(group, groups[group]))


def _kinds(group: str, parts: Iterable[str]) -> Iterator[tuple[str, ChannelKind]]:
    """The channels of a group of `channels.yaml` of each of its `parts`."""
    for part in parts:
        words = " ".join(re.findall(r"[^\W\d_]+", part.lower()))
        words = f"{words} {_SYNONYMS.get(part, '')}".strip()
        for name, keys in _KINDS[group].items():
            texts = {key: text.format(part=words) for key, text in keys.items() if "words" in key}
            yield name.format(part=part), ChannelKind(**keys | texts, part=part)


CHANNEL_RULES = [name for kinds in _KINDS.values() for name in kinds if "{part}" in name]
"""Names of the channels of the parts of a mechanism, with {part} for a body or slide."""

CHANNELS = {name: kind.unit for name, kind in channel_kinds(SLIDER_CRANK).items()}
"""SI unit of each channel of a slider-crank."""

PRESSURES = {name: side["piston_side"] for name, side in _KINDS["slider_crank"].items()}
"""Channels of known loads on the slider, and the side of the slider on which they act."""
