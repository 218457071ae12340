"""The study of robust lengths: main result, tables and figures."""

from collections.abc import Iterator

import numpy as np

from jointgap.config import Scenario
from jointgap.core.facts import Fact
from jointgap.core.page import FigureBlock, TableBlock
from jointgap.core.plot import Drawing, Quantity, Sheet
from jointgap.core.words import format_name, percent
from jointgap.designs.figures import parameter_table
from jointgap.designs.optimise_robust import (
    COMPARED,
    RobustOptimum,
    best_of,
    format_objective,
)
from jointgap.designs.study import (
    Study,
    fact_table,
    facts_of_rows,
    format_interval,
)

_MDEG = 1e3 * 180.0 / np.pi
"""Thousandths of a degree in a radian."""

_LOOKS = {
    "original": ("original lengths", "ideal"),
    "frozen": ("frozen motion (as in the paper)", "paper"),
    "nominal": ("best at nominal values", "network"),
    "robust": ("robust optimum", "simulation"),
}
"""Label and colour of each pair of lengths."""

_SECTIONS = {
    "optimise_robust_lengths": "{lengths}/",
    "optimise_robust_gains": "{lengths} beside {beside}/",
    "optimise_robust_constraints": "{lengths} keeps {constraint}/",
}
_ERROR_COLUMNS = ("error_mean", "error_deviation", "error_measure", "error_quantile_95")
_LOAD_COLUMNS = ("force_mean", "force_deviation", "stroke_mean", "stroke_deviation")
_GAIN_COLUMNS = ("probability", "mean_fall", "measure_fall")
_HEADS = {
    "asked": "required",
    "probability": "share of the samples",
    "error_measure": "error, objective",
    "mean_fall": "reduction of the mean",
    "measure_fall": "reduction of the objective",
}


def robust_study(optimum: RobustOptimum, scenario: Scenario, name: str) -> Study:
    """The study of the robust lengths of the scenario `name`."""
    facts: dict[str, Fact] = {}
    for table, frame in optimum.frames.items():
        if section := _SECTIONS.get(table.name):
            facts |= facts_of_rows(table, frame, section)
    figure = FigureBlock("robust_errors", "Error in the validation samples")
    sentences = " ".join(_sentences(optimum, facts))
    result = Fact("is_feasible", optimum.is_feasible, sentence=sentences)
    return Study(
        _headline(optimum, facts),
        [result, *facts.values()],
        _introduction(optimum, scenario),
        tuple(_tables(optimum, facts)),
        _method(optimum),
        {figure: lambda: _draw_errors(optimum)},
        optimum.frames,
        f"{name}: robust lengths",
    )


def _label(optimum: RobustOptimum, name: str) -> str:
    if name == "robust" and not optimum.is_feasible:
        return "nearest to the constraints"
    return _LOOKS[name][0]


def _short(name: str) -> str:
    """``crank`` of ``crank_length``, ``rocker`` of ``rocker.length``, ``frame C x``."""
    return name.removesuffix("_length").removesuffix(".length").replace(".", " ")


def _headline(optimum: RobustOptimum, facts: dict[str, Fact]) -> str:
    """The result in one line."""
    best = 1e3 * best_of(optimum.robust_candidates)[optimum.problem.names]
    lengths = ", ".join(f"{_short(name)} {length:.2f} mm" for name, length in best.items())
    reduction = facts["robust beside original/measure_fall"]
    if not optimum.is_feasible:
        return f"No candidate satisfies the constraints; nearest: {lengths}"
    if reduction.low > 0.0:
        objective = format_objective(optimum.problem.options)
        return (
            f"{lengths[0].upper()}{lengths[1:]}: the error ({objective}) falls by"
            f" {format_interval(reduction)} %"
        )
    return "No significant improvement: keep the original lengths"


def _sentences(optimum: RobustOptimum, facts: dict[str, Fact]) -> Iterator[str]:
    """The result in a few sentences."""
    objective = format_objective(optimum.problem.options)
    if not optimum.is_feasible:
        yield "No robust optimum: widen the bounds of the lengths, or relax a constraint."
    for name in ("robust", "nominal") if optimum.is_feasible else ():
        probability, mean, reduction = (
            format_interval(facts[f"{name} beside original/{column}"]) for column in _GAIN_COLUMNS
        )
        yield (
            f"{_LOOKS[name][0].capitalize()}: the error of the transmission angle ({objective})"
            f" falls by {reduction} %, its mean by {mean} %. It is smaller than with the original"
            f" lengths in {probability} % of the samples."
        )
    reduction = facts["robust beside original/measure_fall"]
    if optimum.is_feasible and reduction.high <= 0.0:
        yield "Keep the original lengths: the best lengths found are worse."
    elif optimum.is_feasible and reduction.low <= 0.0:
        yield "Keep the original lengths: the improvement is not significant."
    violated = optimum.constraints.query("lengths == 'robust' and probability_high < asked")
    for key, required in zip(violated["constraint"], violated["asked"], strict=True):
        share = format_interval(facts[f"robust keeps {key}/probability"])
        yield (
            f"The constraint {key} holds in {share} % of the samples; {percent(required, 0)} are"
            " required."
        )


