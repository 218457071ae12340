"""The score of a set of trials: rates with intervals, the page and its figure, and the run for MLflow."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import binom, binomtest

from jointgap.campaign.figures import list_rows
from jointgap.core import plot
from jointgap.core.page import FigureBlock, Heading, Page, Paragraph, TableBlock, to_html, to_markdown, written_today
from jointgap.core.plot import Quantity, Sheet
from jointgap.core.publish import Record
from jointgap.identification.fit import LEVELS
from validation.calibrate import GAP_TOLERANCE
from validation.plan import CLEARANCES
from validation.rig import BASES
from validation.score import BASELINES

CONFIDENCE = 0.95
"""Of the intervals of shares and medians."""

DESCRIPTION = "Blind trials: campaigns with hidden effects, analysed without the truth at hand"
"""Of the set's experiment in MLflow."""

CLOSE_SIZE = 0.1
"""Relative error up to which the size of a clearance that is named right is close."""

GOALS = {
    "right name": (0.95, "at least"),
    "right joint, a clearance hidden": (0.85, "at least"),
    "wrong name": (0.01, "at most"),
    "wrong name, effect off the list": (0.05, "at most"),
    "nothing found, nothing hidden": (0.99, "at least"),
    "both named and no third": (0.85, "at least"),
    "wrong name, data wired wrongly": (0.01, "at most"),
    "told which channel, data wired wrongly": (0.80, "at least"),
}
"""Rates that the trials are to reach, and from which side."""


def rates(trials: pd.DataFrame) -> pd.DataFrame:
    """The rates and medians of a set, one a row: what, group, count, value, low, high.

    Shares have Clopper and Pearson's interval; medians have the one that order statistics give.
    """
    kind = trials["kind"]
    is_one = kind.isin(["single", "exudyn", "clearance"]) & (trials["hidden"] != "nothing")
    one, is_listed = trials[is_one & trials["detectable"]], kind != "clearance"
    single, clearances = one[one["kind"] != "clearance"], one[one["hidden"].isin(CLEARANCES)]
    all_clearances = trials[is_one & trials["hidden"].isin(CLEARANCES)]
    nothing, wiring = trials[(trials["hidden"] == "nothing") & (kind != "wiring")], trials[kind == "wiring"]
    pairs, off_list = trials[(kind == "pair") & trials["detectable"]], trials[kind == "off_list"]
    hidden = trials[(is_one & is_listed) | (kind == "pair")]
    right_clearances = clearances[clearances["outcome"] == "right"]
    foreseen = single.assign(outcome=np.where(single["verdict"] == "ambiguous", single["outcome"], ""))
    rows = [
        *_outcomes("right name", single, ("right",), _groups(single)),
        *_outcomes("right, of which ambiguous as foreseen", foreseen, ("right",)),
        *_outcomes(
            "right, small effects too that preflight does not exclude",
            trials[is_one & is_listed & ~trials["foreseen"]],
            ("right",),
        ),
        *_outcomes("wrong name", single, ("wrong",), _groups(single)),
        *_outcomes("wrong name, effect undetectable", hidden[~hidden["detectable"]], ("wrong",)),
        *_outcomes("right joint, a clearance hidden", clearances, ("right",), _groups(clearances)),
        *_outcomes("wrong name, a clearance hidden", clearances, ("wrong",), _groups(clearances)),
        _share("size within 10 %, a clearance named right", right_clearances["error"] <= CLOSE_SIZE),
        *_outcomes("ambiguous", single, ("ambiguous",), _groups(single)),
        *_outcomes("unexplained", single, ("unexplained",), _groups(single)),
        *_outcomes("missed", single, ("missed",), _groups(single)),
        *_outcomes("wrong name, effect off the list", off_list, ("wrong",)),
        *_outcomes("unexplained or the force found, effect off the list", off_list, ("unexplained", "right")),
        *_outcomes("ambiguous or missed, effect off the list", off_list, ("ambiguous", "missed")),
        *_outcomes("nothing found, nothing hidden", nothing, ("right",), _groups(nothing)),
        *_outcomes("both named and no third", pairs, ("right",)),
        *_outcomes("wrong name, two effects", pairs, ("wrong",)),
        _share("undetectable", ~hidden["detectable"]),
        _share("undetectable, as preflight says", hidden["foreseen"]),
        _share("undetectable, within a stated range or overwritten", hidden["idle"]),
        _share("undetectable, a clearance hidden", ~all_clearances["detectable"]),
        *_outcomes("wrong name, data wired wrongly", wiring, ("wrong",), _groups(wiring)),
        *(
            _share("told which channel, data wired wrongly", wiring.loc[mask, "told"], name)
            for name, mask in _groups(wiring).items()
        ),
        *_outcomes("failed", trials, ("failed",)),
        _quantile("error of the size, median", single["error"], "all", 0.5),
        *(_share(f"size within the {level} % interval", single[f"covered_{level}"].dropna()) for level in LEVELS),
        *(_nuisances(trials, level, base) for level in LEVELS for base in ("", *BASES)),
        _quantile("share of the excess closed, median", single["closed"], "all", 0.5),
        _quantile("gap after, median", single.loc[single["outcome"] == "right", "gap_after"], "all", 0.5),
        *(
            _quantile(what, trials.loc[trials["base"] == base, "seconds"], f"base {base}", share)
            for what, share in (("seconds, median", 0.5), ("seconds, of 90 % at most", 0.9))
            for base in BASES
        ),
    ]
    for baseline, words in BASELINES.items():
        for what, group, wanted in (
            ("right name", single, "right"),
            ("wrong name", single, "wrong"),
            ("false alarm", nothing, "wrong"),
            ("wrong name, effect off the list", off_list, "wrong"),
        ):
            asked = group.loc[group[baseline] != "not asked", baseline]
            rows.append(_share(f"{words}: {what}", asked == wanted))
    return pd.DataFrame([row for row in rows if row["count"]])


