"""The figure of a trend: sizes over dates, with their intervals and the line through them."""

import math
from collections.abc import Mapping, Sequence
from datetime import date as Date
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from scipy.stats import norm

from jointgap.campaign import verdict_json as verdict_file
from jointgap.campaign.campaign_files import VERDICT, check_unchanged, config_snapshot
from jointgap.campaign.sentences import label_in_words, parameter_in_words, unit_of
from jointgap.campaign.state import FALSE_ALARM_RATE
from jointgap.config.campaign import Campaign
from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.core.files import write_text
from jointgap.core.page import FigureBlock, Page, Paragraph, TableBlock, to_markdown
from jointgap.core.plot import Drawing, Quantity, Sheet, matplotlib_style, save
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.schema import CONFIG_SNAPSHOT, DETECTABLE, TREND, TREND_GROWTH
from jointgap.core.words import in_words, joined, number, with_unit
from jointgap.effects import EFFECTS
from jointgap.identification.decide_verdict import NO_DISAGREEMENT
from jointgap.identification.fit import HALF_WIDTHS, LEVELS

SHOWN_UNITS = {"m": (1e6, "µm")}
"""Units in which sizes are shown, by SI unit, and how many of them that is."""

_DATE = Quantity("date", "d since 1970-01-01")


def trend_figure(sizes: pd.DataFrame, growth: pd.DataFrame) -> Drawing:
    """Sizes over dates, a panel for each: 90 % intervals, and the line where one was fitted."""
    sheet = Sheet(0.8 + 2.4 * len(growth), len(growth), 1)
    above = None
    days = date2num(pd.to_datetime(sizes["date"]).to_numpy())
    for place, line in enumerate(growth.to_dict("records")):
        factor, unit = SHOWN_UNITS.get(line["unit"], (1.0, line["unit"]))
        of_line = (sizes["label"] == line["label"]).to_numpy()
        own, when = sizes[of_line], days[of_line]
        panel = sheet.panel((place, 0), in_words(line["label"]), _DATE, Quantity("size", unit), below=above)
        panel.axes.set_xlabel("date")
        above = panel
        counts, stated = own["counts"].to_numpy(), own["value"].notna().to_numpy()
        for kept, series, colour, style in (
            (counts, "size with 90 % interval", "settled", {}),
            (stated & ~counts, "does not count in the line", "limit", {"markerfacecolor": "white"}),
        ):
            if kept.any():
                shown = factor * own.loc[kept, ["value", "low_90", "high_90"]].to_numpy(float)
                value, low, high = shown.T
                ends = [np.where(np.isnan(end), value, end) for end in (low, high)]
                panel.marks(series, when[kept], value, colour, *ends, **style)
        smallest = factor * own["smallest_detectable"].to_numpy(float)
        known, unknown = (~stated & (np.isnan(smallest) == lost) for lost in (False, True))
        if known.any():
            panel.marks("not found; would show from here on", when[known], smallest[known], "other", marker="v")
        for order, day in enumerate(when[unknown]):
            panel.vertical_line("not found; no size known", day, named=order == 0)
        if pd.notna(line["rate"]):
            span = np.array([when[counts].min(), when[counts].max()])
            ends = factor * (line["first_value"] + line["rate"] * (span - when.min()))
            panel.line("straight line", span, ends, "before")
        locator = AutoDateLocator(minticks=3, maxticks=8)
        panel.axes.xaxis.set_major_locator(locator)
        panel.axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
        panel.axes.margins(x=0.05)
    sheet.legend()
    return sheet.drawing()


FEWEST_DATES = 3
"""Different dates: two make a line whatever the errors are, and nothing tells whether these are right."""

PAGE, FIGURE = "trend.md", "trend"
"""Files in the folder of a trend, beside its tables."""

_SOMETHING_ELSE = ("unexplained", "ambiguous")  # is missing there that the base does not have
_CLEARANCE = "_clearance"  # ends the names of effects and nuisances that are clearances


class Dated(NamedTuple):
    """A campaign and what came of it."""

    campaign: Campaign
    verdict: dict[str, Any]
    smallest: dict[str, float]
    """Smallest detectable size [SI] by label."""


class Growth(NamedTuple):
    """A straight line through sizes over days: rate with its 90 % interval [SI/d], value on day 0 [SI], probability of
    as large a rate where nothing grows [1], and the factor on the stated errors [1].
    """

    rate: float
    low: float
    high: float
    first_value: float
    p: float
    error_scale: float


