"""What the paper did not say, in plain words: what comes out, for which settings, and what it most likely used."""

from typing import Any

import numpy as np
import pandas as pd

from jointgap.core.page import Bullets, Cell, FigureBlock, Heading, Page, Paragraph, TableBlock
from jointgap.core.words import joined
from jointgap.designs.design_of_experiments import Axis
from jointgap.designs.words_of_designs import parameter_in_words, value_in_words
from jointgap.paper.printed import TRAINING_ITERATIONS, TRAINING_MSE
from jointgap.paper_settings.infer_settings import NUMBERS, InferredSettings, densest
from jointgap.paper_settings.infer_settings_figures import MAP, NUMBERS_FIGURE, POSTERIOR
from jointgap.paper_settings.train_networks import NEAREST, RANDOM

NEAREST_FILE = "nearest_scenario.yaml"
"""Name of the configuration of the nearest settings that a scenario can hold."""

_SHOWN = 8
"""Nearest designs that the page lists."""

_FEW = 30.0
"""Designs' worth of weight below which the posterior is said to be poor: a bin then has four."""


def page(found: InferredSettings, training: pd.DataFrame) -> Page:
    """The page of what the printed numbers tell of the settings."""
    blocks = [
        Paragraph(headline(found), strong=True),
        Paragraph(_told(found)),
        *_numbers(found),
        *_settings(found),
        *_nearest(found),
        *_training(found, training),
        Heading("How it was found"),
        Paragraph(_method(found)),
        Paragraph(
            "All numbers: `numbers.parquet`, `settings.parquet`, `training.parquet` and `designs.parquet`; `jointgap "
            "describe` explains their columns. Beside each figure lies what is drawn in it."
        ),
    ]
    return Page("What the paper did not say", tuple(blocks))


def headline(found: InferredSettings) -> str:
    """What comes out together, and how near, in a sentence or two."""
    number, together = len(found.frame), int(found.frame["together"].sum())
    within = f"within {100 * found.options.within:g} %"
    nearest = _percent(float(found.frame["farthest"].min()))
    if not together:
        return (
            f"The paper's printed numbers come out together for none of {number} designs, {within}; in the nearest one "
            f"the farthest is {nearest} off."
        )
    return (
        f"The paper's printed numbers come out together, {within}, for {together} of {number} designs "
        f"({_percent(found.together)}); in the nearest one none is more than {nearest} off."
    )


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def _told(found: InferredSettings) -> str:
    """Which settings the numbers tell of, and of which they tell nothing."""
    if found.effective_sample_size < _FEW:
        return (
            "Too few designs come near for a posterior: their weight is worth "
            f"{found.effective_sample_size:.0f} designs. Sweep more designs, or allow a larger deviation."
        )
    by_key = {axis.key: axis for axis in found.varied}
    tells = [key for key, is_told in found.moved["told"].items() if is_told]
    silent = [parameter_in_words(key) for key in by_key if key not in tells]
    if not tells:
        return "The printed numbers tell nothing of any setting."
    text = "What the paper most likely used, as far as its program did what this simulation does: "
    text += "; ".join(f"{parameter_in_words(key)}: {_likeliest(found, by_key[key])}" for key in tells) + "."
    if silent:
        text += f" The printed numbers tell nothing of: {joined(silent)}."
    return text


def _likeliest(found: InferredSettings, axis: Axis) -> str:
    """The values of a setting that hold most of the weight."""
    own = found.settings[found.settings["setting"] == axis.key]
    if axis.values is None:
        *ends, weight, drawn = densest(own)
        low, high = (value_in_words(axis, value) for value in ends)
        return f"{low} to {high} ({100 * weight:.0f} %, of the designs {100 * drawn:.0f} %)"
    words = dict(zip(map(str, axis.values), axis.values, strict=True))
    parts = [
        f"{value_in_words(axis, words[row['value']])} {100 * row['posterior']:.0f} %"
        for _, row in own.sort_values("posterior", ascending=False, kind="stable").iterrows()
    ]
    return joined(parts)


