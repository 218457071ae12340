"""What a run of the workflow came to, in lines for the terminal: the verdict of a campaign, the optima of scenarios."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jointgap.campaign import verdict
from jointgap.campaign.campaign_files import SUMMARIES, VERDICT
from jointgap.campaign.phrasing import effect_in_words, estimate_row, unit_of
from jointgap.campaign.verdict_sentences import answer, held_out_in_words
from jointgap.config import Scenario
from jointgap.errors import InputError
from jointgap.report.plain_words import in_words
from jointgap.tables.optimise_tables import OPTIMA, RESIMULATED
from jointgap.tables.results_folder import ResultsFolder

SUMMARY, SUMMARY_PAGE = "summary.json", "summary.html"
"""Files of a scenario: what came out for programs, and for people."""

_MOST_PAGES = 3  # that are named one by one

_HEADS = ("scenario", "crank [mm]", "rod [mm]", "error [deg]", "gain, window [%]", "gain, revolution [%]")
_LEGEND = (
    "error: RMS error of the transmission angle over the window, at the original lengths and at those found;",
    "gain: by how much it is less, simulated again (median, 5-95 % of an ensemble), over window and settled revolution",
)


def verdict_lines(folder: Path) -> list[str]:
    """The verdict of a campaign: the answer, sizes with their intervals, the gap on held-out data, and the page.

    Parameters
    ----------
    folder : Path
        The campaign's folder of results.

    Raises
    ------
    InputError
        There is no verdict.
    """
    content = verdict.read(folder / VERDICT)
    told = {"samples": "compared sample by sample", "statistics": "compared by statistics over cycles"}
    return [
        f"campaign {content['campaign']}: {answer(content)}",
        *(f"  {line}" for line in _sizes(content["effects"])),
        f"  gap (residual in standard deviations of the noise), {told.get(content['basis'], content['basis'])}: "
        f"{_small(held_out_in_words(content))}",
        f"  page: {folder / SUMMARIES[1]}",
    ]


def _sizes(effects: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    for effect in effects:
        for name, estimate in effect["parameters"].items():
            unit = unit_of(effect["name"], effect["site"], name)
            # the catalogue ends names of parameters with their unit
            words = in_words(name.removesuffix(f"_{unit}"))
            _, value, _, interval = estimate_row(name, estimate, unit)
            yield f"{effect_in_words(effect)}: {words} {value} (90 % interval {interval})"


def _small(sentence: str) -> str:
    return f"{sentence[:1].lower()}{sentence[1:]}"


def optimum_lines(scenarios: Mapping[str, Scenario], results: Path) -> list[str]:
    """A table of the optima that scenarios came to, a row each; then the remarks on them.

    The optimum is that of the genetic algorithm on the networks in the first box. Empty where there is none.

    Parameters
    ----------
    scenarios : mapping of str to Scenario
        By name.
    results : Path
        Folder of the scenarios' folders.
    """
    rows = {name: row for name, scenario in scenarios.items() if (row := _optimum(name, scenario, results / name))}
    if not rows:
        return []
    pages = [f"page of {name}: {results / name / SUMMARY_PAGE}" for name in rows]
    shown = pages if len(pages) <= _MOST_PAGES else [f"pages: {results}/*/{SUMMARY_PAGE}"]
    return [*_aligned([_HEADS, *rows.values()]), *_LEGEND, *_remarks(list(rows), results), *shown]


def _optimum(name: str, scenario: Scenario, path: Path) -> tuple[str, ...] | None:
    folder, box = ResultsFolder(path), next(iter(scenario.optimise.boxes))
    try:
        optima, again = folder.read(OPTIMA), folder.read(RESIMULATED)
    except InputError:  # all joints ideal, or another run makes it at this moment
        return None
    point = f"networks_{box}_genetic"
    best = optima[optima["point"] == point]
    again = again[(again["point"] == point) & (again["measure"] == "rms")].set_index("stretch")
    if best.empty or not {"window", "settled"} <= set(again.index):
        return None
    window = again.loc["window"]
    return (
        name,
        *(f"{1e3 * best[length].iloc[0]:.3f}" for length in ("crank_length", "rod_length")),
        " to ".join(f"{np.degrees(window[error]):.4f}" for error in ("original_error", "error")),
        _percent(window),
        _percent(again.loc["settled"]),
    )


def _percent(row: pd.Series) -> str:
    middle, low, high = (100 * row[name] for name in ("reduction", "reduction_low", "reduction_high"))
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


def _aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        first, *others = (
            f"{cell:<{width}}" if place == 0 else f"{cell:>{width}}"
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        yield "  ".join((first, *others)).rstrip()


def _remarks(names: Sequence[str], results: Path) -> Iterator[str]:
    """What the summaries of scenarios remark; what several share is told once."""
    told: dict[str, dict[str, None]] = {}
    for name in names:
        summary = results / name / SUMMARY
        if not summary.is_file():
            continue
        for remark in json.loads(summary.read_text(encoding="utf-8"))["remarks"]:
            told.setdefault(remark, {})[name] = None
    for sentence, owners in told.items():
        everyone = len(owners) > 1 and len(owners) == len(names)
        yield f"remark on {'all scenarios' if everyone else ', '.join(owners)}: {sentence}"
