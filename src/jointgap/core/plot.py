"""Style, output and registry of all figures; matplotlib is imported on first use."""

import re
from base64 import b64encode
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import yaml
from numpy.typing import ArrayLike

from jointgap.core import parquet, schema
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.files import package_data

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.contour import QuadContourSet
    from matplotlib.figure import Figure

_NOTEBOOK_DOTS = 110
"""Resolution of figures in notebooks [1/in]."""

INK = "#222222"
COLOURS = package_data("core/colours.yaml")
STYLE = Path(__file__).parent / "templates/jointgap.mplstyle"
WIDTH = 7.5  # inches
DOTS_PER_INCH = 160  # [1/in] for screens; print the SVG


@dataclass(frozen=True, repr=False)
class Drawing:
    """A figure, or the frames of an animation, with the plotted data.

    Attributes
    ----------
    figure : Figure
        The figure; for an animation, its last frame.
    data : DataFrame
        Table `PLOTTED`.
    frames : tuple of ndarray
        Frames of an animation, shape (height, width, 3), uint8; empty for a still figure.
    frame_duration : float
        Duration of a frame [s]; 0 for a still figure.
    """

    figure: "Figure"
    data: pd.DataFrame
    frames: tuple[np.ndarray, ...] = ()
    frame_duration: float = 0.0

    def save(self, path: Path | str) -> Path:
        """Write the figure without its data.

        Parameters
        ----------
        path : Path or str
            Suffix ``.png`` or ``.svg``; ``.gif`` for an animation.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        InputError
            Another suffix, or the file is not writable.
        """
        path, writers = Path(path), self.writers()
        if path.suffix not in writers:
            raise InputError(
                f"{path}: no figure format '{path.suffix}'; use {' or '.join(writers)}"
            )
        parquet.write_atomically(path, writers[path.suffix])
        return path

    def writers(self) -> dict[str, Callable]:
        """Functions that write the file, by suffix."""
        return (
            {".gif": self._write_gif}
            if self.frames
            else {".png": self._write_png, ".svg": self._write_svg}
        )

    def _write_svg(self, file) -> None:
        with matplotlib_style():
            self.figure.savefig(
                file, format="svg", dpi=DOTS_PER_INCH, metadata={"Date": None, "Creator": None}
            )

    def _write_png(self, file) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from PIL import Image

        canvas = FigureCanvasAgg(self.figure)
        with matplotlib_style():
            canvas.draw()
        self.figure.set_layout_engine(None)  # a layout engine would draw the SVG twice
        # a palette of 256 colours is sufficient, and halves the size of pages and reports
        drawn = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
        reduced = drawn.quantize(256, dither=Image.Dither.NONE)
        reduced.save(file, format="PNG", dpi=(DOTS_PER_INCH, DOTS_PER_INCH))

    def _write_gif(self, file) -> None:
        from PIL import Image

        # one palette for all frames, from the last one, which has all colours: static parts do not
        # flicker
        frames = [Image.fromarray(frame) for frame in self.frames]
        palette = frames[-1].quantize(128, method=Image.Quantize.MAXCOVERAGE)
        first_frame, *more_frames = (
            frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames
        )
        timing = {"duration": round(1000 * self.frame_duration), "loop": 0}
        first_frame.save(
            file, format="GIF", save_all=True, append_images=more_frames, optimize=True, **timing
        )

    def _repr_mimebundle_(
        self, include=None, exclude=None
    ) -> tuple[dict[str, str], dict[str, dict[str, int]]]:
        """The image for a notebook."""
        suffix, content = ".gif" if self.frames else ".png", BytesIO()
        self.writers()[suffix](content)
        kind = f"image/{suffix[1:]}"
        width = {} if self.frames else {"width": round(self.figure.get_figwidth() * _NOTEBOOK_DOTS)}
        return {kind: b64encode(content.getvalue()).decode()}, {kind: width}

    def __repr__(self) -> str:
        count = len(self.figure.axes)
        panels = "1 panel" if count == 1 else f"{count} panels"
        return f"Figure of {panels}: .save('name.{'gif' if self.frames else 'png'}') writes it"


def matplotlib_style() -> AbstractContextManager[None]:
    """Context for creating and saving figures."""
    from matplotlib import rc_context

    return rc_context(fname=STYLE)


