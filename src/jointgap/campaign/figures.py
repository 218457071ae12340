"""Figures of a campaign."""

from collections.abc import Mapping, Sequence
from math import pi, tau
from typing import Any

import numpy as np
import pandas as pd

from jointgap.core import plot
from jointgap.core.plot import CRANK_ANGLE, WIDTH, Drawing, Panel, Quantity, Sheet
from jointgap.core.words import format_name, format_size, format_unit, number, percent
from jointgap.identification.settings import DEFAULT_SETTINGS

FIGURES = plot.Figures()
figure = FIGURES.figure
Tables, Verdict = Mapping[str, pd.DataFrame], Mapping[str, Any]
_FIRST, _WHERE, _WHAT = "Measured and predicted", "Location of the residual", "Missing effects"
_BETTER, _PLAN = "Improvement", "Detectability"

SPREADS = "standard deviations of the noise"
MEAN = Quantity("mean residual", SPREADS)
GAP = Quantity("gap: root mean square residual", SPREADS)
COSINE = Quantity("cosine of the sensitivities", "1")
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


def _moments(before: pd.Series, after: pd.Series) -> list[str]:
    return ["before", "after"] if (before != after).any() else ["before"]


def _no_scale(panel: Panel) -> None:
    panel.axes.set_xlabel("")
    panel.axes.tick_params(labelbottom=False)


def _band(panel: Panel, x: np.ndarray, half: np.ndarray, label: str) -> None:
    panel.axes.fill_between(x, -half, half, color="#DDDDDD", linewidth=0.0, zorder=0, label=label)
    panel.record(label, x, np.zeros(len(x)), low=-half, high=half)


@figure(
    "measured_against_model",
    "Measured against the model",
    _FIRST,
    ("residuals", "channel_errors"),
    nothing="no sample to compare with the model",
)
def measured_against_model(tables: Tables, verdict: Verdict) -> Drawing:
    """One revolution of each channel in the unit of its column: measured, and predicted before and
    after adding the effects. Below: the residual; the title gives its root mean square over the
    run. Grey band: two standard deviations of the noise. At most three runs, by speed; held-out
    ones have priority. Channels by size of the residual. Table channel_errors has all numbers. A
    crank angle is shown as deviation from steady rotation. If nothing was identified, "after" shows
    the best candidate, if any.
    """
    return _runs_against_model(tables, MOST_RUNS, WIDTH)


ONE_RUN = "measured_against_model_one_run"
"""Stem of the variant of that figure for narrow screens."""


def one_run_against_model(tables: Tables) -> Drawing:
    """`measured_against_model` with its first run alone."""
    return _runs_against_model(tables, 1, 4.2)


def _runs_against_model(tables: Tables, most_runs: int, least_width: float) -> Drawing:
    samples, errors = tables["residuals"], tables["channel_errors"]
    moments = _moments(samples["base"], samples["augmented"])
    runs = (
        errors.sort_values("held_out", ascending=False, kind="stable")
        .drop_duplicates("run")
        .head(most_runs)
    )
    runs = runs.sort_values("speed", kind="stable")
    missed = (errors["before"] / errors["noise"]).groupby(errors["channel"]).max()
    channels = list(missed.sort_values(ascending=False, kind="stable").index)
    shares, width = [1.7, 1.0] * len(channels), max(least_width, 3.1 * len(runs))
    sheet = Sheet(
        0.7 + 2.9 * len(channels), len(shares), len(runs), width=width, height_ratios=shares
    )
    series = dict(list(samples.groupby(["run", "channel", "held_out"], sort=False)))
    errors = errors.set_index(["run", "channel", "held_out"])
    for column, run in enumerate(runs.itertuples()):
        lowest = None
        for row, channel in enumerate(channels):
            if (key := (run.run, channel, run.held_out)) in series:
                if lowest is not None:  # only the lowest panel has a scale
                    _no_scale(lowest)
                lowest = _pair(sheet, 2 * row, column, series[key], errors.loc[key], moments)
    sheet.legend()
    return sheet.drawing()


