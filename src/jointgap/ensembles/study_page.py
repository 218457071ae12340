"""The study in plain words."""

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.ensembles.study_catalogue import FIGURES, SHOWN
from jointgap.report.page import FigureBlock, Page, Paragraph, TableBlock
from jointgap.report.plain_words import in_words, joined

_AXES = {
    "clearance": ("clearance", lambda value: f"{1e3 * value:.3g} mm"),
    "speed": ("speed", lambda value: f"{value * 30.0 / np.pi:.4g} rpm"),
    "friction": ("friction", lambda value: f"{value:g}"),
}


_CAPTION = (
    "Every point is simulated from several starts that differ by a hair; numbers are medians over them, measured over "
    "the settled revolutions. Where a number is underlined, the small change has grown beyond a thousandth of the "
    "clearance: the motion is chaotic or has not settled, and only statistics can be compared. Acceleration orders are "
    'amplitudes at multiples of the crank speed; "above order 10" is what the ideal mechanism does not have.'
)


def figures(place: str) -> list[FigureBlock]:
    """The maps, with what they show; `place` is where they lie, relative to the folder of figures, with a slash."""
    return [FigureBlock(f"{place}{name}", title, _CAPTION) for name, title in FIGURES.items()]


def page(points: pd.DataFrame, scenario: Scenario) -> Page:
    """What was varied, what it does, where only statistics hold."""
    study, loose = scenario.study, joined(map(in_words, scenario.mechanism.applied().loose))
    introduction = (
        f"Loose joints: {loose}. Each of the {len(points)} points is simulated from {study.members} starts, all but "
        "the first "
        f"changed by {study.perturbation:g} of the clearance; {study.transient_revolutions} revolutions pass, "
        f"{study.settled_revolutions} count. Numbers are medians over the starts."
    )
    meaning = (
        "From the smallest to the largest value, all else equal, a number becomes so many times as large (median, "
        "and range "
        "in brackets, over the other two axes):"
    )
    files = (
        "Figures: `study_<measure>.png`, a map for each measure; `study_orders.png`, the slider's acceleration by "
        "order. All "
        "numbers: `points.parquet` (`jointgap describe` explains the columns)."
    )
    findings = (_sensitive(points), _spreads(points), _failures(points), files)
    blocks = (
        Paragraph(introduction),
        Paragraph(meaning),
        _effects(points),
        *(Paragraph(text) for text in findings if text),
    )
    return Page("Clearance, speed and friction", blocks)


def _effects(points: pd.DataFrame) -> TableBlock:
    """By measure: its range, and its ratio from the smallest to the largest value of each axis, all else equal."""
    axes = [axis for axis in _AXES if points[axis].nunique() > 1]
    heads = [f"{_AXES[axis][0]} {_ends(points, axis)}" for axis in axes]
    rows = []
    for measure, shown in SHOWN.items():
        values = shown.factor * points[measure]
        cells = (f"{shown.quantity} [{shown.unit}]", f"{values.min():.3g}", f"{values.max():.3g}")
        rows.append((*cells, *(_ratio(points, measure, axis) for axis in axes)))
    return TableBlock(("over the settled revolutions", "smallest", "largest", *heads), tuple(rows))


def _ends(points: pd.DataFrame, axis: str) -> str:
    words = _AXES[axis][1]
    return f"{words(points[axis].min())} to {words(points[axis].max())}"


def _ratio(points: pd.DataFrame, measure: str, axis: str) -> str:
    others = [other for other in _AXES if other != axis]
    low, high = (
        points[points[axis] == end].set_index(others)[measure] for end in (points[axis].min(), points[axis].max())
    )
    ratio = (high / low).replace([np.inf, -np.inf], np.nan).dropna()
    if ratio.empty:
        return "-"
    return f"x {ratio.median():.3g} ({ratio.min():.3g} to {ratio.max():.3g})"


def _decided(points: pd.DataFrame) -> pd.DataFrame:
    """The points at which at least two starts went on, so that it is known whether they part."""
    return points[points["growth"].notna()]


def _sensitive(points: pd.DataFrame) -> str:
    decided = _decided(points)
    if decided.empty:
        return "Too many starts failed to tell whether a small change of the start grows."
    sensitive = decided[decided["sensitive"]]
    if sensitive.empty:
        return "At no point does a small change of the start grow: samples of these motions can be compared."
    by_friction = [
        f"{int(part['sensitive'].sum())} of {len(part)} at friction {friction:g}"
        for friction, part in decided.groupby("friction")
    ]
    return (
        f"At {len(sensitive)} of {len(decided)} points a small change of the start grows beyond a thousandth of the "
        "clearance "
        f"(largest factor {sensitive['growth'].max():.2g}): the motion is chaotic there or has not settled, and only "
        "statistics "
        f"can be compared. They are {', '.join(by_friction)}."
    )


def _spreads(points: pd.DataFrame) -> str:
    decided, spreads = _decided(points), []
    for words, part in (
        ("where samples hold", decided[~decided["sensitive"]]),
        ("where only statistics hold", decided[decided["sensitive"]]),
    ):
        spread = ((part["peak_force_high"] - part["peak_force_low"]) / part["peak_force"]).dropna()
        if len(spread):
            spreads.append(f"{100 * spread.median():.2g} % {words}")
    lead = "Spread of the peak force over the starts (largest less smallest, median of the points)"
    return f"{lead}: {'; '.join(spreads)}." if spreads else ""


def _failures(points: pd.DataFrame) -> str:
    failed = points[points["failed"] > 0]
    if failed.empty:
        return ""
    return f"Starts that failed: {failed['failed'].sum()}; the first: {failed['reason'].iloc[0]}"
