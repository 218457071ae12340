"""The result of a scenario's optimisation on one page, and as a document for programs."""

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
from jointgap.scenario.figures import FIGURES
from jointgap.scenario.outcome import MOTIONS, Outcome, ideal_swing

MM = 1e3
_MOST_DECIMALS = 5
_AS_WELL = 0.02  # spread of the reduction along the valley up to which all its points are equally good
_MEASURES = {"rms": "root mean square (RMS)", "mean_absolute": "mean absolute", "peak": "peak"}
_FIGURES = ("valley", "resimulation", "contact_forces", "orbits")


def headline(outcome: Outcome) -> str:
    """The answer in one line, with its numbers."""
    (crank, rod), (new_crank, new_rod), gain = outcome.original, outcome.lengths, outcome.gain
    kept = f"Crank {_fixed(MM * crank, 2)} mm as it is" if outcome.keeps_crank else ""
    changed = f"Crank {_fixed(MM * crank, 2)} → {_fixed(MM * new_crank, 2)} mm"
    before, after = _alike(math.degrees(gain.before), math.degrees(gain.after))
    low, high = (f"{end:+.1f}" for end in sorted((-100 * gain.low, -100 * gain.high)))
    ends = "from every start" if low == high else f"{low} to {high} %"
    spread = f"{-100 * gain.reduction:+.1f} % ({ends})".replace("-", "−")
    verdict = "" if gain.is_certain else ", worse" if gain.is_loss else ", not significant"
    return (
        f"{kept or changed}, rod {_fixed(MM * rod, 2)} → {_fixed(MM * new_rod, 2)} mm (crank over rod "
        f"{crank / rod:.4f} → {new_crank / new_rod:.4f}): RMS error of the transmission angle {before} → {after} deg, "
        f"{spread}, simulated again{verdict}"
    )


def document(outcome: Outcome, name: str, remarks: Sequence[str]) -> dict[str, Any]:
    """The outcome of the scenario called `name` for programs, with its `remarks`: content of ``summary.json``."""
    gain = outcome.gain
    crank, rod = (
        {"before": MM * old, "after": MM * new} for old, new in zip(outcome.original, outcome.lengths, strict=True)
    )
    return {
        "scenario": name,
        "headline": headline(outcome),
        "remarks": list(remarks),
        "found_on": outcome.chosen["source"],
        "crank_length_mm": crank,
        "rod_length_mm": rod,
        "at_bounds": list(outcome.bounds),
        "rms_error_deg": {"before": math.degrees(gain.before), "after": math.degrees(gain.after)},
        "reduction_percent": {
            "median": 100 * gain.reduction,
            "5_percent": 100 * gain.low,
            "95_percent": 100 * gain.high,
            "motion_frozen": 100 * gain.frozen,
        },
    }


def page(outcome: Outcome, name: str, remarks: Sequence[str]) -> Page:
    """The outcome of the scenario called `name` on one page, with its `remarks`."""
    scenario = outcome.scenario
    compared = scenario.paper and not departures(scenario.mechanism, scenario.simulate)
    links = (
        *([Link("The paper's numbers and claims compared", "comparison.html")] if compared else []),
        Link("Zoom into the impacts", "figures/impacts.html", ": gaps, contact forces and modes"),
        Link("All figures of this scenario", "figures", " as PNG, SVG, and the plotted data as Parquet"),
        Link("The same numbers for programs", "summary.json"),
        Link("Every table of the search", "optimise", "; `jointgap describe FILE` explains the columns"),
    )
    blocks: list[Block] = [
        *([Paragraph(scenario.description)] if scenario.description else []),
        Paragraph(_definition(outcome)),
        _figure("animation"),
        *([Heading("Check before you use this"), Bullets(tuple(remarks))] if remarks else []),
        Heading("Lengths"),
        *_lengths(outcome),
        Heading("Gain"),
        *_gains(outcome),
        Heading("Side effects"),
        *_side_effects(outcome),
        *_constraints(outcome),
        Heading("Motion used by the search"),
        *_motions(outcome),
        Heading("Figures"),
        *map(_figure, _FIGURES),
        Heading("Files"),
        Bullets(links),
    ]
    return Page(headline(outcome), tuple(blocks), subject=f"Scenario {name}", width="60rem")


def _figure(name: str) -> FigureBlock:
    spec = FIGURES[name]
    return FigureBlock(
        name, f"{spec.title}, original lengths" if spec.category == "Contact" else spec.title, spec.caption, spec.moving
    )


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


