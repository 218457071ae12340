"""Trend of effect sizes over campaigns of one rig."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num

from jointgap.campaign import verdict_json
from jointgap.campaign.campaign_files import VERDICT, check_unchanged, config_snapshot
from jointgap.campaign.labels import estimates, format_label, format_parameter, label_of
from jointgap.campaign.page import frame_block
from jointgap.campaign.state import FALSE_ALARM_RATE
from jointgap.config.campaign import Campaign
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.core.files import write_text
from jointgap.core.page import FigureBlock, Page, Paragraph, to_markdown
from jointgap.core.plot import Drawing, Quantity, Sheet, matplotlib_style
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import CONFIG_SNAPSHOT, DETECTABLE, TREND, TREND_GROWTH
from jointgap.core.words import format_name, joined, with_unit
from jointgap.identification.fit import HALF_WIDTHS, LEVELS
from jointgap.identification.line import Line, fit_line

_SHOWN_UNITS = {"m": (1e6, "µm")}  # factor and unit by SI unit

FEWEST_DATES = 3
"""Different dates that a growth rate requires: with two the errors cannot be checked."""

_PAGE, _FIGURE = "trend.md", "figures/trend.png"
_CLEARANCE = "_clearance"  # suffix of effects and nuisances that are clearances


def fit_growth(days: np.ndarray, values: np.ndarray, errors: np.ndarray) -> Line:
    """Line through sizes over days; the sizes of one day become their weighted mean, as what
    differs between days is common to them."""
    dates, index = np.unique(days, return_inverse=True)
    weight = 1.0 / errors**2
    total = np.bincount(index, weight)
    return fit_line(dates, np.bincount(index, weight * values) / total, total**-0.5)


def trend(files: Sequence[Path], results: Path, folder: Path) -> str:
    """Write tables, figure and page of a trend, and return its summary."""
    target = ResultsFolder(folder)
    target.check_writable(TREND.path, TREND_GROWTH.path, _PAGE, _FIGURE)
    campaigns = _campaigns(files)
    folders = {campaign.name: ResultsFolder(results / campaign.name) for campaign in campaigns}
    verdicts = {
        name: verdict_json.read(campaign_folder.path / VERDICT)
        for name, campaign_folder in folders.items()
    }
    for campaign in campaigns:
        check_unchanged(campaign, folders[campaign.name].read(CONFIG_SNAPSHOT))
    sizes = _size_frame(campaigns, verdicts, folders)
    growth = growth_frame(sizes)
    target.write(TREND, sizes)
    target.write(TREND_GROWTH, growth)
    with matplotlib_style():
        trend_figure(sizes, growth).save(folder / _FIGURE)
    write_text(folder / _PAGE, to_markdown(_page(sizes, growth)))
    lines = map(growth_summary, growth.to_dict("records"))
    return "\n".join([*lines, str(folder / _PAGE)])


def _campaigns(files: Sequence[Path]) -> list[Campaign]:
    """The campaigns by date; InputError if they are not of different dates of one rig."""
    campaigns: list[Campaign] = []
    for file in files:
        campaign = load_campaign(file)
        if campaign.date is None:
            raise InputError(
                f"{file}: has no `date`; add the day of the measurement, such as 'date: 2026-03-01'"
            )
        for earlier in campaigns:
            _check_apart(file, campaign, earlier)
        campaigns.append(campaign)
    return sorted(campaigns, key=lambda campaign: (campaign.date, campaign.name))


def _check_apart(file: Path, campaign: Campaign, earlier: Campaign) -> None:
    """InputError if the campaign of `file` repeats an `earlier` one or has another mechanism."""
    if campaign.name == earlier.name:
        raise InputError(
            f"{file}: campaign '{campaign.name}' is given twice; give each once, with its own name"
        )
    data, earlier_data = (
        {path.resolve() for path in campaign.data_files} for campaign in (campaign, earlier)
    )
    if shared := sorted(data & earlier_data):
        raise InputError(
            f"{file}: reads {shared[0]}, like campaign '{earlier.name}'; give each campaign the"
            " data of its own date"
        )
    keys, earlier_keys = (
        config_snapshot(campaign).set_index("key")["value"].filter(like="mechanism.")
        for campaign in (campaign, earlier)
    )
    for key in (*earlier_keys.index, *keys.index):
        value, earlier_value = keys.get(key, "absent"), earlier_keys.get(key, "absent")
        if value != earlier_value:
            raise InputError(
                f"{file}: {key} = {value}, but {earlier_value} in campaign '{earlier.name}' (SI); a"
                " trend requires the same mechanism, analyse all campaigns with the same file"
            )


def _sizes(verdict: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Sizes by label: of named or certain effects, and of fitted clearances."""
    sizes = {
        key: {"parameter": key, "unit": "m", "source": "nuisance", "estimate": estimate}
        for key, estimate in verdict["nuisances"].items()
        if key.endswith(_CLEARANCE)
    }
    for source, effects in (("named", verdict["effects"]), ("certain", verdict.get("certain", ()))):
        for effect in effects:
            size = next(iter(estimates([effect])), None)
            if size is not None and size.is_number:
                estimate = effect["parameters"][size.name]
                columns = {"parameter": size.name, "unit": size.unit, "source": source}
                sizes[label_of(effect)] = columns | {"estimate": estimate}
    return sizes