def _introduction(optimum: RobustOptimum, scenario: Scenario) -> str:
    options, draws = scenario.optimise_robust, optimum.lengths["draws"].iloc[0]
    revolution = (scenario.optimise_linkage or scenario.optimise).ensemble.settled_revolution
    return (
        f"{draws} validation samples, independent of the search and common to all lengths"
        f" ({options.fresh_draws - draws} more failed and are excluded). The error is the RMS over"
        f" revolution {revolution} of the transmission angle of the original lengths without"
        " clearance, minus that of the simulated motion. The objective is its"
        f" {format_objective(options)}. In brackets: 95 % intervals (bootstrap; exact for"
        " probabilities)."
    )


def _method(optimum: RobustOptimum) -> str:
    options, region = optimum.problem.options, optimum.problem.region
    candidates, names = optimum.robust_candidates, optimum.problem.names
    best = best_of(candidates.dropna(subset="error"))[names]
    pairs = zip(map(_short, names), region.searched, strict=True)
    ranges = ", ".join(f"{name} {ends}" for name, ends in pairs)
    return (
        f"{len(candidates)} sets of lengths (searched in mm: {ranges}), each"
        f" simulated in the same {options.draws} samples (scrambled Sobol sequence, seed"
        f" {options.seed}). Search: a grid, then differential evolution. Active limits:"
        f" {region.active(best.to_numpy(dtype=float))}. All numbers are in the Parquet files next"
        " to this page; `jointgap describe FILE` explains their columns."
    )


def _tables(optimum: RobustOptimum, facts: dict[str, Fact]) -> Iterator[TableBlock]:
    labels, words = {name: _label(optimum, name) for name in COMPARED}, optimum.problem.words
    stroke, force = words.get("stroke", "stroke"), "joint force" if words else "pin force"

    def head(column: str) -> str:
        words = _HEADS.get(column) or format_name(column)
        return words.replace("stroke", stroke.partition(" ")[0])

    def row(label: str, prefix: str, columns: tuple[str, ...]) -> list[tuple[str, str, Fact]]:
        row_facts = [(column, facts[prefix + column]) for column in columns]
        return [(label, f"{head(column)} [{fact.unit}]", fact) for column, fact in row_facts]

    for caption, columns in (
        (
            "Error of the transmission angle in the validation samples",
            (*optimum.problem.names, *_ERROR_COLUMNS),
        ),
        (f"Largest {force}, and simulated {stroke}", _LOAD_COLUMNS),
    ):
        cells = [cell for name in COMPARED for cell in row(labels[name], f"{name}/", columns)]
        yield fact_table(cells, caption)
    cells = []
    for name, reference in zip(optimum.gains["lengths"], optimum.gains["beside"], strict=True):
        label = f"{labels[name]}, compared with {labels[reference]}"
        cells += row(label, f"{name} beside {reference}/", _GAIN_COLUMNS)
    yield fact_table(cells, "Share of the samples with a smaller error, and its reduction", 3)
    if len(optimum.constraints):
        problem, cells = optimum.problem, []
        limits = {limit.key: f"{limit.words} {limit.range_text()}" for limit in problem.ranges}
        force = problem.constraints.largest_pin_force or 0
        limits["largest_pin_force"] = f"largest pin force {force:g} N at most"
        for key, name in zip(
            optimum.constraints["constraint"], optimum.constraints["lengths"], strict=True
        ):
            label = f"{limits[key]}: {labels[name]}"
            cells += row(label, f"{name} keeps {key}/", ("asked", "probability"))
        yield fact_table(cells, "Share of the samples that satisfy the constraints", 3)
    yield parameter_table(optimum.uncertain.axes, optimum.fresh)


def _draw_errors(optimum: RobustOptimum) -> Drawing:
    """Distribution of the error over the samples, and of its reduction per sample."""
    sheet, share = Sheet(4.0, 1, 2), Quantity("share of the samples", "%")
    errors = optimum.fresh.pivot(index="draw", columns="lengths", values="error").dropna()
    errors *= _MDEG
    quantity = Quantity("RMS error of the transmission angle", "mdeg")
    error_panel = sheet.panel((0, 0), "error", quantity, share)
    quantity = Quantity("reduction of the error", "mdeg")
    reduction_panel = sheet.panel((0, 1), quantity.name, quantity, share)
    shares = 100.0 * np.arange(1, len(errors) + 1) / len(errors)
    for name, (_, colour) in _LOOKS.items():
        label = _label(optimum, name)
        style = {"linewidth": 1.8 if name == "robust" else 1.2}
        style |= {"linestyle": "--" if name == "nominal" else "-"}
        error_panel.line(label, np.sort(errors[name]), shares, colour, **style)
        if name != "original":
            reduction = np.sort(errors["original"] - errors[name])
            reduction_panel.line(label, reduction, shares, colour, **style)
    reduction_panel.vertical_line("no gain", 0.0)
    error_panel.axes.set(xlim=(0.0, None), ylim=(0.0, 100.0))
    reduction_panel.axes.set_ylim(0.0, 100.0)
    sheet.legend()
    return sheet.drawing()
