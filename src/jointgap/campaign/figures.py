"""Figures of a campaign."""

from collections.abc import Mapping, Sequence
from math import pi, tau
from typing import Any

import numpy as np
import pandas as pd

from jointgap.core.plot import (
    COLOURS,
    CRANK_ANGLE,
    INK,
    WIDTH,
    Drawing,
    Figures,
    Panel,
    Quantity,
    Sheet,
    label_ticks,
    message_sheet,
    round_up,
    tick_label,
)
from jointgap.core.words import in_words, percent, size_for_the_eye, unit_in_words
from jointgap.identification.settings import DEFAULT_SETTINGS

FIGURES = Figures()
figure, draw = FIGURES.figure, FIGURES.draw
_FIRST, _WHERE, _WHAT = "Measured and predicted", "Where", "What is missing"
_BETTER, _PLAN = "What it brings", "What could be found"
MOST_RUNS = 3  # beside each other, so that they can be read on a page
_FULL = 0.95  # share of the fullest revolution's samples from which a revolution counts as whole
_MODELS = {"before": ("base", {"linestyle": (0, (5, 1.5))}), "after": ("augmented", {})}
_NOISE_SPREADS = 2.0  # of the band to each side: 95 % of the noise
_NOISE = "95 % of the noise"
_SAMPLE = Quantity("sample", "1")


@figure(
    "measured_against_model",
    "Measured against the model",
    _FIRST,
    ("residuals", "channel_errors"),
    "One revolution of each channel in the unit of its column: measured, and predicted before and after effects were "
    "added. Below each: the residual, with the root mean square of the whole run in the title; grey band: two "
    "standard deviations of the noise. Held-out runs come first, three runs at most, then the channel with the "
    "largest residual; numbers of all: table channel_errors. A crank angle is shown as its deviation from steady "
    'rotation. If nothing was identified, "after" shows the best candidate, if any.',
    nothing="no sample could be compared with the model",
)
def measured_against_model(tables: Mapping[str, pd.DataFrame], verdict: Mapping[str, Any]) -> Drawing:
    """One revolution of every channel, measured and predicted, above the residual: a row a channel, a column a run."""
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
        below.over_crank_angle(0.0, 360.0, step=90.0)
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


Tables, Verdict = Mapping[str, pd.DataFrame], Mapping[str, Any]
SPREADS = "standard deviations of the noise"


def _runs_in(frame: pd.DataFrame) -> list[str]:
    """Runs of a table in its order."""
    return list(frame["run"].unique())


def list_rows(panel: Panel, names: Sequence[str]) -> None:
    """The `names` down the ordinate of a `panel`, the first on top."""
    panel.rows(names, range(len(names)))
    panel.axes.set_ylim(len(names) - 0.4, -0.6)
    panel.axes.grid(True, axis="y", alpha=0.5)


MEAN = Quantity("mean residual", SPREADS)
_FLAGGED = "window with a disagreement"
_LINEAR_MEANS = 6.0  # larger means are shown on a logarithmic scale of colours