def fit_growth(days: np.ndarray, values: np.ndarray, errors: np.ndarray) -> Growth:
    """The straight line through sizes over days."""
    weights = errors**-2.0
    mean_day, mean = (np.average(each, weights=weights) for each in (days, values))
    moment = weights @ (days - mean_day) ** 2
    rate = weights @ ((days - mean_day) * (values - mean)) / moment
    residuals = values - mean - rate * (days - mean_day)
    scale = max(1.0, math.sqrt(weights @ residuals**2 / (len(days) - 2)))
    error = scale / math.sqrt(moment)
    half_width = HALF_WIDTHS[90] * error
    p = 2.0 * float(norm.sf(abs(rate) / error))
    return Growth(rate, rate - half_width, rate + half_width, mean - rate * mean_day, p, scale)


def trend(files: Sequence[Path], results: Path, folder: Path) -> str:
    """Write the tables, the figure and the page of a trend."""
    target = ResultsFolder(folder)
    drawn = (f"figures/{FIGURE}{suffix}" for suffix in (".svg", ".png", ".parquet"))
    target.check_writable(TREND.path, TREND_GROWTH.path, PAGE, *drawn)
    sizes = trend_frame(read_campaigns(files, results))
    growth = growth_frame(sizes)
    with matplotlib_style():
        drawing = trend_figure(sizes, growth)
    target.write(TREND, sizes)
    target.write(TREND_GROWTH, growth)
    save(drawing, folder / "figures" / FIGURE)
    write_text(folder / PAGE, to_markdown(_page(sizes, growth)))
    return "\n".join(map(growth_in_words, growth.to_dict("records"))) + f"\n{folder / PAGE}"


def read_campaigns(files: Sequence[Path], results: Path) -> list[Dated]:
    """Campaigns with their verdicts, by date; arguments and errors as in `trend`."""
    campaigns: list[Campaign] = []
    for file in files:
        campaign = load_campaign(file)
        if campaign.date is None:
            raise InputError(f"{file}: has no date; add the day of the measurement, such as 'date: 2026-03-01'")
        for other in campaigns:
            _check_apart(file, campaign, other)
        campaigns.append(campaign)
    return [_read(each, results) for each in sorted(campaigns, key=lambda each: (each.date, each.name))]


def _read(campaign: Campaign, results: Path) -> Dated:
    folder = ResultsFolder(results / campaign.name)
    verdict = verdict_file.read(folder.path / VERDICT)
    if verdict["campaign"] != campaign.name:
        raise InputError(
            f"{folder.path / VERDICT}: is of campaign '{verdict['campaign']}', not '{campaign.name}'; run `make "
            "campaign` on it again"
        )
    check_unchanged(campaign, folder.read(CONFIG_SNAPSHOT))
    return Dated(campaign, verdict, _smallest_detectable(folder))


def _check_apart(file: Path, campaign: Campaign, other: Campaign) -> None:
    """InputError where a campaign of the `file` is the `other` one again, or of another mechanism."""
    if campaign.name == other.name:
        raise InputError(f"{file}: campaign '{campaign.name}' is given twice; give each once, with a name of its own")
    own, others = ({(each.folder / run.file).resolve() for run in each.runs} for each in (campaign, other))
    if shared := sorted(own & others):
        raise InputError(
            f"{file}: reads {shared[0]}, as campaign '{other.name}' does; give each campaign the data of its own date"
        )
    mine, its = (_mechanism(each) for each in (campaign, other))
    different = next((key for key in {**its, **mine} if mine.get(key) != its.get(key)), None)
    if different is not None:
        raise InputError(
            f"{file}: {different} = {mine.get(different, 'absent')}, but {its.get(different, 'absent')} in campaign "
            f"'{other.name}' (SI); campaigns of a trend are of one mechanism, analyse them with the same file"
        )


def _mechanism(campaign: Campaign) -> dict[str, str]:
    snapshot = config_snapshot(campaign)
    own = snapshot[snapshot["key"].str.startswith("mechanism.")]
    return dict(zip(own["key"], own["value"], strict=True))


def _smallest_detectable(folder: ResultsFolder) -> dict[str, float]:
    if not folder.place(DETECTABLE).exists():  # a verdict can be kept without what led to it
        return {}
    effects = folder.read(DETECTABLE)
    return dict(zip(effects["label"], effects["smallest_detectable"], strict=True))


class _Size(NamedTuple):
    """A size that a campaign states, with its estimate as ``verdict.json`` has it."""

    parameter: str
    unit: str
    source: str
    estimate: Mapping[str, Any]


