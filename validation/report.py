"""Page and figures of the score of a set, and its MLflow run."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from jointgap.campaign.figures import list_rows
from jointgap.core import plot
from jointgap.core.page import (
    FigureBlock,
    Heading,
    Page,
    Paragraph,
    TableBlock,
    to_html,
    to_markdown,
    written_today,
)
from jointgap.core.plot import Quantity, Sheet
from jointgap.core.publish import Record
from validation.rig import RECIPE
from validation.score import confusion, rates

DESCRIPTION = "Blind trials: campaigns with hidden effects, analysed without the truth at hand"

# Required rates: relation and value
GOALS = {what: rate["goal"].split() for what, rate in RECIPE["rates"].items() if "goal" in rate}

BASES = {"ideal": "ideal joints", "loose": "loose joints", "chaotic": "never repeats"}
"""Columns of the tables in the documentation, by the joints and motion of a trial."""

_ROWS = {
    "right name, one detectable effect": "right name",
    "wrong name, one detectable effect": "wrong name",
    "right joint, clearance hidden": "right joint, a clearance hidden",
    "wrong name, clearance hidden": "wrong name, a clearance hidden",
    "size within 10 %, clearance named": "size within 10 %, a clearance named right",
    "nothing named, nothing hidden": "nothing found, nothing hidden",
    "both of two effects and no third": "both named and no third",
    "wrong name, two effects": "wrong name, two effects",
    "all of three effects and no other": "all three named and no other",
    "wrong name, three effects": "wrong name, three effects",
    "wrong name, effect not listed": "wrong name, effect off the list",
    "wrong name, data fault": "wrong name, data wired wrongly",
    "damaged channel reported": "told which channel, data wired wrongly",
    "right name, encoder on a coupling or eccentric disc": "right name, encoder fault",
    "right name, AC-coupled channel": "right name, AC-coupled channel",
    "nothing named, truncating counter": "nothing found, truncating counter",
    "unfinished": "unfinished",
    "size within its 90 % interval": "size within the 90 % interval",
    "nuisance within its 90 % interval": "nuisance within its 90 % interval",
    "map of the crank angle, F1": "map: F1 of the bins",
    "names, F1": "names: F1",
    "processor time, median [s]": "seconds, median",
    "processor time, 90 % of the trials [s]": "seconds, of 90 % at most",
}
_FRONT_ROWS = {
    "one effect": ("right name", "wrong name"),
    "a clearance": ("right joint, a clearance hidden", "wrong name, a clearance hidden"),
    "two effects, both identified": ("both named and no third", "wrong name, two effects"),
    "an effect that is not listed: not explained, or its force found": (
        "unexplained or the force found, effect off the list",
        "wrong name, effect off the list",
    ),
    "nothing": ("nothing found, nothing hidden", "wrong name, nothing hidden"),
}

_SHOWN = (
    "id kind base gap_caused numerics_gap detectable hidden verdict named outcome cause reason"
).split()

FILES = [f"{name}.{end}" for name in ("rates", "curves") for end in ("svg", "png")]
FILES += ["summary.html", "summary.md", "trials.csv", "rates.csv", "confusion.csv"]
"""Files of a score."""


def write_score(name: str, trials: pd.DataFrame, folder: Path) -> str:
    """Write trials.csv, rates.csv, the figure and the page to `folder`; the page as Markdown."""
    folder.mkdir(parents=True, exist_ok=True)
    table = rates(trials)
    trials.to_csv(folder / "trials.csv", index=False, float_format="%.6g")
    table.to_csv(folder / "rates.csv", index=False, float_format="%.6g")
    confusion(trials).to_csv(folder / "confusion.csv", index=False)
    with plot.matplotlib_style():
        plot.save(draw_rates(table), folder / "rates")
        plot.save(draw_curves(table), folder / "curves")
    numbers = [
        (row.what, row.group, str(row.count), f"{row.value:.3g}", f"{row.low:.3g} - {row.high:.3g}")
        for row in table.itertuples(name="Rate")
    ]
    abstained = (trials["kind"] == "off_list") & (trials["outcome"] == "unexplained")
    others = (
        trials.loc[(trials["outcome"] != "right") & ~abstained, _SHOWN]
        .sort_values(["outcome", "kind"])
        .round(2)
    )
    page = Page(
        f"Blind trials: {name}",
        (
            Paragraph(
                f"{len(trials)} campaigns, all in trials.csv. Shares have 95 % intervals of Clopper"
                " and Pearson, medians those of order statistics. confusion.csv counts hidden and"
                " named effects."
            ),
            FigureBlock("rates", "Shares of right and wrong verdicts"),
            FigureBlock("curves", "Right names over the size of the effect; coverage of intervals"),
            TableBlock(("what", "group", "of", "value", "95 %"), tuple(numbers), "llrrl"),
            Heading("Trials that are not right"),
            TableBlock(
                tuple(_SHOWN),
                tuple(others.astype(object).fillna("").astype(str).itertuples(index=False)),
            ),
        ),
        footer=written_today(),
    )
    (folder / "summary.html").write_text(to_html(page, folder), encoding="utf-8")
    text = to_markdown(page, ".")
    (folder / "summary.md").write_text(text, encoding="utf-8")
    return text


def rates_of(trials: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Rates of the trials with each base, by name of the rate."""
    tables = {}
    for base in BASES:
        table = rates(trials[trials["base"] == base])
        whole = table["group"].isin(["all", f"base {base}"])
        tables[base] = table[whole].drop_duplicates("what").set_index("what")
    return tables