@figure(
    "disagreement",
    "Map of disagreement",
    _WHERE,
    ("map_bins", "map_windows"),
    "Mean residual of the current model with re-fitted parameters, by channel, run and crank angle, in standard "
    "deviations of the noise; red: the measurement is above. Outlined: windows with a significant residual "
    "(false-discovery rate 1 %). Where means exceed 6 the colour scale is linear up to 1 and logarithmic beyond.",
    nothing="no sample could be compared with the model",
)
def disagreement(tables: Tables, verdict: Verdict) -> Drawing:
    """Mean whitened residual of the recalibrated model by crank angle, a panel for each channel; flagged windows
    outlined."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize, SymLogNorm

    bins, windows = tables["map_bins"], tables["map_windows"]
    channels = list(bins["channel"].unique())
    heights = [bins[bins["channel"] == channel]["run"].nunique() for channel in channels]
    shares = [0.75 + count for count in heights]
    sheet = Sheet(1.25 + 0.32 * sum(shares), len(channels), 1, height_ratios=shares)
    most = round_up(max(1.0, np.nanmax(np.abs(bins["mean"].to_numpy(dtype=float)), initial=0.0)))
    norm = Normalize(-most, most) if most <= _LINEAR_MEANS else SymLogNorm(1.0, vmin=-most, vmax=most)
    colours = ScalarMappable(norm, "RdBu_r")
    above = None
    for row, channel in enumerate(channels):
        panel = sheet.panel((row, 0), in_words(channel), CRANK_ANGLE, Quantity("run", ""), below=above)
        own = bins[bins["channel"] == channel]
        for place, run in enumerate(_runs_in(own)):
            _bin_row(panel, place, run, own[own["run"] == run], colours)
            _windows(panel, place, run, windows[(windows["channel"] == channel) & (windows["run"] == run)])
        panel.rows(_runs_in(own), range(heights[row]))
        panel.axes.set_ylim(heights[row] - 0.4, -0.6)
        panel.axes.grid(False)
        panel.over_crank_angle(0.0, 360.0)
        above = panel
    bar = sheet.figure.colorbar(
        colours, ax=[panel.axes for panel in sheet.panels], label=MEAN.label, location="bottom", shrink=0.7, aspect=45
    )
    bar.ax.minorticks_off()
    if isinstance(norm, SymLogNorm):
        decades = 10.0 ** np.arange(0, np.floor(np.log10(most)) + 1)
        ticks = [*-decades[::-1], 0.0, *decades]
        bar.set_ticks(ticks, labels=[tick_label(tick, 0) for tick in ticks])
    if windows.empty:
        sheet.figure.suptitle("no window stands out of the noise", fontsize=8.5, x=0.99, ha="right")
    else:
        sheet.legend()
    return sheet.drawing()


def _bin_row(panel: Panel, place: int, run: str, bins: pd.DataFrame, colours: Any) -> None:
    filled = bins[bins["mean"].notna()]
    start, width = filled["start_deg"].to_numpy(), (filled["end_deg"] - filled["start_deg"]).to_numpy()
    spans = list(zip(start, width, strict=True))
    panel.axes.broken_barh(spans, (place - 0.4, 0.8), facecolors=colours.to_rgba(filled["mean"].to_numpy()))
    panel.record(
        MEAN.name,
        start + width / 2.0,
        np.full(len(filled), float(place)),
        low=start,
        high=filled["end_deg"],
        value=filled["mean"],
        label=[run] * len(filled),
        value_quantity=MEAN.name,
        value_unit=MEAN.unit,
    )


def _windows(panel: Panel, place: int, run: str, windows: pd.DataFrame) -> None:
    from matplotlib.patches import Rectangle

    for window in windows.itertuples():
        low, high = window.start_deg, window.end_deg
        for begin, end in [(low, high)] if low < high else [(low, 360.0), (0.0, high)]:
            frame = Rectangle((begin, place - 0.43), end - begin, 0.86, fill=False, edgecolor=INK, linewidth=1.3)
            frame.set(label=_FLAGGED, zorder=3)
            panel.axes.add_patch(frame)
            panel.record(
                _FLAGGED,
                [(begin + end) / 2.0],
                [float(place)],
                low=[begin],
                high=[end],
                value=[window.mean],
                label=[run],
                value_quantity=MEAN.name,
                value_unit=MEAN.unit,
            )


BAND = 2.0
"""Half of the noise band in standard deviations: 95 % of the samples of a true model lie inside."""

_DOTS = 1500  # dots in a panel
_MEANS = 72  # crank angles at which a mean is drawn
_FULLEST = 12.0  # residuals beyond are shown on a logarithmic scale
_BAND_LABEL = f"noise: {BAND:g} standard deviations"


@figure(
    "residuals",
    "Residuals before and after",
    _WHERE,
    ("residuals",),
    "Residual over the standard deviation of noise and numerics, by crank angle: dots are samples, lines their means "
    "over 5 deg. Before: no effect added, parameters re-fitted unless nominal ones suffice; after: with the effects "
    "of the verdict. A true model keeps 95 % of its samples in the grey band. Large residuals: linear scale inside "
    "the band, logarithmic outside.",
    nothing="no sample could be compared with the model",
)
def residuals(tables: Tables, verdict: Verdict) -> Drawing:
    """Whitened residual by crank angle: a row for each channel, a column for each run."""
    samples = tables["residuals"]
    before, after = ((samples["measured"] - samples[model]) / samples["spread"] for model in ("base", "augmented"))
    moments = ("before", "after") if (before != after).any() else ("before",)  # nothing was added
    samples = samples.assign(before=before, after=after)
    runs, channels = _runs_in(samples), list(samples["channel"].unique())
    sheet = Sheet(0.8 + 1.75 * len(channels), len(channels), len(runs), width=max(WIDTH, 2.9 * len(runs)))
    for row, channel in enumerate(channels):
        largest = np.nanmax(samples.loc[samples["channel"] == channel, list(moments)].abs().to_numpy())
        for column, run in enumerate(runs):
            own = samples[(samples["run"] == run) & (samples["channel"] == channel)]
            if own.empty:
                continue
            angular = own["crank_angle"].notna().any()
            held_out = ", held out" if own["held_out"].all() else ""
            title = f"{run}{held_out}: {in_words(channel)}"
            x = CRANK_ANGLE if angular else _SAMPLE
            panel = sheet.panel((row, column), title, x, Quantity("residual", "noise sd"))
            _fill(panel, own[own["crank_angle"].notna()] if angular else own, moments, angular)
            _residual_scale(panel, largest)
            if channel != samples.loc[samples["run"] == run, "channel"].iloc[-1]:  # the scale stands below the lowest
                panel.axes.set_xlabel("")
                panel.axes.tick_params(labelbottom=False)
            if column:
                panel.axes.set_ylabel("")
                panel.axes.tick_params(labelleft=False)
    sheet.legend()
    return sheet.drawing()


def _fill(panel: Panel, samples: pd.DataFrame, moments: tuple[str, ...], angular: bool) -> None:
    x = (np.degrees(samples["crank_angle"]) % 360.0 if angular else samples["sample"]).to_numpy(dtype=float)
    few = np.unique(np.linspace(0, len(x) - 1, min(_DOTS, len(x))).astype(int))
    for moment in moments:
        values = samples[moment].to_numpy(dtype=float)
        style = {"marker": ".", "markersize": 2.0, "alpha": 0.3, "markeredgewidth": 0.0, "rasterized": True}
        panel.marks(f"{moment}, samples", x[few], values[few], moment, **style)
        panel.axes.lines[-1].set_label("")  # dots as small as these cannot be seen in a legend
        panel.line(f"{moment}, mean", *_means(x, values), moment, linewidth=1.3, zorder=3)
    panel.axes.axhspan(-BAND, BAND, color="#E9E9E9", zorder=0, label=_BAND_LABEL)
    panel.record(_BAND_LABEL, [np.nan], [0.0], low=[-BAND], high=[BAND])
    if angular:
        panel.over_crank_angle(0.0, 360.0, step=90.0)


def _residual_scale(panel: Panel, largest: float) -> None:
    """The same scale for all runs of a channel."""
    if largest > _FULLEST:
        panel.linear_then_logarithmic(BAND, named=False)  # the band of the noise stands there
        panel.axes.set_ylabel(f"logarithmic beyond {BAND:g}\n{panel.y.label}")
        panel.axes.set_ylim(-1.5 * largest, 1.5 * largest)
    else:
        panel.axes.set_ylim(-1.08 * largest, 1.08 * largest)


def _means(x: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of `values` in equal intervals of `x`; NaN where there is none, so that the curve breaks."""
    edges = np.linspace(x.min(), x.max(), _MEANS + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _MEANS - 1)
    count = np.bincount(place, minlength=_MEANS)
    total = np.bincount(place, values, _MEANS)
    return (edges[1:] + edges[:-1]) / 2.0, np.divide(total, count, out=np.full(_MEANS, np.nan), where=count > 0)


