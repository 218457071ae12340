"""The summary page of a scenario."""

import math
from collections.abc import Iterator

import numpy as np

from jointgap.config import Scenario
from jointgap.core.facts import changes
from jointgap.core.page import (
    Block,
    Bullets,
    Cell,
    FigureBlock,
    Heading,
    Link,
    Page,
    Paragraph,
    TableBlock,
)
from jointgap.core.words import format_falls, format_name, format_range, joined, number
from jointgap.lengths.region import FEASIBLE, regions
from jointgap.paper.printed import departures
from jointgap.scenario.chosen_lengths import (
    MOTIONS,
    ChosenLengths,
    details,
    headline,
    interval,
    length_facts,
    percent,
    remarks,
    side_effects,
)
from jointgap.scenario.figures import FIGURES, described

EQUIVALENT = 0.02  # spread of the reduction along the valley below which its points are equivalent
_ERRORS = {"rms": "root mean square (RMS)", "mean_absolute": "mean absolute", "peak": "peak"}
_FIGURES = ("valley", "resimulation", "contact_forces", "orbits")


def page(optimum: ChosenLengths, name: str, repeat_until: float = math.inf) -> Page:
    """The summary page; samples of the motion repeat until a crank angle after the start [rad]."""
    scenario = optimum.scenario
    is_feasible = optimum.status != "infeasible"
    result = [*_constraints(optimum)]
    if is_feasible:
        result = [*_lengths(optimum), *_gains(optimum), *_side_effects(optimum), *result]
    links = [
        Link("Impacts, interactive", "figures/impacts.html", ": gaps, contact forces and modes"),
        Link("All figures", "figures", " (PNG, SVG, and the plotted data as Parquet)"),
        Link("Results as JSON", "summary.json"),
        Link("Tables of the search", "optimise", "; `jointgap describe FILE` explains the columns"),
    ]
    if scenario.paper and not departures(scenario.mechanism, scenario.simulate):
        links.insert(0, Link("Comparison with the paper", "comparison.html"))
    figures = (name for name in _FIGURES if is_feasible or FIGURES[name].category != "Optimum")
    blocks: list[Block] = [
        Paragraph(details(optimum), strong=True),
        _figure("animation", scenario),
        *([Paragraph(scenario.description)] if scenario.description else []),
        Paragraph(repeatability(repeat_until)),
        Heading("Check before you use this" if is_feasible else "Next steps"),
        Bullets(remarks(optimum)),
        *result,
        Heading("Figures"),
        *(_figure(figure, scenario) for figure in figures),
        Heading("Files"),
        Bullets(tuple(links)),
    ]
    return Page(headline(optimum), tuple(blocks), subject=f"Scenario {name}", width="60rem")


def repeatability(repeat_until: float) -> str:
    """A sentence on the crank angle after the start [rad] until which samples repeat."""
    if math.isinf(repeat_until):
        return "All samples of the motion are reproducible by other codes and on other machines."
    return (
        "Samples of the motion are reproducible by other codes and on other machines up to"
        f" {math.degrees(repeat_until):.0f} deg after the start; later only statistics are."
    )


def _figure(name: str, scenario: Scenario) -> FigureBlock:
    spec = described(name, scenario)
    title = f"{spec.title}, original lengths" if spec.category == "Contact" else spec.title
    return FigureBlock(name, title, spec.caption, spec.moving)


def _lengths(optimum: ChosenLengths) -> Iterator[Block]:
    options = optimum.scenario.optimise
    yield Heading("Lengths")
    yield changes(length_facts(optimum))
    searched = regions(optimum.scenario.mechanism.applied(), options)[optimum.box].searched
    cranks, rods = (text if text == "fixed" else f"{text} mm" for text in searched)
    ratio = "" if options.ratio_limit is None else f", crank over rod up to {options.ratio_limit:g}"
    active = " No bound is active." if optimum.status == "optimal" and not optimum.bounds else ""
    source = MOTIONS[optimum.row["source"]] if optimum.is_found else "no converged search"
    yield Paragraph(
        f"Searched (box {optimum.box}): crank {cranks}, rod {rods}{ratio}.{active}"
        f" Motion used by the search: {source}. Of all searches these lengths have the smallest"
        f" re-simulated {optimum.objective_label} over {optimum.stretch_label(optimum.stretch)}."
    )
    floor = optimum.tables["optimise_floor"]
    floor = floor[(floor["source"] == optimum.row["source"]) & (floor["box"] == optimum.box)]
    if floor.empty or not optimum.is_of_angle:  # empty: the search did not converge
        return
    floor = floor[floor["measure"] == "rms"]
    ratios = format_range(f"{floor['ratio'].min():.5f}", f"{floor['ratio'].max():.5f}")
    is_flat = np.ptp(floor["reduction"]) <= EQUIVALENT
    yield Paragraph(
        "The error depends on the ratio only. With frozen joint motion and the best crank for each"
        f" rod, the ratio is {ratios}. The RMS error {format_falls(100 * floor['reduction'])}"
        f"{': all these pairs are equivalent' if is_flat else ''}."
    )


