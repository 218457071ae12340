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
from jointgap.campaign.page import frame_block
from jointgap.campaign.sentences import estimate_unit, format_label, format_parameter, label_of
from jointgap.campaign.state import FALSE_ALARM_RATE
from jointgap.config.campaign import Campaign
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.core.files import write_text
from jointgap.core.page import FigureBlock, Page, Paragraph, to_markdown
from jointgap.core.plot import Drawing, Quantity, Sheet, matplotlib_style, save
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import CONFIG_SNAPSHOT, DETECTABLE, TREND, TREND_GROWTH
from jointgap.core.words import format_name, joined, with_unit
from jointgap.identification.fit import HALF_WIDTHS, LEVELS
from jointgap.identification.line import Line, fit_line

_SHOWN_UNITS = {"m": (1e6, "µm")}  # factor and unit by SI unit

FEWEST_DATES = 3
"""Different dates that a growth rate requires: with two the errors cannot be checked."""

_PAGE = "trend.md"
_CLEARANCE = "_clearance"  # suffix of effects and nuisances that are clearances


def fit_growth(days: np.ndarray, values: np.ndarray, errors: np.ndarray) -> Line:
    """Line through sizes over days; the sizes of one day become their weighted mean, as what
    differs between days is common to them."""
    dates, place = np.unique(days, return_inverse=True)
    weight = 1.0 / errors**2
    total = np.bincount(place, weight)
    return fit_line(dates, np.bincount(place, weight * values) / total, total**-0.5)


def trend(files: Sequence[Path], results: Path, folder: Path) -> str:
    """Write tables, figure and page of a trend, and return its summary."""
    target = ResultsFolder(folder)
    drawn = (f"figures/trend{suffix}" for suffix in (".svg", ".png", ".parquet"))
    target.check_writable(TREND.path, TREND_GROWTH.path, _PAGE, *drawn)
    campaigns: list[Campaign] = []
    for file in files:
        campaign = load_campaign(file)
        if campaign.date is None:
            raise InputError(
                f"{file}: has no `date`; add the day of the measurement, such as 'date: 2026-03-01'"
            )
        for other in campaigns:
            _check_apart(file, campaign, other)
        campaigns.append(campaign)
    campaigns.sort(key=lambda each: (each.date, each.name))
    folders = {each.name: ResultsFolder(results / each.name) for each in campaigns}
    verdicts = {name: verdict_json.read(each.path / VERDICT) for name, each in folders.items()}
    for campaign in campaigns:
        check_unchanged(campaign, folders[campaign.name].read(CONFIG_SNAPSHOT))
    sizes = _sizes_of(campaigns, verdicts, folders)
    growth = growth_frame(sizes)
    with matplotlib_style():
        drawing = trend_figure(sizes, growth)
    target.write(TREND, sizes)
    target.write(TREND_GROWTH, growth)
    save(drawing, folder / "figures/trend")
    write_text(folder / _PAGE, to_markdown(_page(sizes, growth)))
    return "\n".join(map(growth_summary, growth.to_dict("records"))) + f"\n{folder / _PAGE}"


def _check_apart(file: Path, campaign: Campaign, other: Campaign) -> None:
    """InputError if the campaign of `file` repeats `other` or has another mechanism."""
    if campaign.name == other.name:
        raise InputError(
            f"{file}: campaign '{campaign.name}' is given twice; give each once, with its own name"
        )
    own, others = ({file.resolve() for file in each.data_files} for each in (campaign, other))
    if shared := sorted(own & others):
        raise InputError(
            f"{file}: reads {shared[0]}, like campaign '{other.name}'; give each campaign the data"
            " of its own date"
        )
    mine, its = (
        config_snapshot(each).set_index("key")["value"].filter(like="mechanism.")
        for each in (campaign, other)
    )
    for key in (*its.index, *mine.index):
        if mine.get(key) != its.get(key):
            raise InputError(
                f"{file}: {key} = {mine.get(key, 'absent')}, but {its.get(key, 'absent')} in"
                f" campaign '{other.name}' (SI); a trend requires the same mechanism, analyse all"
                " campaigns with the same file"
            )