RANKED = 8
"""The best explanations by one effect that are shown, and the best by more; all stand in the table of the ranking."""

BASE = "the model as it stands"

_KINDS = {
    "base": (BASE, "limit"),
    "single": ("one effect", "after"),
    "pair": ("two effects", "pair"),
    "formula": ("formula", "formula"),
}
_EXPLANATION = Quantity("explanation", "")
_APART = DEFAULT_SETTINGS.decision.min_delta_bic


@figure(
    "ranking",
    "Candidates ranked",
    _WHAT,
    ("ranking",),
    "Each candidate was added to the model and fitted together with all uncertain parameters. Left: its Bayesian "
    "information criterion above that of the best (linear up to 10, logarithmic beyond); a difference beyond 10 is "
    "very strong evidence. Right: share of the misfit beyond noise that it explains. Diamonds: named, or equivalent. "
    "A list always has a best member, even if the true effect is missing: check that only noise is left. All fits, "
    "with reasons of failures: table ranking.",
    nothing="no candidate was fitted: nothing is there to be explained",
)
def ranking(tables: Tables, verdict: Verdict) -> Drawing:
    """The best explanations by how far they are behind the best one in BIC, and by the share of the misfit they
    explain."""
    best = _shown(tables["ranking"])
    names = [in_words(label).replace(" + ", " +\n") for label in best["explanation"]]
    sheet = Sheet(1.35 + 0.31 * max(3, len(best)), 1, 2, width_ratios=(1.25, 1.0))
    behind = sheet.panel(
        (0, 0), "behind the best", Quantity("evidence against it: BIC above the best", "1"), _EXPLANATION
    )
    share = sheet.panel((0, 1), "misfit explained", Quantity("share explained", "1"), _EXPLANATION)
    distance = best["delta_bic"].max() - best["delta_bic"]
    for panel, values in ((behind, distance), (share, best["explained_share"].clip(-0.1, 1.1))):
        _ranking_marks(panel, best, values)
        list_rows(panel, names)
        panel.axes.set_ylabel("")
    behind.vertical_line("told apart from here on", _APART)
    _distance_scale(behind, distance.max())
    share.vertical_line("all of the misfit", 1.0, named=False)
    share.axes.set_xlim(-0.12, 1.12)
    share.axes.tick_params(labelleft=False)
    sheet.legend()
    return sheet.drawing()


