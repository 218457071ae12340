"""The report on scenarios and campaigns, and the lines printed at the end of a run."""

import html
import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
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
from jointgap.core.words import format_day, format_falls, format_name, format_range, joined
from jointgap.scenario import overview
from jointgap.scenario.figures import FIGURES, described
from jointgap.scenario.results import ScenarioResults

MOST_BYTES = 6_000_000
"""[bytes] of the images in a report; encoded they grow by a third, and the page stays below 10
MB."""

_KEY_FIGURES = ("resimulation", "valley", "figure_12", "contact_forces")
_KEY_FIGURES_OF_CAMPAIGNS = ("measured_against_model", "disagreement", "ranking")
"""Figures in reports with too many scenarios for all figures; the others are linked."""


@dataclass(frozen=True)
class _Part:
    """A scenario or a campaign in the report."""

    name: str
    heading: str
    result: str  # In one line; empty without an optimisation
    texts: tuple[str, ...]
    links: tuple[Link, ...]
    place: str  # Folder of its figures, relative to the page
    specs: Mapping[str, FigureSpec]  # Of its figures
    key_figures: Collection[str]

    def figure(self, key: str, spec: FigureSpec, several: bool) -> FigureBlock:
        """A figure; with `several` parts, its title includes the part's name."""
        title = f"{spec.title}: {self.name}" if several else spec.title
        return FigureBlock(f"{self.place}{key}", title, spec.caption, spec.moving)

    def blocks(self, whole: bool, several: bool, shown: str) -> Iterator[Block]:
        """All except the figure `shown` before: figures by category, or key figures and links
        unless the report is `whole`.
        """
        yield Heading(self.heading)
        yield from (Paragraph(text, strong=text == f"{self.result}.") for text in self.texts)
        if self.links:
            yield Bullets(self.links)
        specs = {key: spec for key, spec in self.specs.items() if f"{self.place}{key}" != shown}
        if not whole:
            yield from (
                self.figure(key, specs[key], several) for key in self.key_figures if key in specs
            )
            others = (key for key in self.specs if key not in self.key_figures)
            yield Bullets(
                tuple(Link(self.specs[key].title, f"{self.place}{key}.png") for key in others)
            )
            return
        for category in dict.fromkeys(spec.category for spec in specs.values()):
            yield Heading(f"{category} ({self.name})" if several else category, 3)
            yield from (
                self.figure(key, spec, several)
                for key, spec in specs.items()
                if spec.category == category
            )


def write_report(
    scenarios: Mapping[str, ScenarioResults], campaigns: Sequence[str], folder: Path, file: Path
) -> None:
    """Write the results of a run to one HTML file, with figures."""
    write_text(file, pages.to_html(page(scenarios, campaigns, folder), folder))


