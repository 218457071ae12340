"""Stage show: the figures and the page of a campaign, from its verdict and tables."""

from collections.abc import Iterable

import pandas as pd

from jointgap.campaign import sentences, verdict_json
from jointgap.campaign.campaign_files import (
    MECHANISM,
    SUMMARIES,
    VERDICT,
    failures,
    recorded_failure,
)
from jointgap.campaign.figures import FIGURES
from jointgap.campaign.page import page
from jointgap.campaign.tables import BETWEEN_TEXTS
from jointgap.config.campaign import Campaign
from jointgap.core import schema
from jointgap.core.files import write_text
from jointgap.core.page import Page, Paragraph, to_html, to_markdown
from jointgap.core.results_folder import ResultsFolder

_SHOWN = ("campaign_optimum", "look")  # tables of the page, besides those of the figures


def show(folder: ResultsFolder, campaign: Campaign) -> None:
    """Draw the figures and write the page; errors of single figures are recorded."""
    verdict, drawn = verdict_json.read(folder.path / VERDICT), []
    tables = figure_tables(folder, (*FIGURES.needed_tables(FIGURES), *_SHOWN))
    for name in FIGURES:
        path = folder.path / f"figures/{name}.png"
        path.unlink(missing_ok=True)
        with recorded_failure(folder, name):
            drawing = FIGURES.draw(name, tables, verdict)
            if len(drawing.data):  # else a message that there is nothing to show
                drawing.save(path)
                drawn.append(name)
    verdict["failed"] = failures(folder)
    title = f"{sentences.subject(verdict)}: {sentences.answer(verdict)}"
    summary = Page(title, (Paragraph(f"Details: {VERDICT}"),))
    with recorded_failure(folder, "page"):
        mechanism = MECHANISM if (folder.path / MECHANISM).is_file() else ""
        summary = page(verdict, tables, drawn, _remarks(folder), campaign, mechanism)
    markdown, html = (folder.path / name for name in SUMMARIES)
    write_text(markdown, to_markdown(summary))
    write_text(html, to_html(summary, folder.path / "figures"))


def _remarks(folder: ResultsFolder) -> tuple[str, ...]:
    """Remarks on the data and on their noise."""
    noise = [
        f"Run {row.run}: {remark}."
        for row in folder.read(schema.NOISE).itertuples()
        for remark in filter(None, row.remarks.split(BETWEEN_TEXTS))
    ]
    return (*folder.read(schema.REMARKS)["remark"], *noise)


def figure_tables(folder: ResultsFolder, names: Iterable[str]) -> dict[str, pd.DataFrame]:
    """The tables `names` by name, as far as the `folder` of a campaign contains them."""
    return {name: folder.read(name) for name in names if folder.place(name).is_file()}
