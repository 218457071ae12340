"""Figures of robust lengths: the front, the errors on fresh draws, and the measure over both lengths."""

import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm
from scipy.interpolate import RBFInterpolator

from jointgap.core import plot
from jointgap.core.plot import Drawing, Panel, Quantity, Sheet
from jointgap.robust_lengths.optimise_robust import RobustOptimum

TITLES = {
    "robust_front": "What is traded against the error",
    "robust_errors": "The error on fresh draws",
    "robust_map": "The measure over both lengths",
}
"""Titles of the figures by name."""

MDEG = 1e3 * 180.0 / np.pi
"""Thousandths of a degree in a radian."""

LOOKS = {
    "original": ("original lengths", "ideal", "o"),
    "frozen": ("frozen motion (the paper's way)", "paper", "v"),
    "nominal": ("best at nominal values", "network", "s"),
    "robust": ("robust optimum", "simulation", "D"),
}
"""Words, colour and mark of each pair of lengths."""

_CRANK, _ROD = Quantity("crank length", "mm", "$L_2$"), Quantity("rod length", "mm", "$L_3$")
_MAP_POINTS = 121  # along each length: what is between candidates is interpolated
_VIEW = 0.06  # of the front's width that is shown beyond its ends


def draw_robust(found: RobustOptimum) -> dict[str, Drawing]:
    """All figures by name; without the front where no lengths that were tried keep the constraints, and without the map
    where these leave a line of lengths, or single ones (`has_map`).
    """
    with plot.matplotlib_style():
        drawn = {"robust_errors": _errors(found)}
        if has_map(found):
            drawn["robust_map"] = _map(found)
        if found.candidates["on_front"].any():
            drawn["robust_front"] = _front(found)
        return drawn


def has_map(found: RobustOptimum) -> bool:
    """Whether the candidates lie all over the region, so that a surface goes through them: a fixed stroke leaves a line
    of lengths, two fixed values a point.
    """
    scaled, _ = _scaled_and_squares(found)
    x, y = scaled.T
    return np.linalg.matrix_rank(np.stack([np.ones_like(x), x, y, x * x, x * y, y * y]), tol=1e-6) == 6


def _front(found: RobustOptimum) -> Drawing:
    """Error against force, and against the change of the stroke: the front, and what else was tried near it."""
    robust = found.candidates[found.candidates["search"] == "robust"]
    allowed = robust[(robust["missed"] <= 0.0) & (robust["failed"] == 0)]
    front = robust[robust["on_front"]]
    words = found.asked.measure.words
    error = Quantity(f"error, {words}", "mdeg")
    shown = {
        "force": (Quantity(f"largest force in a pin, {words}", "N"), 1.0),
        "stroke_change": (Quantity("change of the stroke", "mm"), 1e3),
    }
    sheet = Sheet(4.2, 1, 2)
    best = robust.loc[front["error"].idxmin()]
    for place, (name, (quantity, factor)) in enumerate(shown.items()):
        panel = sheet.panel((0, place), f"error and {('force', 'stroke')[place]}", quantity, error)
        limits = [_around(factor * front[name]), _around(MDEG * front["error"])]
        x, y = factor * allowed[name].to_numpy(), MDEG * allowed["error"].to_numpy()
        inside = (limits[0][0] < x) & (x < limits[0][1]) & (limits[1][0] < y) & (y < limits[1][1])
        panel.marks("tried, constraints kept", x[inside], y[inside], "other", markersize=2.5, alpha=0.6)
        panel.marks("front of error, force and stroke", factor * front[name], MDEG * front["error"], "optimised")
        _mark(panel, "robust", [factor * best[name]], [MDEG * best["error"]])
        panel.axes.set_xlim(*limits[0])
        panel.axes.set_ylim(*limits[1])
    sheet.legend()
    return sheet.drawing()


def _around(values: pd.Series) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    width = (high - low) or abs(high) or 1.0
    return low - _VIEW * width, high + _VIEW * width


def _mark(panel: Panel, name: str, x: list[float], y: list[float]) -> None:
    words, colour, marker = LOOKS[name]
    panel.marks(words, x, y, colour, marker=marker, markersize=7.0, markeredgecolor="white", markeredgewidth=0.8)


