"""The outcome of a scenario on one page, for whoever designs the mechanism."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jointgap.core.joints import FROM_FRAME
from jointgap.core.page import Block, Bullets, Cell, FigureBlock, Heading, Link, Page, Paragraph, TableBlock
from jointgap.core.words import in_words, joined
from jointgap.dynamics.kinematics import ideal_cycle
from jointgap.lengths.region import MET, geometric
from jointgap.paper.printed import departures
from jointgap.scenario.outcome import MOTIONS, Gain, Outcome, ideal_swing

MM = 1e3
_MOST_DECIMALS = 5

_AS_WELL = 0.02
"""Spread of the reduction along the valley up to which any pair of lengths on it does as well."""

_MEASURES = {"rms": "root mean square (RMS)", "mean_absolute": "mean size", "peak": "largest"}

_ANIMATION = (
    "The mechanism at your own lengths",
    "First revolution, from the start with the journals in the middle of their bearings. Above: the clearances drawn "
    "as many times as large as the title says; rings are bearings, dots journals. Below: the journals' paths in their "
    "true clearances, and the forces.",
)

_FIGURES = {
    "valley": (
        "The error over both lengths",
        "Left: RMS error over crank and rod length with the motion in the joints frozen, as the networks know it; the "
        "frame is what was searched, the heavy line the best crank for each rod. Along that line the error "
        "hardly changes: the ratio of the lengths is what counts. Right: by how much the error falls along that line.",
    ),
    "resimulation": (
        "Whether the gain lasts when the motion answers to the lengths",
        "By how much the error falls with the lengths found on each description of the motion: diamonds with the "
        "motion frozen, dots simulated again (bars: 5 to 95 %). Left over the first revolution, right over a settled "
        "one. A bar that crosses zero means that there is no gain to speak of.",
    ),
    "contact_forces": (
        "Forces in the joints, your own lengths",
        "Normal force in the loose joints over the first and over a settled revolution; gaps are flight. The bands "
        "below say what each joint is in: flight, impact (the journal hits and rebounds) or contact.",
    ),
    "orbits": (
        "Paths of the journals in their bearings, your own lengths",
        "Left the first revolution, middle a settled one, in which the part beyond the circle (how deep the journal "
        "presses into the wall) is magnified by the factor in the panel: it shows where the bearing carries the load. "
        "Right the distance to the wall over the crank angle; negative values are flight.",
    ),
}
"""Those of a scenario that help to decide, in words for who does; the others stand in the report."""


def headline(outcome: Outcome) -> str:
    """The answer in one line, with its numbers."""
    (crank, rod), (new_crank, new_rod), gain = outcome.original, outcome.lengths, outcome.gain
    links = f"rod {_fixed(MM * rod, 2)} → {_fixed(MM * new_rod, 2)} mm"
    if outcome.keeps_crank:
        links = f"Crank {_fixed(MM * crank, 2)} mm as it is, {links}"
    else:
        links = f"Crank {_fixed(MM * crank, 2)} → {_fixed(MM * new_crank, 2)} mm, {links}"
    links += f" (crank over rod {crank / rod:.4f} → {new_crank / new_rod:.4f})"
    before, after = _alike(math.degrees(gain.before), math.degrees(gain.after))
    sizes = f"RMS error of the transmission angle {before} → {after} deg"
    low, high = (f"{end:+.1f}" for end in sorted((-100 * gain.low, -100 * gain.high)))
    ends = "from every start" if low == high else f"{low} to {high} %"
    spread = f"{-100 * gain.reduction:+.1f} % ({ends})".replace("-", "−")
    verdict = "" if gain.is_certain else ", worse" if gain.is_loss else ", not to be told from chance"
    return f"{links}: {sizes}, {spread}, simulated again{verdict}"


def page(outcome: Outcome, name: str, remarks: Sequence[str]) -> Page:
    """The outcome of the scenario called `name` on one page, with its `remarks`."""
    scenario = outcome.scenario
    paper = not departures(scenario.mechanism, scenario.simulate)
    figures = [FigureBlock(stem, title, caption) for stem, (title, caption) in _FIGURES.items()]
    blocks: list[Block] = [
        *([Paragraph(scenario.description)] if scenario.description else []),
        Paragraph(_meaning(outcome)),
        FigureBlock("animation", *_ANIMATION, moving=True),
        *([Heading("Before you take it over"), Bullets(tuple(remarks))] if remarks else []),
        Heading("The lengths"),
        *_lengths(outcome),
        Heading("What they gain"),
        *_gains(outcome),
        Heading("What they cost"),
        *_costs(outcome),
        *_limits(outcome),
        Heading("Found on which motion"),
        *_motions(outcome),
        Heading("Figures"),
        *figures,
        Heading("More"),
        Bullets(
            (
                *([Link("The paper's numbers and claims beside these", "comparison.html")] if paper else []),
                Link("Zoom into the impacts", "figures/impacts.html", ": gaps, contact forces and modes"),
                Link("All figures of this scenario", "figures", " as PNG, SVG, and the plotted data as Parquet"),
                Link("The same numbers for programs", "summary.json"),
                Link("Every table of the search", "optimise", "; `jointgap describe FILE` explains the columns"),
            )
        ),
    ]
    return Page(headline(outcome), tuple(blocks), subject=f"Scenario {name}", width="60rem")


def document(outcome: Outcome, name: str, remarks: Sequence[str]) -> dict[str, Any]:
    """The outcome of the scenario called `name` for programs, with its `remarks`: content of ``summary.json``."""
    gain = outcome.gain
    return {
        "scenario": name,
        "headline": headline(outcome),
        "remarks": list(remarks),
        "found_on": outcome.source,
        "crank_length_mm": {"before": MM * outcome.original[0], "after": MM * outcome.lengths[0]},
        "rod_length_mm": {"before": MM * outcome.original[1], "after": MM * outcome.lengths[1]},
        "at_bounds": list(outcome.bounds),
        "rms_error_deg": {"before": math.degrees(gain.before), "after": math.degrees(gain.after)},
        "reduction_percent": {
            "median": 100 * gain.reduction,
            "5_percent": 100 * gain.low,
            "95_percent": 100 * gain.high,
            "motion_frozen": 100 * gain.frozen,
        },
    }


def _fixed(value: float, decimals: int) -> str:
    """A number with so many decimals at most, one at least."""
    text = f"{value:.{decimals}f}".rstrip("0")
    return f"{text}0" if text.endswith(".") else text


def _signed(value: float, decimals: int) -> str:
    """A change with its sign; one that is rounded away has none."""
    text = f"{value:+.{decimals}f}"
    return text if float(text) else text[1:]


def _alike(before: float, after: float) -> tuple[str, str]:
    """Two numbers with the same decimals: three digits of the larger, two of their difference, five at most."""
    largest = max(abs(before), abs(after))
    sizes = [largest, *([max(10 * abs(after - before), 0.01 * largest)] if after != before else [])]
    needed = [2 - math.floor(math.log10(size)) for size in sizes if size > 0]
    decimals = min(max([*needed, 0]), _MOST_DECIMALS)
    return f"{before:.{decimals}f}", f"{after:.{decimals}f}"


def _meaning(outcome: Outcome) -> str:
    low, high = map(math.degrees, ideal_swing(outcome.original, outcome.scenario.mechanism.applied().slider.offset))
    loose = joined(in_words(joint) for joint in outcome.scenario.mechanism.applied().loose)
    return (
        "The transmission angle is the angle between the rod and the normal to the slide, best near 90 deg. Its error "
        f"is what clearance in the {loose} does to it: the angle that your own lengths would give without clearance, "
        f"less the one with clearance. It is counted over {outcome.stretch_in_words}, in which the angle itself swings "
        f"from {low:.1f} to {high:.1f} deg."
    )


def _lengths(outcome: Outcome) -> Iterator[Block]:
    main, bounds = next(iter(outcome.scenario.optimise.boxes.items()))
    rows = []
    for words, before, after, (low, high) in (
        ("crank", outcome.original[0], outcome.lengths[0], bounds.crank_length),
        ("rod", outcome.original[1], outcome.lengths[1], bounds.rod_length),
    ):
        rows.append(
            (
                f"{words} length [mm]",
                _fixed(MM * before, 3),
                _fixed(MM * after, 3),
                _signed(MM * (after - before), 3),
                _signed(100 * (after / before - 1), 2),
                f"{MM * low:g} to {MM * high:g}",
            )
        )
    ratios = [crank / rod for crank, rod in (outcome.original, outcome.lengths)]
    limit = outcome.scenario.optimise.ratio_limit
    rows.append(
        (
            "crank over rod [1]",
            *(f"{ratio:.5f}" for ratio in ratios),
            _signed(ratios[1] - ratios[0], 5),
            _signed(100 * (ratios[1] / ratios[0] - 1), 2),
            "–" if limit is None else f"up to {limit:g}",
        )
    )
    heads = ("", "before", "after", "change", "change [%]", f"searched (box {main})")
    yield TableBlock(heads, tuple(rows), "lrrrrr")
    if not outcome.bounds and outcome.keeps_force:
        kept = " The crank keeps its length; `optimise.boxes` lets both vary." if outcome.keeps_crank else ""
        yield Paragraph(f"No bound and no limit is active.{kept}")
    ratios, reductions = (outcome.floor[key] for key in ("ratio", "reduction"))
    low, high = bounds.rod_length
    yield Paragraph(
        "What counts is the ratio. With the motion in the joints frozen, the best crank for each rod from "
        f"{MM * low:g} to {MM * high:g} mm is {ratios.min():.5f} to {ratios.max():.5f} times as long, and the RMS "
        f"error falls by {100 * reductions.min():.1f} to {100 * reductions.max():.1f} %"
        + (": any of these pairs does as well." if np.ptp(reductions) <= _AS_WELL else ".")
    )


def _gains(outcome: Outcome) -> Iterator[Block]:
    stretches = [outcome.stretch, *({"settled", "window"} - {outcome.stretch})]
    rows = [
        _gain_row(f"{_MEASURES[measure]}, {outcome.words_of(stretch)}", outcome.gains[stretch, measure])
        for stretch in stretches
        for measure in _MEASURES
    ]
    members = int(outcome.resimulated["members"].iloc[0])
    heads = (
        "error",
        "before [deg]",
        "after [deg]",
        "simulated again [%]",
        "5 to 95 % [%]",
        "motion frozen [%]",
        "better",
    )
    yield TableBlock(heads, tuple(rows), "lrrrrrr")
    yield Paragraph(
        f"Simulated again: the contact in the joints computed anew at the lengths found, from {members} slightly "
        "different starts for each pair of lengths; 5 to 95 % is the spread over all pairs of such runs, better the "
        "share of pairs in which the new lengths have the smaller error. Motion frozen: what the search believes, "
        "which keeps the motion in the joints as it was at your own lengths. Where both differ, believe the simulation."
    )


def _gain_row(words: str, gain: Gain) -> tuple[str, ...]:
    before, after = _alike(math.degrees(gain.before), math.degrees(gain.after))
    low, high = sorted((-100 * gain.low, -100 * gain.high))
    return (
        words,
        before,
        after,
        f"{-100 * gain.reduction:+.1f}",
        f"{low:+.1f} to {high:+.1f}",
        f"{-100 * gain.frozen:+.1f}",
        f"{100 * gain.share_better:.0f}",
    )


def _costs(outcome: Outcome) -> Iterator[Block]:
    offset = outcome.scenario.mechanism.applied().slider.offset
    before, after = outcome.cycle("simulated")
    ideal = [ideal_cycle(*lengths, offset) for lengths in (outcome.original, outcome.lengths)]
    rows = [
        _cost("stroke [mm]", MM * before["stroke"], MM * after["stroke"]),
        _cost("stroke without clearance [mm]", *(MM * cycle.stroke for cycle in ideal)),
        _cost("outer dead centre, slider at [mm]", MM * before["outer_dead_centre"], MM * after["outer_dead_centre"]),
        _cost("inner dead centre, slider at [mm]", MM * before["inner_dead_centre"], MM * after["inner_dead_centre"]),
        *(
            _cost(
                f"{side} dead centre, crank at [deg]",
                *(math.degrees(getattr(cycle, f"{side}_dead_centre_angle")) for cycle in ideal),
                relative=False,
            )
            for side in ("outer", "inner")
        ),
        _cost(
            "smallest transmission angle [deg]",
            math.degrees(before["smallest_transmission_angle"]),
            math.degrees(after["smallest_transmission_angle"]),
            relative=False,
        ),
    ]
    loose = outcome.scenario.mechanism.applied().loose
    for joint in FROM_FRAME:
        old, new = outcome.load(joint)
        for key, words in (("peak_force", "largest force"), ("rms_force", "RMS force")):
            rows.append(_cost(f"{words} in the {in_words(joint)} [N]", old[key], new[key]))
    for joint in FROM_FRAME:
        if joint in loose:
            old, new = outcome.load(joint)
            shares = (100 * old["contact_share"], 100 * new["contact_share"])
            rows.append(_cost(f"share of time in contact, {in_words(joint)} [%]", *shares, relative=False))
    yield TableBlock(("", "before", "after", "change", "change [%]"), tuple(rows), "lrrrr")
    yield Paragraph(
        "Before: your own lengths; after: the lengths found; medians over the same runs with clearance, over a settled "
        "revolution. Crank angles of the dead centres are those without clearance, counted from the slide's direction. "
        "Forces act between the two bodies of a joint; they come from inertia and from what the mechanism file lists "
        "as effects, so list gas pressure or a load there before you judge them."
    )


def _cost(words: str, before: float, after: float, relative: bool = True) -> tuple[str, ...]:
    """A row; where it is `relative`, with the change in percent."""
    old, new = _alike(before, after)
    changed = _signed(100 * (after / before - 1), 1) if relative and before else "–"
    decimals = len(old.partition(".")[2])
    return words, old, new, _signed(float(new) - float(old), decimals), changed


def _limits(outcome: Outcome) -> Iterator[Block]:
    """What was asked of the lengths besides their bounds, and what they do."""
    options = outcome.scenario.optimise.constraints
    offset = outcome.scenario.mechanism.applied().slider.offset
    rows = [
        (each.words, each.asked(), *(each.show(float(each.value(at))) for at in (outcome.original, outcome.lengths)))
        + (_met(each.missed(outcome.lengths) <= MET),)
        for each in geometric(options, offset)
        if not (each.key == "crank_length" and outcome.keeps_crank)
    ]
    if (most := options.largest_pin_force) is not None:
        forces = [max(forces.values()) for forces in outcome.peak_pin_forces]
        shown = (f"{force:.4g} N" for force in forces)
        rows.append(("largest force in a pin", f"{most:.4g} N at most", *shown, _met(outcome.keeps_force)))
    if rows:
        yield Heading("What was asked of them")
        yield TableBlock(("", "asked", "before", "after", "met"), tuple(rows), "lrrrl")
        yield Paragraph(
            "Stroke, dead centres and space are those without clearance, between the centres of the joints; the force "
            "is simulated again with clearance, as above."
        )


def _met(met: bool) -> Cell:
    return Cell("yes", "good") if met else Cell("no", "bad")


def _motions(outcome: Outcome) -> Iterator[Block]:
    rows = []
    for source, point in outcome.found.items():
        words = MOTIONS[source]
        found = outcome.optima[(outcome.optima["source"] == source) & (outcome.optima["point"] == point)]
        if len(found):
            again = outcome.resimulated
            again = again[(again["point"] == point) & (again["measure"] == "rms")].set_index("stretch")
            rows.append(
                (
                    f"{words}{' (taken)' if source == outcome.source else ''}",
                    f"{MM * found['crank_length'].iloc[0]:.3f}",
                    f"{MM * found['rod_length'].iloc[0]:.3f}",
                    *(_spread(again.loc[stretch]) for stretch in ("settled", "window")),
                )
            )
    yield Paragraph(
        "The search keeps the motion in the joints as it is at your own lengths, and takes that motion from four "
        "places. Of the lengths found, those are taken that have the smallest RMS error over "
        f"{outcome.stretch_in_words} simulated again. Where all four agree, how the motion is described does not "
        "matter."
    )
    heads = (
        "motion from",
        "crank [mm]",
        "rod [mm]",
        *(f"RMS error, {outcome.words_of(s)} [%]" for s in ("settled", "window")),
    )
    yield TableBlock(heads, tuple(rows), "lrrrr")


def _spread(row: pd.Series) -> str:
    low, high = sorted((-100 * row["reduction_low"], -100 * row["reduction_high"]))
    return f"{-100 * row['reduction']:+.1f} ({low:+.1f} to {high:+.1f})"