def _groups(trials: pd.DataFrame) -> dict[str, pd.Series]:
    """All, by base, by drive, by gap, those from Exudyn, and by what was damaged: masks by name."""
    is_exudyn, is_wired = trials["kind"] == "exudyn", trials["kind"] == "wiring"
    loose = (trials["base"] == "loose") | trials["hidden"].isin(CLEARANCES)
    larger = trials["gap_caused"] > (1 + 2 * GAP_TOLERANCE) * trials["size"]
    groups = {"all": trials["kind"].notna(), **{f"base {base}": trials["base"] == base for base in BASES}}
    if (trials["drive"] != "constant_speed").any():
        groups |= {f"drive {drive}": trials["drive"] == drive for drive in ("constant_speed", "measured_angle")}
    for size in sorted(set(trials["size"]) - {0.0}):
        groups[f"gap {size:g}"] = (trials["size"] == size) & ~larger
    groups["gap larger than asked for"] = larger & (trials["size"] > 0)
    groups |= {"from Exudyn, joints ideal": is_exudyn & ~loose, "from Exudyn, joints loose": is_exudyn & loose}
    damage = trials["hidden"].str.partition(":")[0].where(is_wired) if len(trials) else trials["hidden"]
    return groups | {name: damage == name for name in sorted(set(damage.dropna()))}


def _outcomes(what: str, trials: pd.DataFrame, wanted: tuple, groups: dict | None = None) -> list[dict]:
    """The share of some outcomes in each of some groups."""
    hit = trials["outcome"].isin(wanted)
    return [_share(what, hit[mask], name) for name, mask in (groups or {"all": trials["kind"].notna()}).items()]


def _share(what: str, hits: pd.Series, group: str = "all") -> dict:
    """The share of `hits`, of which a trial may count a half."""
    return _share_of_counts(what, group, round(float(hits.sum())), len(hits))


def _share_of_counts(what: str, group: str, hits: int, count: int) -> dict:
    """Clopper and Pearson's interval: Biometrika 26 (1934) 404-413."""
    value, low, high = math.nan, math.nan, math.nan
    if count:
        value, (low, high) = hits / count, map(float, binomtest(hits, count).proportion_ci(CONFIDENCE, "exact"))
    return {"what": what, "group": group, "count": count, "value": value, "low": low, "high": high}


def _nuisances(trials: pd.DataFrame, level: int, base: str) -> dict:
    own = trials[trials["base"] == base] if base else trials
    counts = (int(own[column].sum()) for column in (f"nuisances_covered_{level}", "nuisances"))
    return _share_of_counts(f"nuisance within its {level} % interval", f"base {base}" if base else "all", *counts)


def _quantile(what: str, values: pd.Series, group: str, share: float) -> dict:
    """The value below which a share of all lies, with the interval between two of the sorted values, by the binomial
    distribution of how many lie below.
    """
    ordered = np.sort(values.dropna().to_numpy(float))
    row = {"what": what, "group": group, "count": ordered.size, **dict.fromkeys(("value", "low", "high"), math.nan)}
    if not ordered.size:
        return row
    tail = (1 - CONFIDENCE) / 2
    low = max(int(binom.ppf(tail, ordered.size, share)) - 1, 0)
    high = min(int(binom.isf(tail, ordered.size, share)), ordered.size - 1)
    value = float(np.quantile(ordered, share))
    return row | {"value": value, "low": float(ordered[low]), "high": float(ordered[high])}


