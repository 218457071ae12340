"""The one style of all figures, what a figure function hands back, and the only place that saves it."""

from base64 import b64encode
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from PIL import Image

from jointgap import tables
from jointgap.errors import InputError

_NOTEBOOK_DOTS = 110
"""Dots per inch at which a notebook shows a figure."""

INK = "#222222"
COLOURS = {
    # After Okabe and Ito's palette, which people with any colour vision tell apart; what stands together in one panel
    # differs in lightness too
    "ideal": "#000000",
    "simulation": "#0072B2",
    "network": "#D55E00",
    "second surrogate": "#009E73",
    "spline": "#CC79A7",
    "optimised": "#009E73",
    "genetic": "#D55E00",
    "local": "#0072B2",
    "paper": "#E69F00",
    "crank pin": "#00508C",
    "piston pin": "#D55E00",
    "crank pivot": "#33B58A",
    "flight": "#DDDDDD",
    "impact": "#E69F00",
    "contact": "#0072B2",
    "first": "#E69F00",
    "settled": "#0072B2",
    "limit": "#777777",
    "other": "#999999",
    "before": "#D55E00",
    "after": "#00508C",
    "pair": "#E69F00",
    "formula": "#CC79A7",
    "named": "#009E73",
    "sky": "#56B4E9",
}
LOOK = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same letters on every machine
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "lines.solid_joinstyle": "round",
    "path.simplify_threshold": 0.3,  # of a pixel: nobody sees it, and it takes a seventh off the SVG of a dense curve
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.hashsalt": "jointgap",  # the same names of clip paths in every run
    "svg.fonttype": "path",
}
WIDTH = 7.5  # inches
DOTS_PER_INCH = 160  # [1/in] sharp on a screen; printing takes the SVG


@dataclass(frozen=True, repr=False)
class Drawing:
    """A figure, or the frames of an animation, and the data that it shows.

    Attributes
    ----------
    figure : Figure
        The figure; of an animation, the state of the last frame.
    data : DataFrame
        Table `jointgap.tables.PLOTTED`.
    frames : tuple of ndarray
        Frames of an animation, shape (height, width, 3), uint8; empty for a still figure.
    frame_duration : float
        Time a frame is shown [s]; 0 for a still figure.
    """

    figure: Figure
    data: pd.DataFrame
    frames: tuple[np.ndarray, ...] = ()
    frame_duration: float = 0.0

    def save(self, path: Path | str) -> Path:
        """Write the figure alone, without its data.

        Parameters
        ----------
        path : Path or str
            Its suffix says how: ``.png`` or ``.svg``; of an animation ``.gif``.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        InputError
            Another suffix, or a file that cannot be written.
        """
        path, savers = Path(path), _savers(self)
        if path.suffix not in savers:
            raise InputError(
                f"{path}: figures are not written as '{path.suffix}'; end the name in {' or '.join(savers)}"
            )
        tables.write_atomically(path, savers[path.suffix])
        return path

    def _repr_mimebundle_(self, include=None, exclude=None) -> tuple[dict[str, str], dict[str, dict[str, int]]]:
        """The picture, for a notebook."""
        suffix, content = ".gif" if self.frames else ".png", BytesIO()
        _savers(self)[suffix](content)
        kind = f"image/{suffix[1:]}"
        width = {} if self.frames else {"width": round(self.figure.get_figwidth() * _NOTEBOOK_DOTS)}
        return {kind: b64encode(content.getvalue()).decode()}, {kind: width}

    def __repr__(self) -> str:
        return f"Figure of {len(self.figure.axes)} panels: .save('name.{'gif' if self.frames else 'png'}') writes it"


def matplotlib_style() -> AbstractContextManager[None]:
    """Context in which figures are made and saved."""
    return mpl.rc_context(LOOK)


def save(drawing: Drawing, stem: Path | str) -> tuple[Path, ...]:
    """Write a drawing and the data it shows.

    Neither file carries a date or the name of the software: the same drawing gives the same bytes.
    """
    stem = Path(stem)
    paths = []
    for suffix, saver in _savers(drawing).items():
        path = stem.with_name(stem.name + suffix)
        tables.write_atomically(path, saver)
        paths.append(path)
    data = stem.with_name(stem.name + ".parquet")
    tables.write(tables.PLOTTED, drawing.data, data)
    return (*paths, data)


def _savers(drawing: Drawing) -> dict[str, Callable]:
    """Functions that write the `drawing`, by suffix."""
    return _moving(drawing) if drawing.frames else _still(drawing)


def _still(drawing: Drawing) -> dict[str, Callable]:
    figure = drawing.figure
    with matplotlib_style():
        figure.draw_without_rendering()  # lays the panels out, once for both formats
    figure.set_layout_engine("none")

    def vectors(path):
        with matplotlib_style():
            figure.savefig(path, format="svg", dpi=DOTS_PER_INCH, metadata={"Date": None, "Creator": None})

    def pixels(path):
        drawn = BytesIO()
        with matplotlib_style():
            figure.savefig(drawn, format="png", dpi=DOTS_PER_INCH)
        # a palette of 256 colours is enough for curves and maps, and halves what pages and reports weigh
        reduced = Image.open(drawn).convert("RGB").quantize(256, dither=Image.Dither.NONE)
        reduced.save(path, format="PNG", optimize=True, dpi=(DOTS_PER_INCH, DOTS_PER_INCH))

    return {".svg": vectors, ".png": pixels}


def _moving(drawing: Drawing) -> dict[str, Callable]:
    def gif(path):
        # One palette for all frames, taken from a frame late enough to hold every colour: what stands still stays the
        # same
        # in each frame, and only what moves is stored again.
        frames = [Image.fromarray(frame) for frame in drawing.frames]
        palette = frames[-1].quantize(128, method=Image.Quantize.MAXCOVERAGE)
        reduced = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
        reduced[0].save(
            path,
            format="GIF",
            save_all=True,
            append_images=reduced[1:],
            duration=round(1000 * drawing.frame_duration),
            loop=0,
            optimize=True,
        )

    return {".gif": gif}