def _stated(verdict: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Sizes by label: of named or certain effects, and of fitted clearances."""
    stated = {
        key: {"parameter": key, "unit": "m", "source": "nuisance", "estimate": estimate}
        for key, estimate in verdict["nuisances"].items()
        if key.endswith(_CLEARANCE)
    }
    for source, effects in (("named", verdict["effects"]), ("certain", verdict.get("certain", ()))):
        for effect in effects:
            parameter, estimate = next(iter(effect["parameters"].items()), ("", {}))
            if isinstance(estimate.get("value"), int | float):  # not the formula of a law
                unit = estimate_unit(effect, parameter)
                size = {
                    "parameter": parameter,
                    "unit": unit,
                    "source": source,
                    "estimate": estimate,
                }
                stated[label_of(effect)] = size
    return stated


def _sizes_of(
    campaigns: Sequence[Campaign],
    verdicts: Mapping[str, Mapping],
    folders: Mapping[str, ResultsFolder],
) -> pd.DataFrame:
    """Table `TREND`: a row for each size and campaign."""
    stated = {name: _stated(verdict) for name, verdict in verdicts.items()}
    times = pd.Series(
        [label for each in stated.values() for label in each], dtype=object
    ).value_counts(sort=False)
    followed = [label for label, count in times.items() if label.endswith(_CLEARANCE) or count > 1]
    if not followed:
        raise InputError(
            f"campaigns {joined(stated)}: none identified a clearance, and no two the same effect,"
            " so there is no size to follow; give campaigns that identified one"
        )
    detectable = {}
    for name, folder in folders.items():
        if folder.place(DETECTABLE).exists():  # a verdict can be kept without its tables
            detectable[name] = folder.read(DETECTABLE).set_index("label")["smallest_detectable"]
    rows = []
    for label in followed:
        like = [each[label] for each in stated.values() if label in each]
        # a clearance can be an effect in one campaign and a nuisance in another
        known = next((size for size in like if size["source"] != "nuisance"), like[0])
        for campaign in campaigns:
            size = stated[campaign.name].get(label)
            estimate = size["estimate"] if size else {}
            reason = _reason_not_used(label, size, verdicts[campaign.name])
            row = {
                "label": label,
                "parameter": known["parameter"],
                "unit": known["unit"],
                "campaign": campaign.name,
            }
            row |= {
                "date": campaign.date.isoformat(),
                "days": (campaign.date - campaigns[0].date).days,
            }
            row |= {
                "source": size["source"] if size else "",
                "counts": not reason,
                "reason": reason,
            }
            row["value"] = estimate.get("value")
            for level in LEVELS:
                row[f"low_{level}"], row[f"high_{level}"] = estimate.get(f"interval_{level}") or (
                    None,
                    None,
                )
            if not size:
                row["smallest_detectable"] = detectable.get(campaign.name, {}).get(label)
            rows.append(row)
    frame = pd.DataFrame(rows, columns=TREND.names)
    numbers = [column.name for column in TREND.columns if column.kind == "float"]
    return frame.astype(dict.fromkeys(numbers, float))  # None becomes NaN


def _reason_not_used(label: str, size: Mapping[str, Any] | None, verdict: Mapping[str, Any]) -> str:
    """Why a campaign's size of `label` is not used for the growth; empty if it is."""
    if size:
        if size["source"] == "nuisance" and verdict["verdict"] in ("unexplained", "ambiguous"):
            return "fitted without the missing effect"
        low, high = size["estimate"].get("interval_90") or (None, None)
        bounded = low is not None and high is not None and high > low
        return size["estimate"].get("remark") or ("" if bounded else "has no 90 % interval")
    if any(
        label == label_of(effect) for explanation in verdict["equivalent"] for effect in explanation
    ):
        return "not certain: one of several equivalent explanations"
    if label in map(label_of, (verdict["best_known"] or {}).get("effects", ())):
        return "not confirmed: only in the best candidate"
    if label in verdict["preflight"]["undetectable"]:
        return "not found: not detectable with these runs and channels"
    return f"not found; the verdict is {verdict['verdict'].replace('_', ' ')}"


def growth_frame(sizes: pd.DataFrame) -> pd.DataFrame:
    """Table `TREND_GROWTH` of the sizes in table `TREND`."""
    rows = []
    for (label, parameter, unit), own in sizes.groupby(["label", "parameter", "unit"], sort=False):
        counted = own[own["counts"]]
        row = {
            "label": label,
            "parameter": parameter,
            "unit": unit,
            "dates": counted["days"].nunique(),
        }
        row["growth"] = "too few dates"
        if row["dates"] >= FEWEST_DATES:
            errors = (counted["high_90"] - counted["low_90"]) / (2.0 * HALF_WIDTHS[90])
            found = fit_growth(
                *(
                    each.to_numpy(dtype=float)
                    for each in (counted["days"], counted["value"], errors)
                )
            )
            row |= {
                "rate": found.slope,
                "rate_low": found.low,
                "rate_high": found.high,
                "first_value": found.first,
            }
            row |= {"p": found.p, "error_scale": found.error_scale}
            row["growth"] = (
                "no growth"
                if found.p > FALSE_ALARM_RATE
                else "grew"
                if found.slope > 0
                else "shrank"
            )
        rows.append(row)
    return pd.DataFrame(rows, columns=TREND_GROWTH.names)


def growth_summary(growth: Mapping[str, Any]) -> str:
    """A row of table `TREND_GROWTH` in a sentence."""
    what = format_label(growth["label"])
    if growth["growth"] == "too few dates":
        return (
            f"{what}: too few dates for a growth rate ({growth['dates']} of at least"
            f" {FEWEST_DATES})"
        )
    factor, unit = _SHOWN_UNITS.get(growth["unit"], (1.0, growth["unit"]))
    sign = -1.0 if growth["growth"] == "shrank" else 1.0
    rates = sorted(sign * factor * growth[key] for key in ("rate_low", "rate", "rate_high"))
    low, rate, high = (_rounded(each, rates[2] - rates[1]) for each in rates)
    verdict = (
        "no significant growth:" if growth["growth"] == "no growth" else f"{growth['growth']} by"
    )
    p = "below 1e-10" if growth["p"] < 1e-10 else f"= {growth['p']:.2g}"
    return (
        f"{what}: {verdict} {with_unit(rate, unit)} per day (90 % interval {low} to {high}; p {p})"
    )


def _rounded(value: float, error: float) -> str:
    """A `value` to the second digit of its `error`, without minus zero."""
    decimals = max(0, 1 - math.floor(math.log10(error)))
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def trend_figure(sizes: pd.DataFrame, growth: pd.DataFrame) -> Drawing:
    """Sizes over dates with 90 % intervals and the fitted line, one panel for each size."""
    sheet, above = Sheet(0.8 + 2.4 * len(growth), len(growth), 1), None
    sizes = sizes.assign(day=date2num(pd.to_datetime(sizes["date"]).to_numpy()))
    for place, line in enumerate(growth.to_dict("records")):
        factor, unit = _SHOWN_UNITS.get(line["unit"], (1.0, line["unit"]))
        own, date = sizes[sizes["label"] == line["label"]], Quantity("date", "d since 1970-01-01")
        above = panel = sheet.panel(
            (place, 0), format_name(line["label"]), date, Quantity("size", unit), below=above
        )
        panel.axes.set_xlabel("date")
        counts, stated = own[own["counts"]], own["value"].notna()
        others = own[stated & ~own["counts"]]
        series = {"size with 90 % interval": (counts, "settled", {})}
        series["not used for the line"] = (others, "limit", {"markerfacecolor": "white"})
        for words, (shown, colour, style) in series.items():
            if len(shown):
                low, high = (
                    factor * shown[end].fillna(shown["value"]) for end in ("low_90", "high_90")
                )
                panel.marks(
                    words, shown["day"], factor * shown["value"], colour, low, high, **style
                )
        known = own[~stated].dropna(subset=["smallest_detectable"])
        if len(known):
            smallest = factor * known["smallest_detectable"]
            panel.marks(
                "not found; detectable from this size", known["day"], smallest, "other", marker="v"
            )
        unknown = own.loc[~stated & own["smallest_detectable"].isna(), "day"]
        for order, day in enumerate(unknown):
            panel.vertical_line("not found; detectable size unknown", day, named=order == 0)
        if pd.notna(line["rate"]):
            span = np.array([counts["day"].min(), counts["day"].max()])
            ends = line["first_value"] + line["rate"] * (span - own["day"].min())
            panel.line("straight line", span, factor * ends, "before")
        locator = AutoDateLocator(minticks=3, maxticks=8)
        panel.axes.xaxis.set_major_locator(locator)
        panel.axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
        panel.axes.margins(x=0.05)
    sheet.legend()
    return sheet.drawing()


def _page(sizes: pd.DataFrame, growth: pd.DataFrame) -> Page:
    blocks = []
    for row in growth.to_dict("records"):
        known = pd.notna(row["error_scale"])
        scatter = (
            f" Scatter about the line: {row['error_scale']:.2g} times the stated errors."
            if known
            else ""
        )
        blocks.append(Paragraph(f"{growth_summary(row)}.{scatter}", strong=True))
        factor, unit = _SHOWN_UNITS.get(row["unit"], (1.0, row["unit"]))
        own = sizes[(sizes["label"] == row["label"]) & (sizes["parameter"] == row["parameter"])]
        names = (
            "date",
            "campaign",
            "value",
            "low_90",
            "high_90",
            "source",
            "smallest_detectable",
            "reason",
        )
        parameter = format_parameter(row["label"].partition(":")[0], row["parameter"])
        blocks.append(frame_block(TREND, own, names, f"By campaign: {parameter}.", (unit, factor)))
    meaning = (
        "Lines: weighted least squares over the days (`trend_growth.parquet`; sizes in SI:"
        " `trend.parquet`). Intervals and p follow Student's distribution, as the scatter is"
        " estimated from the residuals: three dates only show a growth much larger than the"
        f" scatter. Grew or shrank: p below {FALSE_ALARM_RATE:g}. A campaign that did not find the"
        " effect is not used for the line: the size there is below the smallest detectable one."
    )
    return Page(
        "Wear by date", (*blocks, FigureBlock("trend", "Sizes by date"), Paragraph(meaning))
    )
