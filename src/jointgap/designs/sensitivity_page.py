"""What decides, in plain words: which parameter decides which measure, how sure that is, and what is poor."""

from collections import Counter
from typing import Any

import pandas as pd

from jointgap.core.page import Bullets, FigureBlock, Heading, Page, Paragraph, TableBlock
from jointgap.core.words import joined
from jointgap.designs.sensitivity_figures import EFFECTS, INDICES, MAP, of_measure
from jointgap.designs.sensitivity_indices import SensitivityResult
from jointgap.designs.sensitivity_settings import SETTINGS
from jointgap.designs.words_of_designs import measure_in_words, parameter_in_words

_MEANING = (
    "The index of a parameter is the share of a measure's variance over the designs that it decides: alone (first "
    "order), or alone and together with others (total). Where both are alike it acts by itself. Intervals hold 90 %: "
    "they carry which designs the surrogate was trained on, how well it is known what it misses, and what it misses "
    "itself, which may belong to any parameter."
)


def page(found: SensitivityResult) -> Page:
    """The page of what decides a sweep's measures."""
    blocks = [
        Paragraph(_headline(found), strong=True),
        Paragraph(_designs(found)),
        *_decisions(found),
        *_indices(found),
        *_pictures(found),
        *_without(found),
        Heading("How it was found"),
        Paragraph(_method(found)),
        Paragraph(
            "All numbers: `indices.parquet`, `surrogates.parquet` and `main_effects.parquet`; `jointgap describe` "
            "explains their columns. Beside each figure lies what is drawn in it."
        ),
    ]
    return Page("What decides", tuple(blocks))


def _leaders(found: SensitivityResult) -> dict[str, pd.DataFrame]:
    """By measure that has indices: its rows, those of the largest total index first."""
    return {measure: of_measure(found, measure) for measure in found.good}


def _is_sure(ranked: pd.DataFrame) -> bool:
    """Whether the interval of the largest total index lies above that of the next."""
    return len(ranked) < 2 or ranked["total_low"].iloc[0] > ranked["total_high"].iloc[1]


def _headline(found: SensitivityResult) -> str:
    number = int(found.surrogates["mean"].notna().sum())
    if not found.good:
        return f"What decides is not known: none of the {number} measures has a surrogate that is good enough."
    leaders = _leaders(found)
    counted = Counter(ranked["parameter"].iloc[0] for ranked in leaders.values())
    sure = sum(map(_is_sure, leaders.values()))
    first, *others = [(parameter_in_words(key), count) for key, count in counted.most_common()]
    text = f"{first[0][0].upper()}{first[0][1:]} decides {first[1]} of {len(leaders)} measures most"
    if others:
        text += ", " + joined(f"{words} {count}" for words, count in others)
    text += f"; in {sure} of them that is sure."
    if len(leaders) < number:
        text += f" Of {number - len(leaders)} more measures it is not known."
    return text


def _designs(found: SensitivityResult) -> str:
    varied = joined(parameter_in_words(one.axis.key) for one in found.inputs.each)
    share = 100 * found.failed / found.number
    failed = f"{found.failed} failed ({share:.1f} %) and are left out" if found.failed else "none failed"
    return f"From {found.number} designs of the sweep, of which {failed}. Varied: {varied}."


def _interval(row: Any, index: str) -> str:
    return f"{row[index]:.2f} ({row[f'{index}_low']:.2f} to {row[f'{index}_high']:.2f})"


def _decisions(found: SensitivityResult) -> list:
    if not found.good:
        return []
    q2 = found.surrogates.set_index("measure")["q2"]
    rows = []
    for measure, ranked in _leaders(found).items():
        parts = [(parameter_in_words(row["parameter"]), _interval(row, "total")) for _, row in ranked[:2].iterrows()]
        first, second = (*parts, ("–", ""))[:2]
        sure = "sure" if _is_sure(ranked) else "open which of the two"
        rows.append((measure_in_words(measure), *first, *second, sure, f"{q2[measure]:.3f}"))
    heads = ("measure", "decided most by", "total index", "then by", "total index", "order", "Q2")
    caption = (
        "Total index: share of the variance that the parameter takes part in, with its 90 % interval. The order is "
        "sure where the two intervals lie apart. Q2: share of the variance of held-out designs that the surrogate "
        "explains."
    )
    return [TableBlock(heads, tuple(rows), "lllllll", caption)]


def _indices(found: SensitivityResult) -> list:
    if not found.good:
        return []
    caption = "Bars: indices; lines: their 90 % intervals."
    return [Heading("Indices of all measures"), Paragraph(_MEANING), FigureBlock(INDICES, "Sobol indices", caption)]


def _pictures(found: SensitivityResult) -> list:
    blocks = []
    for measure, ranked in _leaders(found).items():
        words = measure_in_words(measure)
        if not blocks:
            blocks += [
                Heading("What the parameters do"),
                Paragraph(
                    "Main effects: mean of the measure where one parameter has a value and the others vary as in the "
                    "sweep, with the 90 % interval of the training alone; parameters with a total index below "
                    f"{SETTINGS.shown_share:g} are left out, and of normal tolerances the outer 1 % on each side. "
                    "Maps: the same for two parameters together."
                ),
            ]
        blocks += [Heading(words, 3), FigureBlock(f"{EFFECTS}_{measure}", f"Main effects: {words}")]
        if len(ranked) > 1:
            two = joined(parameter_in_words(key) for key in ranked["parameter"][:2])
            blocks.append(FigureBlock(f"{MAP}_{measure}", f"Map: {words} over {two}", small=True))
    return blocks


def _without(found: SensitivityResult) -> list:
    # What no design has, such as the impacts of an ideal joint, nobody asks for.
    poor = found.surrogates[found.surrogates["reason"].notna() & found.surrogates["mean"].notna()]
    if poor.empty:
        return []
    rows = tuple((measure_in_words(row["measure"]), row["reason"]) for _, row in poor.iterrows())
    points = []
    if poor["q2"].notna().any():
        points.append(
            "Where the surrogate explains too little, simulate more designs: a larger `sweep.number` of a Sobol "
            "sequence keeps those that are there. Narrower ranges help too."
        )
        points.append(
            "Where more designs do not help, the measure is rough: a design beside another has another number of "
            "impacts. Then no parameter decides a single motion, and only means over several revolutions or starts "
            "(`jointgap ensemble`) can be compared."
        )
    if poor["reason"].str.contains("lack it").any():
        points.append(
            "Where designs lack the measure, the page of the sweep tells why; narrow the ranges to where it is."
        )
    return [
        Heading("Measures without indices"),
        TableBlock(("measure", "why"), rows),
        *([Bullets(tuple(points))] if points else []),
    ]


def _method(found: SensitivityResult) -> str:
    made = found.surrogates[found.surrogates["kind"].notna()]
    if made.empty:
        return "No surrogate was made."
    kinds = joined(f"{count} x {kind}" for kind, count in made["kind"].value_counts(sort=True).items())
    trained, held = int(made["trained"].max()), int(made["held_out"].max())
    return (
        f"A surrogate of each measure (OpenTURNS; {kinds}), trained on up to {trained} designs and judged by {held} "
        "others, held out by chance with a seed. Q2 is 1 less the mean squared error on these over the variance of the "
        f"measure on them; below {SETTINGS.least_q2:g} there are no indices. With S the surrogate's own index, the "
        "interval runs from Q2 S to Q2 S + 1 - Q2, both with 90 % of bootstrap replicates of surrogate and Q2."
    )