def _numbers(found: InferredSettings) -> list:
    rows = []
    for one, (_, row) in zip(NUMBERS, found.numbers.iterrows(), strict=True):
        ranged = f"{one.shown(row['low'])} to {one.shown(row['high'])}"
        rows.append(
            (one.words, one.shown(row["printed"]), _percent(row["share"]), one.shown(row["median"]), ranged,
             one.shown(row["nearest"]))
        )  # fmt: skip
    rows.append(("all together", "", _percent(found.together), "", "", ""))
    heads = ("printed number", "printed", "comes out in", "median design", "5 to 95 % of designs", "nearest design")
    caption = (
        f"A reduction comes out within {100 * found.options.within:g} % of what is printed, the ratio within as much "
        "of its change from the original 0.26596: it lies within a percent of that whatever the settings."
    )
    return [
        Heading("What comes out, alone and together"),
        TableBlock(heads, tuple(rows), "lrrrrr", caption),
        FigureBlock(
            NUMBERS_FIGURE,
            "Two of the printed numbers in every design",
            "Axes end where 0.2 % of the designs lie beyond. Along the valley all three reductions follow from one.",
            small=True,
        ),
    ]


def _settings(found: InferredSettings) -> list:
    rows = []
    moved = found.moved
    by_key = {axis.key: axis for axis in found.varied}
    for key, measured in moved.iterrows():
        axis = by_key[key]
        drawn = (
            joined(value_in_words(axis, value) for value in axis.values)
            if axis.values is not None
            else " to ".join(value_in_words(axis, value) for value in axis.law.ppf([0.0, 1.0]))
        )
        verdict = Cell("told", "good") if measured["told"] else Cell("open", "open")
        shares = (f"{100 * measured[name]:.0f} %" for name in ("moved", "by_chance"))
        rows.append((parameter_in_words(key), drawn, _likeliest(found, axis), *shares, verdict))
    heads = ("setting", "drawn from", "weight lies at", "weight moved", "by chance", "verdict")
    caption = (
        "Weight lies at: of a range the fewest neighbouring eighths that hold half of the weight, with that weight and "
        "the share of the designs there; of a list the weight of each value. Weight moved: share of the weight that "
        "lies elsewhere than the designs. By chance: what would move in one of a hundred deals of the weights to the "
        "designs by lot; told is what moved more."
    )
    blocks = [
        Heading("The settings"),
        TableBlock(heads, tuple(rows), "lllrrl", caption),
        FigureBlock(
            POSTERIOR,
            "Posterior of each setting",
            "Shares of eighths of a range that were equally likely before, and of the values of a list; bars: 90 % "
            "intervals of other draws of designs.",
        ),
    ]
    if len(found.varied) > 1:
        blocks.append(
            FigureBlock(
                MAP,
                "Where the printed numbers come out, over the two ranges of which they tell most",
                "Share of the designs in each field, whatever their other settings. White: half of the largest share, "
                "smoothed.",
            )
        )
    return blocks


def _row(found: InferredSettings, design: Any, rank: str) -> tuple[str, ...]:
    settings = (value_in_words(axis, design[axis.key]) for axis in found.varied)
    numbers = (one.shown(design[one.column]) for one in NUMBERS)
    return (rank, *settings, *numbers, _percent(design["farthest"]))


def _nearest(found: InferredSettings) -> list:
    rows = [_row(found, row, str(rank)) for rank, (_, row) in enumerate(found.nearest[:_SHOWN].iterrows(), 1)]
    chosen = found.nearest_scenario
    if chosen is not None:
        rows.append(_row(found, chosen, "scenario"))
    short = ("genetic", "local", "local, other", "L2/L3")
    heads = ("", *(parameter_in_words(axis.key) for axis in found.varied), *short, "farthest off")
    if chosen is None:
        text = (
            "No design counts the RMS over the first revolution, as the optimum of a scenario does; so `compare` can "
            "judge none of them."
        )
    else:
        text = (
            "The row *scenario* is the nearest design that counts the RMS over the first revolution, as the optimum of "
            f"a scenario does: `{NEAREST_FILE}` is that scenario, and `make run CONFIG=...` with it simulates, trains, "
            "optimises and compares it with the paper as any other."
        ).replace("*", "")
    return [
        Heading("The nearest settings"),
        Paragraph(text),
        TableBlock(heads, tuple(rows), "l" * (1 + len(found.varied)) + "r" * 5),
    ]


