"""The page of `jointgap look`: motion and forces of a mechanism at a few speeds."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.core.errors import InputError
from jointgap.core.files import write_text
from jointgap.core.joints import FROM_FRAME
from jointgap.core.page import (
    Block,
    Bullets,
    FigureBlock,
    Heading,
    Page,
    Paragraph,
    TableBlock,
    to_html,
    written_today,
)
from jointgap.core.plot import CRANK_ANGLE, Drawing, Quantity, Sheet, matplotlib_style
from jointgap.core.words import format_name, format_unit, joined, number
from jointgap.motion.linkage import linkage_remarks, simulate_linkage
from jointgap.motion.mechanism_warnings import sentences
from jointgap.motion.slider_crank import simulate

_COLOURS = ("simulation", "network", "optimised", "spline", "paper", "limit")  # one for each speed
_SETTLING, _SAMPLES = 5, 3600  # revolutions before the one that is shown; samples of a revolution
_SIZE = (4.2, 2.9)  # [inches] of a figure: two side by side, or one on a phone

_MOTION = {
    "slider_position": ("mm", 1e3),
    "slider_velocity": ("m/s", 1.0),
    "slider_acceleration": ("m/s^2", 1.0),
    "crank_torque": ("N*m", 1.0),
}
_FORCES = {f"{joint}_force": ("N", 1.0) for joint in FROM_FRAME} | {"guide_force": ("N", 1.0)}
"""Unit, and units per SI unit, by column."""


def write_look(
    mechanism: Mechanism | LinkageFile, speeds: Sequence[float], name: str, path: Path
) -> None:
    """Simulate a `mechanism` at crank `speeds` [rad/s] and write the page about it, called `name`,
    to `path`."""
    speeds = list(dict.fromkeys(speeds))
    if 0.0 in speeds:
        raise InputError("--speed: must not be 0; give a speed such as '240 rpm'")
    if len(speeds) > len(_COLOURS):
        raise InputError(f"--speed: {len(speeds)} speeds are given; give at most {len(_COLOURS)}")
    turns = {
        f"{number(speed * 30.0 / math.pi)} rpm": _settled_turn(mechanism, speed) for speed in speeds
    }
    with TemporaryDirectory() as folder:
        blocks = _blocks(mechanism, max(speeds, key=abs), turns, Path(folder))
        page = Page(
            f"{name} at {joined(turns)}", tuple(blocks), "Motion and forces", written_today()
        )
        write_text(path, to_html(page, folder))


def check_linkage(mechanism: Mechanism | LinkageFile, source: str) -> None:
    """InputError, with the `source` of a general linkage, where it cannot be built or turned."""
    if not isinstance(mechanism, LinkageFile):
        return
    try:
        linkage_remarks(mechanism, Simulate())
    except InputError as error:
        raise InputError(f"{source}: {error}") from error


def _settled_turn(mechanism: Mechanism | LinkageFile, speed: float) -> pd.DataFrame:
    """Samples of the last simulated revolution, by rising crank angle from 0, with the sizes of the
    joint forces."""
    options = Simulate(speed=speed, revolutions=_SETTLING + 1, samples_per_revolution=_SAMPLES)
    run = simulate_linkage if isinstance(mechanism, LinkageFile) else simulate
    turn = run(mechanism, options).samples.tail(_SAMPLES + 1)
    turn = turn.assign(
        crank_angle=np.abs(turn["crank_angle"].to_numpy()) - 2.0 * math.pi * _SETTLING
    )
    if speed < 0.0:
        turn = turn[::-1].assign(crank_angle=2.0 * math.pi - turn["crank_angle"][::-1])
    joints = (name.removesuffix("_x") for name in turn if name.endswith("_force_x"))
    sizes = {name: np.hypot(turn[f"{name}_x"], turn[f"{name}_y"]) for name in joints}
    bodies = [f"{name}_angle" for name in getattr(mechanism, "bodies", ())]
    shifted = {  # without the whole turns before this revolution
        name: turn[name] - 2.0 * math.pi * round(turn[name].mean() / (2.0 * math.pi))
        for name in bodies
        if name in turn and name != "crank_angle"
    }
    return turn.assign(**sizes | shifted).reset_index(drop=True)


def _quantities(
    mechanism: Mechanism | LinkageFile, turn: pd.DataFrame
) -> dict[str, dict[str, tuple[str, float]]]:
    """What the page shows, by heading: unit, and units per SI unit, by column."""
    if isinstance(mechanism, Mechanism):
        return {"Motion": _MOTION, "Forces in the joints": _FORCES}
    motion = {"crank_torque": ("N*m", 1.0)}
    for end, shown in _OF_BODIES.items():
        bodies = (name for name in turn if name.endswith(end) and name not in _OF_DRIVE)
        motion |= {name: shown for name in bodies if turn.attrs["units"][name] == _SI[end]}
    forces = {name: ("N", 1.0) for name in turn if name.endswith("_force")}
    normal = {
        f"{joint}_{kind}_force" for joint in mechanism.loose for kind in ("normal", "friction")
    }
    return {
        "Motion": motion,
        "Forces in the joints": {name: of for name, of in forces.items() if name not in normal},
    }


_OF_DRIVE = ("crank_angle", "crank_speed", "crank_torque")
_OF_BODIES = {
    "_position": ("mm", 1e3),
    "_velocity": ("m/s", 1.0),
    "_acceleration": ("m/s^2", 1.0),
    "_angle": ("deg", 180.0 / math.pi),
    "_angular_velocity": ("rad/s", 1.0),
}
_SI = {"_position": "m", "_velocity": "m/s", "_acceleration": "m/s^2", "_angle": "rad"}
_SI |= {"_angular_velocity": "rad/s"}
"""Quantities of the bodies of a general linkage, by the end of their column."""


def peaks(
    turns: Mapping[str, pd.DataFrame], columns: Mapping[str, tuple[str, float]]
) -> TableBlock:
    """Largest magnitude of each column, with its sign, and its crank angle, by speed."""
    heads, rows = ["quantity", "unit"], []
    heads += [head for speed in turns for head in (f"peak at {speed}", "angle [deg]")]
    for column, (unit, factor) in columns.items():
        row = [format_name(column), format_unit(unit)]
        for turn in turns.values():
            place = int(np.argmax(np.abs(turn[column])))
            row += [
                number(factor * turn[column][place]),
                number(math.degrees(turn["crank_angle"][place])),
            ]
        rows.append(tuple(row))
    caption = "Peaks: largest magnitude, with its sign, and its crank angle."
    return TableBlock(tuple(heads), tuple(rows), "ll" + "r" * (2 * len(turns)), caption)


def _blocks(
    mechanism: Mechanism | LinkageFile,
    speed: float,
    turns: Mapping[str, pd.DataFrame],
    folder: Path,
) -> list[Block]:
    is_linkage = isinstance(mechanism, LinkageFile)
    loose = mechanism.applied().loose
    state = "All joints are ideal."
    if loose:
        state = (
            f"Loose joints: {joined(map(format_name, loose))}. Impacts may differ between"
            " revolutions."
        )
    text = (
        f"Revolution {_SETTLING + 1} after the start, at constant speed, with samples every"
        f" {360 / _SAMPLES:g} deg."
    )
    shown = _quantities(mechanism, next(iter(turns.values())))
    every = {name: of for columns in shown.values() for name, of in columns.items()}
    blocks: list[Block] = [Paragraph(f"{text} {state}"), peaks(turns, every)]
    with matplotlib_style():
        for title, columns in shown.items():
            blocks.append(Heading(title))
            for column, (unit, factor) in columns.items():
                _over_angle(column, unit, factor, turns).save(folder / f"{column}.png")
                blocks.append(FigureBlock(column, format_name(column).capitalize(), small=True))
    if is_linkage:
        remarks = linkage_remarks(mechanism, Simulate(speed=speed))
    else:
        remarks = sentences(mechanism, speed)
    if remarks:
        blocks += [Heading("Remarks"), Bullets(remarks)]
    return blocks


def _over_angle(
    column: str, unit: str, factor: float, turns: Mapping[str, pd.DataFrame]
) -> Drawing:
    sheet = Sheet(_SIZE[1], 1, 1, _SIZE[0])
    panel = sheet.panel((0, 0), "", CRANK_ANGLE, Quantity(format_name(column), format_unit(unit)))
    for (speed, turn), colour in zip(turns.items(), _COLOURS, strict=False):
        panel.line(speed, np.degrees(turn["crank_angle"]), factor * turn[column], colour)
    panel.over_crank_angle(0.0, 360.0)
    shown = np.concatenate([factor * turn[column] for turn in turns.values()])
    if shown.min() < 0.0 and not column.endswith(("_position", "_velocity", "_angle")):  # impacts
        panel.spread_scale(shown)
    sheet.legend()
    return sheet.drawing()