def page(scenarios: Mapping[str, ScenarioResults], campaigns: Sequence[str], folder: Path) -> Page:
    learned = {
        name: own for name, own in scenarios.items() if own.scenario.mechanism.applied().loose
    }
    summaries = {name: _summary(own) for name, own in learned.items()}
    parts = [_scenario(own, summaries.get(name)) for name, own in scenarios.items()]
    parts += [_campaign(folder, name) for name in campaigns]
    several = len(parts) > 1
    pictures = (path for part in parts for path in (folder / part.place).glob("*.png"))
    whole = sum(path.stat().st_size for path in pictures) <= MOST_BYTES
    blocks: list[Block] = []
    if parts:
        key, spec = "measured_against_model", CAMPAIGN_FIGURES["measured_against_model"]
        if scenarios:
            key, spec = "animation", described("animation", next(iter(scenarios.values())).scenario)
        blocks.append(parts[0].figure(key, spec, several))
    first = blocks[0].stem if blocks else ""
    if len(summaries) > 1:
        blocks.append(
            TableBlock.of((_row(name, known) for name, known in summaries.items()), "lrrrrrrrr")
        )
    if several:
        results = [(part, part.result or "all joints are ideal: motion only") for part in parts]
        blocks.append(
            Bullets(
                tuple(
                    Link(part.name, f"#{pages.place_of(part.heading)}", f": {text}")
                    for part, text in results
                )
            )
        )
    compared = {name: own for name, own in learned.items() if own.scenario.paper}
    if len(compared) > 1:
        read = {
            name: (own.read_all(overview.NEEDED), own.scenario) for name, own in compared.items()
        }
        blocks += [Heading(overview.TITLE), *overview.side_by_side(overview.overview(read))]
    blocks += [block for part in parts for block in part.blocks(whole, several, first)]
    if not whole:
        linked = {
            key: spec
            for part in parts
            for key, spec in part.specs.items()
            if key not in part.key_figures
        }
        rows = tuple((spec.title, spec.caption) for spec in linked.values())
        blocks += [
            Heading("Contents of the linked figures"),
            TableBlock(("figure", "content"), rows),
        ]
    of_run = (*scenarios, *(f"campaigns/{name}" for name in campaigns))
    blocks += _others(folder, {f"{place}/{SUMMARY_PAGE}" for place in of_run})
    footer = (
        f"{pages.written_today()} Runs and their files: `jointgap dashboard`. Stages:"
        " docs/workflow.md."
    )
    return Page(
        _headline(summaries, parts), tuple(blocks), subject="Results of this run", footer=footer
    )


def _others(folder: Path, shown: Collection[str]) -> list[Block]:
    """Links to the pages of other runs in the `folder` of results, all except those `shown`; the
    newest first."""
    found = (path for pattern in ("*", "*/*") for path in folder.glob(f"{pattern}/{SUMMARY_PAGE}"))
    written = [path for path in found if path.relative_to(folder).as_posix() not in shown]
    links = []
    for path in sorted(written, key=lambda path: path.stat().st_mtime, reverse=True):
        title = re.search("<title>(.*?)</title>", path.read_text(encoding="utf-8"), re.DOTALL)
        day = format_day(date.fromtimestamp(path.stat().st_mtime))
        words = html.unescape(title[1]) if title else path.parent.name
        links.append(Link(words, path.relative_to(folder).as_posix(), f", written on {day}"))
    return [Heading("Other results in this folder"), Bullets(tuple(links))] if links else []


def _row(name: str, known: Mapping[str, Any]) -> dict[str, str | Link]:
    """A scenario in the table of all; dashes without an optimum."""
    is_found = has_optimum(known)

    def cell(value: float, digits: str) -> str:
        return format(value, digits) if is_found else "–"

    row = {
        "scenario": Link(name, f"#{pages.place_of(f'Scenario {name}')}"),
        "speed [rpm]": f"{known['speed_rpm']:g}",
        "crank [mm]": cell(known["crank_length_mm"]["after"], ".3f"),
        "rod [mm]": cell(known["rod_length_mm"]["after"], ".3f"),
        "change of the error [%]": _change(known) if is_found else "no optimum",
    }
    for joint, force in known["largest_force_N"].items():
        row[f"{format_name(joint)}, largest force [N]"] = cell(force["after"], ".4g")
        row[f"at [deg] ({format_name(joint)})"] = cell(force["after_at_deg"], ".0f")
    return row


def _own_goal(known: Mapping[str, Any]) -> str:
    """The objective of a scenario, its ``summary.json``, other than the transmission angle; or
    ''."""
    return (
        ""
        if (goal := known.get("objective", "transmission_angle")) == "transmission_angle"
        else goal
    )


def _change(known: Mapping[str, Any]) -> str:
    """The change [%] of the objective."""
    goal = _own_goal(known)
    change = -(known[goal] if goal else known)["reduction_percent"]["median"]
    return f"{change:+.1f} ({format_name(goal)})" if goal else f"{change:+.1f}"


