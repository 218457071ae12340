"""The report over scenarios and campaigns, and what came out at the end of a run."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.campaign import page as verdict_page
from jointgap.campaign import sentences as say
from jointgap.campaign import verdict_json
from jointgap.campaign.campaign_files import SUMMARIES, VERDICT
from jointgap.campaign.figures import FIGURES as CAMPAIGN_FIGURES
from jointgap.core import page as pages
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.files import write_text
from jointgap.core.page import Block, Bullets, FigureBlock, Heading, Link, Page, Paragraph, TableBlock
from jointgap.core.plot import FigureSpec
from jointgap.core.words import fall_in_percent
from jointgap.scenario import overview
from jointgap.scenario.figures import FIGURES
from jointgap.scenario.results import ScenarioResults

MOST_BYTES = 6_000_000
"""Of the images that a report takes in: as text in the page they have a third more, and the page stays below 10 MB."""

_KEY_FIGURES = ("resimulation", "valley", "figure_12", "contact_forces")
_KEY_FIGURES_OF_CAMPAIGNS = ("measured_against_model", "disagreement", "ranking")
"""Figures that stand in a report of so many scenarios that all would be too large for a page; the others are linked."""


@dataclass(frozen=True)
class _Part:
    """A scenario or a campaign as the report shows it."""

    name: str
    heading: str
    result: str  # In a line; empty where nothing was optimised
    texts: tuple[str, ...]
    links: tuple[Link, ...]
    place: str  # Folder of its figures, relative to the page
    specs: Mapping[str, FigureSpec]  # Of the figures that were drawn
    key_figures: Collection[str]

    def figure(self, key: str, spec: FigureSpec, several: bool) -> FigureBlock:
        """A figure; its title has the part's name where there are several parts."""
        title = f"{spec.title}: {self.name}" if several else spec.title
        return FigureBlock(f"{self.place}{key}", title, spec.caption, spec.moving)

    def blocks(self, whole: bool, several: bool, shown: str) -> Iterator[Block]:
        """All of it but the figure `shown` before: figures by category or, unless the report is `whole`, key figures
        and links to the others.
        """
        yield Heading(self.heading)
        yield from (Paragraph(text, strong=text == f"{self.result}.") for text in self.texts)
        if self.links:
            yield Bullets(self.links)
        specs = {key: spec for key, spec in self.specs.items() if f"{self.place}{key}" != shown}
        if not whole:
            yield from (self.figure(key, specs[key], several) for key in self.key_figures if key in specs)
            others = (key for key in self.specs if key not in self.key_figures)
            yield Bullets(tuple(Link(self.specs[key].title, f"{self.place}{key}.png") for key in others))
            return
        for category in dict.fromkeys(spec.category for spec in specs.values()):
            yield Heading(f"{category} ({self.name})" if several else category, 3)
            yield from (self.figure(key, spec, several) for key, spec in specs.items() if spec.category == category)


def write_report(scenarios: Mapping[str, ScenarioResults], campaigns: Sequence[str], folder: Path, file: Path) -> None:
    """Put the results of a run on one page in one file, with its figures."""
    write_text(file, pages.to_html(page(scenarios, campaigns, folder), folder))


def page(scenarios: Mapping[str, ScenarioResults], campaigns: Sequence[str], folder: Path) -> Page:
    """The results of a run."""
    learned = {name: own for name, own in scenarios.items() if own.scenario.mechanism.applied().loose}
    summaries = {name: _summary(own) for name, own in learned.items()}
    parts = [_scenario(own, summaries.get(name)) for name, own in scenarios.items()]
    parts += [_campaign(folder, name) for name in campaigns]
    several = len(parts) > 1
    pictures = (path for part in parts for path in (folder / part.place).glob("*.png"))
    whole = sum(path.stat().st_size for path in pictures) <= MOST_BYTES
    blocks: list[Block] = []
    if parts:
        key, specs = ("animation", FIGURES) if scenarios else ("measured_against_model", CAMPAIGN_FIGURES)
        blocks.append(parts[0].figure(key, specs[key], several))
    first = blocks[0].stem if blocks else ""
    if several:
        results = ((part, part.result or "all joints are ideal: simulated") for part in parts)
        blocks.append(
            Bullets(tuple(Link(part.name, f"#{pages.place_of(part.heading)}", f": {said}") for part, said in results))
        )
    compared = {name: own for name, own in learned.items() if own.scenario.paper}
    if len(compared) > 1:
        read = {name: (own.read_all(overview.NEEDED), own.scenario) for name, own in compared.items()}
        blocks += [Heading(overview.TITLE), *overview.side_by_side(overview.overview(read))]
    blocks += [block for part in parts for block in part.blocks(whole, several, first)]
    if not whole:
        linked = {key: spec for part in parts for key, spec in part.specs.items() if key not in part.key_figures}
        rows = tuple((spec.title, spec.caption) for spec in linked.values())
        blocks += [Heading("Contents of the linked figures"), TableBlock(("figure", "content"), rows)]
    footer = f"{pages.written_today()} Runs and their files: `jointgap dashboard`. Stages: docs/workflow.md."
    return Page(_headline(summaries, parts), tuple(blocks), subject="Results of this run", footer=footer)


def _summary(own: ScenarioResults) -> Mapping[str, Any]:
    """Content of ``summary.json``."""
    path = own.path / "summary.json"
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is no summary of a scenario ({error}); run `jointgap summarise` first") from error


