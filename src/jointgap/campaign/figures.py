"""Figures of a campaign; their titles and captions are in `figures.yaml`."""

from collections.abc import Mapping, Sequence
from math import pi, tau
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jointgap.core import plot
from jointgap.core.plot import CRANK_ANGLE, WIDTH, Drawing, Panel, Quantity, Sheet
from jointgap.core.words import format_name, format_run, format_size, format_unit, number
from jointgap.identification.settings import DEFAULT_SETTINGS

FIGURES = plot.Figures(Path(__file__).with_suffix(".yaml"))
figure = FIGURES.figure
Tables, Verdict = Mapping[str, pd.DataFrame], Mapping[str, Any]

SPREADS = "standard deviations of the noise"
MEAN = Quantity("mean residual", SPREADS)
GAP = Quantity("gap: root mean square residual", SPREADS)
_SAMPLE, _RUN, _EFFECT = Quantity("sample", "1"), Quantity("run", ""), Quantity("effect", "")

BAND = 2.0
"""Half width of the noise band in standard deviations: it contains 95 % of the samples of a true
model."""

BASE = "the current model"
MODELS = {"before": "base", "after": "augmented"}
"""Names of the models in tables, by series."""

MOST_RUNS = 3  # columns that are readable on a page
RANKED = 8  # explanations shown with one effect, and with several


def list_rows(panel: Panel, names: Sequence[str]) -> None:
    """Label the ordinate of a `panel` with `names`, the first on top."""
    panel.rows(names, range(len(names)))
    panel.axes.set_ylim(len(names) - 0.4, -0.6)
    panel.axes.grid(True, axis="y", alpha=0.5)
    panel.axes.set_ylabel("")


def _phase(verdict: Verdict) -> Quantity:
    """The place in a cycle, of which figures show one."""
    cycle = verdict.get("cycle", CRANK_ANGLE.name)
    return CRANK_ANGLE if cycle == CRANK_ANGLE.name else Quantity(cycle, "deg")


def _moments(before: pd.Series, after: pd.Series) -> list[str]:
    return ["before", "after"] if (before != after).any() else ["before"]


def _band(panel: Panel, x: np.ndarray, half: np.ndarray, label: str) -> None:
    panel.axes.fill_between(x, -half, half, color="#DDDDDD", linewidth=0.0, zorder=0, label=label)
    panel.record(label, x, np.zeros(len(x)), low=-half, high=half)


@figure
def measured_against_model(tables: Tables, verdict: Verdict) -> Drawing:
    """One revolution of each channel, measured and predicted, above the residual."""
    samples, errors = tables["residuals"], tables["channel_errors"]
    moments = _moments(samples["base"], samples["augmented"])
    by_priority = errors.sort_values("held_out", ascending=False, kind="stable")
    runs = by_priority.drop_duplicates("run").head(MOST_RUNS).sort_values("speed", kind="stable")
    misfit = (errors["before"] / errors["noise"]).groupby(errors["channel"]).max()
    channels = list(misfit.sort_values(ascending=False, kind="stable").index)
    sheet = Sheet(
        0.7 + 2.9 * len(channels),
        2 * len(channels),
        len(runs),
        width=max(WIDTH, 3.1 * len(runs)),
        height_ratios=[1.7, 1.0] * len(channels),
    )
    keys = ["run", "channel", "held_out"]
    series = dict(list(samples.groupby(keys, sort=False)))
    errors = errors.set_index(keys)
    phase = _phase(verdict)
    for column, run in enumerate(runs.itertuples()):
        lowest = None
        for row, channel in enumerate(channels):
            key = (run.run, channel, run.held_out)
            if key in series:
                if lowest is not None:
                    lowest.axes.set_xlabel("")
                    lowest.axes.tick_params(labelbottom=False)
                place = 2 * row, column
                lowest = _compare(sheet, place, series[key], errors.loc[key], moments, phase)
    sheet.legend()
    return sheet.drawing()