def _training(found: InferredSettings, training: pd.DataFrame) -> list:
    if training.empty:
        return [
            Heading("The training errors"),
            Paragraph("No networks were trained; `infer_settings.trained` asks for them."),
        ]
    reached = training.assign(reached=training["training_mse"] <= training["paper_mse"])
    rows = []
    for output, printed in TRAINING_MSE.items():
        cells = []
        for drawn in (NEAREST, RANDOM):
            own = reached[(reached["output"] == output) & (reached["drawn"] == drawn)]
            middle = f"{own['training_mse'].median():.2g}"
            spread = f"{own['training_mse'].min():.2g} to {own['training_mse'].max():.2g}"
            cells += [f"{own['reached'].sum()} of {len(own)}", f"{middle} ({spread})"]
        rows.append((output, f"{printed:.4g}", *cells))
    heads = ("network", "printed", "nearest: reached in", "training error", "random: reached in", "training error")
    counts = {
        drawn: reached[reached["drawn"] == drawn].groupby("design")["reached"].sum() for drawn in (NEAREST, RANDOM)
    }
    whole = {drawn: f"{int((count == len(TRAINING_MSE)).sum())} of {len(count)}" for drawn, count in counts.items()}
    typical = {drawn: f"{np.median(count):g}" for drawn, count in counts.items()}
    text = (
        f"The paper's eight networks were trained at the {len(counts[NEAREST])} nearest designs and at "
        f"{len(counts[RANDOM])} drawn at random, {found.options.iterations} iterations from one start (the paper: "
        f"{TRAINING_ITERATIONS}). All eight training errors are reached in {whole[NEAREST]} of the nearest and "
        f"{whole[RANDOM]} of the random designs; in the median design {typical[NEAREST]} and {typical[RANDOM]} of "
        "eight. More iterations only lower them."
    )
    caption = "Training error: median (smallest to largest), on data normalised to 0 to 1."
    return [
        Heading("The training errors"),
        Paragraph(text),
        TableBlock(heads, tuple(rows), "lrrrrr", caption),
        Bullets((_verdict_of_training(reached),)),
    ]


def _verdict_of_training(reached: pd.DataFrame) -> str:
    """Whether networks learn better at the nearest designs than at random ones."""
    by_design = reached.groupby(["drawn", "design"], observed=True)["reached"].mean()
    near, random = (float(by_design[drawn].mean()) for drawn in (NEAREST, RANDOM))
    if min(len(by_design[drawn]) for drawn in (NEAREST, RANDOM)) < 2:
        return (
            f"{_percent(near)} of the training errors are reached at the nearest design and {_percent(random)} at a "
            "random one; how far designs differ two of each have to tell."
        )
    error = float(np.sqrt(sum(by_design[drawn].var(ddof=1) / len(by_design[drawn]) for drawn in (NEAREST, RANDOM))))
    apart = (
        "they tell the two apart"
        if abs(near - random) > 2.0 * error
        else "they do not tell the two apart, and so nothing of the settings"
    )
    return (
        f"{_percent(near)} of the training errors are reached at the nearest designs and {_percent(random)} at random "
        f"ones (standard error of the difference {_percent(error)}): {apart}."
    )


def _method(found: InferredSettings) -> str:
    failed = f"{found.failed} failed and are left out" if found.failed else "none failed"
    return (
        f"{found.designs.number} designs of a sweep ({failed}), each simulated, with the motion in its joints kept "
        "while lengths are changed, as the paper does. Weights: a normal likelihood of the departures with a standard "
        f"deviation of {100 * found.options.deviation:g} %, in which the three reductions count as one number. The "
        f"weight is worth {found.effective_sample_size:.0f} designs. The best ratio is that of the least RMS on the "
        "original rod. The lengths themselves tell nothing of the settings: along the valley of one ratio bounds "
        "decide, which the paper does not print."
    )