def _definition(outcome: Outcome) -> str:
    applied = outcome.scenario.mechanism.applied()
    low, high = map(math.degrees, ideal_swing(outcome.original, applied.slider.offset))
    loose = joined(in_words(joint) for joint in applied.loose)
    return (
        "The transmission angle is the angle between the rod and the normal to the slide, best near 90 deg. Its "
        f"error is the angle without clearance at the original lengths minus the angle with clearance in the {loose}, "
        f"over {outcome.stretch_in_words}. The angle itself varies from {low:.1f} to {high:.1f} deg."
    )


def _lengths(outcome: Outcome) -> Iterator[Block]:
    main, bounds = next(iter(outcome.scenario.optimise.boxes.items()))
    limit, (low, high) = outcome.scenario.optimise.ratio_limit, bounds.rod_length
    (crank, rod), (new_crank, new_rod) = outcome.original, outcome.lengths
    rows = [
        (
            f"{words} length [mm]",
            _fixed(MM * before, 3),
            _fixed(MM * after, 3),
            _signed(MM * (after - before), 3),
            _signed(100 * (after / before - 1), 2),
            f"{MM * least:g} to {MM * most:g}",
        )
        for words, before, after, (least, most) in (
            ("crank", crank, new_crank, bounds.crank_length),
            ("rod", rod, new_rod, bounds.rod_length),
        )
    ]
    ratio, new_ratio = crank / rod, new_crank / new_rod
    change = _signed(new_ratio - ratio, 5), _signed(100 * (new_ratio / ratio - 1), 2)
    rows.append(
        (
            "crank over rod [1]",
            f"{ratio:.5f}",
            f"{new_ratio:.5f}",
            *change,
            "–" if limit is None else f"up to {limit:g}",
        )
    )
    yield TableBlock(("", "before", "after", "change", "change [%]", f"searched (box {main})"), tuple(rows), "lrrrrr")
    if not outcome.bounds and outcome.keeps_force:
        kept = " The crank keeps its length; `optimise.boxes` lets both vary." if outcome.keeps_crank else ""
        yield Paragraph(f"No bound is active.{kept}")
    floor = outcome.frames["optimise_floor"]
    floor = floor[(floor["source"] == outcome.chosen["source"]) & (floor["box"] == main) & (floor["measure"] == "rms")]
    ratios, reductions = floor["ratio"], floor["reduction"]
    yield Paragraph(
        f"The ratio determines the error. With frozen joint motion and the best crank for each rod from {MM * low:g} "
        f"to {MM * high:g} mm, the ratio is {ratios.min():.5f} to {ratios.max():.5f} and the RMS error falls by "
        f"{100 * reductions.min():.1f} to {100 * reductions.max():.1f} %"
        + (": all these pairs are equally good." if np.ptp(reductions) <= _AS_WELL else ".")
    )


def _gains(outcome: Outcome) -> Iterator[Block]:
    rows = []
    for stretch in (outcome.stretch, *({"settled", "window"} - {outcome.stretch})):
        for measure, words in _MEASURES.items():
            gain = outcome.gains[stretch, measure]
            low, high = sorted((-100 * gain.low, -100 * gain.high))
            rows.append(
                (
                    f"{words}, {outcome.words_of(stretch)}",
                    *_alike(math.degrees(gain.before), math.degrees(gain.after)),
                    f"{-100 * gain.reduction:+.1f}",
                    f"{low:+.1f} to {high:+.1f}",
                    f"{-100 * gain.frozen:+.1f}",
                    f"{100 * gain.share_better:.0f}",
                )
            )
    heads = ("error", "before [deg]", "after [deg]", "simulated again [%]", "5 to 95 % [%]", "frozen [%]")
    yield TableBlock((*heads, "improved in [% of run pairs]"), tuple(rows), "lrrrrrr")
    yield Paragraph(
        "Simulated again: the result that counts, medians and spread over pairs of "
        f"{outcome.frames['optimise_resimulated']['members'].iloc[0]} runs from perturbed starts for each pair of "
        "lengths. Frozen: estimate with unchanged joint motion."
    )