def _shown(fits: pd.DataFrame) -> pd.DataFrame:
    """The best of the fits, best first, and the base, which all of them are compared with."""
    fitted = fits[(fits["kind"] != "base") & fits["delta_bic"].notna()].sort_values("delta_bic", ascending=False)
    alone = fitted["kind"] == "single"
    base = {"explanation": BASE, "kind": "base", "delta_bic": 0.0, "explained_share": 0.0, "place": ""}
    rows = [fitted[alone].head(RANKED), fitted[~alone].head(RANKED), pd.DataFrame([base])]
    columns = list(base)
    kept = pd.concat([frame[columns] for frame in rows if len(frame)], ignore_index=True)
    return kept.sort_values("delta_bic", ascending=False, kind="stable", ignore_index=True)


def _ranking_marks(panel: Panel, best: pd.DataFrame, values: pd.Series) -> None:
    place = np.arange(len(best))
    for kind, (series, colour) in _KINDS.items():
        own = ((best["kind"] == kind) & (best["place"] == "")).to_numpy()
        if own.any():
            panel.marks(series, values[own], place[own], colour, labels=list(best["explanation"][own]))
    for series, words in (
        ("named", "named"),
        ("equivalent", "cannot be told apart"),
        ("best_known", "best known, not proven"),
    ):
        own = (best["place"] == series).to_numpy()
        if own.any():
            labels = list(best["explanation"][own])
            panel.marks(words, values[own], place[own], "named", labels=labels, marker="D", markersize=6.0)


def _distance_scale(panel: Panel, farthest: float) -> None:
    """An abscissa that is linear up to the difference that tells two explanations apart and logarithmic beyond."""
    from matplotlib.ticker import FixedLocator

    decades = 10.0 ** np.arange(1, 12)
    ticks = [0.0, *decades[decades <= 1.5 * max(farthest, _APART)]]
    panel.axes.set_xscale("symlog", linthresh=_APART, linscale=0.7)
    label_ticks(panel.axes.xaxis, FixedLocator(ticks))
    panel.axes.set_xlim(-1.5, 1.8 * max(farthest, _APART))


POSITION = Quantity("slider position", "mm", "$x$")
SPEED = Quantity("slider velocity", "m/s", "$v$")
FORCES = {"slider_force": Quantity("force on the slider", "N"), "crank_torque": Quantity("torque on the crank", "N m")}
_COLOURS = ("paper", "after", "network", "second surrogate", "spline", "other", "ideal")
_WIDEST = 5.0  # [pt] curve of the first run, which lies lowest


