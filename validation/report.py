"""The page and the figure of a set's score, and the run for MLflow."""

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

# Of the set's experiment in MLflow
DESCRIPTION = "Blind trials: campaigns with hidden effects, analysed without the truth at hand"

# Rates that the trials are to reach, and from which side
GOALS = {what: rate["goal"].split() for what, rate in RECIPE["rates"].items() if "goal" in rate}

_SHOWN = (
    "id kind base gap_caused numerics_gap detectable hidden verdict named outcome cause reason"
).split()

FILES = [f"{name}.{end}" for name in ("rates", "curves") for end in ("svg", "png")]
FILES += ["summary.html", "summary.md", "trials.csv", "rates.csv", "confusion.csv"]
"""What a score is written to."""


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
                " and Pearson, medians those of order statistics. confusion.csv counts what was"
                " named where what was hidden."
            ),
            FigureBlock("rates", "Shares of right and wrong verdicts"),
            FigureBlock(
                "curves",
                "Right names over the size of the effect, and how often intervals hold the truth",
            ),
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


def draw_rates(table: pd.DataFrame) -> plot.Drawing:
    """Rates with their intervals beside what is asked for."""
    shown = table[table["what"].isin(GOALS)].reset_index(drop=True)
    goals = shown["what"].map(lambda what: float(GOALS[what][1]))
    least = shown["what"].map(lambda what: GOALS[what][0] == ">=")
    met = (shown["value"] == goals) | ((shown["value"] > goals) == least)
    names = shown["what"] + ": " + shown["group"] + " (" + shown["count"].astype(str) + ")"
    sheet = Sheet(1.2 + 0.22 * max(len(shown), 3), 1, 1)
    quantities = Quantity("share of the trials", "1"), Quantity("what, and of which trials", "")
    panel = sheet.panel((0, 0), "how often, with 95 % intervals", *quantities)
    for words, colour, own in (
        ("as asked for", "after", met),
        ("not as asked for", "before", ~met),
    ):
        part = shown[own]
        if len(part):
            panel.marks(
                words,
                part["value"],
                part.index,
                colour,
                part["low"],
                part["high"],
                names[own],
                along="x",
            )
    panel.marks("asked for", goals, shown.index, "limit", labels=names, marker="|", markersize=9.0)
    list_rows(panel, names.tolist())
    panel.axes.set_xlim(-0.02, 1.02)
    panel.axes.set_ylabel("")
    sheet.legend()
    return sheet.drawing()


def draw_curves(table: pd.DataFrame) -> plot.Drawing:
    """Right and wrong names over the gap that the effect causes, and the share of intervals that
    hold the truth over the probability that they state."""
    sheet = Sheet(3.2, 1, 2)
    share = Quantity("share of the trials", "1")
    power = sheet.panel(
        (0, 0),
        "names by the size of the effect",
        Quantity("gap that the effect causes", "1"),
        share,
    )
    for words, what, colour in (
        ("right", "right name", "after"),
        ("wrong", "wrong name", "before"),
    ):
        part = table[(table["what"] == what) & table["group"].str.fullmatch(r"gap [\d.]+")]
        gaps = part["group"].str.removeprefix("gap ").astype(float)
        power.marks(words, gaps, part["value"], colour, part["low"], part["high"])
    power.axes.set_ylim(-0.02, 1.02)
    power.axes.set_xlim(1.0, 1.1 * max(RECIPE["gaps"]))
    stated = Quantity("probability stated", "1")
    panel = sheet.panel(
        (0, 1), "intervals that hold the truth", stated, Quantity("share of the intervals", "1")
    )
    panel.line("as stated", [0.0, 1.0], [0.0, 1.0], "limit")
    for words, what, colour in (
        ("sizes", "size within", "after"),
        ("nuisances", "nuisance within its", "before"),
    ):
        of_all = table[table["group"] == "all"]
        part = of_all[of_all["what"].str.startswith(what) & of_all["what"].str.endswith("interval")]
        levels = part["what"].str.extract(r"(\d+) %")[0].astype(float) / 100
        panel.marks(words, levels, part["value"], colour, part["low"], part["high"], marker="s")
    sheet.legend()
    return sheet.drawing()


def mlflow_records(folder: Path) -> list[Record]:
    """The set as one run of MLflow with every score, so that sets can be compared."""
    table, trials = pd.read_csv(folder / "rates.csv"), pd.read_csv(folder / "trials.csv")
    # MLflow takes no comma and no % in a name, and groups by what stands before a slash
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
