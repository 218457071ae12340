"""Robust lengths in plain words: whether a change is worth it, what it costs, and how sure that is."""

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.page import Block, Cell, FigureBlock, Heading, Page, Paragraph, TableBlock, written_today
from jointgap.core.words import joined, percent, reading_unit, unit_in_words
from jointgap.designs.words_of_designs import parameter_in_words
from jointgap.robust_lengths.optimise_robust import COMPARED, RobustOptimum
from jointgap.robust_lengths.robust_figures import LOOKS, MDEG, TITLES, has_map
from jointgap.robust_lengths.search_lengths import best_of
from jointgap.robust_lengths.uncertain_draws import LENGTHS, law_in_words

_WORDS = {name: words for name, (words, _, _) in LOOKS.items()}
_MINUS = str.maketrans("-", "\N{MINUS SIGN}")
_FRONT_ROWS = 9
_CAPTIONS = {
    "robust_front": "Each dot is a pair of lengths in all draws of the search. Of the front no lengths are better in "
    "error, force and change of the stroke at once; the best of one alone are the ends.",
    "robust_errors": "Left: which share of the fresh draws has an error below a value. Right: by how much it falls "
    "against the original lengths in the same draw; what lies left of the line is no gain.",
    "robust_map": "In the draws of the search: a surface through the candidates (dots), exact at these alone. White: "
    "beyond the limit of the ratio.",
}


def page(found: RobustOptimum, scenario: Scenario, name: str) -> Page:
    """The page of robust lengths."""
    blocks: list[Block] = [Paragraph(sentence, strong=True) for sentence in verdict(found)]
    blocks += [Heading("Side by side"), Paragraph(_what_is_compared(found, scenario)), *_side_by_side(found)]
    blocks += [Heading("Is it a gain at all?"), _gains(found), _figure("robust_errors")]
    if len(found.comparison.constraints):
        blocks += [Heading("Constraints"), *_constraints(found)]
    blocks += [Heading("What is traded"), *_front(found)]
    blocks += [_figure("robust_map")] if has_map(found) else []
    blocks += [Heading("What is uncertain"), _uncertain(found), Heading("How it was found")]
    blocks += [Paragraph(_how(found, scenario)), Paragraph(_files())]
    return Page(headline(found), tuple(blocks), subject=f"{name}: robust lengths", footer=written_today())


def headline(found: RobustOptimum) -> str:
    """What came out, in a line."""
    gain, (crank, rod) = _gain(found, "robust", "original"), _lengths(found, "robust")
    lengths = f"crank {crank:.2f} mm, rod {rod:.2f} mm"
    if _best(found)["missed"] > 0.0 or _best(found)["failed"]:
        return f"No lengths that were tried keep what is asked; nearest: {lengths}"
    if gain["measure_fall_low"] > 0.0:
        change = _changes(gain["measure_fall"], gain["measure_fall_low"], gain["measure_fall_high"])
        return f"{lengths[0].upper()}{lengths[1:]}: the error ({found.asked.measure.words}) {change}"
    return "No change of the lengths is worth it"


def verdict(found: RobustOptimum) -> tuple[str, ...]:
    """What came out, in a few plain sentences."""
    gain, words = _gain(found, "robust", "original"), found.asked.measure.words
    crank, rod = _lengths(found, "robust")
    change = _changes(gain["measure_fall"], gain["measure_fall_low"], gain["measure_fall_high"])
    sentences = [
        f"With a crank of {crank:.2f} mm and a rod of {rod:.2f} mm the error of the transmission angle ({words}) "
        f"{change} against the original lengths, and its mean "
        f"{_changes(gain['mean_fall'], gain['mean_fall_low'], gain['mean_fall_high'])}. In "
        f"{_share(gain, 'probability')} of the cases the change is a gain at all."
    ]
    if gain["measure_fall_low"] <= 0.0:
        sentences.append(
            "So no change is worth it: these are the best lengths that were found, and what they gain cannot be told "
            "from nothing."
            if gain["measure_fall_high"] > 0.0
            else "So no change is worth it: the best lengths that were found are worse than the original ones."
        )
    elif gain["mean_fall_low"] <= 0.0:
        sentences.append("What surely falls are the large errors, not the mean.")
    sentences.append(_of_nominal(found))
    held = found.comparison.constraints
    for row in held[held["lengths"] == "robust"].to_dict("records"):
        if row["probability_high"] < row["asked"]:
            sentences.append(
                f"The constraint {row['constraint']} holds in {_share(row, 'probability')} of the cases, not in the "
                f"{percent(row['asked'], 0)} that are asked for."
            )
    return tuple(sentences)


def _of_nominal(found: RobustOptimum) -> str:
    """What the optimum at nominal values would have done."""
    gain, (crank, rod) = _gain(found, "nominal", "original"), _lengths(found, "nominal")
    change = _changes(gain["measure_fall"], gain["measure_fall_low"], gain["measure_fall_high"])
    beside = _gain(found, "robust", "nominal")
    return (
        f"The lengths that are best at nominal values, {crank:.2f} and {rod:.2f} mm, are a gain in "
        f"{_share(gain, 'probability')} of the cases; with them the error {change}. The robust lengths are better than "
        f"these in {_share(beside, 'probability')} of the cases."
    )