@figure(
    "missing_force",
    "The missing force",
    _WHAT,
    ("missing_force",),
    "Force on the slider, or torque on the crank, of the named effects along one settled revolution of each fitted "
    "run: over velocity, over position (crank angle for a torque), and as colour over both. Effects that are no "
    "force (a mass, a length, a clearance, a sensor fault) have none.",
    nothing="no force or torque was named, so none is shown",
)
def missing_force(tables: Tables, verdict: Verdict) -> Drawing:
    """What the named effects push the slider with (or turn the crank) along each run: over x, over v, and over both."""
    samples = tables["missing_force"]
    shown = [name for name in FORCES if samples[name].abs().max() > 0.0]
    if not shown:
        return message_sheet(FIGURES["missing_force"].title, FIGURES["missing_force"].nothing)
    across = [("slider_velocity", SPEED, 1.0), ("slider_position", POSITION, 1e3)]
    sheet = Sheet(0.5 + 2.7 * len(shown), len(shown), 3, width=10.5)
    for row, name in enumerate(shown):
        force = FORCES[name]
        if name == "crank_torque":
            across = [across[0], ("crank_angle", CRANK_ANGLE, 180.0 / np.pi)]
        for column, (key, quantity, factor) in enumerate(across):
            panel = sheet.panel((row, column), f"{force.name} over {quantity.name}", quantity, force)
            for number, run in enumerate(_runs_in(samples)):
                own = samples[samples["run"] == run]
                colour = _COLOURS[number % len(_COLOURS)]
                width = _WIDEST * 0.5**number + 0.7  # one curve may lie on the others: those drawn first show beside it
                panel.line(f"run {run}", factor * own[key].to_numpy(), own[name].to_numpy(), colour, linewidth=width)
            panel.axes.axhline(0.0, color="#777777", linewidth=0.8)
            if quantity is CRANK_ANGLE:
                panel.over_crank_angle(0.0, 360.0)
        _plane(sheet, row, samples, name)
    sheet.legend()
    return sheet.drawing()


def _plane(sheet: Sheet, row: int, samples: pd.DataFrame, name: str) -> None:
    """Colour of the force along the runs in the plane of position and speed."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    force = FORCES[name]
    panel = sheet.panel((row, 2), f"{force.name} as colour", POSITION, SPEED)
    x, y, value = 1e3 * samples["slider_position"], samples["slider_velocity"], samples[name]
    most = value.abs().max()
    colours = ScalarMappable(Normalize(-most, most), "RdBu_r")
    panel.axes.scatter(x, y, c=value, cmap=colours.cmap, norm=colours.norm, s=9.0, linewidths=0.0, rasterized=True)
    panel.record(force.name, x, y, value=value, value_quantity=force.name, value_unit=force.unit)
    sheet.figure.colorbar(colours, ax=panel.axes, label=force.label)


GAP = Quantity("gap: root mean square residual", SPREADS)
ROLES = {"confirm": "held out: took no part in fitting or choosing", "identify": "used for fitting"}


@figure(
    "gaps",
    "Gap before and after",
    _BETTER,
    ("gaps",),
    "Root mean square residual over the standard deviation of the noise, by run and channel, with 90 % bootstrap "
    "intervals; 1 is noise. Held-out runs took no part in fitting or choosing; run-specific values (speed, start "
    "angle) were fitted for each run, before and after.",
    nothing="no gap was taken",
)
def gaps(tables: Tables, verdict: Verdict) -> Drawing:
    """Root mean squared whitened residual by run and channel, with 90 % intervals; 1 is the noise. Nothing after where
    nothing was added."""
    table = tables["gaps"]
    roles = [role for role in ROLES if (table["role"] == role).any()]
    counts = [int((table["role"] == role).sum()) for role in roles]
    sheet = Sheet(
        1.2 + sum(0.55 + 0.2 * count for count in counts), len(roles), 1, height_ratios=[2 + n for n in counts]
    )
    added = not np.array_equal(table["before"], table["after"])
    moments = (("before", -0.14, "before"), ("after", 0.14, "after")) if added else (("before", 0.0, "before"),)
    above, widest = None, max(_width_of(_gap_label(each)) for each in table.itertuples())
    for row, role in enumerate(roles):
        own = _in_order(table[table["role"] == role])
        panel = sheet.panel((row, 0), ROLES[role], GAP, Quantity("run", ""), below=above)
        place = np.arange(len(own))
        labels = [_gap_label(each) for each in own.itertuples()]
        for series, shift, colour in moments:
            low, high = (own[f"{series}_{end}"] for end in ("low", "high"))
            marker = "D" if series == "after" else "o"
            panel.marks(series, own[series], place + shift, colour, low, high, labels, along="x", marker=marker)
        list_rows(panel, labels)
        _from_the_left(panel, widest)
        panel.vertical_line("noise alone", 1.0)
        panel.axes.set_ylabel("")
        above = panel
    _gap_scale(sheet, table)
    sheet.legend()
    return sheet.drawing()


def _in_order(own: pd.DataFrame) -> pd.DataFrame:
    """All runs first, then each run: all channels, then one by one."""
    runs = {run: place for place, run in enumerate(("all", *(run for run in own["run"].unique() if run != "all")))}
    place = own["run"].map(runs) + (own["channel"] != "all") * 0.5
    return own.assign(place=place).sort_values("place", kind="stable").drop(columns="place").reset_index(drop=True)


def _gap_label(row) -> str:
    """The channels of a run are indented below it."""
    if row.channel != "all":
        return f"      {in_words(row.channel)}"
    return "all runs" if row.run == "all" else f"run {row.run}"


def _width_of(label: str) -> float:
    """Width [pt] of a tick's label; a blank has none by itself."""
    from matplotlib import rcParams
    from matplotlib.textpath import TextPath

    size = rcParams["ytick.labelsize"]
    ends = (TextPath((0, 0), f"{text}|", size=size).get_extents().x1 for text in (label, ""))
    return next(ends) - next(ends)