def has_optimum(known: Mapping[str, Any]) -> bool:
    """Whether a scenario, its ``summary.json``, has lengths that satisfy all constraints."""
    return known.get("status") != "infeasible"


def _summary(own: ScenarioResults) -> Mapping[str, Any]:
    """Content of ``summary.json``."""
    path = own.path / "summary.json"
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: is not a summary of a scenario ({error}); run `jointgap summarise` first"
        ) from error


def _headline(summaries: Mapping[str, Any], parts: Sequence[_Part]) -> str:
    if len(summaries) > 1:
        optima = {name: known for name, known in summaries.items() if has_optimum(known)}
        found = [
            known["reduction_percent"]["median"]
            for known in optima.values()
            if not _own_goal(known)
        ]
        own = [f"{name}: {known['headline']}" for name, known in optima.items() if _own_goal(known)]
        unmet = [name for name, known in summaries.items() if not has_optimum(known)]
        sentences = (
            [f"In {len(unmet)} scenarios ({joined(unmet)}) no lengths satisfy the constraints"]
            if unmet
            else []
        )
        if len(unmet) == 1:
            sentences = [f"{unmet[0]}: {summaries[unmet[0]]['headline']}"]
        sentences += own
        if found:
            error = (
                f"the RMS error of the transmission angle {format_falls(found)} at the lengths"
                " found"
            )
            where = "the others" if unmet or own else f"{len(summaries)} scenarios"
            sentences.append(f"In {where} {error}, simulated again")
        return ". ".join(sentences)
    if summaries:
        return next(iter(summaries.values()))["headline"]
    results = {part.name: part.result for part in parts if part.result}
    lines = [
        result if len(results) == 1 else f"{name}: {result}" for name, result in results.items()
    ]
    return "; ".join(lines) or "The motion of the mechanism, simulated"


def _scenario(own: ScenarioResults, summary: Mapping[str, Any] | None) -> _Part:
    name, result = own.path.name, summary["headline"] if summary else ""
    pages = {
        "summary.html": (
            "lengths, gain and side effects"
            if not summary or has_optimum(summary)
            else "constraints"
        ),
        "figures/impacts.html": "impacts, interactive",
        "comparison.html": "comparison with the paper",
    }
    links = tuple(
        Link(words, f"{name}/{path}")
        for path, words in pages.items()
        if (own.path / path).is_file()
    )
    shown = [key for key in FIGURES.still if _shows(own.path / f"figures/{key}.png")]
    specs = {key: described(key, own.scenario) for key in shown}
    texts = tuple(filter(None, (own.scenario.description, f"{result}." if result else "")))
    return _Part(
        name, f"Scenario {name}", result, texts, links, f"{name}/figures/", specs, _KEY_FIGURES
    )


def _campaign(folder: Path, name: str) -> _Part:
    place = f"campaigns/{name}/"
    content = verdict_json.read(folder / place / VERDICT)
    result = verdict_page.title(content)
    specs = {
        key: spec
        for key, spec in CAMPAIGN_FIGURES.items()
        if _shows(folder / place / f"figures/{key}.png")
    }
    links = (Link("numbers, parameters and next steps", f"{place}{SUMMARIES[1]}"),)
    texts = (f"{result}.", say.answer(content))
    return _Part(
        name,
        f"Campaign {name}",
        result,
        texts,
        links,
        f"{place}figures/",
        specs,
        _KEY_FIGURES_OF_CAMPAIGNS,
    )


def _shows(picture: Path) -> bool:
    """Whether a figure was drawn; a sheet with a message instead has no plotted data."""
    plotted = picture.with_suffix(".parquet")
    return picture.is_file() and (
        not plotted.is_file() or parquet.read_footer(plotted).num_rows > 0
    )


SUMMARY, SUMMARY_PAGE = "summary.json", "summary.html"
"""Result files of a scenario: JSON and page."""

_MOST_PAGES = 3  # listed singly