def _sizes(verdict: Mapping[str, Any]) -> dict[str, _Size]:
    """The sizes that a campaign states, by label: of what is named or certain, and clearances that were fitted."""
    stated = {
        key: _Size(key, "m", "nuisance", estimate)
        for key, estimate in verdict["nuisances"].items()
        if key.endswith(_CLEARANCE)
    }
    for source, effects in (("named", verdict["effects"]), ("certain", verdict.get("certain", ()))):
        for effect in effects:
            parameter, estimate = next(iter(effect["parameters"].items()), ("", {}))
            if isinstance(estimate.get("value"), int | float):  # a law that was found has a formula instead
                unit = unit_of(effect["name"], effect["site"], parameter)
                stated[_label(effect)] = _Size(parameter, unit, source, estimate)
    return stated


def _label(effect: Mapping[str, Any]) -> str:
    """The label of an effect of a verdict, as the preflight has it."""
    name, site = effect["name"], effect["site"]
    return name if name in EFFECTS and "site" not in EFFECTS[name].model_fields else f"{name}:{site}"


def trend_frame(campaigns: Sequence[Dated]) -> pd.DataFrame:
    """Table `TREND`: every size that can be followed, with a row for each campaign."""
    stated = [_sizes(each.verdict) for each in campaigns]
    labels = list(dict.fromkeys(label for each in stated for label in each))
    followed = [label for label in labels if label.endswith(_CLEARANCE) or sum(label in each for each in stated) > 1]
    if not followed:
        names = joined(each.campaign.name for each in campaigns)
        raise InputError(
            f"campaigns {names}: no clearance was found in any of them, and no other effect in two; there is no size "
            "to follow"
        )
    rows = []
    for label in followed:
        like = [each[label] for each in stated if label in each]
        # an effect states whole sizes under its own name, which the nuisance of a clearance has as its key
        known = next((size for size in like if size.source != "nuisance"), like[0])
        for each, own in zip(campaigns, stated, strict=True):
            rows.append(_row(label, known, own.get(label), each, campaigns[0].campaign.date))
    frame = pd.DataFrame(rows, columns=TREND.names)
    numbers = [name for name in TREND.names if name.startswith(("value", "low_", "high_", "smallest"))]
    return frame.astype(dict.fromkeys(numbers, float))  # None, of what has no interval, is no number


def _row(label: str, known: _Size, size: _Size | None, dated: Dated, first: Date) -> dict[str, Any]:
    estimate = size.estimate if size else {}
    ends = {level: estimate.get(f"interval_{level}") or (None, None) for level in LEVELS}
    reason = _why_it_does_not_count(label, size, dated.verdict)
    return {
        "label": label,
        "parameter": known.parameter,
        "unit": known.unit,
        "campaign": dated.campaign.name,
        "date": dated.campaign.date.isoformat(),
        "days": (dated.campaign.date - first).days,
        "source": size.source if size else "",
        "value": estimate.get("value"),
        **{f"{end}_{level}": ends[level][place] for level in LEVELS for place, end in enumerate(("low", "high"))},
        "counts": not reason,
        "reason": reason,
        "smallest_detectable": None if size else dated.smallest.get(label),
    }


def _why_it_does_not_count(label: str, size: _Size | None, verdict: Mapping[str, Any]) -> str:
    """Why a campaign's size of `label` does not count in the growth; empty where it does."""
    if size:
        if size.source == "nuisance" and verdict["verdict"] in _SOMETHING_ELSE:
            return "fitted without what else is missing"
        estimate = size.estimate
        low, high = estimate.get("interval_90") or (None, None)
        bounded = low is not None and high is not None and high > low
        return estimate.get("remark") or ("" if bounded else "has no 90 % interval")

    def holds(explanation: Sequence[Mapping[str, Any]]) -> bool:
        return label in map(_label, explanation)

    if any(map(holds, verdict["equivalent"])):
        return "not certain: one of several explanations that fit equally well"
    if holds((verdict["best_known"] or {}).get("effects", ())):
        return "not proven, though in the best explanation known"
    if label in verdict["preflight"]["undetectable"]:
        return "not found, and not detectable with its runs and channels"
    if verdict["verdict"] == NO_DISAGREEMENT:
        return "not found: the mechanism as it stands leaves noise alone"
    return f"not found; the verdict is {verdict['verdict']}"