def _from_the_left(panel: Panel, width: float) -> None:
    """Labels of rows begin at one place, `width` [pt] left of the axis, so that indents show."""
    panel.axes.tick_params(axis="y", pad=width + 4.0)
    for label in panel.axes.get_yticklabels():
        label.set_horizontalalignment("left")


def _gap_scale(sheet: Sheet, table: pd.DataFrame) -> None:
    from matplotlib.ticker import LogLocator

    shown = table[["before", "after", "before_low", "before_high", "after_low", "after_high"]].to_numpy(dtype=float)
    low, high = np.nanmin(shown), np.nanmax(shown)
    for panel in sheet.panels:
        panel.axes.set_xscale("log")
        panel.axes.set_xlim(0.85 * min(low, 0.9), 1.2 * max(high, 1.5))
        label_ticks(panel.axes.xaxis, LogLocator(subs=(1.0, 2.0, 5.0)))


MODELS = {"base": "before", "augmented": "after"}
"""Series of the models of table `CAMPAIGN_OPTIMUM`."""

_LENGTHS = {"crank_length": "crank length", "rod_length": "rod length"}
_ROOM = 0.25  # of a scale's span, to each side
_SMALLEST_CHANGE = 2e-3  # of a length: smaller ones look small


@figure(
    "optimum",
    "Optimum before and after",
    _BETTER,
    ("campaign_optimum",),
    "Link lengths with the smallest error of the transmission angle, on the current model (before) and on the model "
    "with the effects of the verdict (after). Right: RMS error at the original and at the optimal lengths with "
    "frozen joint motion, its reduction there, and the reduction when simulated again. A model without a loose joint "
    "has no optimum.",
    nothing="nothing to optimise: no effect was added to the mechanism, or no joint of it is loose",
)
def optimum(tables: Tables, verdict: Verdict) -> Drawing:
    """Optimal link lengths, and the error of the transmission angle that they leave, of the model as it stood and with
    the effect added."""
    optima = tables["campaign_optimum"].dropna(subset=["crank_length"])
    if optima.empty:
        return message_sheet("Optimum before and after", "the model could not be optimised again: see the summary")
    order = optima["model"].map(list(MODELS).index)
    optima = optima.assign(order=order).sort_values(["source", "order"], kind="stable", ignore_index=True)
    names = [f"{MODELS[row.model]}, {in_words(row.source)}" for row in optima.itertuples()]
    sheet = Sheet(1.0 + 0.32 * max(3, len(names)), 1, 3, width=9.0, width_ratios=[1.0, 1.0, 1.3])
    for column, (key, words) in enumerate(_LENGTHS.items()):
        panel = sheet.panel((0, column), f"optimal {words}", Quantity(words, "mm"), Quantity("model", ""))
        for place, row in enumerate(optima.itertuples()):
            value, series = 1e3 * getattr(row, key), MODELS[row.model]
            edge = ", at a bound" if row.at_edge else ""
            panel.marks(series, [value], [place], series, labels=[row.source], marker="D")
            _beside(panel, value, place, f"{value:.2f} mm{edge}")
        _length_scale(panel, 1e3 * optima[key].to_numpy(dtype=float))
        _optimum_rows(panel, names, column == 0)
    error = sheet.panel(
        (0, 2), "RMS error of the transmission angle", Quantity("RMS error", "mdeg"), Quantity("model", "")
    )
    for place, row in enumerate(optima.itertuples()):
        original, optimal = (1e3 * np.degrees(value) for value in (row.rms_before, row.rms_after))
        error.line("fall", [original, optimal], [place, place], "limit", linewidth=1.0)
        error.axes.lines[-1].set_label("")
        error.marks("original lengths", [original], [place], "other", labels=[row.source], markerfacecolor="white")
        error.marks("optimal lengths", [optimal], [place], MODELS[row.model], labels=[row.source], marker="D")
        again = "" if pd.isna(row.resimulated) else f", simulated again {percent(-row.resimulated)}"
        _beside(error, 0.0, place, f"{percent(-row.reduction)}{again}".replace("-", "−"))
    most = 1e3 * np.degrees(optima["rms_before"].max())
    error.axes.set_xlim(0.0, 1.08 * most)
    _optimum_rows(error, names, False)
    sheet.legend([error])
    return sheet.drawing()