def _size_frame(
    campaigns: Sequence[Campaign],
    verdicts: Mapping[str, Mapping],
    folders: Mapping[str, ResultsFolder],
) -> pd.DataFrame:
    """Table `TREND`: a row for each size and campaign."""
    sizes = {name: _sizes(verdict) for name, verdict in verdicts.items()}
    labels = [label for sizes_of_campaign in sizes.values() for label in sizes_of_campaign]
    followed = [
        label
        for label in dict.fromkeys(labels)
        if label.endswith(_CLEARANCE) or labels.count(label) > 1
    ]
    if not followed:
        raise InputError(
            f"campaigns {joined(sizes)}: none identified a clearance, and no two the same effect,"
            " so there is no size to follow; give campaigns that identified one"
        )
    detectable = {}
    for name, folder in folders.items():
        if folder.place(DETECTABLE).exists():  # a verdict can be kept without its tables
            detectable[name] = folder.read(DETECTABLE).set_index("label")["smallest_detectable"]
    rows = []
    for label in followed:
        alike = [of_campaign[label] for of_campaign in sizes.values() if label in of_campaign]
        # a clearance can be an effect in one campaign and a nuisance in another
        kind = next((size for size in alike if size["source"] != "nuisance"), alike[0])
        for campaign in campaigns:
            name = campaign.name
            size = sizes[name].get(label, {})
            estimate = size.get("estimate", {})
            reason = _reason_not_used(label, size, verdicts[name])
            row = {
                "label": label,
                "parameter": kind["parameter"],
                "unit": kind["unit"],
                "campaign": name,
                "date": campaign.date.isoformat(),
                "days": (campaign.date - campaigns[0].date).days,
                "source": size.get("source", ""),
                "value": estimate.get("value"),
                "counts": not reason,
                "reason": reason,
                "smallest_detectable": None if size else detectable.get(name, {}).get(label),
            }
            for level in LEVELS:
                low, high = estimate.get(f"interval_{level}") or (None, None)
                row |= {f"low_{level}": low, f"high_{level}": high}
            rows.append(row)
    frame = pd.DataFrame(rows, columns=TREND.names)
    numbers = [column.name for column in TREND.columns if column.kind == "float"]
    return frame.astype(dict.fromkeys(numbers, float))  # None becomes NaN


def _reason_not_used(label: str, size: Mapping[str, Any], verdict: Mapping[str, Any]) -> str:
    """Why a campaign's size of `label` is not used for the growth; empty if it is."""
    if size:
        if size["source"] == "nuisance" and verdict["verdict"] in ("unexplained", "ambiguous"):
            return "fitted without the missing effect"
        low, high = size["estimate"].get("interval_90") or (None, None)
        is_bounded = low is not None and high is not None and high > low
        return size["estimate"].get("remark") or ("" if is_bounded else "has no 90 % interval")
    equivalent = [effect for explanation in verdict["equivalent"] for effect in explanation]
    if label in map(label_of, equivalent):
        return "not certain: one of several equivalent explanations"
    if label in map(label_of, (verdict["best_known"] or {}).get("effects", ())):
        return "not confirmed: only in the best candidate"
    if label in verdict["preflight"]["undetectable"]:
        return "not found: not detectable with these runs and channels"
    return f"not found; the verdict is {verdict['verdict'].replace('_', ' ')}"


def growth_frame(sizes: pd.DataFrame) -> pd.DataFrame:
    """Table `TREND_GROWTH` of the sizes in table `TREND`."""
    rows, keys = [], ["label", "parameter", "unit"]
    for key, points in sizes.groupby(keys, sort=False):
        points = points[points["counts"]]
        row = dict(zip(keys, key, strict=True)) | {"dates": points["days"].nunique()}
        row["growth"] = "too few dates"
        if row["dates"] >= FEWEST_DATES:
            errors = (points["high_90"] - points["low_90"]) / (2.0 * HALF_WIDTHS[90])
            columns = (points["days"], points["value"], errors)
            line = fit_growth(*(column.to_numpy(dtype=float) for column in columns))
            row["growth"] = "grew" if line.slope > 0 else "shrank"
            if line.p > FALSE_ALARM_RATE:
                row["growth"] = "no growth"
            row |= {"rate": line.slope, "rate_low": line.low, "rate_high": line.high}
            row |= {"first_value": line.first, "p": line.p, "error_scale": line.error_scale}
        rows.append(row)
    return pd.DataFrame(rows, columns=TREND_GROWTH.names)