def _headline(summaries: Mapping[str, Any], parts: Sequence[_Part]) -> str:
    if len(summaries) > 1:
        falls = fall_in_percent(known["reduction_percent"]["median"] for known in summaries.values())
        error = f"the RMS error of the transmission angle {falls} at the lengths found, simulated again"
        return f"In {len(summaries)} scenarios {error}"
    if summaries:
        return next(iter(summaries.values()))["headline"]
    results = {part.name: part.result for part in parts if part.result}
    told = [result if len(results) == 1 else f"{name}: {result}" for name, result in results.items()]
    return "; ".join(told) or "The motion of the mechanism, simulated"


def _scenario(own: ScenarioResults, summary: Mapping[str, Any] | None) -> _Part:
    name, result = own.path.name, summary["headline"] if summary else ""
    pages = {
        "summary.html": "lengths, gain and side effects",
        "figures/impacts.html": "zoom into the impacts",
        "comparison.html": "the paper's numbers and claims compared",
    }
    links = tuple(Link(words, f"{name}/{path}") for path, words in pages.items() if (own.path / path).is_file())
    specs = {key: FIGURES[key] for key in FIGURES.still if (own.path / f"figures/{key}.png").is_file()}
    texts = tuple(filter(None, (own.scenario.description, f"{result}." if result else "")))
    return _Part(name, f"Scenario {name}", result, texts, links, f"{name}/figures/", specs, _KEY_FIGURES)


def _campaign(folder: Path, name: str) -> _Part:
    place = f"campaigns/{name}/"
    content = verdict_json.read(folder / place / VERDICT)
    result = verdict_page.title(content)
    specs = {key: spec for key, spec in CAMPAIGN_FIGURES.items() if _shows(folder / place / f"figures/{key}.png")}
    links = (Link("numbers, parameters and next steps", f"{place}{SUMMARIES[1]}"),)
    texts = (f"{result}.", say.answer(content))
    return _Part(name, f"Campaign {name}", result, texts, links, f"{place}figures/", specs, _KEY_FIGURES_OF_CAMPAIGNS)


def _shows(picture: Path) -> bool:
    """Whether a figure was drawn, and not a sheet that says why there is nothing to draw: that has no plotted data."""
    plotted = picture.with_suffix(".parquet")
    return picture.is_file() and (not plotted.is_file() or parquet.read_footer(plotted).num_rows > 0)


SUMMARY, SUMMARY_PAGE = "summary.json", "summary.html"
"""Files of a scenario: what came out for programs, and for people."""

_MOST_PAGES = 3  # that are named one by one

_HEADS = ("scenario", "crank [mm]", "rod [mm]", "error [deg]", "change [%]")
_LEGEND = (
    "error: RMS error of the transmission angle at the original lengths and at those found, simulated again over a",
    "settled revolution, or over the window that a scenario asks for; change: median (5 to 95 % of an ensemble)",
)


def verdict_lines(folder: Path) -> list[str]:
    """The verdict of a campaign: the answer, sizes with their intervals, the gap on held-out data, and the page."""
    content = verdict_json.read(folder / VERDICT)
    told = {"samples": "compared sample by sample", "statistics": "compared by statistics over cycles"}
    lines = [f"campaign {content['campaign']}: {say.answer(content)}", *say.left_out_summary(content)]
    for effect in content["effects"]:
        for words, *row in say.parameter_rows([effect]):
            lines.append(f"{say.format_effect(effect)}: {words} {say.format_estimate(*row)}")
    gap = say.held_out_summary(content)
    lines.append(f"{gap} (1 is noise; {told[content['basis']]})")
    return "\n  ".join([*lines, f"page: {folder / SUMMARIES[1]}"]).split("\n")


def optimum_lines(names: Sequence[str], results: Path) -> list[str]:
    """A table of the optima that scenarios came to, a row each; then the remarks on them.

    The numbers are those of ``summary.json``, which the scenarios' pages have too. Scenarios without that file are left
    out; empty where there is none.
    """
    paths = {name: results / name / SUMMARY for name in names}
    known = {name: json.loads(path.read_text(encoding="utf-8")) for name, path in paths.items() if path.is_file()}
    if not known:
        return []
    rows = [_optimum(name, summary) for name, summary in known.items()]
    pages = [f"page of {name}: {results / name / SUMMARY_PAGE}" for name in known]
    shown = pages if len(pages) <= _MOST_PAGES else [f"pages: {results}/*/{SUMMARY_PAGE}"]
    told: dict[str, list[str]] = {}  # what several share is told once
    for name, summary in known.items():
        for remark in summary["remarks"]:
            told.setdefault(remark, []).append(name)
    remarks = [
        f"remark on {'all scenarios' if len(known) > 1 and owners == [*known] else ', '.join(owners)}: {sentence}"
        for sentence, owners in told.items()
    ]
    table = pd.DataFrame(rows, columns=_HEADS).to_string(index=False)
    return [*table.splitlines(), *_LEGEND, *remarks, *shown]


def _optimum(name: str, summary: Mapping[str, Any]) -> tuple[str, ...]:
    error, falls = summary["rms_error_deg"], summary["reduction_percent"]
    middle, *ends = (-falls[key] for key in ("median", "5_percent", "95_percent"))
    lengths = (f"{summary[length]['after']:.3f}" for length in ("crank_length_mm", "rod_length_mm"))
    change = f"{middle:+.2f} ({min(ends):+.2f} to {max(ends):+.2f})"
    return name, *lengths, f"{error['before']:.4f} to {error['after']:.4f}", change