def _side_effects(outcome: Outcome) -> Iterator[Block]:
    applied = outcome.scenario.mechanism.applied()
    cycles = outcome.cycle("simulated")
    ideal = [ideal_cycle(*lengths, applied.slider.offset) for lengths in (outcome.original, outcome.lengths)]
    angles = ("outer_dead_centre_angle", "inner_dead_centre_angle")
    rows = [
        _change("stroke [mm]", *(MM * cycle["stroke"] for cycle in cycles)),
        _change("stroke without clearance [mm]", *(MM * cycle.stroke for cycle in ideal)),
        *(
            _change(f"{side} dead centre, slider at [mm]", *(MM * cycle[f"{side}_dead_centre"] for cycle in cycles))
            for side in ("outer", "inner")
        ),
        *(
            _change(
                f"{name[:5]} dead centre, crank at [deg]", *(math.degrees(getattr(one, name)) for one in ideal), False
            )
            for name in angles
        ),
        _change(
            "smallest transmission angle [deg]",
            *(math.degrees(cycle["smallest_transmission_angle"]) for cycle in cycles),
            relative=False,
        ),
        *(
            _change(f"{words} in the {in_words(joint)} [N]", *(load[key] for load in outcome.load(joint)))
            for joint in FROM_FRAME
            for key, words in (("peak_force", "largest force"), ("rms_force", "RMS force"))
        ),
        *(
            _change(
                f"share of time in contact, {in_words(joint)} [%]",
                *(100 * load["contact_share"] for load in outcome.load(joint)),
                relative=False,
            )
            for joint in FROM_FRAME
            if joint in applied.loose
        ),
    ]
    yield TableBlock(("", "before", "after", "change", "change [%]"), tuple(rows), "lrrrr")
    yield Paragraph(
        "Medians over the runs with clearance, over a settled revolution. Crank angles of the dead centres: without "
        "clearance, from the slide's direction. Forces come from inertia and from the effects listed in the "
        "mechanism file; list gas pressure or a load there."
    )


def _change(words: str, before: float, after: float, relative: bool = True) -> tuple[str, ...]:
    """A row; where it is `relative`, with the change in percent."""
    old, new = _alike(before, after)
    changed = _signed(100 * (after / before - 1), 1) if relative and before else "–"
    return words, old, new, _signed(float(new) - float(old), len(old.partition(".")[2])), changed


def _constraints(outcome: Outcome) -> Iterator[Block]:
    """The constraints on the lengths besides their bounds."""
    options, lengths = outcome.scenario.optimise.constraints, (outcome.original, outcome.lengths)
    rows = [
        (
            each.words,
            each.asked(),
            *(each.show(float(each.value(at))) for at in lengths),
            _met(each.missed(outcome.lengths) <= MET),
        )
        for each in geometric(options, outcome.scenario.mechanism.applied().slider.offset)
        if not (each.key == "crank_length" and outcome.keeps_crank)
    ]
    if (most := options.largest_pin_force) is not None:
        forces = (f"{max(forces.values()):.4g} N" for forces in outcome.peak_pin_forces)
        rows.append(("largest force in a pin", f"{most:.4g} N at most", *forces, _met(outcome.keeps_force)))
    if rows:
        yield Heading("Constraints")
        yield TableBlock(("", "required", "before", "after", "met"), tuple(rows), "lrrrl")
        yield Paragraph("Lengths and angles without clearance; forces simulated with clearance.")


def _met(met: bool) -> Cell:
    return Cell("yes", "good") if met else Cell("no", "bad")


def _motions(outcome: Outcome) -> Iterator[Block]:
    optima, again = outcome.frames["optimise_optima"], outcome.frames["optimise_resimulated"]
    again = again[again["measure"] == "rms"].set_index(["point", "stretch"])
    rows = []
    for source, point in outcome.found.items():
        lengths = optima[(optima["source"] == source) & (optima["point"] == point)].iloc[0]
        rows.append(
            (
                f"{MOTIONS[source]}{' (chosen)' if source == outcome.chosen['source'] else ''}",
                *(f"{MM * lengths[key]:.3f}" for key in ("crank_length", "rod_length")),
                *(_spread(again.loc[point, stretch]) for stretch in ("settled", "window")),
            )
        )
    yield Paragraph(
        "The search uses frozen joint motion from several sources. The lengths with the smallest re-simulated RMS "
        f"error over {outcome.stretch_in_words} are chosen."
    )
    errors = (f"RMS error, {outcome.words_of(stretch)} [%]" for stretch in ("settled", "window"))
    yield TableBlock(("motion from", "crank [mm]", "rod [mm]", *errors), tuple(rows), "lrrrr")


def _spread(row: pd.Series) -> str:
    low, high = sorted((-100 * row["reduction_low"], -100 * row["reduction_high"]))
    return f"{-100 * row['reduction']:+.1f} ({low:+.1f} to {high:+.1f})"