def _changes(fall: float, low: float, high: float) -> str:
    """``falls by 12.1 % (10.0 to 14.2 %)``, or grows."""
    if fall >= 0.0:
        return f"falls by {percent(fall)} ({100 * low:.1f} to {percent(high)})".translate(_MINUS)
    return f"grows by {percent(-fall)} ({-100 * high:.1f} to {percent(-low)})".translate(_MINUS)


def _share(row: dict, name: str) -> str:
    """``87 % (84 to 90 %)`` of a probability with its interval."""
    return f"{percent(row[name], 0)} ({100 * row[f'{name}_low']:.0f} to {percent(row[f'{name}_high'], 0)})"


def _best(found: RobustOptimum) -> pd.Series:
    robust = found.candidates[found.candidates["search"] == "robust"].reset_index(drop=True)
    return robust.iloc[best_of(robust)]


def _gain(found: RobustOptimum, lengths: str, beside: str) -> dict:
    gains = found.comparison.gains
    return gains[(gains["lengths"] == lengths) & (gains["beside"] == beside)].to_dict("records")[0]


def _row(found: RobustOptimum, lengths: str) -> dict:
    frame = found.comparison.lengths
    return frame[frame["lengths"] == lengths].to_dict("records")[0]


def _lengths(found: RobustOptimum, name: str) -> tuple[float, float]:
    """In mm."""
    row = _row(found, name)
    return 1e3 * row["crank_length"], 1e3 * row["rod_length"]


def _what_is_compared(found: RobustOptimum, scenario: Scenario) -> str:
    options, row = scenario.optimise_robust, _row(found, "robust")
    where = (
        f"revolution {scenario.optimise.ensemble.settled_revolution}"
        if options.revolution == "settled"
        else "the window of the first revolution"
    )
    failed = int(np.count_nonzero(~found.comparison.counted))
    return (
        f"On {row['draws']} fresh draws of what is uncertain, which took no part in the search and are the same for "
        f"all lengths. The error is the RMS over {where} of the transmission angle of the original lengths without "
        "clearance, less that of the simulated motion (equation 12). In brackets: 95 % intervals, of statistics by "
        "bootstrap over the draws, of probabilities exact."
        + (
            f" Further draws, {failed} of {failed + row['draws']}, are left out of the statistics, for a simulation "
            "failed with one of the lengths or more; of the constraints they count as missed."
            if failed
            else ""
        )
    )


def _side_by_side(found: RobustOptimum) -> tuple[Block, ...]:
    words, rows = found.asked.measure.words, []
    for name in COMPARED:
        row, (crank, rod) = _row(found, name), _lengths(found, name)
        cells = [_with_interval(row, f"error_{key}", MDEG) for key in ("mean", "deviation", "measure", "quantile_95")]
        rows.append((_WORDS[name], f"{crank:.2f}", f"{rod:.2f}", *cells))
    heads = ("lengths", "crank [mm]", "rod [mm]", "mean", "standard deviation", words, "95 % quantile")
    errors = TableBlock(heads, tuple(rows), "lrrrrrr", caption="Error of the transmission angle [mdeg]")
    rows = []
    for name in COMPARED:
        row = _row(found, name)
        force = [_with_interval(row, f"force_{key}", 1.0) for key in ("mean", "deviation", "quantile_95")]
        rows.append((_WORDS[name], *force, *(f"{1e3 * row[f'stroke_{key}']:.2f}" for key in ("mean", "deviation"))))
    heads = ("lengths", "force, mean [N]", "standard deviation [N]", "95 % quantile [N]", "stroke, mean [mm]",
             "standard deviation [mm]")  # fmt: skip
    price = TableBlock(heads, tuple(rows), "lrrrrr", caption="Largest force in a pin, and simulated stroke")
    return errors, price


def _with_interval(row: dict, name: str, factor: float) -> str:
    value, low, high = (factor * row[name + suffix] for suffix in ("", "_low", "_high"))
    least = max(abs(high - low), 1e-4 * abs(value), 1e-6)  # where all draws agree there is no width to go by
    digits = max(0, 1 - int(np.floor(np.log10(least))))
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _gains(found: RobustOptimum) -> TableBlock:
    rows = []
    for row in found.comparison.gains.to_dict("records"):
        tone = "good" if row["measure_fall_low"] > 0 else "bad" if row["measure_fall_high"] < 0 else ""
        falls = [" ".join(_percents(row, f"{key}_fall")) for key in ("mean", "measure")]
        words = _WORDS[row["lengths"]], _WORDS[row["beside"]]
        rows.append((*words, _share(row, "probability"), falls[0], Cell(falls[1], tone)))
    heads = (
        "these lengths",
        "beside",
        "smaller error in",
        "mean falls by [%]",
        f"{found.asked.measure.words} falls by [%]",
    )
    return TableBlock(heads, tuple(rows), "llrrl", caption="Draw by draw: how often the error is smaller, and how much")