def _pair(
    sheet: Sheet, row: int, column: int, samples: pd.DataFrame, error: pd.Series, moments: list[str]
) -> Panel:
    """Draw measured and predicted values of a channel above their difference; return the lower
    panel."""
    run, channel, held_out = error.name
    angular = samples["crank_angle"].notna().any()
    shown = _one_revolution(samples) if angular else samples
    angle = shown["crank_angle"].to_numpy(dtype=float)
    x = np.degrees(angle % tau) if angular else shown["sample"].to_numpy(dtype=float)
    words, unit = format_name(channel), format_unit(error["unit"])
    less = angle if channel == "crank_angle" else 0.0
    name = "deviation" if channel == "crank_angle" else words.split()[-1]
    names = ["measured", *(MODELS[moment] for moment in moments), "spread"]
    measured, *predicted, spread = (
        shown[each].to_numpy(dtype=float) / error["si_per_unit"] for each in names
    )
    title = (
        f"{words}\n{run}, {number(error['speed'] * 30.0 / pi)}"
        f" rpm{', held out' if held_out else ''}"
    )
    abscissa = CRANK_ANGLE if angular else _SAMPLE
    above = sheet.panel((row, column), title, abscissa, Quantity(name, unit))
    below = sheet.panel(
        (row + 1, column), f"{title}: residual", abscissa, Quantity("residual", unit), below=above
    )
    rms = (
        "unknown" if np.isnan(error[moment]) else f"{error[moment]:#.3g}".rstrip(".")
        for moment in moments
    )
    below.axes.set_title(f"RMS {' → '.join(rms)} {unit}")
    less = less / error["si_per_unit"]
    above.marks(
        "measured", x, measured - less, "limit", markersize=3.2, markeredgewidth=0.0, zorder=1.8
    )
    for moment, model in zip(moments, predicted, strict=True):
        style = {"linestyle": (0, (5, 1.5))} if moment == "before" else {}
        above.line(f"model {moment}", x, model - less, moment, linewidth=1.4, **style)
        below.line(f"measured − model {moment}", x, measured - model, moment, linewidth=0.9)
        below.axes.lines[-1].set_label("")  # same colour as above
    _band(below, x, BAND * spread, "95 % of the noise")
    if angular:
        below.over_crank_angle(0.0, 360.0, step=90.0)
    return below


def _one_revolution(samples: pd.DataFrame) -> pd.DataFrame:
    """The last full revolution, sorted by angle."""
    known = samples[samples["crank_angle"].notna()]
    turn = np.floor(known["crank_angle"] / tau)
    count = turn.value_counts()
    shown = known[turn == count.index[count >= 0.95 * count.max()].max()]
    return shown.iloc[np.argsort(shown["crank_angle"].to_numpy() % tau, kind="stable")]