def _compare(
    sheet: Sheet,
    place: tuple[int, int],
    samples: pd.DataFrame,
    error: pd.Series,
    moments: Sequence[str],
    phase: Quantity,
) -> Panel:
    """Draw measured and predicted values of a channel above their difference; return the lower
    panel."""
    run, channel, held_out = error.name
    is_angular = samples["crank_angle"].notna().any()
    if is_angular:
        samples = _latest_revolution(samples)
    angle, unit = samples["crank_angle"].to_numpy(dtype=float), format_unit(error["unit"])
    x, abscissa = np.degrees(angle % tau), phase
    if not is_angular:
        x, abscissa = samples["sample"].to_numpy(dtype=float), _SAMPLE
    names = ["measured", *(MODELS[moment] for moment in moments), "spread"]
    measured, *predicted, spread = samples[names].to_numpy(dtype=float).T / error["si_per_unit"]
    label = format_name(channel)
    quantity, steady = Quantity(label.split()[-1], unit), 0.0
    if channel == "crank_angle":
        quantity, steady = Quantity("deviation", unit), angle / error["si_per_unit"]

    title = f"{label}\n{run}"
    if np.isfinite(error["speed"]):
        title += f", {number(error['speed'] * 30.0 / pi)} rpm"
    title += ", held out" if held_out else ""
    row, column = place
    upper = sheet.panel(place, title, abscissa, quantity)
    residual = Quantity("residual", unit)
    lower = sheet.panel((row + 1, column), f"{title}: residual", abscissa, residual, below=upper)
    rms = [
        "unknown" if np.isnan(error[moment]) else f"{error[moment]:#.3g}".rstrip(".")
        for moment in moments
    ]
    lower.axes.set_title(f"RMS {' → '.join(rms)} {unit}")
    style = {"markersize": 3.2, "markeredgewidth": 0.0, "zorder": 1.8}
    upper.marks("measured", x, measured - steady, "limit", **style)
    for moment, values in zip(moments, predicted, strict=True):
        style = {"linestyle": (0, (5, 1.5))} if moment == "before" else {}
        upper.line(f"model {moment}", x, values - steady, moment, linewidth=1.4, **style)
        lower.line(f"measured − model {moment}", x, measured - values, moment, linewidth=0.9)
        lower.axes.lines[-1].set_label("")  # same colour as above
    _band(lower, x, BAND * spread, "95 % of the noise")
    if is_angular:
        lower.over_crank_angle(0.0, 360.0, step=90.0)
    return lower


def _latest_revolution(samples: pd.DataFrame) -> pd.DataFrame:
    """The last full revolution, sorted by angle."""
    samples = samples.dropna(subset=["crank_angle"])
    turn = np.floor(samples["crank_angle"] / tau)
    count = turn.value_counts()
    samples = samples[turn == count.index[count >= 0.95 * count.max()].max()]
    order = np.argsort(samples["crank_angle"].to_numpy() % tau, kind="stable")
    return samples.iloc[order]


SIGNIFICANT = "window with a significant residual"
_OUTLINE = {"facecolors": "none", "edgecolors": plot.INK, "linewidth": 1.3, "zorder": 3}