def _optimum_rows(panel: Panel, names: list[str], named: bool) -> None:
    panel.rows(names if named else [""] * len(names), np.arange(len(names), dtype=float))
    panel.axes.set_ylim(len(names) - 0.4, -0.75)
    panel.axes.set_ylabel("")


def _beside(panel: Panel, x: float, place: float, text: str) -> None:
    panel.axes.annotate(
        text, (x, place), (0, 5), textcoords="offset points", ha="center" if x else "left", va="bottom", fontsize=8.0
    )


def _length_scale(panel: Panel, values: np.ndarray) -> None:
    """A scale on which a change of a thousandth of a length looks small."""
    middle, span = (values.min() + values.max()) / 2.0, values.max() - values.min()
    half = max((0.5 + _ROOM) * span, _SMALLEST_CHANGE * middle)
    panel.axes.set_xlim(middle - half, middle + half)
    panel.axes.locator_params(axis="x", nbins=4)


COSINE = Quantity("cosine of the signatures", "1")
_EFFECT = Quantity("effect", "")
_RELATIVE_SIZE = Quantity("smallest detectable size over the size that makes a gap of 1.5", "1")
_WRITTEN_FROM = 0.5  # cosines that are written as numbers
_MERGED = "cannot be told apart here"


@figure(
    "confusability",
    "Effects that look alike",
    _PLAN,
    ("confusability",),
    "Cosine between the changes that two effects make in the measured channels, whitened and after re-fitting "
    "uncertain parameters; 1: these runs cannot tell them apart at any size. Outlined: effects that count as one. "
    "Known before measuring.",
    nothing="there are no candidates to compare",
)
def confusability(tables: Tables, verdict: Verdict) -> Drawing:
    """Cosines between what any two effects do to the measurement once the nuisances are re-fitted; merged classes
    outlined."""
    from matplotlib.patches import Rectangle

    pairs = tables["confusability"]
    labels = sorted({*pairs["first"], *pairs["second"]})
    number = {label: place for place, label in enumerate(labels)}
    cosine = np.eye(len(labels))
    rows, columns = pairs["first"].map(number), pairs["second"].map(number)
    cosine[rows, columns] = cosine[columns, rows] = np.nan_to_num(np.abs(pairs["cosine"].to_numpy(dtype=float)))
    np.fill_diagonal(cosine, 1.0)
    order = _order_by_likeness(cosine, [[number[label] for label in group] for group in _merged(verdict, number)])
    labels, cosine = [labels[i] for i in order], cosine[np.ix_(order, order)]
    number = {label: place for place, label in enumerate(labels)}
    count = len(labels)
    size = 3.6 + 0.25 * count
    sheet = Sheet(size * 0.95, 1, 1, width=size)
    panel = sheet.panel((0, 0), "how alike the effects look", _EFFECT, _EFFECT)
    drawn = panel.axes.pcolormesh(
        np.arange(count + 1) - 0.5, np.arange(count + 1) - 0.5, cosine, cmap="Blues", vmin=0, vmax=1
    )
    x, y = np.meshgrid(np.arange(count, dtype=float), np.arange(count, dtype=float))
    panel.record(
        COSINE.name,
        x.ravel(),
        y.ravel(),
        value=cosine.ravel(),
        label=[f"{first} / {second}" for first in labels for second in labels],
        value_quantity=COSINE.name,
        value_unit=COSINE.unit,
    )
    for (row, column), value in np.ndenumerate(cosine):
        if row != column and value >= _WRITTEN_FROM:
            ink = "white" if value > 0.6 else "black"
            panel.axes.text(column, row, _two_digits(value), ha="center", va="center", color=ink, fontsize=6.0)
    for group in _merged(verdict, number):
        places = sorted(number[label] for label in group)
        edge = Rectangle((places[0] - 0.5, places[0] - 0.5), len(places), len(places), fill=False, linewidth=1.8)
        edge.set(edgecolor=COLOURS["before"], label=_MERGED, zorder=3)
        panel.axes.add_patch(edge)
        panel.record(_MERGED, places, places, label=[labels[place] for place in places])
    names = [in_words(label) for label in labels]
    panel.axes.set_xticks(range(count), names, rotation=90, fontsize=7.0)
    panel.axes.set_yticks(range(count), names, fontsize=7.0)
    panel.axes.set(xlabel="", ylabel="", aspect="equal")
    panel.axes.invert_yaxis()
    panel.axes.grid(False)
    sheet.figure.colorbar(drawn, ax=panel.axes, label=COSINE.label, shrink=0.6)
    if _merged(verdict, number):
        sheet.legend()
    return sheet.drawing()