@figure(
    "disagreement",
    "Map of disagreement",
    _WHERE,
    ("map_bins", "map_windows"),
    nothing="no sample to compare with the model",
)
def disagreement(tables: Tables, verdict: Verdict) -> Drawing:
    """Mean residual of the current model with re-fitted parameters by channel, run and crank angle,
    in standard deviations of the noise. Red: measured above predicted. Outlined: windows with a
    significant residual (false-discovery rate 1 %). The colour scale is linear up to 1 and
    logarithmic beyond.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import SymLogNorm

    bins = tables["map_bins"].dropna(subset=["mean"])
    most = plot.round_up(max(1.0, bins["mean"].abs().max()))
    colours = ScalarMappable(SymLogNorm(1.0, vmin=-most, vmax=most), "RdBu_r")
    runs_of = {
        channel: list(own["run"].unique()) for channel, own in bins.groupby("channel", sort=False)
    }
    shares = [0.75 + len(runs) for runs in runs_of.values()]
    sheet, above = Sheet(1.25 + 0.32 * sum(shares), len(shares), 1, height_ratios=shares), None
    for row, (channel, runs) in enumerate(runs_of.items()):
        above = panel = sheet.panel((row, 0), format_name(channel), CRANK_ANGLE, _RUN, below=above)
        for place, run in enumerate(runs):
            own, windows = (
                table[(table["channel"] == channel) & (table["run"] == run)]
                for table in (bins, tables["map_windows"])
            )
            spans = list(zip(own["start_deg"], own["end_deg"] - own["start_deg"], strict=True))
            panel.axes.broken_barh(
                spans, (place - 0.4, 0.8), facecolors=colours.to_rgba(own["mean"].to_numpy())
            )
            _record_spans(panel, MEAN.name, place, run, own)
            _outline(panel, place, run, windows)
        list_rows(panel, runs)
        panel.axes.grid(False)
        panel.over_crank_angle(0.0, 360.0)
    axes = [panel.axes for panel in sheet.panels]
    bar = sheet.figure.colorbar(
        colours, ax=axes, label=MEAN.label, location="bottom", shrink=0.7, aspect=45
    )
    bar.ax.minorticks_off()
    bar.ax.xaxis.set_major_formatter(plot.tick_label)
    if len(tables["map_windows"]):
        sheet.legend()
    return sheet.drawing()


def _record_spans(panel: Panel, series: str, place: int, run: str, spans: pd.DataFrame) -> None:
    low, high = spans["start_deg"], spans["end_deg"]
    shown = {
        "value": spans["mean"],
        "value_quantity": MEAN.name,
        "value_unit": MEAN.unit,
        "label": [run] * len(spans),
    }
    panel.record(
        series, (low + high) / 2.0, np.full(len(spans), float(place)), low=low, high=high, **shown
    )


def _outline(panel: Panel, place: int, run: str, windows: pd.DataFrame) -> None:
    from matplotlib.patches import Rectangle

    across = windows["start_deg"] >= windows["end_deg"]  # across dead centre: outlined at both ends
    ends = (
        windows.assign(end_deg=windows["end_deg"].where(~across, 360.0)),
        windows[across].assign(start_deg=0.0),
    )
    series = "window with a significant residual"
    for spans in ends:
        for low, high in zip(spans["start_deg"], spans["end_deg"], strict=True):
            frame = Rectangle(
                (low, place - 0.43), high - low, 0.86, fill=False, edgecolor=plot.INK, linewidth=1.3
            )
            frame.set(label=series, zorder=3)
            panel.axes.add_patch(frame)
        _record_spans(panel, series, place, run, spans)


@figure(
    "residuals",
    "Residuals before and after",
    _WHERE,
    ("residuals", "channel_errors"),
    nothing="no sample to compare with the model",
)
def residuals(tables: Tables, verdict: Verdict) -> Drawing:
    """Residual by crank angle in standard deviations of noise and solver error: dots are samples,
    lines are means over 5 deg. Before: no effect added, parameters re-fitted unless nominal ones
    suffice. After: with the effects of the verdict, or else the best candidate. The grey band
    contains 95 % of the samples of a true model. For large residuals the scale is linear inside the
    band and logarithmic outside.
    """
    samples = tables["residuals"]
    whitened = {
        moment: (samples["measured"] - samples[model]) / samples["spread"]
        for moment, model in MODELS.items()
    }
    moments, samples = _moments(*whitened.values()), samples.assign(**whitened)
    runs, channels = (
        list(tables["channel_errors"]["run"].unique()),
        list(samples["channel"].unique()),
    )
    sheet = Sheet(
        0.8 + 1.75 * len(channels), len(channels), len(runs), width=max(WIDTH, 2.9 * len(runs))
    )
    largest = samples[moments].abs().max(axis=1).groupby(samples["channel"]).max()
    last = samples.groupby("run")["channel"].last()
    for (run, channel), own in samples.groupby(["run", "channel"], sort=False):
        angular = own["crank_angle"].notna().any()
        title = f"{run}{', held out' if own['held_out'].all() else ''}: {format_name(channel)}"
        place, x = (channels.index(channel), runs.index(run)), CRANK_ANGLE if angular else _SAMPLE
        panel = sheet.panel(place, title, x, Quantity("residual", "noise sd"))
        _dots(panel, own.dropna(subset=["crank_angle"]) if angular else own, moments, angular)
        panel.axes.set_ylim(-1.08 * largest[channel], 1.08 * largest[channel])
        if largest[channel] > 12.0:
            panel.linear_then_logarithmic(BAND, named=False)
            panel.axes.set_ylabel(f"logarithmic beyond {BAND:g}\n{panel.y.label}")
            panel.axes.set_ylim(-1.5 * largest[channel], 1.5 * largest[channel])
        if channel != last[run]:
            _no_scale(panel)
        if place[1]:
            panel.axes.set_ylabel("")
            panel.axes.tick_params(labelleft=False)
    sheet.legend()
    return sheet.drawing()


def _dots(
    panel: Panel, samples: pd.DataFrame, moments: list[str], angular: bool, most: int = 1500
) -> None:
    """Some of the samples, and means of all samples in 72 equal intervals (5 deg)."""
    x = (np.degrees(samples["crank_angle"]) % 360.0 if angular else samples["sample"]).to_numpy(
        dtype=float
    )
    few = np.unique(np.linspace(0, len(x) - 1, min(most, len(x))).astype(int))
    edges = np.linspace(x.min(), x.max(), 73)
    place = pd.cut(x, edges, labels=False, include_lowest=True)
    style = {
        "marker": ".",
        "markersize": 2.0,
        "alpha": 0.3,
        "markeredgewidth": 0.0,
        "rasterized": True,
    }
    for moment in moments:
        panel.marks(f"{moment}, samples", x[few], samples[moment].to_numpy()[few], moment, **style)
        panel.axes.lines[-1].set_label("")  # too small for the legend
        means = (
            samples[moment].groupby(place).mean().reindex(range(72))
        )  # NaN of an empty interval breaks the curve
        panel.line(
            f"{moment}, mean",
            (edges[1:] + edges[:-1]) / 2.0,
            means,
            moment,
            linewidth=1.3,
            zorder=3,
        )
    _band(
        panel,
        np.array([x.min(), x.max()]),
        np.full(2, BAND),
        f"noise: {BAND:g} standard deviations",
    )
    if angular:
        panel.over_crank_angle(0.0, 360.0, step=90.0)


_KINDS = {
    "base": (BASE, "limit"),
    "single": ("one effect", "after"),
    "pair": ("two effects", "pair"),
    "formula": ("formula", "formula"),
}
_PLACES = {
    "named": "named",
    "twin": "predicts the same",
    "equivalent": "equivalent",
    "best_known": "best candidate, not confirmed",
}
_APART = DEFAULT_SETTINGS.decision.min_delta_bic


def _short_name(label: str) -> str:
    """Label of an explanation: ``slider Coulomb friction + gravity``, ``slider force v^3 + 1`` of a
    force law."""
    parts = label.split(" + ")
    law = [one for one in parts if one.startswith("discovered_")]
    terms = [one.partition("[")[2].removesuffix("]") for one in law]
    named = [format_name(one) for one in parts if one not in law]
    if law:
        effect = law[0].partition("[")[0].removeprefix("discovered_")
        named.append(f"{format_name(effect)}: {', '.join(terms)}")
    return " + ".join(named)


@figure(
    "ranking",
    "Candidates ranked",
    _WHAT,
    ("ranking",),
    nothing="no candidate was fitted, as there is no significant residual",
)
def ranking(tables: Tables, verdict: Verdict) -> Drawing:
    """Each candidate was added to the model and fitted together with all uncertain parameters.
    Left: its Bayesian information criterion (BIC) minus that of the best candidate, linear up to
    10, logarithmic beyond; more than 10 is very strong evidence. Right: the explained share of the
    misfit beyond noise. Diamonds: named or equivalent. The first candidate may be wrong if the list
    lacks the true effect: check that the residual is noise. Table ranking has all fits and the
    reasons of failures.
    """
    from matplotlib.ticker import FixedLocator

    base = {
        "explanation": BASE,
        "kind": "base",
        "delta_bic": 0.0,
        "explained_share": 0.0,
        "place": "",
    }
    fits = (
        tables["ranking"]
        .query("kind != 'base'")
        .dropna(subset=["delta_bic"])
        .sort_values("delta_bic")[list(base)]
    )
    best = fits.groupby(fits["kind"] == "single").tail(RANKED)
    best = pd.concat([best, pd.DataFrame([base])]).sort_values(
        "delta_bic", ascending=False, kind="stable"
    )
    names = [_short_name(label).replace(" + ", " +\n") for label in best["explanation"]]
    sheet = Sheet(1.35 + 0.31 * max(3, len(best)), 1, 2, width_ratios=(1.25, 1.0))
    shown = {
        Quantity("BIC minus that of the best", "1"): best["delta_bic"].max() - best["delta_bic"],
        Quantity("explained share", "1"): best["explained_share"].clip(-0.1, 1.1),
    }
    titles, place = ("distance to the best", "explained misfit"), np.arange(len(best))
    for column, (quantity, values) in enumerate(shown.items()):
        panel = sheet.panel((0, column), titles[column], quantity, Quantity("explanation", ""))
        series = {
            words: (colour, best["kind"].eq(kind) & best["place"].eq(""), {})
            for kind, (words, colour) in _KINDS.items()
        }
        diamond = {"marker": "D", "markersize": 6.0}
        series |= {
            words: ("named", best["place"] == name, diamond) for name, words in _PLACES.items()
        }
        for words, (colour, own, style) in series.items():
            if own.any():
                panel.marks(
                    words,
                    values[own],
                    place[own],
                    colour,
                    labels=list(best["explanation"][own]),
                    **style,
                )
        list_rows(panel, names)
    behind, share = sheet.panels
    farthest = max(float(best["delta_bic"].max() - best["delta_bic"].min()), _APART)
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


POSITION, SPEED = (
    Quantity("slider position", "mm", "$x$"),
    Quantity("slider velocity", "m/s", "$v$"),
)
FORCES = {
    "slider_force": Quantity("force on the slider", "N"),
    "crank_torque": Quantity("torque on the crank", "N m"),
}
_COLOURS = ("paper", "after", "network", "optimised", "spline", "other", "ideal")


@figure(
    "missing_force",
    "The missing force",
    _WHAT,
    ("missing_force",),
    nothing="no force or torque was identified",
)
def missing_force(tables: Tables, verdict: Verdict) -> Drawing:
    """Force on the slider, or torque on the crank, of the named effects over one steady-state
    revolution of each fitted run: over velocity, over position (a torque: over crank angle), and as
    colour over both. A mass, a length, a clearance or a sensor fault exerts no force.
    """
    samples = tables["missing_force"]
    shown = {name: force for name, force in FORCES.items() if samples[name].abs().max() > 0.0}
    if not shown:
        return plot.message_sheet(FIGURES["missing_force"].title, FIGURES["missing_force"].nothing)
    values = {SPEED: samples["slider_velocity"], POSITION: 1e3 * samples["slider_position"]}
    values[CRANK_ANGLE] = np.degrees(samples["crank_angle"])
    sheet = Sheet(0.5 + 2.7 * len(shown), len(shown), 3, width=10.5)
    for row, (name, force) in enumerate(shown.items()):
        for column, quantity in enumerate(
            (SPEED, POSITION if name == "slider_force" else CRANK_ANGLE)
        ):
            panel = sheet.panel(
                (row, column), f"{force.name} over {quantity.name}", quantity, force
            )
            for place, run in enumerate(samples["run"].unique()):
                own = samples["run"] == run
                style = {"linewidth": 5.0 * 0.5**place + 0.7}  # curves may coincide
                colour = _COLOURS[place % len(_COLOURS)]
                panel.line(f"run {run}", values[quantity][own], samples[name][own], colour, **style)
            panel.axes.axhline(0.0, color="#777777", linewidth=0.8)
            if quantity is CRANK_ANGLE:
                panel.over_crank_angle(0.0, 360.0)
        panel = sheet.panel((row, 2), f"{force.name} as colour", POSITION, SPEED)
        most = samples[name].abs().max()
        style = {
            "cmap": "RdBu_r",
            "vmin": -most,
            "vmax": most,
            "s": 9.0,
            "linewidths": 0.0,
            "rasterized": True,
        }
        drawn = panel.axes.scatter(values[POSITION], values[SPEED], c=samples[name], **style)
        recorded = {"value": samples[name], "value_quantity": force.name, "value_unit": force.unit}
        panel.record(force.name, values[POSITION], values[SPEED], **recorded)
        sheet.figure.colorbar(drawn, ax=panel.axes, label=force.label)
    sheet.legend()
    return sheet.drawing()


ROLES = {"confirm": "held-out data", "identify": "fitted data"}


@figure("gaps", "Gap before and after", _BETTER, ("gaps",), nothing="no gap was computed")
def gaps(tables: Tables, verdict: Verdict) -> Drawing:
    """Root mean square residual in standard deviations of the noise by run and channel, with 90 %
    bootstrap intervals; 1 is noise. Held-out data were used neither for fitting nor for selection.
    Run-specific values (speed, start angle) were fitted for each run, before and after.
    """
    table = tables["gaps"]
    moments = _moments(table["before"], table["after"])
    by_role = {
        role: table[table["role"] == role] for role in ROLES if (table["role"] == role).any()
    }
    counts = [len(own) for own in by_role.values()]
    height = 1.2 + sum(0.55 + 0.2 * count for count in counts)
    sheet, above = (
        Sheet(height, len(counts), 1, height_ratios=[2 + count for count in counts]),
        None,
    )
    ends = table[[f"{moment}{end}" for moment in moments for end in ("", "_low", "_high")]]
    limits = 0.85 * min(ends.min().min(), 0.9), 1.2 * max(ends.max().max(), 1.5)
    for row, (role, own) in enumerate(by_role.items()):
        order = pd.DataFrame(
            {
                "alone": own["run"] != "all",
                "run": pd.factorize(own["run"])[0],
                "one": own["channel"] != "all",
            }
        )
        own = own.loc[order.sort_values(["alone", "run", "one"], kind="stable").index]
        labels = [
            ("all runs" if one.run == "all" else f"run {one.run}")
            + ("" if one.channel == "all" else f", {format_name(one.channel)}")
            for one in own.itertuples()
        ]
        above = panel = sheet.panel((row, 0), ROLES[role], GAP, _RUN, below=above)
        for moment in moments:
            place = np.arange(len(own)) + (
                0.0 if len(moments) == 1 else -0.14 if moment == "before" else 0.14
            )
            value, low, high = (own[f"{moment}{end}"] for end in ("", "_low", "_high"))
            marker = "D" if moment == "after" else "o"
            panel.marks(moment, value, place, moment, low, high, labels, along="x", marker=marker)
        list_rows(panel, labels)
        panel.vertical_line("noise alone", 1.0)
        panel.axes.set_xscale("log")
        panel.axes.set_xlim(*limits)
        plot.label_log_ticks(panel.axes.xaxis, *limits)
    sheet.legend()
    return sheet.drawing()


@figure(
    "optimum",
    "Optimum before and after",
    _BETTER,
    ("campaign_optimum",),
    nothing="no optimum: no effect was added to the mechanism, or all joints are ideal",
)
def optimum(tables: Tables, verdict: Verdict) -> Drawing:
    """Link lengths with the smallest error of the transmission angle, for the current model
    (before) and with the effects of the verdict (after). Right: RMS error at the original and the
    optimal lengths, with the reduction. Frozen: estimate with unchanged joint motion. Re-simulated:
    the result that counts. A model without loose joints has no optimum.
    """
    optima = tables["campaign_optimum"].dropna(subset=["crank_length"])
    if optima.empty:
        return plot.message_sheet(
            "Optimum before and after", "the optimisation failed: see the summary"
        )
    series = {model: moment for moment, model in MODELS.items()}
    optima = optima.assign(series=optima["model"].map(series)).sort_values(
        ["source", "model"], ascending=[True, False]
    )
    rows = list(optima.itertuples())
    sheet = Sheet(1.0 + 0.32 * max(3, len(rows)), 1, 3, width=9.0, width_ratios=[1.0, 1.0, 1.3])
    titles = {"crank length": "optimal crank length", "rod length": "optimal rod length"}
    titles["RMS error"] = "RMS error of the transmission angle"
    panels = [
        sheet.panel(
            (0, column),
            title,
            Quantity(name, "mdeg" if "RMS" in name else "mm"),
            Quantity("model", ""),
        )
        for column, (name, title) in enumerate(titles.items())
    ]
    error = panels[2]
    for place, row in enumerate(rows):
        diamond = {"labels": [row.source], "marker": "D"}
        for panel, length in zip(panels, (row.crank_length, row.rod_length), strict=False):
            panel.marks(row.series, [1e3 * length], [place], row.series, **diamond)
            _annotate(
                panel,
                1e3 * length,
                place,
                f"{1e3 * length:.2f} mm{', at a bound' if row.at_edge else ''}",
            )
        original, optimal = (1e3 * np.degrees(value) for value in (row.rms_before, row.rms_after))
        error.line("reduction", [original, optimal], [place, place], "limit", linewidth=1.0)
        error.axes.lines[-1].set_label("")
        error.marks(
            "original lengths",
            [original],
            [place],
            "other",
            labels=[row.source],
            markerfacecolor="white",
        )
        error.marks("optimal lengths", [optimal], [place], row.series, **diamond)
        changes = {"frozen": -row.reduction, "re-simulated": -row.resimulated}
        texts = [
            f"{name} {percent(change).replace('-', '−')}"
            for name, change in changes.items()
            if pd.notna(change)
        ]
        _annotate(error, 0.0, place, ", ".join(texts))
    for panel, length in zip(panels, ("crank_length", "rod_length"), strict=False):
        low, high = 1e3 * optima[length].min(), 1e3 * optima[length].max()
        half = max(
            0.75 * (high - low), 1e-3 * (low + high)
        )  # so that a change of 0.1 % looks small
        panel.axes.set_xlim((low + high) / 2.0 - half, (low + high) / 2.0 + half)
        panel.axes.locator_params(axis="x", nbins=4)
    error.axes.set_xlim(0.0, 1.08e3 * np.degrees(optima["rms_before"].max()))
    for panel in panels:
        list_rows(
            panel,
            [
                f"{row.series}, {format_name(row.source)}" if panel is panels[0] else ""
                for row in rows
            ],
        )
        panel.axes.set_ylim(len(rows) - 0.4, -0.75)
    sheet.legend([error])
    return sheet.drawing()


def _annotate(panel: Panel, x: float, place: float, text: str) -> None:
    style = {"ha": "center" if x else "left", "va": "bottom", "fontsize": 8.0}
    panel.axes.annotate(text, (x, place), (0, 5), textcoords="offset points", **style)


@figure(
    "confusability",
    "Confusable effects",
    _PLAN,
    ("confusability",),
    nothing="there are no candidates to compare",
)
def confusability(tables: Tables, verdict: Verdict) -> Drawing:
    """Cosine between the changes of the measured channels that two effects cause, in units of the
    noise and after re-fitting uncertain parameters. 1: these runs cannot distinguish them at any
    size. Outlined: effects counted as one. No measured data are used.
    """
    from matplotlib.patches import Rectangle

    pairs = tables["confusability"].assign(cosine=lambda table: table["cosine"].abs())
    matrix = pairs.pivot_table(index="first", columns="second", values="cosine", dropna=False)
    matrix = matrix.combine_first(matrix.T).fillna(0.0)
    groups = [
        own
        for group in verdict.get("preflight", {}).get("merged", ())
        if len(own := [label for label in group if label in matrix.index]) > 1
    ]
    labels = _order_by_likeness(matrix, groups)
    cosine, count = matrix.loc[labels, labels].to_numpy(), len(labels)
    size = 3.6 + 0.25 * count
    sheet = Sheet(size * 0.95, 1, 1, width=size)
    panel = sheet.panel((0, 0), "similarity of effects", _EFFECT, _EFFECT)
    drawn = panel.axes.imshow(cosine, cmap="Blues", vmin=0, vmax=1)
    y, x = (place.ravel().astype(float) for place in np.indices(cosine.shape))
    shown = {
        "label": [f"{first} / {second}" for first in labels for second in labels],
        "value": cosine.ravel(),
    }
    panel.record(COSINE.name, x, y, value_quantity=COSINE.name, value_unit=COSINE.unit, **shown)
    for (row, column), value in np.ndenumerate(cosine):
        if row != column and value >= 0.5:
            ink, text = "white" if value > 0.6 else "black", f"{value:.2f}".lstrip("0")
            panel.axes.text(column, row, text, ha="center", va="center", color=ink, fontsize=6.0)
    for group in groups:
        places, series = sorted(map(labels.index, group)), "indistinguishable in these runs"
        edge = Rectangle(
            (places[0] - 0.5, places[0] - 0.5), len(places), len(places), fill=False, linewidth=1.8
        )
        edge.set(edgecolor=plot.COLOURS["before"], label=series, zorder=3)
        panel.axes.add_patch(edge)
        panel.record(series, places, places, label=[labels[place] for place in places])
    names = [format_name(label) for label in labels]
    panel.axes.set_xticks(range(count), names, rotation=90, fontsize=7.0)
    panel.axes.set_yticks(range(count), names, fontsize=7.0)
    panel.axes.set(xlabel="", ylabel="")
    panel.axes.grid(False)
    sheet.figure.colorbar(drawn, ax=panel.axes, label=COSINE.label, shrink=0.6)
    if groups:
        sheet.legend()
    return sheet.drawing()


def _order_by_likeness(matrix: pd.DataFrame, groups: list[list[str]]) -> list[str]:
    """Labels sorted so that similar effects, and those of each group, are neighbours."""
    from scipy.cluster.hierarchy import leaves_list, linkage
    from scipy.spatial.distance import squareform

    if len(matrix) < 3:
        return list(matrix.index)
    distance = 2.0 - matrix
    for group in groups:
        distance.loc[group, group] = 0.0  # less than any other distance
    values = distance.to_numpy(copy=True)
    np.fill_diagonal(values, 0.0)
    tree = linkage(squareform(values, checks=False), "average", optimal_ordering=True)
    return list(matrix.index[leaves_list(tree)])


@figure(
    "detectable",
    "Smallest detectable sizes",
    _PLAN,
    ("detectable",),
    nothing="there are no candidates to detect",
)
def detectable(tables: Tables, verdict: Verdict) -> Drawing:
    """Size at which an effect is found in nine of ten such campaigns, relative to the size that
    causes a gap of 1.5 after re-fitting uncertain parameters (gap: root mean square residual in
    standard deviations of the noise). The ratio is inverted if the effect decreases with its
    parameter ("up to"). Right: the size itself. No measured data are used.
    """
    effects = tables["detectable"]
    ratio = (effects["smallest_detectable"] / effects["typical"]).abs()
    effects = effects.assign(ratio=ratio.where(~effects["falls"], 1.0 / ratio))
    effects = effects.sort_values("ratio", na_position="last").reset_index(drop=True)
    sheet = Sheet(1.3 + 0.21 * len(effects), 1, 1)
    quantity = Quantity("smallest detectable size / size that causes a gap of 1.5", "1")
    panel = sheet.panel((0, 0), "smallest detectable size of each effect", quantity, _EFFECT)
    seen = effects[effects["detectable"].astype(bool)]
    panel.marks(
        "smallest detectable size", seen["ratio"], seen.index, "after", labels=list(seen["label"])
    )
    list_rows(panel, [format_name(label) for label in effects["label"]])
    panel.vertical_line("size that causes a gap of 1.5", 1.0)
    panel.axes.set_xscale("log")
    panel.axes.set_xlim(
        0.7 * np.fmin(seen["ratio"].min(), 0.2), 2.0 * np.fmax(seen["ratio"].max(), 1.0)
    )
    panel.axes.xaxis.set_major_formatter(plot.tick_label)
    right_axis = panel.axes.secondary_yaxis("right")
    right_axis.set_yticks(
        range(len(effects)), [_detectable_size(row) for row in effects.itertuples()]
    )
    right_axis.tick_params(length=0)
    right_axis.spines["right"].set_visible(False)
    sheet.legend()
    return sheet.drawing()


def _detectable_size(effect) -> str:
    if pd.notna(effect.failed):
        return "not simulated"
    size = (
        format_size(effect.smallest_detectable, effect.unit)
        if effect.detectable
        else "not detectable"
    )
    return f"up to {size}" if effect.detectable and effect.falls else size