@figure
def disagreement(tables: Tables, verdict: Verdict) -> Drawing:
    """Mean residual by channel, run and crank angle, with the significant windows."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import SymLogNorm

    bins, windows = tables["map_bins"].dropna(subset=["mean"]), tables["map_windows"]
    crosses = windows["start_deg"] >= windows["end_deg"]  # across 0: outlined at both ends
    at_start = windows[crosses].assign(start_deg=0.0)
    at_end = windows["end_deg"].where(~crosses, 360.0)
    windows = pd.concat([windows.assign(end_deg=at_end), at_start])
    most = plot.round_up(max(1.0, bins["mean"].abs().max()))
    colours = ScalarMappable(SymLogNorm(1.0, vmin=-most, vmax=most), "RdBu_r")
    channels = dict(list(bins.groupby("channel", sort=False)))
    heights = [0.75 + part["run"].nunique() for part in channels.values()]
    sheet = Sheet(1.25 + 0.32 * sum(heights), len(heights), 1, height_ratios=heights)
    panel = None
    for row, (channel, part) in enumerate(channels.items()):
        panel = sheet.panel((row, 0), format_name(channel), _phase(verdict), _RUN, below=panel)
        for place, (run, spans) in enumerate(part.groupby("run", sort=False)):
            colour = colours.to_rgba(spans["mean"].to_numpy())
            _spans(panel, MEAN.name, place, run, spans, facecolors=colour)
            outlined = windows[(windows["channel"] == channel) & (windows["run"] == run)]
            if len(outlined):
                _spans(panel, SIGNIFICANT, place, run, outlined, label=SIGNIFICANT, **_OUTLINE)
        list_rows(panel, list(part["run"].unique()))
        panel.axes.grid(False)
        panel.over_crank_angle(0.0, 360.0)
    axes = [panel.axes for panel in sheet.panels]
    bar = sheet.figure.colorbar(
        colours, ax=axes, label=MEAN.label, location="bottom", shrink=0.7, aspect=45
    )
    bar.ax.minorticks_off()
    bar.ax.xaxis.set_major_formatter(plot.tick_label)
    if len(windows):
        sheet.legend()
    return sheet.drawing()


def _spans(
    panel: Panel, series: str, place: int, run: str, spans: pd.DataFrame, **look: Any
) -> None:
    """Bars of a run over the crank angle, recorded with their mean residuals."""
    low, high = spans["start_deg"], spans["end_deg"]
    panel.axes.broken_barh(np.column_stack([low, high - low]), (place - 0.4, 0.8), **look)
    panel.record(
        series,
        (low + high) / 2.0,
        np.full(len(spans), float(place)),
        low=low,
        high=high,
        value=spans["mean"],
        value_quantity=MEAN.name,
        value_unit=MEAN.unit,
        label=[run] * len(spans),
    )


_APART = DEFAULT_SETTINGS.decision.min_delta_bic


def _short_name(label: str) -> str:
    """Label of an explanation: ``slider Coulomb friction + gravity``, ``slider force v^3 + 1`` of a
    force law."""
    labels = label.split(" + ")
    names = [format_name(effect) for effect in labels if not effect.startswith("discovered_")]
    law = [effect.partition("[") for effect in labels if effect.startswith("discovered_")]
    if law:
        effect = law[0][0].removeprefix("discovered_")
        terms = ", ".join(term.removesuffix("]") for _, _, term in law)
        names.append(f"{format_name(effect)}: {terms}")
    return " + ".join(names)


@figure
def ranking(
    tables: Tables, verdict: Verdict, kinds: Mapping[str, dict], places: Mapping[str, str]
) -> Drawing:
    """The candidates by BIC, with the share of the misfit that they explain."""
    from matplotlib.ticker import FixedLocator

    base = {"explanation": BASE, "kind": "base", "delta_bic": 0.0}
    base |= {"explained_share": 0.0, "place": ""}
    fits = tables["ranking"].query("kind != 'base'").dropna(subset=["delta_bic"])
    fits = fits.sort_values("delta_bic")[list(base)]
    fits = fits.groupby(fits["kind"] == "single").tail(RANKED)
    fits = pd.concat([fits, pd.DataFrame([base])])
    fits = fits.sort_values("delta_bic", ascending=False, kind="stable", ignore_index=True)
    distance = fits["delta_bic"].max() - fits["delta_bic"]
    series = {
        shown["label"]: (shown["colour"], (fits["kind"] == kind) & (fits["place"] == ""), {})
        for kind, shown in kinds.items()
    }
    diamond = {"marker": "D", "markersize": 6.0}
    for place, label in places.items():
        series[label] = ("named", fits["place"] == place, diamond)
    names = [_short_name(label).replace(" + ", " +\n") for label in fits["explanation"]]
    sheet = Sheet(1.35 + 0.31 * max(3, len(fits)), 1, 2, width_ratios=(1.25, 1.0))
    columns = {
        "distance to the best": (Quantity("BIC minus that of the best", "1"), distance),
        "explained misfit": (
            Quantity("explained share", "1"),
            fits["explained_share"].clip(-0.1, 1.1),
        ),
    }
    for column, (title, (quantity, values)) in enumerate(columns.items()):
        panel = sheet.panel((0, column), title, quantity, Quantity("explanation", ""))
        for label, (colour, rows, style) in series.items():
            if rows.any():
                explanations = list(fits["explanation"][rows])
                x, y = values[rows], fits.index[rows]
                panel.marks(label, x, y, colour, labels=explanations, **style)
        list_rows(panel, names)
    behind, share = sheet.panels
    farthest = max(float(distance.max()), _APART)
    behind.vertical_line("very strong evidence from here", _APART)
    behind.axes.set_xscale("symlog", linthresh=_APART, linscale=0.7)
    decades = 10.0 ** np.arange(1, 12)
    plot.label_ticks(behind.axes.xaxis, FixedLocator([0.0, *decades[decades <= 1.5 * farthest]]))
    behind.axes.set_xlim(-1.5, 1.8 * farthest)
    share.vertical_line("all of the misfit", 1.0, named=False)
    share.axes.set_xlim(-0.12, 1.12)
    share.axes.tick_params(labelleft=False)
    sheet.legend()
    return sheet.drawing()


_COLOURS = ("paper", "after", "network", "optimised", "spline", "other", "ideal")


@figure
def missing_force(tables: Tables, verdict: Verdict) -> Drawing:
    """Force or torque of the named effects on each body, over its velocity and its position or the
    crank angle."""
    samples = tables["missing_force"]
    if samples.empty:
        spec = FIGURES["missing_force"]
        return plot.message_sheet(spec.title, spec.nothing)
    bodies = [*samples["body"].unique()]
    sheet = Sheet(0.5 + 2.7 * len(bodies), len(bodies), 3, width=10.5)
    for row, body in enumerate(bodies):
        _force_on(sheet, row, body, samples[samples["body"] == body])
    sheet.legend()
    return sheet.drawing()


def _force_on(sheet: Sheet, row: int, body: str, samples: pd.DataFrame) -> None:
    """Panels of the force or torque on one body."""
    name, crank_angle = format_name(body), np.degrees(samples["crank_angle"])
    if samples["force"].notna().any():
        force, values = Quantity(f"force on the {name}", "N"), samples["force"]
        place, speed = Quantity(f"{name} position", "mm"), Quantity(f"{name} velocity", "m/s")
        x, v = 1e3 * samples["position"], samples["velocity"]
        curves = ((speed, v), (place, x))
    else:
        force, values = Quantity(f"torque on the {name}", "N m"), samples["torque"]
        place = Quantity(f"{name} angle", "deg")
        speed = Quantity(f"{name} angular velocity", "rad/s")
        x, v = np.degrees(samples["angle"]), samples["angular_velocity"]
        curves = ((speed, v), (CRANK_ANGLE, crank_angle))
    for column, (quantity, abscissa) in enumerate(curves):
        panel = sheet.panel((row, column), f"over {quantity.name}", quantity, force)
        for order, run in enumerate(samples["run"].unique()):
            rows = samples["run"] == run
            width = 5.0 * 0.5**order + 0.7  # curves may coincide
            colour = _COLOURS[order % len(_COLOURS)]
            panel.line(format_run(run), abscissa[rows], values[rows], colour, linewidth=width)
        panel.axes.axhline(0.0, color="#777777", linewidth=0.8)
        if quantity is CRANK_ANGLE:
            panel.over_crank_angle(0.0, 360.0)
    panel = sheet.panel((row, 2), "as colour", place, speed)
    most = values.abs().max()
    colours = panel.axes.scatter(
        x,
        v,
        c=values,
        cmap="RdBu_r",
        vmin=-most,
        vmax=most,
        s=9.0,
        linewidths=0.0,
        rasterized=True,
    )
    shown = {"value": values, "value_quantity": force.name, "value_unit": force.unit}
    panel.record(force.name, x, v, **shown)
    sheet.figure.colorbar(colours, ax=panel.axes, label=force.label)


_LEAST_GAP = 0.05  # shown; the end of an interval may be 0

ROLES = {"confirm": "held-out data", "identify": "fitted data"}


@figure
def gaps(tables: Tables, verdict: Verdict) -> Drawing:
    """Gap by run and channel with its interval, before and after."""
    table = tables["gaps"]
    moments = _moments(table["before"], table["after"])
    by_role = {role: table[table["role"] == role] for role in ROLES}
    by_role = {role: rows for role, rows in by_role.items() if len(rows)}
    counts = [len(rows) for rows in by_role.values()]
    height, ratios = 1.2 + sum(0.55 + 0.2 * count for count in counts), [2 + n for n in counts]
    sheet, panel = Sheet(height, len(counts), 1, height_ratios=ratios), None
    ends = table[[f"{moment}{end}" for moment in moments for end in ("", "_low", "_high")]]
    lowest = max(ends.min().min(), _LEAST_GAP)
    limits = 0.85 * min(lowest, 0.9), 1.2 * max(ends.max().max(), 1.5)
    offsets = {"before": -0.14, "after": 0.14} if len(moments) == 2 else {"before": 0.0}
    for row, (role, rows) in enumerate(by_role.items()):
        # all runs first, and of each run all channels first
        runs = ["all", *rows["run"].unique()]
        rows = rows.sort_values("channel", key=lambda name: name != "all", kind="stable")
        rows = rows.sort_values("run", key=lambda name: name.map(runs.index), kind="stable")
        names = []
        for gap in rows.itertuples():
            name = "all runs" if gap.run == "all" else format_run(gap.run)
            names.append(name + ("" if gap.channel == "all" else f", {format_name(gap.channel)}"))
        panel = sheet.panel((row, 0), ROLES[role], GAP, _RUN, below=panel)
        for moment in moments:
            place = np.arange(len(rows)) + offsets[moment]
            value, low, high = (rows[f"{moment}{end}"] for end in ("", "_low", "_high"))
            marker = "D" if moment == "after" else "o"
            panel.marks(moment, value, place, moment, low, high, names, along="x", marker=marker)
        list_rows(panel, names)
        panel.vertical_line("noise alone", 1.0)
        panel.axes.set_xscale("log")
        panel.axes.set_xlim(*limits)
        plot.label_log_ticks(panel.axes.xaxis, *limits)
    sheet.legend()
    return sheet.drawing()


@figure
def detectable(tables: Tables, verdict: Verdict) -> Drawing:
    """Smallest detectable size of each effect, relative to a size that is easily seen."""
    effects = tables["detectable"]
    ratio = (effects["smallest_detectable"] / effects["typical"]).abs()
    effects = effects.assign(ratio=ratio.where(~effects["falls"], 1.0 / ratio))
    effects = effects.sort_values("ratio", na_position="last", ignore_index=True)
    sheet = Sheet(1.3 + 0.21 * len(effects), 1, 1)
    quantity = Quantity("smallest detectable size / size that causes a gap of 1.5", "1")
    panel = sheet.panel((0, 0), "smallest detectable size of each effect", quantity, _EFFECT)
    rows = effects[effects["detectable"].astype(bool)]
    series, labels = "smallest detectable size", list(rows["label"])
    panel.marks(series, rows["ratio"], rows.index, "after", labels=labels)
    list_rows(panel, [format_name(label) for label in effects["label"]])
    panel.vertical_line("size that causes a gap of 1.5", 1.0)
    low, high = np.fmin(rows["ratio"].min(), 0.2), np.fmax(rows["ratio"].max(), 1.0)
    panel.axes.set_xscale("log")
    panel.axes.set_xlim(0.7 * low, 2.0 * high)
    panel.axes.xaxis.set_major_formatter(plot.tick_label)
    sizes = [_detectable_size(row) for row in effects.itertuples()]
    right_axis = panel.axes.secondary_yaxis("right")
    right_axis.set_yticks(range(len(effects)), sizes)
    right_axis.tick_params(length=0)
    right_axis.spines["right"].set_visible(False)
    sheet.legend()
    return sheet.drawing()


def _detectable_size(effect: Any) -> str:
    if pd.notna(effect.failed):
        return "not simulated"
    if not effect.detectable:
        return "not detectable"
    size = format_size(effect.smallest_detectable, effect.unit)
    return f"up to {size}" if effect.falls else size