def _cell(table: pd.DataFrame, what: str) -> str:
    """A rate in percent, or a time in seconds, with its interval and the number of trials."""
    factor = 1.0 if what.startswith("seconds") else 100.0
    if what not in table.index:
        return "–"
    row = table.loc[what]
    value, low, high = (f"{factor * row[name]:.0f}" for name in ("value", "low", "high"))
    return f"{value} ({low} - {high}) of {row['count']:.0f}"


def documented_rates(
    trials: pd.DataFrame, linkages: pd.DataFrame
) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of the table of rates [%]: of slider-cranks by joints, and of linkages."""
    of_linkages = rates(linkages).query("group == 'all'").set_index("what")
    tables = [*rates_of(trials).values(), of_linkages]
    rows = [[label, *(_cell(table, what) for table in tables)] for label, what in _ROWS.items()]
    heads = ["rate [%]", *BASES.values(), "linkages"]
    return heads, [row for row in rows if {*row[1:]} != {"–"}]


def outcomes(sets: Mapping[str, pd.DataFrame]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of the table of published sets: analysed trials, and how they ended."""
    counts = pd.DataFrame({name: trials["outcome"].value_counts() for name, trials in sets.items()})
    counts = counts.fillna(0).astype(int)
    rows = [
        [
            f"[{name}](trials_{name}.csv)",
            ", ".join(f"{code:.8s}" for code in trials["code"].unique()),
            str(len(trials)),
            *map(str, counts[name]),
        ]
        for name, trials in sets.items()
    ]
    return ["set", "commit", "trials", *counts.index], rows