def write_score(name: str, trials: pd.DataFrame, folder: Path) -> str:
    """Write trials.csv, rates.csv, the figure and the page to `folder`; the page as Markdown."""
    folder.mkdir(parents=True, exist_ok=True)
    table = rates(trials)
    trials.to_csv(folder / "trials.csv", index=False, float_format="%.6g")
    table.to_csv(folder / "rates.csv", index=False, float_format="%.6g")
    with plot.matplotlib_style():
        plot.save(draw_rates(table), folder / "rates")
    summary = page(name, trials, table)
    (folder / "summary.html").write_text(to_html(summary, folder), encoding="utf-8")
    text = to_markdown(summary, ".")
    (folder / "summary.md").write_text(text, encoding="utf-8")
    return text


def page(name: str, trials: pd.DataFrame, table: pd.DataFrame) -> Page:
    """The rates on one page, and the trials that are not right."""
    rows = tuple(
        (row.what, row.group, str(row.count), f"{row.value:.3g}", f"{row.low:.3g} - {row.high:.3g}")
        for row in table.itertuples(name="Rate")
    )
    columns = "id kind base gap_caused numerics_gap detectable hidden verdict named outcome reason".split()
    abstained = (trials["kind"] == "off_list") & (trials["outcome"] == "unexplained")
    others = trials.loc[(trials["outcome"] != "right") & ~abstained, columns].round(2)
    return Page(
        f"Blind trials: {name}",
        (
            Paragraph(
                f"{len(trials)} campaigns, all in trials.csv. Shares have 95 % intervals of Clopper and Pearson, "
                "medians those of order statistics."
            ),
            FigureBlock("rates", "Shares of right and wrong verdicts"),
            TableBlock(("what", "group", "of", "value", "95 %"), rows, "llrrl"),
            Heading("Trials that are not right"),
            TableBlock(
                tuple(columns), tuple(map(tuple, others.sort_values(["outcome", "kind"]).map(_cell).to_numpy()))
            ),
        ),
        footer=written_today(),
    )


def _cell(value: object) -> str:
    return "" if pd.isna(value) else str(value)


def draw_rates(table: pd.DataFrame) -> plot.Drawing:
    """Rates with their intervals beside what is asked for."""
    shown = table[table["what"].isin(GOALS)].reset_index(drop=True)
    goals = shown["what"].map(lambda what: GOALS[what][0]).to_numpy(float)
    least = shown["what"].map(lambda what: GOALS[what][1] == "at least").to_numpy(bool)
    met = np.where(least, shown["value"] >= goals, shown["value"] <= goals)
    names = (shown["what"] + ": " + shown["group"] + " (" + shown["count"].astype(str) + ")").tolist()
    sheet = Sheet(1.2 + 0.22 * max(len(shown), 3), 1, 1)
    quantities = Quantity("share of the trials", "1"), Quantity("what, and of which trials", "")
    panel = sheet.panel((0, 0), "how often, with 95 % intervals", *quantities)
    places = np.arange(len(shown))
    for words, colour, own in (("as asked for", "after", met), ("not as asked for", "before", ~met)):
        if own.any():
            part, labels = shown[own], [name for name, taken in zip(names, own, strict=True) if taken]
            panel.marks(words, part["value"], places[own], colour, part["low"], part["high"], labels, along="x")
    panel.marks("asked for", goals, places, "limit", labels=names, marker="|", markersize=9.0)
    list_rows(panel, names)
    panel.axes.set_xlim(-0.02, 1.02)
    panel.axes.set_ylabel("")
    sheet.legend()
    return sheet.drawing()


def mlflow_records(folder: Path) -> list[Record]:
    """The set as one run of MLflow with every score, so that sets can be compared."""
    table, trials = pd.read_csv(folder / "rates.csv"), pd.read_csv(folder / "trials.csv")
    # MLflow takes no comma and no % in a name, and groups by what stands before a slash
    names = (table["what"] + ", " + table["group"]).replace({": ": "/", ", ": "/", "%": "percent"}, regex=True)
    scores, costly = dict(zip(names, table["value"], strict=True)), names.str.startswith("seconds")
    files = {name: folder / name for name in ("summary.md", "trials.csv", "rates.csv")}
    return [
        Record(
            "blind",
            metrics={f"trials/{kind}": float(count) for kind, count in trials["kind"].value_counts().items()}
            | {name: scores[name] for name in names[~costly]},
            costs={name: scores[name] for name in names[costly]},
            files=files | {f"figures/{name}": folder / name for name in ("rates.svg", "rates.png")},
        )
    ]
