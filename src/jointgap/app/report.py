"""The report over scenarios and campaigns, and what came out at the end of a run."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.campaign import page as verdict_page
from jointgap.campaign import verdict_json
from jointgap.campaign.campaign_files import SUMMARIES, VERDICT
from jointgap.campaign.figures import FIGURES as CAMPAIGN_FIGURES
from jointgap.campaign.sentences import (
    answer,
    effect_in_words,
    estimate_row,
    held_out_in_words,
    left_out_in_words,
    parameter_in_words,
    sure_value,
    unit_of,
)
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
    place_of,
    to_html,
    written_today,
)
from jointgap.core.plot import FigureSpec
from jointgap.core.words import fall_in_percent
from jointgap.scenario import overview as scenario_overview
from jointgap.scenario.figures import FIGURES
from jointgap.scenario.results import ScenarioResults

MOST_BYTES = 6_000_000
"""Of the images that a report takes in: as text in the page they have a third more, and the page stays below 10 MB."""

_PACKED = 0.4  # size of a still figure in a page over that of its PNG file, at most

_KEY_FIGURES = ("resimulation", "valley", "figure_12", "contact_forces")
_KEY_FIGURES_OF_CAMPAIGNS = ("measured_against_model", "disagreement", "ranking")
"""Figures that stand in a report of so many scenarios that all would be too large for a page; the others are linked."""


def write_report(scenarios: Mapping[str, ScenarioResults], campaigns: Sequence[str], folder: Path, file: Path) -> None:
    """Put what came out of a run on one page in one file, with its figures."""
    write_text(file, to_html(page(scenarios, campaigns, folder), folder))


def page(
    scenarios: Mapping[str, ScenarioResults],
    campaigns: Sequence[str],
    folder: Path,
) -> Page:
    """What came out of a run."""
    verdicts = {name: verdict_json.read(_of_campaign(folder, name) / VERDICT) for name in campaigns}
    learned = {name: results for name, results in scenarios.items() if results.scenario.mechanism.applied().loose}
    table = None
    if compared := {name: own for name, own in learned.items() if own.scenario.paper}:
        read = {name: (own.read_all(scenario_overview.NEEDED), own.scenario) for name, own in compared.items()}
        table = scenario_overview.overview(read)
    summaries = {name: _summary(own) for name, own in learned.items()}
    gains = {name: known["headline"] for name, known in summaries.items()}
    whole = _size(folder, scenarios, campaigns) <= MOST_BYTES
    several = len(scenarios) + len(campaigns) > 1
    first = _first_picture(scenarios, campaigns, folder, several)
    parts = (
        *_side_by_side(table),
        *(
            block
            for name, own in scenarios.items()
            for block in _scenario(own, gains.get(name, ""), whole, folder, several)
        ),
        *(block for name, content in verdicts.items() for block in _campaign(content, whole, folder, several)),
        *([] if whole else _other_figures(scenarios, campaigns)),
    )
    return Page(
        _headline(summaries, verdicts),
        (
            *first,
            *([Bullets(tuple(_glance(scenarios, gains, verdicts)))] if several else []),
            *_without(first, parts),
        ),
        subject="What came out of this run",
        footer=f"{written_today()} The runs side by side, with their files: `jointgap dashboard`. What each stage "
        "reads and writes: docs/workflow.md.",
    )


def _without(shown: Sequence[Block], blocks: Sequence[Block]) -> list[Block]:
    """`blocks` without the figures among those `shown` before them, and without parts that are empty then."""
    stems = {block.stem for block in shown if isinstance(block, FigureBlock)}
    left = [block for block in blocks if not (isinstance(block, FigureBlock) and block.stem in stems)]
    return [
        block
        for block, after in zip(left, [*left[1:], None], strict=True)
        if not (isinstance(block, Heading) and block.level == 3 and (after is None or isinstance(after, Heading)))
    ]


def _of_campaign(folder: Path, name: str) -> Path:
    return folder / "campaigns" / name


def _summary(own: ScenarioResults) -> Mapping[str, Any]:
    """What the stage summarise found, content of ``summary.json``."""
    path = own.path / "summary.json"
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is no summary of a scenario ({error}); run `jointgap summarise` first") from error


def _headline(summaries: Mapping[str, Any], verdicts: Mapping[str, Any]) -> str:
    if len(summaries) == 1:
        return next(iter(summaries.values()))["headline"]
    if summaries:
        falls = fall_in_percent(known["reduction_percent"]["median"] for known in summaries.values())
        return (
            f"In {len(summaries)} scenarios the RMS error of the transmission angle {falls} at the lengths found, "
            "simulated again"
        )
    if len(verdicts) == 1:
        return verdict_page.title(next(iter(verdicts.values())))
    if verdicts:
        return "; ".join(f"{name}: {verdict_page.title(content)}" for name, content in verdicts.items())
    return "The motion of the mechanism, simulated"


def _first_picture(
    scenarios: Mapping[str, ScenarioResults],
    campaigns: Sequence[str],
    folder: Path,
    several: bool,
) -> list[Block]:
    if scenarios:
        name = next(iter(scenarios))
        title = _title(FIGURES["animation"].title, name, several)
        return [FigureBlock(f"{name}/figures/animation", title, FIGURES["animation"].caption, moving=True)]
    if campaigns:
        spec = CAMPAIGN_FIGURES["measured_against_model"]
        stem = _of_campaign(folder, campaigns[0]).relative_to(folder) / "figures/measured_against_model"
        return [FigureBlock(str(stem), _title(spec.title, campaigns[0], several), spec.caption)]
    return []


def _title(words: str, name: str, several: bool) -> str:
    """Of a figure; where the report is of `several` scenarios and campaigns, with the `name` of its own."""
    return f"{words}: {name}" if several else words


def _glance(
    scenarios: Mapping[str, ScenarioResults],
    gains: Mapping[str, str],
    verdicts: Mapping[str, Any],
) -> Iterator[Link]:
    """One point for each part, with what came out of it."""
    for name in scenarios:
        yield Link(name, f"#{place_of(_of_scenario(name))}", f": {gains.get(name, 'all joints are ideal: simulated')}")
    for name, content in verdicts.items():
        yield Link(name, f"#{place_of(_of_verdict(name))}", f": {verdict_page.title(content)}")


def _of_scenario(name: str) -> str:
    return f"Scenario {name}"


def _of_verdict(name: str) -> str:
    return f"Campaign {name}"


def _side_by_side(table: pd.DataFrame | None) -> list[Block]:
    if table is None or len(table) < 2:
        return []
    return [Heading(scenario_overview.TITLE), *scenario_overview.side_by_side(table)]


def _scenario(own: ScenarioResults, gain: str, whole: bool, folder: Path, several: bool) -> list[Block]:
    name, description = own.path.name, own.scenario.description
    pages = {
        "summary.html": "the lengths, what they gain and what they cost",
        "figures/impacts.html": "zoom into the impacts",
        "comparison.html": "the paper's numbers and claims beside these",
    }
    links = [Link(words, f"{name}/{path}") for path, words in pages.items() if (folder / name / path).is_file()]
    specs = {key: FIGURES[key] for key in FIGURES.still if (folder / name / f"figures/{key}.png").is_file()}
    return [
        Heading(_of_scenario(name)),
        *([Paragraph(description)] if description else []),
        *([Paragraph(f"{gain}.", strong=True)] if gain else []),
        *([Bullets(tuple(links))] if links else []),
        *_figures(specs, f"{name}/figures/", name if several else "", () if whole else _KEY_FIGURES),
    ]


def _campaign(content: Mapping[str, Any], whole: bool, folder: Path, several: bool) -> list[Block]:
    name = content["campaign"]
    place = f"{_of_campaign(folder, name).relative_to(folder)}/"
    specs = {key: spec for key, spec in CAMPAIGN_FIGURES.items() if _shows(folder / f"{place}figures/{key}.png")}
    return [
        Heading(_of_verdict(name)),
        Paragraph(f"{verdict_page.title(content)}.", strong=True),
        Paragraph(answer(content)),
        Bullets((Link("the whole page, with numbers, parameters and what to do next", f"{place}{SUMMARIES[1]}"),)),
        *_figures(specs, f"{place}figures/", name if several else "", () if whole else _KEY_FIGURES_OF_CAMPAIGNS),
    ]


def _shows(picture: Path) -> bool:
    """Whether a figure was drawn, and not a sheet that says why there is nothing to draw: that has no plotted data."""
    plotted = picture.with_suffix(".parquet")
    return picture.is_file() and (not plotted.is_file() or parquet.read_footer(plotted).num_rows > 0)


def _figures(specs: Mapping[str, FigureSpec], place: str, name: str, wanted: Collection[str]) -> Iterator[Block]:
    """All figures by category, or those `wanted` and links to the others; a `name` stands in their titles."""
    categories = dict.fromkeys(spec.category for spec in specs.values())
    for category in categories if not wanted else ():
        yield Heading(f"{category} ({name})" if name else category, 3)
        for key in (key for key, spec in specs.items() if spec.category == category):
            yield _figure(specs[key], place, key, name)
    for key in wanted:
        if key in specs:
            yield _figure(specs[key], place, key, name)
    if wanted:
        others = [key for key in specs if key not in wanted]
        yield Bullets(tuple(Link(specs[key].title, f"{place}{key}.png") for key in others))


def _figure(spec: FigureSpec, place: str, key: str, name: str) -> FigureBlock:
    return FigureBlock(f"{place}{key}", _title(spec.title, name, bool(name)), spec.caption)


def _other_figures(scenarios: Collection[str], campaigns: Collection[str]) -> list[Block]:
    """What the figures show that are linked only."""
    linked = [FIGURES[key] for key in FIGURES.still if scenarios and key not in _KEY_FIGURES]
    linked += [spec for key, spec in CAMPAIGN_FIGURES.items() if campaigns and key not in _KEY_FIGURES_OF_CAMPAIGNS]
    rows = tuple((spec.title, spec.caption) for spec in linked)
    return [Heading("What the figures show that are linked"), TableBlock(("figure", "what it shows"), rows)]


def _size(folder: Path, scenarios: Mapping[str, Any], campaigns: Sequence[str]) -> float:
    """Bytes of all figures as a page would take them in."""
    places = [*(folder / name for name in scenarios), *(_of_campaign(folder, name) for name in campaigns)]
    return _PACKED * sum(path.stat().st_size for place in places for path in place.glob("figures/*.png"))


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
    return [
        f"campaign {content['campaign']}: {answer(content)}",
        *(f"  {line}" for line in left_out_in_words(content)),
        *(f"  {line}" for line in _sizes(content["effects"])),
        f"  gap (residual in standard deviations of the noise), {told.get(content['basis'], content['basis'])}: "
        f"{_small(held_out_in_words(content))}",
        f"  page: {folder / SUMMARIES[1]}",
    ]


def _sizes(effects: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    for effect in effects:
        for name, estimate in effect["parameters"].items():
            unit = unit_of(effect["name"], effect["site"], name)
            words, *row = estimate_row(parameter_in_words(effect["name"], name), estimate, unit)
            yield f"{effect_in_words(effect)}: {words} {sure_value(*row)}"


def _small(sentence: str) -> str:
    return f"{sentence[:1].lower()}{sentence[1:]}"


def optimum_lines(names: Sequence[str], results: Path) -> list[str]:
    """A table of the optima that scenarios came to, a row each; then the remarks on them.

    The numbers are those of ``summary.json``, which the scenarios' pages have too. Scenarios without that file are left
    out; empty where there is none.
    """
    paths = {name: results / name / SUMMARY for name in names}
    known = {name: json.loads(path.read_text(encoding="utf-8")) for name, path in paths.items() if path.is_file()}
    if not known:
        return []
    rows = (_optimum(name, summary) for name, summary in known.items())
    pages = [f"page of {name}: {results / name / SUMMARY_PAGE}" for name in known]
    shown = pages if len(pages) <= _MOST_PAGES else [f"pages: {results}/*/{SUMMARY_PAGE}"]
    return [*_aligned([_HEADS, *rows]), *_LEGEND, *_remarks(known), *shown]


def _optimum(name: str, summary: Mapping[str, Any]) -> tuple[str, ...]:
    error, falls = summary["rms_error_deg"], summary["reduction_percent"]
    middle, *ends = (-falls[key] for key in ("median", "5_percent", "95_percent"))
    low, high = sorted(ends)
    return (
        name,
        *(f"{summary[length]['after']:.3f}" for length in ("crank_length_mm", "rod_length_mm")),
        f"{error['before']:.4f} to {error['after']:.4f}",
        f"{middle:+.2f} ({low:+.2f} to {high:+.2f})",
    )


def _aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        first, *others = (
            f"{cell:<{width}}" if place == 0 else f"{cell:>{width}}"
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        yield "  ".join((first, *others)).rstrip()


def _remarks(known: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """What the summaries of scenarios remark; what several share is told once."""
    told: dict[str, dict[str, None]] = {}
    for name, summary in known.items():
        for remark in summary["remarks"]:
            told.setdefault(remark, {})[name] = None
    for sentence, owners in told.items():
        everyone = len(owners) > 1 and len(owners) == len(known)
        yield f"remark on {'all scenarios' if everyone else ', '.join(owners)}: {sentence}"
