"""The four ways in plain words: which wins where, and from which cost of a simulation on it pays to learn."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.page import Block, FigureBlock, Heading, Page, Paragraph, TableBlock, written_today
from jointgap.core.words import joined
from jointgap.design_networks.networks_page import axes_table
from jointgap.design_networks.settings import SETTINGS as OF_NETWORKS
from jointgap.length_searches.break_even import pays_from
from jointgap.length_searches.compare_searches import FROZEN, NETWORKS, SIMULATION, WAYS, Compared
from jointgap.length_searches.searches_figures import BREAK_EVEN, CAPTIONS, GAIN, LOOKS, TITLES
from jointgap.length_searches.settings import SETTINGS

MDEG = 1e3 * 180.0 / np.pi
"""Thousandths of a degree in a radian."""

_SENTENCE = {
    FROZEN: "the frozen motion",
    NETWORKS: "the networks",
    "surrogate": "the surrogate of the error",
    SIMULATION: "the simulation itself",
}
_MINUS = str.maketrans("-", "\N{MINUS SIGN}")
_COUNTS = {2: "two", 3: "three"}
_MANY = 100
"""Optima for which the verdict says what pays, beside those of the configuration."""


@dataclass(frozen=True)
class Shown:
    """What the page is about."""

    compared: Compared
    summary: pd.DataFrame  # Tables compare_searches_summary and compare_searches_break_even
    break_even: pd.DataFrame  # Tables compare_searches_summary and compare_searches_break_even
    scenario: Scenario


def page(shown: Shown, name: str) -> Page:
    """The page of the four ways."""
    blocks: list[Block] = [Paragraph(sentence, strong=True) for sentence in verdict(shown)]
    blocks += [Heading("Side by side"), Paragraph(_what_is_compared(shown)), _table(shown.summary), _figure(GAIN)]
    blocks += [Heading("When learning pays"), Paragraph(_when(shown)), _pays(shown), _figure(BREAK_EVEN)]
    blocks += [Heading("What varies"), axes_table(shown.compared.space.axes), Heading("The four ways")]
    blocks += [_ways(), Paragraph(_files())]
    return Page(
        headline(shown), tuple(blocks), subject=f"{name}: four ways to the best lengths", footer=written_today()
    )


def headline(shown: Shown) -> str:
    """What came out, in a line."""
    row = winner(shown.summary)
    words = _SENTENCE[row["way"]]
    return f"{words[0].upper()}{words[1:]} win{'' if row['way'] == NETWORKS else 's'}: {_gained(row)}"


def winner(summary: pd.DataFrame) -> pd.Series:
    """Of the rows whose gain is as good as the largest, the one that takes the least CPU time."""
    good = summary[summary["gain"] >= SETTINGS.as_good * summary["gain"].max()]
    return good.loc[good["cpu_time"].idxmin()]


def verdict(shown: Shown) -> tuple[str, ...]:
    """What came out, in a few plain sentences."""
    return (_overall(shown), *_by_budget(shown.summary), *_learning(shown))


def _overall(shown: Shown) -> str:
    summary, row = shown.summary, winner(shown.summary)
    most = summary.loc[summary["gain"].idxmax()]
    words = _SENTENCE[row["way"]]
    sentence = f"{words[0].upper()}{words[1:]} win{'' if row['way'] == NETWORKS else 's'}: {_gained(row)}."
    if most["way"] != row["way"]:
        sentence += (
            f" The largest gain is that of {_SENTENCE[most['way']]}, {100 * most['gain']:.2f} %, at "
            f"{most['cpu_time'] / row['cpu_time']:.3g} times the CPU time."
        )
    return sentence


def _gained(row: pd.Series) -> str:
    """``the error falls by 6.85 % in 0.0104 CPU-seconds for each optimum``."""
    spread = f" ({_range(100 * row['gain_low'], 100 * row['gain_high'], 2)} %)" if row["way"] != FROZEN else ""
    return f"the error falls by {100 * row['gain']:.2f} %{spread} in {row['cpu_time']:.3g} CPU-seconds for each optimum"


def _by_budget(summary: pd.DataFrame) -> list[str]:
    """At each budget, which of the ways that spend it gains most."""
    sentences = []
    for budget, rows in summary.dropna(subset="budget").groupby("budget"):
        rows = rows.sort_values("gain", ascending=False)
        best = rows.iloc[0]
        level = (rows["gain"] >= SETTINGS.as_good * best["gain"]) | (rows["gain_high"] >= best["gain_low"])
        told = [
            f"{_SENTENCE[row['way']]} {100 * row['gain']:.2f} % ".translate(_MINUS)
            + f"({_range(100 * row['gain_low'], 100 * row['gain_high'], 2)})"
            for _, row in rows.iterrows()
        ]
        count = int(level.sum())
        apart = f"; the first {_COUNTS[count]} cannot be told apart" if count > 1 else ""
        sentences.append(f"With {budget:g} CPU-seconds for each optimum the other ways gain: {joined(told)}{apart}.")
    return sentences


def _learning(shown: Shown) -> list[str]:
    """From which cost of a simulation on networks pay."""
    cost = f"A simulation takes {1e3 * shown.compared.cost:.1f} ms here."
    return [f"{_against(shown, SIMULATION)} {cost}", _against(shown, FROZEN)]


def _against(shown: Shown, against: str) -> str:
    numbers = sorted({shown.scenario.compare_searches.optima, _MANY, int(shown.break_even["optima"].max())})
    costs = {number: _cheapest(shown.break_even, NETWORKS, against, number) for number in numbers}
    told = [f"for {number} optima {costs[number]}" for number in numbers if costs[number]]
    never = joined(str(number) for number in numbers if not costs[number]).replace(" and ", " or ")
    words = f"Against {_SENTENCE[against]} networks pay {'; '.join(told)}" if told else ""
    if never and told:
        words += f"; for {never} they do not, whatever a simulation costs"
    elif never:
        words = f"Against {_SENTENCE[against]} networks do not pay for {never} optima, whatever a simulation costs"
    return f"{words}."


def _cheapest(break_even: pd.DataFrame, way: str, against: str, optima: int) -> str:
    """``from 1.7 ms a simulation on (1.6 to 1.8 ms)``; empty where it never pays."""
    costs = pays_from(break_even, way, against, optima)
    if costs is None:
        return ""
    if costs.max() == 0.0:
        return "at any cost of a simulation"
    low, mean, high = 1e3 * costs.min(), 1e3 * costs.mean(), 1e3 * costs.max()
    return f"from {_two_digits(mean)} ms a simulation on ({_range(low, high, None)} ms)"


def _range(low: float, high: float, digits: int | None) -> str:
    ends = (_two_digits(end) if digits is None else f"{end:.{digits}f}" for end in (low, high))
    return " to ".join(ends).translate(_MINUS)


def _two_digits(value: float) -> str:
    """``110``, not ``1.1e+02``."""
    return f"{float(f'{value:.2g}'):g}"


def _what_is_compared(shown: Shown) -> str:
    options, motion = shown.scenario.compare_searches, shown.scenario.optimise.ensemble.settled_revolution
    return (
        f"Wanted are the best lengths for {options.optima} designs, drawn from what varies. The error is the RMS over "
        f"revolution {motion} of the transmission angle of the original lengths without clearance, less that of the "
        "simulated motion (equation 12). The gain is simulated again with the lengths that a way found, and is the "
        "mean over the designs. CPU time is that of all threads, for each optimum: its search, and its share of the "
        "simulations and the training that all of them have in common. Brackets: smallest to largest of "
        f"{options.repetitions} repetitions with other training designs and other random numbers. Held-out designs, "
        f"{int(shown.compared.predictions['designs'].iloc[0])} of them, are the same for all ways, with any lengths."
    )


def _table(summary: pd.DataFrame) -> TableBlock:
    rows = []
    for row in summary.to_dict("records"):
        missed = [MDEG * row[f"missed{end}"] for end in ("", "_low", "_high")]
        rows.append(
            (
                LOOKS[row["way"]][0],
                "–" if np.isnan(row["budget"]) else f"{row['budget']:g}",
                f"{row['cpu_time']:.3g}",
                f"{row['simulations']:.3g}",
                f"{100 * row['gain']:.2f} ".translate(_MINUS)
                + f"({_range(100 * row['gain_low'], 100 * row['gain_high'], 2)})",
                f"{100 * row['share']:.1f}".translate(_MINUS),
                f"{_two_digits(missed[0])} ({_range(missed[1], missed[2], None)})",
            )
        )
    heads = (
        "way",
        "budget [CPU-s]",
        "spent [CPU-s]",
        "simulations",
        "gain [%]",
        "of the largest [%]",
        "misses the error on held-out designs by [mdeg]",
    )
    return TableBlock(heads, tuple(rows), "lrrrrrr", caption="Four ways, for each optimum")


def _when(shown: Shown) -> str:
    return (
        "What is learned once serves any number of optima, and saves simulations. It pays where these are dear, or the "
        "optima many. From which cost of a simulation on, for as much gain (within "
        f"{100 * (1 - SETTINGS.as_good):.0f} %), follows from what was measured: simulations, training and search of "
        "each way. Where the simulation takes more, all else being equal, learning is the cheaper way. What gains less "
        "than the frozen motion never pays against it. Where the simulation did not reach the gain with its "
        "largest budget, learning pays from a lower cost on than what stands here."
    )


def _pays(shown: Shown) -> TableBlock:
    frame = shown.break_even
    numbers = sorted({1, 10, shown.scenario.compare_searches.optima, _MANY, int(frame["optima"].max())})
    rows = []
    for (way, budget, against), of in frame.groupby(["way", "budget", "against"]):
        cells = []
        for number in numbers:
            costs = 1e3 * of[of["optima"] == number]["cost"]
            if costs.isna().any():
                cells.append("never" if costs.isna().all() else "not always")
            else:
                cells.append(f"{_two_digits(costs.mean())} ({_range(costs.min(), costs.max(), None)})")
        rows.append((LOOKS[way][0], f"{budget:g}", LOOKS[against][0], *cells))
    rows.sort(key=lambda row: (row[2], row[0], float(row[1])))
    heads = (
        "way",
        "budget [CPU-s]",
        "against",
        *(f"{number} optima" if number > 1 else "1 optimum" for number in numbers),
    )
    caption = "From which cost of a simulation on it pays [ms]; not always: in some repetitions alone"
    return TableBlock(heads, tuple(rows), "lrl" + "r" * len(numbers), caption=caption)


def _ways() -> TableBlock:
    told = {
        FROZEN: "one simulation with the original lengths; its motion in the joints is kept while the lengths are "
        "searched by sequential quadratic programming (the paper's way)",
        NETWORKS: "designs with any lengths are simulated, and a network learns the motion in the joints from crank "
        f"angle and design ({OF_NETWORKS.harmonics} harmonics, L-BFGS); the same search on what it says",
        "surrogate": "the same designs; a surrogate learns the mean square error from the design (OpenTURNS: chaos "
        "expansion or kriging); the same search",
        SIMULATION: "every candidate is simulated; CMA-ES (pymoo), begun anew where it has converged",
    }
    return TableBlock(("way", "how"), tuple((LOOKS[way][0], told[way]) for way in WAYS), "ll")


def _figure(name: str) -> FigureBlock:
    return FigureBlock(name, TITLES[name], CAPTIONS[name])


def _files() -> str:
    files = joined(f"`{name}.parquet`" for name in ("summary", "optima", "wanted", "progress", "break_even"))
    return f"All numbers: {files} beside this page; `jointgap describe FILE` explains their columns."
