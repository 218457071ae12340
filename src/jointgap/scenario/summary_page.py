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


def page(chosen: ChosenLengths, name: str, repeat_until: float = math.inf) -> Page:
    """The summary page; samples of the motion repeat until a crank angle after the start [rad]."""
    scenario = chosen.scenario
    is_feasible = chosen.status != "infeasible"
    result = [*_constraints(chosen)]
    if is_feasible:
        result = [*_lengths(chosen), *_gains(chosen), *_side_effects(chosen), *result]
        result += _motions(chosen) if chosen.best_points else []
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
        Paragraph(details(chosen), strong=True),
        _figure("animation", scenario),
        *([Paragraph(scenario.description)] if scenario.description else []),
        Paragraph(repeatability(repeat_until)),
        Heading("Check before you use this" if is_feasible else "Next steps"),
        Bullets(remarks(chosen)),
        *result,
        Heading("Figures"),
        *(_figure(figure, scenario) for figure in figures),
        Heading("Files"),
        Bullets(tuple(links)),
    ]
    return Page(headline(chosen), tuple(blocks), subject=f"Scenario {name}", width="60rem")


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


def _lengths(chosen: ChosenLengths) -> Iterator[Block]:
    options = chosen.scenario.optimise
    yield Heading("Lengths")
    yield changes(length_facts(chosen))
    searched = regions(chosen.scenario.mechanism.applied(), options)[chosen.box].searched
    cranks, rods = (text if text == "fixed" else f"{text} mm" for text in searched)
    ratio = "" if options.ratio_limit is None else f", crank over rod up to {options.ratio_limit:g}"
    active = " No bound is active." if chosen.status == "optimal" and not chosen.bounds else ""
    yield Paragraph(f"Searched (box {chosen.box}): crank {cranks}, rod {rods}{ratio}.{active}")
    floor = chosen.tables["optimise_floor"]
    floor = floor[(floor["source"] == chosen.row["source"]) & (floor["box"] == chosen.box)]
    if floor.empty or not chosen.is_of_angle:  # empty: the search did not converge
        return
    floor = floor[floor["measure"] == "rms"]
    ratios = format_range(f"{floor['ratio'].min():.5f}", f"{floor['ratio'].max():.5f}")
    is_flat = np.ptp(floor["reduction"]) <= EQUIVALENT
    yield Paragraph(
        "The error depends on the ratio only. With frozen joint motion and the best crank for each"
        f" rod, the ratio is {ratios}. The RMS error {format_falls(100 * floor['reduction'])}"
        f"{': all these pairs are equivalent' if is_flat else ''}."
    )


def _gains(chosen: ChosenLengths) -> Iterator[Block]:
    yield Heading("Gain")
    stretches = chosen.stretch, "window" if chosen.stretch == "settled" else "settled"
    rows = {
        f"{label}, {chosen.stretch_label(stretch)}": (stretch, measure, "deg", np.degrees(1.0))
        for stretch in stretches
        for measure, label in _ERRORS.items()
    }
    goal, about = chosen.goal, "Frozen: estimate with unchanged joint motion."
    if not chosen.is_of_angle:
        place = chosen.stretch, goal.measure, goal.unit, goal.factor
        rows = {f"{goal.words}, {chosen.stretch_label(chosen.stretch)}": place} | rows
        about = f"{goal.words.capitalize()}: {goal.definition}; frozen: estimate of the search."
    cells = []
    for label, (stretch, measure, unit, factor) in rows.items():
        gain = chosen.gains.loc[(stretch, measure)]
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
    loose = joined(map(format_name, chosen.scenario.mechanism.applied().loose))
    yield Paragraph(
        f"{'Errors' if chosen.is_of_angle else 'Other errors'} are those of the transmission angle,"
        " which is the angle between the rod and the normal to the slide: the angle without"
        f" clearance at the original lengths minus the angle with clearance in the {loose}."
        " Simulated again: the result that counts; median and spread over"
        f" {chosen.gains['members'].iloc[0]} pairs of runs with perturbed starts. {about}"
    )


def _side_effects(chosen: ChosenLengths) -> Iterator[Block]:
    yield Heading("Side effects")
    yield changes(side_effects(chosen))
    yield Paragraph(
        "Medians over the runs with clearance, for a settled revolution. Forces include inertia"
        " and the effects listed in the mechanism file; gas pressure and external loads count only"
        " if listed there."
    )


def _constraints(chosen: ChosenLengths) -> Iterator[Block]:
    """Constraints besides the bounds of the lengths."""
    is_feasible = chosen.status != "infeasible"
    rows = [
        (
            constraint.words,
            constraint.range_text(),
            *(
                constraint.show(float(constraint.value(at)))
                for at in (chosen.original, chosen.lengths)
            ),
            constraint.violation(chosen.lengths) <= FEASIBLE,
        )
        for constraint in chosen.constraints
    ]
    if not math.isinf(chosen.force_limit):
        forces = (f"{number(force)} N" for force in chosen.peak_force)
        limit = f"{number(chosen.force_limit)} N at most"
        rows.append(("largest force in a pin", limit, *forces, is_feasible))
    if rows:
        yield Heading("Constraints")
        cells = tuple(
            (*texts, Cell("yes", "good") if is_met else Cell("no", "bad"))
            for *texts, is_met in rows
        )
        after = "after" if is_feasible else "smallest force"
        yield TableBlock(("", "required", "before", after, "met"), cells, "lrrrl")
        yield Paragraph("Lengths and angles without clearance; forces simulated with clearance.")


def _motions(chosen: ChosenLengths) -> Iterator[Block]:
    yield Heading("Motion used by the search")
    optima = chosen.tables["optimise_optima"].set_index(["source", "point"])
    gains = chosen.tables["optimise_resimulated"].query(f"measure == {chosen.goal.measure!r}")
    gains = gains.set_index(["point", "stretch"])
    rows = []
    for source, point in chosen.best_points.items():
        lengths = optima.loc[(source, point)]
        is_chosen = " (chosen)" if source == chosen.row["source"] else ""
        row = {
            "motion from": f"{MOTIONS[source]}{is_chosen}",
            "crank [mm]": f"{1e3 * lengths['crank_length']:.3f}",
            "rod [mm]": f"{1e3 * lengths['rod_length']:.3f}",
        }
        for stretch in ("settled", "window") if chosen.is_of_angle else ("settled",):
            gain = gains.loc[(point, stretch)]
            head = f"{chosen.objective_label}, {chosen.stretch_label(stretch)} [%]"
            row[head] = f"{percent(gain['reduction'])} ({interval(gain)})"
        rows.append(row)
    motion = "one simulation for each pair of lengths on a grid"
    if chosen.is_of_angle:
        motion = "frozen joint motion from several sources"
    yield Paragraph(
        f"The search uses {motion}. The result is the pair of lengths with the smallest"
        f" re-simulated {chosen.objective_label} over {chosen.stretch_label(chosen.stretch)}."
    )
    yield TableBlock.of(rows, "l" + "r" * (len(rows[0]) - 1))
