"""The report: the results of all scenarios and campaigns of a run on one page."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jointgap.app.run_summary import Summary, has_optimum, other_objective
from jointgap.campaign import sentences as say
from jointgap.campaign import verdict_json
from jointgap.campaign.campaign_files import SUMMARIES, VERDICT
from jointgap.campaign.figures import FIGURES as CAMPAIGN_FIGURES
from jointgap.config.scenario_results import ScenarioResults
from jointgap.core import page as pages
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.files import write_text
from jointgap.core.joints import PINS
from jointgap.core.page import (
    Block,
    Bullets,
    FigureBlock,
    Heading,
    Link,
    Page,
    Paragraph,
    TableBlock,
)
from jointgap.core.plot import FigureSpec
from jointgap.core.words import format_falls, format_name
from jointgap.scenario import overview
from jointgap.scenario.figures import FIGURES, described

_PAGES = {
    "summary.html": "lengths, gain and side effects",
    "figures/impacts.html": "impacts, interactive",
    "comparison.html": "comparison with the paper",
}
_FIRST_FIGURES = ("animation", "measured_against_model")  # of a scenario, of a campaign


@dataclass(frozen=True)
class _Part:
    """A scenario or a campaign in the report."""

    name: str
    heading: str
    result: str  # in one line; empty without an optimisation
    texts: tuple[str, ...]
    links: tuple[Link, ...]
    folder: str  # of its figures, relative to the page
    figures: Mapping[str, FigureSpec]

    def figure(self, name: str, is_single: bool) -> FigureBlock:
        """A figure; unless the part `is_single` in the report, the title includes its name."""
        spec = self.figures[name]
        title = spec.title if is_single else f"{spec.title}: {self.name}"
        return FigureBlock(f"{self.folder}{name}", title, spec.caption, spec.moving)

    def blocks(self, is_single: bool, shown: Collection[FigureBlock]) -> Iterator[Block]:
        """Result, links and, by category, all still figures that are not `shown` above."""
        yield Heading(self.heading)
        yield from (Paragraph(text, strong=text == f"{self.result}.") for text in self.texts)
        if self.links:
            yield Bullets(self.links)
        by_category: dict[str, list[FigureBlock]] = {}
        for name, spec in self.figures.items():
            figure = self.figure(name, is_single)
            if figure not in shown and not spec.moving:
                by_category.setdefault(spec.category, []).append(figure)
        for category, figures in by_category.items():
            yield Heading(category if is_single else f"{category} ({self.name})", 3)
            yield from figures


def write_report(
    scenarios: Mapping[str, ScenarioResults], campaigns: Sequence[str], folder: Path, file: Path
) -> None:
    """Write the results of a run to one HTML file, with figures."""
    write_text(file, pages.to_html(page(scenarios, campaigns, folder), folder))


def page(scenarios: Mapping[str, ScenarioResults], campaigns: Sequence[str], folder: Path) -> Page:
    loose = {
        name: results
        for name, results in scenarios.items()
        if results.scenario.mechanism.applied().loose
    }
    summaries = {name: _summary(results) for name, results in loose.items()}
    parts = [_scenario(results, summaries.get(name)) for name, results in scenarios.items()]
    parts += [_campaign(folder, name) for name in campaigns]
    is_single = len(parts) == 1
    shown = [
        parts[0].figure(name, is_single)
        for name in _FIRST_FIGURES
        if parts and name in parts[0].figures
    ]
    blocks: list[Block] = [*shown]
    if len(summaries) > 1:
        rows = (_row(name, summary) for name, summary in summaries.items())
        blocks.append(TableBlock.of(rows, "lrrrrrrrr"))
    if len(parts) > 1:
        links = (
            Link(
                part.name,
                f"#{pages.place_of(part.heading)}",
                f": {part.result or 'all joints are ideal: motion only'}",
            )
            for part in parts
        )
        blocks.append(Bullets(tuple(links)))
    compared = {
        name: (results.read_all(overview.NEEDED), results.scenario)
        for name, results in loose.items()
        if results.scenario.paper
    }
    if len(compared) > 1:
        table = overview.overview(compared)
        blocks += [Heading(overview.TITLE), *overview.side_by_side(table)]
    for part in parts:
        blocks += part.blocks(is_single, shown)
    footer = (
        f"{pages.written_today()} Runs and their files: `jointgap dashboard`. Stages:"
        " docs/workflow.md."
    )
    title = _headline(summaries, parts)
    return Page(title, tuple(blocks), subject="Results of this run", footer=footer)


def _row(name: str, summary: Summary) -> dict[str, str | Link]:
    """A scenario in the table of all; dashes without an optimum."""
    is_feasible = has_optimum(summary)

    def cell(value: float, digits: str) -> str:
        return format(value, digits) if is_feasible else "–"

    row = {
        "scenario": Link(name, f"#{pages.place_of(f'Scenario {name}')}"),
        "speed [rpm]": f"{summary['speed_rpm']:g}",
        "crank [mm]": cell(summary["crank_length_mm"]["after"], ".3f"),
        "rod [mm]": cell(summary["rod_length_mm"]["after"], ".3f"),
        "change of the error [%]": _change(summary) if is_feasible else "no optimum",
    }
    for joint in PINS:
        force = summary["largest_force_N"][joint]
        row[f"{format_name(joint)}, largest force [N]"] = cell(force["after"], ".4g")
        row[f"at [deg] ({format_name(joint)})"] = cell(force["after_at_deg"], ".0f")
    return row


def _change(summary: Summary) -> str:
    """The change [%] of the objective."""
    objective = other_objective(summary)
    result = summary[objective] if objective else summary
    change = f"{-result['reduction_percent']['median']:+.1f}"
    return f"{change} ({format_name(objective)})" if objective else change


def _summary(results: ScenarioResults) -> Summary:
    path = results.path / "summary.json"
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: is not a summary of a scenario ({error}); run `jointgap summarise` first"
        ) from error


def _headline(summaries: Mapping[str, Summary], parts: Sequence[_Part]) -> str:
    """The only result; else the reductions of the transmission angle's error in one sentence, after
    all other results."""
    results = {name: summary["headline"] for name, summary in summaries.items()}
    results = results or {part.name: part.result for part in parts if part.result}
    if len(results) == 1:
        return next(iter(results.values()))
    reductions = {
        name: summary["reduction_percent"]["median"]
        for name, summary in summaries.items()
        if has_optimum(summary) and not other_objective(summary)
    }
    headlines = [f"{name}: {text}" for name, text in results.items() if name not in reductions]
    if reductions:
        scenarios = "the others" if headlines else f"{len(summaries)} scenarios"
        headlines.append(
            f"In {scenarios} the RMS error of the transmission angle"
            f" {format_falls(reductions.values())} at the lengths found, simulated again"
        )
    return ". ".join(headlines) or "The motion of the mechanism, simulated"


def _scenario(results: ScenarioResults, summary: Summary | None) -> _Part:
    name = results.path.name
    result = summary["headline"] if summary else ""
    names = dict(_PAGES)
    if summary and not has_optimum(summary):
        names["summary.html"] = "constraints"
    links = tuple(
        Link(words, f"{name}/{path}")
        for path, words in names.items()
        if (results.path / path).is_file()
    )
    figures = {
        key: described(key, results.scenario)
        for key in FIGURES
        if key == "animation" or _is_drawn(results.path / f"figures/{key}.png")
    }
    texts = tuple(filter(None, (results.scenario.description, f"{result}." if result else "")))
    return _Part(name, f"Scenario {name}", result, texts, links, f"{name}/figures/", figures)


def _campaign(folder: Path, name: str) -> _Part:
    path = f"campaigns/{name}/"
    verdict = verdict_json.read(folder / path / VERDICT)
    result = say.title(verdict)
    figures = {
        key: spec
        for key, spec in CAMPAIGN_FIGURES.items()
        if _is_drawn(folder / path / f"figures/{key}.png")
    }
    links = (Link("numbers, parameters and next steps", f"{path}{SUMMARIES[1]}"),)
    texts = (f"{result}.", say.answer(verdict))
    return _Part(name, f"Campaign {name}", result, texts, links, f"{path}figures/", figures)


def _is_drawn(picture: Path) -> bool:
    """Whether a figure exists and has data; without data it contains only a message."""
    data = picture.with_suffix(".parquet")
    return picture.is_file() and (not data.is_file() or parquet.read_footer(data).num_rows > 0)
