"""What a run of the workflow came to, in lines for the terminal: the verdict of a campaign, the optima of scenarios."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from jointgap.campaign import verdict
from jointgap.campaign.campaign_files import SUMMARIES, VERDICT
from jointgap.campaign.phrasing import effect_in_words, estimate_row, parameter_in_words, sure_value, unit_of
from jointgap.campaign.verdict_sentences import answer, held_out_in_words, left_out_in_words

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
    content = verdict.read(folder / VERDICT)
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
