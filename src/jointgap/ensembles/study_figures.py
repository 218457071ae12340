"""Maps of the study and orders of the slider's acceleration."""

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, Normalize
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from jointgap.config import Scenario
from jointgap.ensembles.study_catalogue import SHOWN
from jointgap.figures import style
from jointgap.figures.sheet import Panel, Quantity, Sheet
from jointgap.figures.style import Drawing
from jointgap.tables.study_tables import ORDERS

CLEARANCE = Quantity("radial clearance", "mm", "$r_c$")
SPEED = Quantity("crank speed", "rpm")

_MOST_CELLS = 8  # in a row, so that their numbers can be read
_COLOURS = ("sky", "simulation", "second surrogate", "paper", "network", "spline", "limit")


def draw_study(points: pd.DataFrame, scenario: Scenario) -> dict[str, Drawing]:
    """All figures of the study by name."""
    with style.matplotlib_style():
        maps = {f"study_{measure}": _study_map(points, measure) for measure in SHOWN}
        return maps | {"study_orders": _order_lines(points, scenario)}


def _study_map(points: pd.DataFrame, measure: str) -> Drawing:
    """One measure over clearance and speed, a panel for each friction; where only statistics hold, underlined."""
    shown = SHOWN[measure]
    quantity, factor = Quantity(shown.quantity, shown.unit), shown.factor
    frictions = sorted(points["friction"].unique())
    columns = min(2, len(frictions))
    rows = -(-len(frictions) // columns)
    clearances, speeds = (np.sort(points[key].unique()) for key in ("clearance", "speed"))
    sheet = Sheet(1.0 + rows * (0.9 + 0.27 * len(speeds)), rows, columns)
    values = factor * points[measure].to_numpy(dtype=float)
    finite = values[~np.isnan(values)]
    low, high = (finite.min(), finite.max()) if finite.size else (0.0, 1.0)
    norm = (
        LogNorm(low, high)
        if shown.logarithmic and 0 < low < high
        else Normalize(low, high if high > low else low + 1.0)
    )
    drawn = None
    for place, friction in enumerate(frictions):
        panel = sheet.panel(divmod(place, columns), f"friction {friction:g}", CLEARANCE, SPEED)
        own = points[points["friction"] == friction].pivot(index="speed", columns="clearance")
        grid = factor * own[measure].to_numpy(dtype=float)
        drawn = panel.axes.pcolormesh(grid, cmap="viridis", norm=norm)
        _label(panel, clearances, speeds)
        marked = own["sensitive"].to_numpy(dtype=bool)
        x, y = np.meshgrid(1e3 * clearances, speeds * 30.0 / np.pi)
        panel.record(
            quantity.name,
            x.ravel(),
            y.ravel(),
            value=grid.ravel(),
            value_quantity=quantity.name,
            value_unit=quantity.unit,
        )
        panel.record("only statistics", x[marked], y[marked])
        _write(panel, grid, marked, norm)
    bar = sheet.figure.colorbar(
        drawn, ax=[panel.axes for panel in sheet.panels], label=quantity.label, location="bottom", shrink=0.7, aspect=40
    )
    if isinstance(norm, LogNorm):
        bar.ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 1e3 else (1.0,)))
        bar.ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _short(value)))
        bar.ax.xaxis.set_minor_locator(NullLocator())
    note = "underlined: sensitive to the start, only statistics hold" if points["sensitive"].any() else ""
    sheet.figure.suptitle(note, fontsize=8.5, x=0.99, ha="right")
    return sheet.drawing()


def _label(panel: Panel, clearances: np.ndarray, speeds: np.ndarray) -> None:
    axes = panel.axes
    axes.set_xticks(np.arange(len(clearances)) + 0.5, [f"{1e3 * value:.3g}" for value in clearances])
    axes.set_yticks(np.arange(len(speeds)) + 0.5, [f"{value * 30.0 / np.pi:.4g}" for value in speeds])
    axes.grid(False)
    axes.tick_params(length=0)


def _write(panel: Panel, grid: np.ndarray, marked: np.ndarray, norm: Normalize) -> None:
    """Numbers in the cells where there is room; a line below those of marked points."""
    small = grid.shape[1] <= _MOST_CELLS
    for (row, column), value in np.ndenumerate(grid):
        if np.isnan(value):
            continue
        colour = "white" if norm(value) < 0.6 else "black"
        if small:
            panel.axes.text(
                column + 0.5, row + 0.52, _short(value), ha="center", va="center", color=colour, fontsize=7.5
            )
        if marked[row, column]:
            panel.axes.plot([column + 0.22, column + 0.78], [row + 0.16] * 2, color=colour, linewidth=1.2)


def _short(value: float) -> str:
    """Three digits, thousands and millions by letter."""
    for limit, letter in ((1e6, "M"), (1e4, "k")):
        if abs(value) >= limit:
            return f"{value / {'M': 1e6, 'k': 1e3}[letter]:.3g}{letter}"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _order_lines(points: pd.DataFrame, scenario: Scenario) -> Drawing:
    """Amplitudes of the slider's acceleration by order at the middle speed that has any, a panel for each friction."""
    frictions = np.sort(points["friction"].unique())
    measured = points[points["order_1"].notna()]
    speeds = np.sort((points if measured.empty else measured)["speed"].unique())
    speed = speeds[len(speeds) // 2]
    columns = min(2, len(frictions))
    rows = -(-len(frictions) // columns)
    sheet = Sheet(0.6 + 2.3 * rows, rows, columns)
    orders = np.arange(1, ORDERS + 1)
    names = [f"order_{k}" for k in orders]
    ideal = ideal_orders(scenario, speed)
    amplitude = Quantity("amplitude", "m/s²")
    shown = measured[measured["speed"] == speed]
    lowest = shown[names].to_numpy(dtype=float).min(initial=ideal.max())
    for place, friction in enumerate(frictions):
        title = f"friction {friction:g}, {speed * 30.0 / np.pi:.4g} rpm"
        panel = sheet.panel(divmod(place, columns), title, Quantity("order of the crank speed", "1"), amplitude)
        own = shown[shown["friction"] == friction].sort_values("clearance")
        for number, (_, row) in enumerate(own.iterrows()):
            values = row[names].to_numpy(dtype=float)
            colour = _COLOURS[number % len(_COLOURS)]
            panel.line(f"clearance {1e3 * row['clearance']:.3g} mm", orders, values, colour, marker="o", markersize=2.5)
        visible = ideal > 0.3 * lowest
        panel.marks("no clearance", orders[visible], ideal[visible], "ideal", marker="_", markersize=9)
        panel.axes.set_yscale("log")
        panel.axes.set_ylim(bottom=0.3 * lowest)
        panel.axes.set_xticks([1, 5, 10, 15, 20])
    sheet.legend()
    return sheet.drawing()


def ideal_orders(scenario: Scenario, speed: float) -> np.ndarray:
    """Amplitudes (ORDERS,) [m/s^2] of the slider in a `scenario` without clearance at `speed` [rad/s], by order from
    1.
    """
    mechanism = scenario.mechanism.applied()
    angle = np.arange(720) * (2.0 * np.pi / 720)
    height = mechanism.slider.offset - mechanism.crank.length * np.sin(angle)
    position = mechanism.crank.length * np.cos(angle) + np.sqrt(mechanism.rod.length**2 - height**2)
    amplitudes = 2.0 * np.abs(np.fft.rfft(position)) / len(angle)
    orders = np.arange(1, ORDERS + 1)
    return amplitudes[orders] * (orders * speed) ** 2