def growth_frame(sizes: pd.DataFrame) -> pd.DataFrame:
    """Table `TREND_GROWTH` of the sizes in table `TREND`."""
    rows = []
    for (label, parameter, unit), own in sizes.groupby(["label", "parameter", "unit"], sort=False):
        counted = own[own["counts"]]
        row = {"label": label, "parameter": parameter, "unit": unit, "dates": counted["days"].nunique()}
        if row["dates"] < FEWEST_DATES:
            rows.append(row | {"growth": "too few dates"})
            continue
        errors = (counted["high_90"] - counted["low_90"]) / (2.0 * HALF_WIDTHS[90])
        found = fit_growth(*(each.to_numpy(dtype=float) for each in (counted["days"], counted["value"], errors)))
        growth = "no growth" if found.p > FALSE_ALARM_RATE else "grew" if found.rate > 0 else "shrank"
        interval = {"rate_low": found.low, "rate_high": found.high}
        rest = {key: value for key, value in found._asdict().items() if key not in ("low", "high")}
        rows.append(row | {"growth": growth} | interval | rest)
    return pd.DataFrame(rows, columns=TREND_GROWTH.names)


def growth_in_words(growth: Mapping[str, Any]) -> str:
    """A row of table `TREND_GROWTH` in a sentence."""
    what = label_in_words(growth["label"])
    if growth["growth"] == "too few dates":
        return f"{what}: too few dates, {growth['dates']} of the {FEWEST_DATES} at least that a growth needs"
    factor, unit = SHOWN_UNITS.get(growth["unit"], (1.0, growth["unit"]))
    sign = -1.0 if growth["growth"] == "shrank" else 1.0
    rates = sorted(sign * factor * growth[key] for key in ("rate_low", "rate", "rate_high"))
    low, rate, high = (_rounded(each, rates[2] - rates[1]) for each in rates)
    verdict = "no growth that these data show," if growth["growth"] == "no growth" else f"{growth['growth']} by"
    told = with_unit(rate, unit)
    p = "below 1e-10" if growth["p"] < 1e-10 else f"= {growth['p']:.2g}"
    return f"{what}: {verdict} {told} per day (90 % interval {low} to {high}; p {p})"


def _rounded(value: float, error: float) -> str:
    """A `value` to the second digit of its `error`, with no minus zero."""
    decimals = max(0, 1 - math.floor(math.log10(error)))
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def _page(sizes: pd.DataFrame, growth: pd.DataFrame) -> Page:
    blocks = []
    for row in growth.to_dict("records"):
        blocks += [Paragraph(f"{growth_in_words(row)}.", strong=True), *_widened(row)]
        factor, unit = SHOWN_UNITS.get(row["unit"], (1.0, row["unit"]))
        own = sizes[(sizes["label"] == row["label"]) & (sizes["parameter"] == row["parameter"])]
        size = f"{parameter_in_words(row['label'].partition(':')[0], row['parameter'])} [{unit}]"
        intervals = (f"{level} % interval" for level in LEVELS)
        heads = ("date", "campaign", size, *intervals, "from", "smallest that shows", "why it does not count")
        lines = tuple(_line(line, factor) for line in own.to_dict("records"))
        blocks.append(TableBlock(heads, lines, "llrrrrlrl"))
    meaning = (
        "Straight lines by weighted least squares over the days; `trend_growth.parquet` has them, `trend.parquet` the "
        f"sizes in SI. Grew or shrank: p below {FALSE_ALARM_RATE:g}. A campaign that found nothing does not count; its "
        "size may be anything below the smallest that shows there."
    )
    return Page("Wear by date", (*blocks, FigureBlock(FIGURE, "Sizes by date"), Paragraph(meaning)))


def _widened(growth: Mapping[str, Any]) -> list[Paragraph]:
    if not growth["error_scale"] > 1.0:
        return []
    return [
        Paragraph(
            f"The sizes scatter about the line more than their intervals say; errors were widened by the factor "
            f"{growth['error_scale']:.2g}."
        )
    ]


def _line(row: Mapping[str, Any], factor: float) -> tuple[str, ...]:
    error = factor * (row["high_90"] - row["low_90"]) / 2.0

    def shown(key: str) -> str:
        if pd.isna(row[key]):
            return "–"
        return _rounded(factor * row[key], error) if error > 0.0 else number(factor * row[key])

    intervals = (f"{shown(f'low_{level}')} to {shown(f'high_{level}')}" for level in LEVELS)
    ends = [text if text != "– to –" else "–" for text in intervals]
    smallest = shown("smallest_detectable")
    return row["date"], row["campaign"], shown("value"), *ends, row["source"] or "–", smallest, row["reason"] or "–"