def save(drawing: Drawing, stem: Path | str) -> tuple[Path, ...]:
    """Write a drawing and its data; reproducible bytes (no date, no version)."""
    stem = Path(stem)
    paths = []
    for suffix, writer in drawing.writers().items():
        paths.append(stem.with_name(stem.name + suffix))
        parquet.write_atomically(paths[-1], writer)
    data = stem.with_name(stem.name + ".parquet")
    parquet.write(schema.PLOTTED, drawing.data, data)
    return (*paths, data)


_PART = re.compile(r"\[(not )?(\w+):([^\]]*)\]")


@dataclass(frozen=True)
class FigureSpec:
    """One figure of a scenario or a campaign."""

    title: str
    category: str  # Section of the report
    tables: Sequence[str]  # Names of its tables
    caption: str
    call: str  # Name for `plot` in Python
    nothing: str = ""  # Message where there is no data; empty: its tables are required
    moving: bool = False  # An animation, saved as GIF
    options: Mapping[str, Any] = field(default_factory=dict)  # Of the function that draws it
    function: Callable[..., Drawing] = None
    template: tuple[str, str] = ("", "")  # Title and caption with conditional parts

    def where(self, **conditions: bool) -> "FigureSpec":
        """The figure with the parts ``[name:words]`` or ``[not name:words]`` whose condition
        holds."""

        def kept(part: re.Match) -> str:
            return part[3] if conditions.get(part[2], True) != bool(part[1]) else ""

        title, caption = (_PART.sub(kept, text) for text in self.template)
        return replace(self, title=title, caption=caption)


class Figures(dict[str, FigureSpec]):
    """Registry of the figures of a kind of results by name, in the order of a YAML file.

    The file has the attributes of `FigureSpec` of each figure. Title and caption of the registry
    have every conditional part, see `FigureSpec.where`.
    """

    def __init__(self, file: Path):
        for name, content in yaml.safe_load(file.read_text(encoding="utf-8")).items():
            function = content.pop("function", name)
            template = content["title"], content["caption"]
            spec = FigureSpec(**{"call": function} | content, function=function, template=template)
            self[name] = spec.where()

    def figure(self, function: Callable) -> Callable:
        """A decorator for the function, from tables and a scenario (or a verdict) to a `Drawing`,
        that the file names for a figure; by default it has the figure's name."""
        for name, spec in self.items():
            if spec.function == function.__name__:
                self[name] = replace(spec, function=function)
        return function

    @property
    def still(self) -> tuple[str, ...]:
        """Names of the figures saved as SVG and PNG."""
        return tuple(name for name, spec in self.items() if not spec.moving)

    def spec(self, name: str) -> FigureSpec:
        if name not in self:
            raise InputError(f"no figure '{name}'; {did_you_mean(name, self)}")
        return self[name]

    def needed_tables(self, names: Iterable[str]) -> tuple[str, ...]:
        """Names of the tables of the figures `names`, sorted."""
        return tuple(sorted({table for name in names for table in self.spec(name).tables}))

    def draw(self, name: str, frames: Mapping[str, pd.DataFrame | None], of: Any) -> Drawing:
        """Draw one figure from `frames` of its tables, `of` a scenario or the content of a
        verdict."""
        spec = self.spec(name)
        missing = [table for table in spec.tables if frames.get(table) is None]
        if missing and not spec.nothing:
            raise InputError(
                f"figure {name} requires the table '{missing[0]}'; give it (required:"
                f" {', '.join(spec.tables)})"
            )
        with matplotlib_style():
            if spec.nothing and (missing or frames[spec.tables[0]].empty):
                return message_sheet(spec.title, spec.nothing)
            return spec.function(frames, of, **spec.options)


@dataclass(frozen=True)
class Quantity:
    """Name and unit of an axis."""

    name: str
    unit: str  # Unit of the axis; ``'1'`` for pure numbers, ``''`` for categories
    symbol: str = ""  # Mathtext, optional

    @property
    def label(self) -> str:
        """Axis label."""
        words = f"{self.name} {self.symbol}".strip()
        return f"{words} [{'–' if self.unit == '1' else self.unit}]" if self.unit else words