def _gains(optimum: ChosenLengths) -> Iterator[Block]:
    yield Heading("Gain")
    stretches = optimum.stretch, "window" if optimum.stretch == "settled" else "settled"
    rows = {
        f"{label}, {optimum.stretch_label(stretch)}": (stretch, measure, "deg", np.degrees(1.0))
        for stretch in stretches
        for measure, label in _ERRORS.items()
    }
    goal, about = optimum.goal, "Frozen: estimate with unchanged joint motion."
    if not optimum.is_of_angle:
        place = optimum.stretch, goal.measure, goal.unit, goal.factor
        rows = {f"{goal.words}, {optimum.stretch_label(optimum.stretch)}": place} | rows
        about = f"{goal.words.capitalize()}: {goal.definition}; frozen: estimate of the search."
    cells = []
    for label, (stretch, measure, unit, factor) in rows.items():
        gain = optimum.gains.loc[(stretch, measure)]
        cells.append(
            {
                "objective or error": label,
                "unit": unit,
                "before": number(factor * gain["original_error"]),
                "after": number(factor * gain["error"]),
                "simulated again [%]": percent(gain["reduction"]),
                "5 to 95 % [%]": interval(gain),
                "frozen [%]": percent(gain["frozen_reduction"]),
                "improved in [% of run pairs]": f"{100 * gain['share_better']:.0f}",
            }
        )
    yield TableBlock.of(cells, "llrrrrrr")
    loose = joined(map(format_name, optimum.scenario.mechanism.applied().loose))
    yield Paragraph(
        "Errors are those of the transmission angle, which is the angle between the rod and the"
        " normal to the slide: the angle without"
        f" clearance at the original lengths minus the angle with clearance in the {loose}."
        " Simulated again: the result that counts; median and spread over"
        f" {optimum.gains['members'].iloc[0]} pairs of runs with perturbed starts. {about}"
    )


def _side_effects(optimum: ChosenLengths) -> Iterator[Block]:
    yield Heading("Side effects")
    yield changes(side_effects(optimum))
    yield Paragraph(
        "Medians over the runs with clearance, for a settled revolution. Forces include inertia"
        " and the effects listed in the mechanism file; gas pressure and external loads count only"
        " if listed there."
    )


def _constraints(optimum: ChosenLengths) -> Iterator[Block]:
    """Constraints besides the bounds of the lengths."""
    is_feasible = optimum.status != "infeasible"
    rows = [
        (
            constraint.words,
            constraint.range_text(),
            *(
                constraint.show(float(constraint.value(at)))
                for at in (optimum.original, optimum.lengths)
            ),
            constraint.violation(optimum.lengths) <= FEASIBLE,
        )
        for constraint in optimum.constraints
    ]
    if not math.isinf(optimum.force_limit):
        forces = (f"{number(force)} N" for force in optimum.peak_force)
        limit = f"{number(optimum.force_limit)} N at most"
        rows.append(("largest force in a pin", limit, *forces, is_feasible))
    if rows:
        yield Heading("Constraints")
        cells = tuple(
            (*texts, Cell("yes", "good") if is_met else Cell("no", "bad"))
            for *texts, is_met in rows
        )
        result = "after" if is_feasible else "smallest force"
        yield TableBlock(("", "required", "before", result, "met"), cells, "lrrrl")
        yield Paragraph("Lengths and angles without clearance; forces simulated with clearance.")