def front_rates(trials: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of the table of the front page: right and wrong [%] by what is hidden."""
    tables, bases = rates_of(trials), ("ideal", "loose")
    heads = [f"{base}: {what}" for base in bases for what in ("right", "wrong")]
    rows = [
        [label, *(_cell(tables[base], what) for base in bases for what in pair)]
        for label, pair in _FRONT_ROWS.items()
    ]
    return ["hidden", *heads], rows


def draw_rates(table: pd.DataFrame) -> plot.Drawing:
    """Rates with their intervals and the required values."""
    shown = table[table["what"].isin(GOALS)].reset_index(drop=True)
    goals = shown["what"].map(lambda what: GOALS[what][1]).astype(float)
    lower = shown["what"].map(lambda what: GOALS[what][0] == ">=").astype(bool)
    reached_goal = (shown["value"] == goals) | ((shown["value"] > goals) == lower)
    names = shown["what"] + ": " + shown["group"] + " (" + shown["count"].astype(str) + ")"
    sheet = Sheet(1.2 + 0.22 * max(len(shown), 3), 1, 1)
    quantities = Quantity("share of the trials", "1"), Quantity("what, and of which trials", "")
    panel = sheet.panel((0, 0), "how often, with 95 % intervals", *quantities)
    for label, colour, rows in (
        ("goal reached", "after", reached_goal),
        ("goal missed", "before", ~reached_goal),
    ):
        part = shown[rows]
        if len(part):
            interval = part["low"], part["high"]
            panel.marks(label, part["value"], part.index, colour, *interval, names[rows], along="x")
    panel.marks("goal", goals, shown.index, "limit", labels=names, marker="|", markersize=9.0)
    list_rows(panel, names.tolist())
    panel.axes.set_xlim(-0.02, 1.02)
    panel.axes.set_ylabel("")
    sheet.legend()
    return sheet.drawing()


def draw_curves(table: pd.DataFrame) -> plot.Drawing:
    """Right and wrong names over the gap of the effect, and the coverage of intervals."""
    sheet = Sheet(3.2, 1, 2)
    share = Quantity("share of the trials", "1")
    gap = Quantity("gap of the effect", "1")
    power = sheet.panel((0, 0), "names by the size of the effect", gap, share)
    for label, colour in (("right", "after"), ("wrong", "before")):
        part = table[
            (table["what"] == f"{label} name") & table["group"].str.fullmatch(r"gap [\d.]+")
        ]
        gaps = part["group"].str.removeprefix("gap ").astype(float)
        power.marks(label, gaps, part["value"], colour, part["low"], part["high"])
    power.axes.set_ylim(-0.02, 1.02)
    power.axes.set_xlim(1.0, 1.1 * max(RECIPE["gaps"]))
    quantities = Quantity("nominal coverage", "1"), Quantity("share of the intervals", "1")
    panel = sheet.panel((0, 1), "intervals that contain the truth", *quantities)
    panel.line("nominal", [0.0, 1.0], [0.0, 1.0], "limit")
    of_all = table[table["group"] == "all"]
    for label, what, colour in (
        ("sizes", "size within", "after"),
        ("nuisances", "nuisance within its", "before"),
    ):
        part = of_all[of_all["what"].str.startswith(what) & of_all["what"].str.endswith("interval")]
        levels = part["what"].str.extract(r"(\d+) %")[0].astype(float) / 100
        panel.marks(label, levels, part["value"], colour, part["low"], part["high"], marker="s")
    sheet.legend()
    return sheet.drawing()


def mlflow_records(folder: Path) -> list[Record]:
    """The set as one MLflow run with every score."""
    table, trials = pd.read_csv(folder / "rates.csv"), pd.read_csv(folder / "trials.csv")
    # names in MLflow have no comma and no %, and are grouped by their part before a slash
    names = (table["what"] + ", " + table["group"]).replace(
        {": ": "/", ", ": "/", "%": "percent"}, regex=True
    )
    scores = table.set_index(names)["value"]
    costly = scores.index.str.startswith("seconds")
    files = {
        name: folder / name for name in ("summary.md", "trials.csv", "rates.csv", "confusion.csv")
    }
    files |= {f"figures/{name}": folder / name for name in FILES if name.endswith((".svg", ".png"))}
    counts = {
        f"trials/{kind}": float(count) for kind, count in trials["kind"].value_counts().items()
    }
    return [
        Record(
            "blind", metrics=counts | dict(scores[~costly]), costs=dict(scores[costly]), files=files
        )
    ]