def growth_summary(growth: Mapping[str, Any]) -> str:
    """A row of table `TREND_GROWTH` in a sentence."""
    label = format_label(growth["label"])
    if growth["growth"] == "too few dates":
        dates = f"{growth['dates']} of at least {FEWEST_DATES}"
        return f"{label}: too few dates for a growth rate ({dates})"
    factor, unit = _SHOWN_UNITS.get(growth["unit"], (1.0, growth["unit"]))
    sign = -1.0 if growth["growth"] == "shrank" else 1.0
    rates = sorted(sign * factor * growth[key] for key in ("rate_low", "rate", "rate_high"))
    decimals = max(0, 1 - math.floor(math.log10(rates[2] - rates[1])))
    # without minus zero
    low, rate, high = (f"{round(value, decimals) + 0.0:.{decimals}f}" for value in rates)
    change = f"{growth['growth']} by"
    if growth["growth"] == "no growth":
        change = "no significant growth:"
    p = "below 1e-10" if growth["p"] < 1e-10 else f"= {growth['p']:.2g}"
    interval = f"90 % interval {low} to {high}; p {p}"
    return f"{label}: {change} {with_unit(rate, unit)} per day ({interval})"


def trend_figure(sizes: pd.DataFrame, growth: pd.DataFrame) -> Drawing:
    """Sizes over dates with 90 % intervals and the fitted line, one panel for each size."""
    sheet, panel = Sheet(0.8 + 2.4 * len(growth), len(growth), 1), None
    sizes = sizes.assign(day=date2num(pd.to_datetime(sizes["date"]).to_numpy()))
    for place, line in enumerate(growth.to_dict("records")):
        factor, unit = _SHOWN_UNITS.get(line["unit"], (1.0, line["unit"]))
        date, size = Quantity("date", "d since 1970-01-01"), Quantity("size", unit)
        panel = sheet.panel((place, 0), format_name(line["label"]), date, size, below=panel)
        panel.axes.set_xlabel("date")
        points = sizes[sizes["label"] == line["label"]]
        used, absent = points[points["counts"]], points["value"].isna()
        unused = points[~points["counts"] & ~absent]
        for series, rows, colour, style in (
            ("size with 90 % interval", used, "settled", {}),
            ("not used for the line", unused, "limit", {"markerfacecolor": "white"}),
        ):
            if len(rows):
                ends = [factor * rows[end].fillna(rows["value"]) for end in ("low_90", "high_90")]
                panel.marks(series, rows["day"], factor * rows["value"], colour, *ends, **style)
        limits = points[absent].dropna(subset=["smallest_detectable"])
        if len(limits):
            series, smallest = "not found; detectable from this size", limits["smallest_detectable"]
            panel.marks(series, limits["day"], factor * smallest, "other", marker="v")
        if pd.notna(line["rate"]):
            span = np.array([used["day"].min(), used["day"].max()])
            values = line["first_value"] + line["rate"] * (span - points["day"].min())
            panel.line("straight line", span, factor * values, "before")
        locator = AutoDateLocator(minticks=3, maxticks=8)
        panel.axes.xaxis.set_major_locator(locator)
        panel.axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
        panel.axes.margins(x=0.05)
    sheet.legend()
    return sheet.drawing()


def _page(sizes: pd.DataFrame, growth: pd.DataFrame) -> Page:
    blocks = []
    names = ("date", "campaign", "value", "low_90", "high_90", "source", "smallest_detectable")
    for row in growth.to_dict("records"):
        text = f"{growth_summary(row)}."
        if pd.notna(row["error_scale"]):
            text += f" Scatter about the line: {row['error_scale']:.2g} times the stated errors."
        blocks.append(Paragraph(text, strong=True))
        factor, unit = _SHOWN_UNITS.get(row["unit"], (1.0, row["unit"]))
        label, parameter = row["label"], row["parameter"]
        points = sizes.query("label == @label and parameter == @parameter")
        caption = f"By campaign: {format_parameter(label.partition(':')[0], parameter)}."
        blocks.append(frame_block(TREND, points, (*names, "reason"), caption, (unit, factor)))
    blocks.append(FigureBlock("trend", "Sizes by date"))
    meaning = (
        "Lines: weighted least squares over the days (`trend_growth.parquet`; sizes in SI:"
        " `trend.parquet`). Intervals and p follow Student's distribution, as the scatter is"
        " estimated from the residuals: three dates only show a growth much larger than the"
        f" scatter. Grew or shrank: p below {FALSE_ALARM_RATE:g}. A campaign that did not find the"
        " effect is not used for the line: the size there is below the smallest detectable one."
    )
    return Page("Wear by date", (*blocks, Paragraph(meaning)))