def _percents(row: dict, name: str) -> tuple[str, str]:
    """``4.6`` and ``(4.3 to 5.0)`` of a share and its interval."""
    value, low, high = (f"{round(100 * row[name + suffix], 1) + 0.0:.1f}" for suffix in ("", "_low", "_high"))
    return value.translate(_MINUS), f"({low} to {high})".translate(_MINUS)


def _constraints(found: RobustOptimum) -> tuple[Block, ...]:
    held, keys = found.comparison.constraints, list(dict.fromkeys(found.comparison.constraints["constraint"]))
    rows = []
    for name in COMPARED:
        cells = []
        for key in keys:
            row = held[(held["lengths"] == name) & (held["constraint"] == key)].to_dict("records")[0]
            tone = "bad" if row["probability_high"] < row["asked"] else ""
            cells.append(Cell(_share(row, "probability"), tone))
        rows.append((_WORDS[name], *cells))
    limits = {each.key: f"{each.words} {each.asked()}" for each in found.asked.uncertain_constraints}
    if (most := found.asked.constraints.largest_pin_force) is not None:
        limits["largest_pin_force"] = f"largest force in a pin {most:g} N at most"
    fixed = [f"{each.words} {each.asked()}" for each in found.asked.region.constraints if each.is_fixed]
    words = (
        f"Asked for in {percent(found.asked.probability, 0)} of the cases: {'; '.join(limits[key] for key in keys)}."
    )
    if fixed:
        words += f" Exact, of the nominal lengths: {'; '.join(fixed)}."
    words += " The paper's way keeps ranges with the nominal lengths alone"
    words += ", and does not know the force." if found.asked.constraints.largest_pin_force is not None else "."
    heads = ("lengths", *(limits[key] for key in keys))
    table = TableBlock(heads, tuple(rows), caption="In which share of the cases it holds")
    return Paragraph(words), table


def _front(found: RobustOptimum) -> tuple[Block, ...]:
    front = found.candidates[found.candidates["on_front"]].sort_values("error")
    if front.empty:
        return (Paragraph("No lengths that were tried keep the constraints, so there is no front."),)
    places = np.unique(np.linspace(0, len(front) - 1, _FRONT_ROWS).round().astype(int))
    rows = tuple(
        (
            f"{1e3 * row.crank_length:.2f}",
            f"{1e3 * row.rod_length:.2f}",
            f"{MDEG * row.error:.2f}",
            f"{row.force:.0f}",
            f"{1e3 * row.stroke_change:.2f}",
        )
        for row in front.iloc[places].itertuples()
    )
    heads = ("crank [mm]", "rod [mm]", "error [mdeg]", "force [N]", "change of the stroke [mm]")
    words = found.asked.measure.words
    told = (
        f"{len(front)} pairs of lengths of which none is better than another in all three: error and largest force in "
        f"a pin ({words}, in the draws of the search), and the change of the stroke without clearance."
    )
    more = f", {len(rows)} of them" if len(rows) < len(front) else ""
    table = TableBlock(heads, rows, "rrrrr", caption=f"The front from the smallest error to the largest{more}")
    return Paragraph(told), table, _figure("robust_front")


def _figure(name: str) -> FigureBlock:
    return FigureBlock(name, TITLES[name], _CAPTIONS[name])


def _uncertain(found: RobustOptimum) -> TableBlock:
    rows = []
    for axis in found.uncertain.axes:
        unit, factor = reading_unit(axis.unit or "1")
        what = parameter_in_words(axis.key) + (", tolerance" if axis.key in LENGTHS else "")
        rows.append((what, "" if unit == "1" else unit_in_words(unit), law_in_words(axis, factor)))
    return TableBlock(("what", "unit", "distribution"), tuple(rows), "lll")


def _how(found: RobustOptimum, scenario: Scenario) -> str:
    options, candidates = scenario.optimise_robust, found.candidates
    tried = int((candidates["search"] == "robust").sum())
    low, high = 1e3 * found.asked.region.lower, 1e3 * found.asked.region.upper
    active, best = found.asked.region.active(np.array(_lengths(found, "robust")) / 1e3), MDEG * _best(found)["error"]
    return (
        f"{tried} pairs of lengths, crank {low[0]:g} to {high[0]:g} mm and rod {low[1]:g} to {high[1]:g} mm, were each "
        f"simulated in the same {options.draws} draws (scrambled Sobol sequence, seed {options.seed}): a grid, then "
        f"differential evolution for the {found.asked.measure.words} of the error, then NSGA-II for the front. In "
        f"these draws it is {best:.2f} mdeg for the robust lengths; the best of many in few draws is "
        "flattered, so fresh draws count. Limits that they lie at: "
        f"{active}. The lengths best at nominal values come from the same search with nothing uncertain; those of the "
        "paper's way from its frozen motion, searched by sequential quadratic programming without networks between."
    )


def _files() -> str:
    files = joined(f"`{name}.parquet`" for name in ("lengths", "gains", "constraints", "candidates", "fresh"))
    return f"All numbers: {files} beside this page; `jointgap describe FILE` explains their columns."