_HEADS = ("scenario", "crank [mm]", "rod [mm]", "error [deg]", "change [%]")
_LEGEND = (
    (
        "error: RMS error of the transmission angle at the original and the new lengths, simulated"
        " again, over a settled"
    ),
    "revolution, or over the configured window; change: median (5 to 95 % of an ensemble)",
)


def verdict_lines(folder: Path) -> list[str]:
    """The verdict of a campaign: answer, sizes with intervals, gap on held-out data, and the page's
    path."""
    content = verdict_json.read(folder / VERDICT)
    told = {
        "samples": "compared sample by sample",
        "statistics": "compared by statistics over cycles",
    }
    lines = [
        f"campaign {content['campaign']}: {say.answer(content)}",
        *say.left_out_summary(content),
    ]
    for effect in content["effects"]:
        for words, *row in say.parameter_rows([effect]):
            lines.append(f"{say.format_effect(effect)}: {words} {say.format_estimate(*row)}")
    gap = say.held_out_summary(content)
    lines.append(f"{gap} (1 is noise; {told[content['basis']]})")
    return "\n  ".join([*lines, f"page: {folder / SUMMARIES[1]}"]).split("\n")


def scenarios_without_optimum(names: Sequence[str], results: Path) -> list[str]:
    """Scenarios in which no lengths satisfy all constraints, by their ``summary.json`` files."""
    return [name for name, known in _summaries(names, results).items() if not has_optimum(known)]


def _summaries(names: Sequence[str], results: Path) -> dict[str, Mapping[str, Any]]:
    """Contents of the ``summary.json`` files that exist, by scenario."""
    paths = {name: results / name / SUMMARY for name in names}
    return {
        name: json.loads(path.read_text(encoding="utf-8"))
        for name, path in paths.items()
        if path.is_file()
    }


def optimum_lines(names: Sequence[str], results: Path) -> list[str]:
    """Scenarios without an optimum or with another objective than the transmission angle, a table
    of the others, one row each, then the remarks; empty without ``summary.json`` files.
    """
    known = _summaries(names, results)
    if not known:
        return []
    optima = {name: summary for name, summary in known.items() if has_optimum(summary)}
    rows = [_optimum(name, summary) for name, summary in optima.items() if not _own_goal(summary)]
    named = [
        *scenarios_without_optimum(names, results),
        *(name for name in optima if _own_goal(known[name])),
    ]
    headlines = [f"{name}: {known[name]['headline']}" for name in named]
    pages = [f"page of {name}: {results / name / SUMMARY_PAGE}" for name in known]
    shown = pages if len(pages) <= _MOST_PAGES else [f"pages: {results}/*/{SUMMARY_PAGE}"]
    owners_of: dict[str, list[str]] = {}  # scenarios by remark: shared remarks are printed once
    for name, summary in known.items():
        for remark in summary["remarks"]:
            owners_of.setdefault(remark, []).append(name)
    remarks = [
        "remark on"
        f" {'all scenarios' if len(known) > 1 and owners == [*known] else ', '.join(owners)}:"
        f" {sentence}"
        for sentence, owners in owners_of.items()
    ]
    table = (
        [*pd.DataFrame(rows, columns=_HEADS).to_string(index=False).splitlines(), *_LEGEND]
        if rows
        else []
    )
    return [*headlines, *table, *remarks, *shown]


def _optimum(name: str, summary: Mapping[str, Any]) -> tuple[str, ...]:
    error, falls = summary["rms_error_deg"], summary["reduction_percent"]
    middle, *ends = (-falls[key] for key in ("median", "5_percent", "95_percent"))
    lengths = (f"{summary[length]['after']:.3f}" for length in ("crank_length_mm", "rod_length_mm"))
    change = f"{middle:+.2f} ({format_range(f'{min(ends):+.2f}', f'{max(ends):+.2f}')})"
    return name, *lengths, f"{error['before']:.4f} to {error['after']:.4f}", change