def _merged(verdict: Mapping[str, Any], shown: Mapping[str, int]) -> list[list[str]]:
    groups = verdict.get("preflight", {}).get("merged", ())
    return [own for group in groups if len(own := [label for label in group if label in shown]) > 1]


def _order_by_likeness(cosine: np.ndarray, groups: list[list[int]]) -> list[int]:
    """An order in which effects that look alike are neighbours, those of one group without a stranger between them."""
    from scipy.cluster.hierarchy import leaves_list, linkage
    from scipy.spatial.distance import squareform

    if len(cosine) < 3:
        return list(range(len(cosine)))
    near = cosine.copy()
    for group in groups:
        near[np.ix_(group, group)] = 2.0  # nearer than any other can be
    distance = 2.0 - near
    np.fill_diagonal(distance, 0.0)
    return list(leaves_list(linkage(squareform(distance, checks=False), "average", optimal_ordering=True)))


def _two_digits(value: float) -> str:
    """Two digits after the point, three where these would be 1.00."""
    return "1" if value >= 0.9995 else f"{value:.{3 if value >= 0.995 else 2}f}".lstrip("0")


@figure(
    "detectable",
    "Smallest detectable sizes",
    _PLAN,
    ("detectable",),
    "Size from which an effect is found in nine of ten such campaigns, over the size at which simulation and "
    "measurement differ by 1.5 standard deviations of the noise after re-fitting uncertain parameters; inverted "
    'where an effect shrinks as its value grows ("up to"). Its value is at the right. Known before measuring.',
    nothing="there are no candidates to detect",
)
def detectable(tables: Tables, verdict: Verdict) -> Drawing:
    """The smallest size of each effect that this experiment shows, over the one that makes a gap of 1.5, with its
    value.

    Where the value falls as the effect grows, the ratio is turned over: to the left of the line is always what is
    easily seen."""
    effects = tables["detectable"]
    ratio = (effects["smallest_detectable"] / effects["typical"]).abs()
    effects = effects.assign(ratio=ratio.where(~effects["falls"], 1.0 / ratio))
    effects = effects.sort_values("ratio", na_position="last").reset_index(drop=True)
    sheet = Sheet(1.3 + 0.21 * len(effects), 1, 1)
    panel = sheet.panel((0, 0), "from which size on this campaign shows an effect", _RELATIVE_SIZE, _EFFECT)
    place, seen = np.arange(len(effects), dtype=float), effects["detectable"].to_numpy(dtype=bool)
    panel.marks(
        "smallest detectable size", effects["ratio"][seen], place[seen], "after", labels=list(effects["label"][seen])
    )
    list_rows(panel, [in_words(label) for label in effects["label"]])
    panel.vertical_line("size that makes a gap of 1.5", 1.0)
    panel.axes.set_xscale("log")
    low, high = effects["ratio"][seen].min(), effects["ratio"][seen].max()
    panel.axes.set_xlim(0.7 * np.fmin(low, 0.2), 2.0 * np.fmax(high, 1.0))
    panel.axes.xaxis.set_major_formatter(tick_label)
    panel.axes.set_ylabel("")
    right_axis = panel.axes.secondary_yaxis("right")
    right_axis.set_yticks(place, [_detectable_size(row) for row in effects.itertuples()])
    right_axis.tick_params(length=0)
    right_axis.spines["right"].set_visible(False)
    sheet.legend()
    return sheet.drawing()


def _detectable_size(effect) -> str:
    if pd.notna(effect.failed):
        return "not simulated"
    if not effect.detectable:
        return "no size shows"
    size = size_for_the_eye(effect.smallest_detectable, effect.unit)
    return f"up to {size}" if effect.falls else size
