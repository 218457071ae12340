"""Measured channels beside what the model predicts, in the channels' own units."""

from collections.abc import Mapping
from math import pi, tau
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.ticker import MultipleLocator

from jointgap.figures.sheet import CRANK_ANGLE, Panel, Quantity, Sheet
from jointgap.figures.style import WIDTH, Drawing
from jointgap.report.plain_words import in_words, unit_in_words

MOST_RUNS = 3  # beside each other, so that they can be read on a page
_FULL = 0.95  # share of the fullest revolution's samples from which a revolution counts as whole
_MODELS = {"before": ("base", {"linestyle": (0, (5, 1.5))}), "after": ("augmented", {})}
_NOISE_SPREADS = 2.0  # of the band to each side: 95 % of the noise
_NOISE = "95 % of the noise"
_SAMPLE = Quantity("sample", "1")


def measured_against_model(tables: Mapping[str, pd.DataFrame], verdict: Mapping[str, Any]) -> Drawing:
    """One revolution of every channel, measured and predicted, above what is left: rows for channels, columns for runs.

    Arguments as in `jointgap.figures.campaign_catalogue.draw`.
    """
    samples, errors = tables["residuals"], tables["channel_errors"]
    moments = ("before", "after") if (samples["base"] != samples["augmented"]).any() else ("before",)
    runs = errors.sort_values("held_out", ascending=False, kind="stable").drop_duplicates("run").head(MOST_RUNS)
    missed = (errors["before"] / errors["noise"]).groupby(errors["channel"]).max()
    channels = list(missed.sort_values(ascending=False, kind="stable").index)
    rows, width = 2 * len(channels), max(WIDTH, 3.1 * len(runs))
    sheet = Sheet(0.7 + 2.9 * len(channels), rows, len(runs), width=width, height_ratios=[1.7, 1.0] * len(channels))
    for column, run in enumerate(runs.itertuples()):
        lowest: Panel | None = None
        for row, channel in enumerate(channels):
            which = {"run": run.run, "channel": channel, "held_out": run.held_out}
            own, error = (table[(table[list(which)] == pd.Series(which)).all(axis=1)] for table in (samples, errors))
            if len(own):
                if lowest is not None:  # the scale stands below the lowest alone
                    lowest.axes.set_xlabel("")
                    lowest.axes.tick_params(labelbottom=False)
                lowest = _pair(sheet, 2 * row, column, own, error.iloc[0], moments)
    sheet.legend()
    return sheet.drawing()


def _pair(sheet: Sheet, row: int, column: int, samples: pd.DataFrame, error: pd.Series, moments: tuple) -> Panel:
    """Measured and predicted above measured less predicted, of one channel of one run; the lower panel."""
    angular = samples["crank_angle"].notna().any()
    shown = _one_revolution(samples) if angular else samples
    angle = shown["crank_angle"].to_numpy(dtype=float)
    x = np.degrees(angle % tau) if angular else shown["sample"].to_numpy(dtype=float)
    words, unit, factor = in_words(error["channel"]), unit_in_words(error["unit"]), error["si_per_unit"]
    of_angle = error["channel"] == "crank_angle"
    quantity = Quantity("less steady rotation" if of_angle else words.split()[-1], unit)
    held_out = ", held out" if error["held_out"] else ""
    title = f"{words}\n{error['run']}, {error['speed'] * 30.0 / pi:.4g} rpm{held_out}"
    abscissa = CRANK_ANGLE if angular else _SAMPLE
    above = sheet.panel((row, column), title, abscissa, quantity)
    below = sheet.panel((row + 1, column), f"{title}: residual", abscissa, Quantity("residual", unit), below=above)
    below.axes.set_title(f"RMS {' → '.join(_three_digits(error[moment]) for moment in moments)} {unit}")
    less = angle if of_angle else 0.0
    measured = shown["measured"].to_numpy(dtype=float)
    above.marks("measured", x, (measured - less) / factor, "limit", markersize=3.2, markeredgewidth=0.0, zorder=1.8)
    for moment in moments:
        model, style = _MODELS[moment]
        predicted = shown[model].to_numpy(dtype=float)
        above.line(f"model {moment}", x, (predicted - less) / factor, moment, linewidth=1.4, **style)
        below.line(f"measured − model {moment}", x, (measured - predicted) / factor, moment, linewidth=0.9)
        below.axes.lines[-1].set_label("")  # its colour says which
    _noise_band(below, x, _NOISE_SPREADS * shown["spread"].to_numpy(dtype=float) / factor)
    if angular:
        below.over_crank_angle(0.0, 360.0)
        below.axes.xaxis.set_major_locator(MultipleLocator(90))
    return below


def _three_digits(value: float) -> str:
    return "unknown" if np.isnan(value) else f"{value:#.3g}".rstrip(".")


def _noise_band(panel: Panel, x: np.ndarray, half: np.ndarray) -> None:
    panel.axes.fill_between(x, -half, half, color="#DDDDDD", linewidth=0.0, zorder=0, label=_NOISE)
    panel.record(_NOISE, x, np.zeros(len(x)), low=-half, high=half)


def _one_revolution(samples: pd.DataFrame) -> pd.DataFrame:
    """The last whole revolution, its samples in the order of their angle."""
    known = samples[samples["crank_angle"].notna()]
    turn = np.floor(known["crank_angle"] / tau)
    count = turn.value_counts()
    last = count.index[count >= _FULL * count.max()].max()
    of_turn = known[turn == last]
    return of_turn.iloc[np.argsort(of_turn["crank_angle"].to_numpy() % tau, kind="stable")]