def _errors(found: RobustOptimum) -> Drawing:
    """Share of the draws below an error, and what a change of the lengths gains in each draw."""
    sheet = Sheet(4.0, 1, 2)
    share = Quantity("share of the draws", "%")
    errors = found.fresh.pivot(index="draw", columns="lengths", values="error").dropna()
    left = sheet.panel((0, 0), "error", Quantity("RMS error of the transmission angle", "mdeg"), share)
    right = sheet.panel((0, 1), "fall of the error by the change", Quantity("fall of the error", "mdeg"), share)
    percent = 100.0 * np.arange(1, len(errors) + 1) / len(errors)
    for name, (words, colour, _) in LOOKS.items():
        heavy = {"linewidth": 1.8 if name == "robust" else 1.2, "linestyle": "--" if name == "nominal" else "-"}
        left.line(words, MDEG * np.sort(errors[name]), percent, colour, **heavy)
        if name != "original":
            falls = MDEG * (errors["original"] - errors[name])
            right.line(words, np.sort(falls), percent, colour, **heavy)
    right.vertical_line("no gain to the left of it", 0.0)
    for panel in (left, right):
        panel.axes.set_ylim(0.0, 100.0)
    left.axes.set_xlim(left=0.0)
    sheet.legend()
    return sheet.drawing()


def _map(found: RobustOptimum) -> Drawing:
    """What is minimised over both lengths, between the candidates by a surface through them."""
    robust = _of_the_search(found)
    x, y, value = _surface(found)
    sheet = Sheet(5.2, 1, 1)
    panel = sheet.panel((0, 0), f"error, {found.asked.measure.words}", _CRANK, _ROD)
    quantity = Quantity("error", "mdeg")
    levels = np.geomspace(np.nanmin(value), np.nanmax(value), 15)
    drawn = panel.contours("measure", x, y, value, quantity, levels=levels, cmap="Blues_r", norm=LogNorm())
    bar = sheet.figure.colorbar(drawn, ax=panel.axes, label=quantity.label, aspect=30)
    ticks = [tick for base in (1, 10, 100, 1000) for tick in (base, 2 * base, 5 * base)]
    ticks = [tick for tick in ticks if levels[0] <= tick <= levels[-1]]
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.minorticks_off()
    lengths = 1e3 * robust[["crank_length", "rod_length"]].to_numpy()
    panel.marks("candidates", lengths[:, 0], lengths[:, 1], "limit", marker=".", markersize=2.0)
    for row in found.comparison.lengths.itertuples():
        _mark(panel, row.lengths, [1e3 * row.crank_length], [1e3 * row.rod_length])
    sheet.legend()
    return sheet.drawing()


def _of_the_search(found: RobustOptimum) -> pd.DataFrame:
    return found.candidates[found.candidates["search"] == "robust"].dropna(subset="error")


def _scaled_and_squares(found: RobustOptimum) -> tuple[np.ndarray, np.ndarray]:
    """Candidates (n, 2) as shares of the box, each once, and the square of the measure there (n,) [mdeg^2]."""
    robust, region = _of_the_search(found), found.asked.region
    scaled = (robust[["crank_length", "rod_length"]].to_numpy() - region.lower) / region.size
    scaled, places = np.unique(np.round(scaled, 6), axis=0, return_index=True)
    return scaled, (MDEG * robust["error"].to_numpy()[places]) ** 2


def _surface(found: RobustOptimum) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Crank and rod lengths [mm] and the measure [mdeg] over them; NaN beyond the ratio limit.

    The square of the measure is interpolated: about the valley's floor it is nearly a parabola.
    """
    region = found.asked.region
    scaled, squares = _scaled_and_squares(found)
    surface = RBFInterpolator(scaled, squares, kernel="cubic", degree=2, smoothing=1e-6)
    line = np.linspace(0.0, 1.0, _MAP_POINTS)
    at = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    value = np.sqrt(np.maximum(surface(at), squares.min()))
    value[~region.contains(region.unscaled(at), slack=1e-12)] = np.nan
    x, y = (1e3 * (low + line * width) for low, width in zip(region.lower, region.size, strict=True))
    return x, y, value.reshape(_MAP_POINTS, _MAP_POINTS)