def round_up(value: float) -> float:
    """The next larger number of the form 1, 2 or 5 times a power of ten."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(
        next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= value * (1 - 1e-9))
    )


def tick_label(value: float, position: int) -> str:
    """Tick label of a `value`: plain below 10 000, a power of ten beyond. Matplotlib passes the
    `position`."""
    if abs(value) < 1e4:
        return f"{value:g}".replace("-", "−")
    exponent = int(np.floor(np.log10(abs(value)) + 1e-9))
    factor = value / 10.0**exponent
    lead = {1.0: "", -1.0: "-"}.get(round(factor, 6), rf"{factor:g} \times ")
    return rf"${lead}10^{{{exponent}}}$"


def label_ticks(axis, locator) -> None:
    """Major ticks of a matplotlib `axis` from a `locator`, with plain labels; no minor ticks."""
    from matplotlib.ticker import NullLocator

    axis.set_major_locator(locator)
    axis.set_major_formatter(tick_label)
    axis.set_minor_locator(NullLocator())


def label_log_ticks(axis, low: float, high: float) -> None:
    """Plain labels of a logarithmic matplotlib `axis` from `low` to `high`, at least three; no
    minor ticks."""
    from matplotlib.ticker import LogLocator, MaxNLocator

    ratio = high / low if low > 0.0 else np.inf
    # LogLocator gives no tick at all with several steps over many decades, and one alone within a
    # few per cent
    steps = (1.0, 2.0, 5.0) if ratio < 1e3 else (1.0,)
    label_ticks(axis, LogLocator(subs=steps) if ratio > 9.99 else MaxNLocator(5))


def width_for(columns: int) -> float:
    """Width [inches] of a figure with one column per loose joint; two columns have the default
    width."""
    return WIDTH * max(1.0, columns / 2)


BULK = 95.0  # [%] of the samples in the linear part of a linear-logarithmic scale
# ratio of the largest value to the bulk (or the desired motion) above which a scale is logarithmic
IMPACTS_DWARF = 4.0
LINEAR_BAND = "grey band: linear scale; outside: logarithmic"
DENSE_LINE, DENSE_MARKS = 5000, 300
"""Numbers of points above which a curve, or marks, are rasterised in SVG to limit its size."""

CRANK_ANGLE = Quantity("crank angle", "deg", r"$\theta_2$")


class Panel:
    """The axes of one panel of a sheet."""

    def __init__(self, axes: "Axes", title: str, x: Quantity, y: Quantity):
        self.axes, self.title, self.x, self.y = axes, title, x, y
        self.records: list[dict[str, np.ndarray]] = []  # Columns of `PLOTTED`
        axes.set_title(title)
        axes.set_xlabel(x.label)
        axes.set_ylabel(y.label)

    def line(self, series: str, x: ArrayLike, y: ArrayLike, colour: str, **style) -> None:
        """A curve `x`, `y`, each (n,) in the unit of its axis, called `series`; gaps where `y` is
        nan.

        `colour` is a name of `COLOURS`, `style` are matplotlib's options.
        """
        pixels = {"rasterized": np.size(x) > DENSE_LINE}
        self.axes.plot(x, y, label=series, color=COLOURS[colour], **pixels | style)
        self.record(series, x, y)

    def marks(
        self,
        series: str,
        x: ArrayLike,
        y: ArrayLike,
        colour: str,
        low=None,
        high=None,
        labels=None,
        along="y",
        **style,
    ) -> None:
        """Points `x`, `y`, each (n,) in the unit of its axis; `series`, `colour` and `style` as in
        `line`.

        Optional bars from `low` to `high` (n,) `along` an axis; `labels` are names of categories.
        """
        pixels = {"rasterized": np.size(x) > DENSE_MARKS}
        style = {"marker": "o", "markersize": 4.0, "linestyle": "none"} | pixels | style
        if low is not None:
            centre = np.asarray(y if along == "y" else x)
            spread = {f"{along}err": np.abs([centre - np.asarray(low), np.asarray(high) - centre])}
            self.axes.errorbar(
                x, y, **spread, label=series, color=COLOURS[colour], capsize=2.5, **style
            )
        else:
            self.axes.plot(x, y, label=series, color=COLOURS[colour], **style)
        self.record(series, x, y, low=low, high=high, label=labels)

    def contours(
        self,
        series: str,
        x: np.ndarray,
        y: np.ndarray,
        value: np.ndarray,
        quantity: Quantity,
        **style,
    ) -> "QuadContourSet":
        """Filled contours of a `value` (len(y), len(x)) over the grid of `x` and `y`; returns the
        artist for a colour bar.

        `quantity` is the name and unit of the value; `series` and `style` as in `line`.
        """
        drawn = self.axes.contourf(x, y, value, **style)
        grid_x, grid_y = np.meshgrid(x, y)
        self.record(
            series,
            grid_x.ravel(),
            grid_y.ravel(),
            value=np.ravel(value),
            value_quantity=quantity.name,
            value_unit=quantity.unit,
        )
        return drawn

    def horizontal_line(self, series: str, y: float) -> None:
        """A horizontal line across the panel at `y`, recorded as `series`, not in the legend."""
        self.axes.axhline(y, color=COLOURS["limit"], linewidth=0.9, linestyle=":")
        self.record(series, [np.nan], [y])

    def categories(self, names: Sequence[str]) -> None:
        """Category names on the abscissa at 0, 1, 2, ..."""
        self.axes.set_xticks(range(len(names)), names)
        self.axes.grid(False, axis="x")

    def rows(self, names: Sequence[str], places: ArrayLike) -> None:
        """Category `names` on the ordinate at `places`."""
        self.axes.set_yticks(places, names)
        self.axes.grid(False, axis="y")

    def bands(
        self, row: float, label: str, x: np.ndarray, values: np.ndarray, kinds: Sequence[str]
    ) -> None:
        """A band at height `row`, recorded as `label`; the colour shows the kind of the text
        `values` (n,) over `x`."""
        starts = np.flatnonzero(np.append(True, values[1:] != values[:-1]))
        edges = np.append(x[starts], x[-1])
        for kind in kinds:
            low, high = (edges[i:][: len(starts)][values[starts] == kind] for i in (0, 1))
            spans = list(zip(low, high - low, strict=True))
            self.axes.broken_barh(
                spans, (row - 0.4, 0.8), color=COLOURS[kind], label=kind, linewidth=0.0
            )
            self.record(
                kind,
                (low + high) / 2.0,
                np.full(len(low), float(row)),
                low=low,
                high=high,
                label=[label] * len(low),
            )

    def vertical_line(self, series: str, x: float, named: bool = True) -> None:
        """A vertical line at `x`, in the legend as `series` if `named`."""
        self.axes.axvline(
            x,
            label=series if named else None,
            color=COLOURS["limit"],
            linewidth=0.9,
            linestyle="--",
        )
        self.record(series, [x], [np.nan])

    def over_crank_angle(self, start: float, end: float, step: float | None = None) -> None:
        """Limits for crank angles from `start` to `end` [deg], with ticks every `step` if given."""
        from matplotlib.ticker import MultipleLocator

        span = end - start
        self.axes.set_xlim(start, end)
        usual = 180 if span > 600 else 60 if span > 200 else 15 if span > 50 else 5
        self.axes.xaxis.set_major_locator(MultipleLocator(step or usual))

    def square(self, half_width: float) -> None:
        """Equal scales on both axes, from -`half_width` to `half_width`."""
        self.axes.set_xlim(-half_width, half_width)
        self.axes.set_ylim(-half_width, half_width)
        self.axes.set_aspect("equal")

    def logarithmic(self) -> None:
        """A logarithmic ordinate with plain numbers; call it after plotting."""
        self.axes.set_yscale("log")
        label_log_ticks(self.axes.yaxis, *self.axes.dataLim.intervaly)

    def linear_then_logarithmic(self, threshold: float, named: bool = True) -> None:
        """An ordinate that is linear within +-`threshold` (grey band) and logarithmic beyond; call
        it after plotting.

        The legend explains it if `named`.
        """
        from matplotlib.ticker import FixedLocator

        bottom, top = self.axes.dataLim.intervaly
        decades = 10.0 ** np.arange(np.floor(np.log10(threshold)) + 1.0, 20.0)
        beyond = decades[
            decades > 4.0 * threshold
        ]  # nearer labels would overlap that of the threshold
        ticks = [
            -threshold,
            0.0,
            threshold,
            *beyond[beyond <= 1.3 * top],
            *-beyond[beyond <= -1.3 * bottom],
        ]
        self.axes.set_yscale("symlog", linthresh=threshold, linscale=1.2)
        label_ticks(self.axes.yaxis, FixedLocator(sorted(ticks)))
        self.axes.set_ylim(min(1.5 * bottom, -1.2 * threshold), max(1.5 * top, 1.2 * threshold))
        if named:
            self.axes.axhspan(-threshold, threshold, color="#EEEEEE", zorder=0, label=LINEAR_BAND)
            self.record(LINEAR_BAND, [np.nan], [0.0], low=[-threshold], high=[threshold])

    def spread_scale(self, shown: np.ndarray) -> None:
        """A linear-logarithmic ordinate where the largest of the values `shown` exceed the bulk by
        far."""
        size = np.abs(shown[np.isfinite(shown)])
        bulk = np.percentile(size, BULK)
        if size.max() > IMPACTS_DWARF * bulk > 0.0:
            self.linear_then_logarithmic(round_up(bulk))

    def record(self, series: str, x: ArrayLike, y: ArrayLike, **more) -> None:
        """Record points `x`, `y` (n,) of a `series` in the plotted data; `more` are further columns
        of `PLOTTED`."""
        constant = {
            "panel": self.title,
            "series": series,
            "x_quantity": self.x.name,
            "x_unit": self.x.unit,
            "y_quantity": self.y.name,
            "y_unit": self.y.unit,
        }
        columns = {"x": x, "y": y} | constant | more
        self.records.append(
            {
                column.name: _column(column, columns.get(column.name), np.size(x))
                for column in schema.PLOTTED.columns
            }
        )


_LEGEND_WIDTH = 2.0  # [points]


class Sheet:
    """A figure in the common style, with its plotted data."""

    def __init__(self, height: float, rows: int, columns: int, width: float = WIDTH, **grid):
        from matplotlib.figure import Figure

        self.figure = Figure(figsize=(width, height), dpi=DOTS_PER_INCH, layout="constrained")
        self.grid = self.figure.add_gridspec(rows, columns, **grid)
        self.panels: list[Panel] = []

    def panel(
        self, place: tuple, title: str, x: Quantity, y: Quantity, below: Panel | None = None
    ) -> Panel:
        """A panel at `place` = (row, column) of the grid with axes `x` and `y`; it shares the
        abscissa of `below`."""
        axes = self.figure.add_subplot(self.grid[place], sharex=below.axes if below else None)
        panel = Panel(axes, title, x, y)
        if below:
            below.axes.set_xlabel("")
            below.axes.tick_params(labelbottom=False)
        self.panels.append(panel)
        return panel

    def legend(self, panels: Sequence[Panel] | None = None, columns: int | None = None) -> None:
        """One legend above the given panels (all by default), without duplicates, in `columns` (as
        many as fit by default).
        """
        handles: dict[str, object] = {}
        for panel in panels or self.panels:
            for handle, label in zip(*panel.axes.get_legend_handles_labels(), strict=True):
                handles.setdefault(label, handle)
        if LINEAR_BAND in handles:  # last, because it explains the scale
            handles[LINEAR_BAND] = handles.pop(LINEAR_BAND)
        if columns is None:
            longest = max(map(len, handles))
            columns = max(
                1, min(len(handles), int(14 * self.figure.get_figwidth() / (longest + 7)))
            )
        legend = self.figure.legend(
            handles.values(), handles.keys(), loc="outside upper center", ncols=columns
        )
        for line in legend.get_lines():  # the colour of a thin line is hard to see
            line.set_linewidth(max(line.get_linewidth(), _LEGEND_WIDTH))

    def drawing(self) -> Drawing:
        """The figure with its data."""
        records = [record for panel in self.panels for record in panel.records]
        columns = {
            name: np.concatenate([record[name] for record in records])
            for name in schema.PLOTTED.names
        }
        return Drawing(self.figure, pd.DataFrame(columns))


def _column(column: schema.Column, value: Any, count: int) -> np.ndarray:
    """A value, or `count` values, as a column of table `PLOTTED`; None is missing."""
    if column.kind == "float":
        values = np.asarray(np.nan if value is None else value, dtype=float)
    else:
        values = np.asarray(value, dtype=object)
    return np.broadcast_to(values, count)


def message_sheet(title: str, sentence: str) -> Drawing:
    """A sheet with a `title` and the reason, a `sentence`, why there is no figure."""
    sheet = Sheet(1.2, 1, 1)
    panel = sheet.panel((0, 0), title, Quantity("", ""), Quantity("", ""))
    panel.axes.set_axis_off()
    panel.axes.text(0.5, 0.4, sentence, ha="center", va="center", transform=panel.axes.transAxes)
    panel.record(sentence, [], [])
    return sheet.drawing()
