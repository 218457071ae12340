"""What a set of blind trials comes to: rates with their intervals, confusion, and how the baselines do."""

import math
from collections.abc import Callable

import numpy as np
import pandas as pd
from scipy.stats import beta, binom

from jointgap.report.page import Block, Heading, Page, Paragraph, TableBlock, to_markdown
from jointgap.trials.draw_rigs import BASES
from jointgap.trials.size_calibration import NEAR

LEVEL = 0.95


def interval(hits: int, count: int) -> tuple[float, float]:
    """Clopper and Pearson's interval of a share, at `LEVEL`.

    C. J. Clopper and E. S. Pearson, Biometrika 26 (1934) 404-413.
    """
    tail = (1 - LEVEL) / 2
    low = float(beta.ppf(tail, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1 - tail, hits + 1, count - hits)) if hits < count else 1.0
    return low, high


def rates(trials: pd.DataFrame) -> pd.DataFrame:
    """The figures of a set, one a row: what, group, hits, count, value, low, high.

    Shares have Clopper and Pearson's interval; medians have the one that order statistics give.
    """
    single = trials[trials["kind"].isin(["single", "exudyn"]) & trials["detectable"]]
    nothing, pairs = trials[trials["kind"] == "nothing"], trials[trials["kind"] == "pair"]
    seen_pairs, off = pairs[pairs["detectable"]], trials[trials["kind"] == "off_list"]
    hidden = trials[trials["kind"].isin(["single", "exudyn", "pair"])]
    unseen = hidden[~hidden["detectable"]]
    listed = trials[trials["kind"].isin(["single", "exudyn"]) & ~trials["foreseen"]]
    rows = [
        *_grouped("right name", single, lambda one: one["outcome"] == "right"),
        _share(
            "right, of which ambiguous as foreseen",
            single,
            (single["outcome"] == "right") & (single["verdict"] == "ambiguous"),
        ),
        _share("right, small effects too that preflight does not exclude", listed, listed["outcome"] == "right"),
        *_grouped("wrong name", single, lambda one: one["outcome"] == "wrong"),
        _share("wrong name, effect undetectable", unseen, unseen["outcome"] == "wrong"),
        *_grouped("ambiguous", single, lambda one: one["outcome"] == "ambiguous"),
        *_grouped("unexplained", single, lambda one: one["outcome"] == "unexplained"),
        *_grouped("missed", single, lambda one: one["outcome"] == "missed"),
        _share("wrong name, effect off the list", off, off["outcome"] == "wrong"),
        _share(
            "unexplained or the force found, effect off the list", off, off["outcome"].isin(["unexplained", "right"])
        ),
        _share("ambiguous or missed, effect off the list", off, off["outcome"].isin(["ambiguous", "missed"])),
        *_grouped("nothing found, nothing hidden", nothing, lambda one: one["outcome"] == "right"),
        _share("both named and no third", seen_pairs, seen_pairs["outcome"] == "right"),
        _share("wrong name, two effects", seen_pairs, seen_pairs["outcome"] == "wrong"),
        _share("undetectable", hidden, ~hidden["detectable"]),
        _share("undetectable, as preflight says", hidden, hidden["foreseen"]),
        _share("failed", trials, trials["outcome"] == "failed"),
        _median("error of the size", single["error"]),
        _of_values("size within the 90 % interval", single["covered"]),
        _median("share of the excess closed", single["closed"]),
        _median("gap after", single.loc[single["outcome"] == "right", "gap_after"]),
        _of_sums("false windows", trials["false_windows"], trials["windows"]),
        _of_sums("bins missed", trials["missed_bins"], trials["bins_off"]),
        *(_median("seconds", trials.loc[trials["base"] == base, "seconds"], f"base {base}") for base in BASES),
    ]
    for baseline in ("greedy", "sparse"):
        words = {"greedy": "greedy BIC", "sparse": "sparse regression"}[baseline]
        asked = trials[trials[baseline] != "not asked"]
        for what, group in (("right name", single), ("wrong name", single), ("false alarm", nothing)):
            chosen = group.loc[group.index.intersection(asked.index)]
            hit = {"right name": ("right",), "wrong name": ("wrong",), "false alarm": ("wrong",)}[what]
            rows.append(_share(f"{words}: {what}", chosen, chosen[baseline].isin(hit)))
        chosen = off.loc[off.index.intersection(asked.index)]
        rows.append(_share(f"{words}: wrong name, effect off the list", chosen, chosen[baseline] == "wrong"))
    return pd.DataFrame([row for row in rows if row["count"]])


def confusion(trials: pd.DataFrame) -> pd.DataFrame:
    """How often what was named, by what was hidden; sites left out, one row a true effect."""
    kinds = trials[trials["kind"].isin(["single", "exudyn", "nothing", "off_list"])]
    bare = {column: kinds[column].map(_without_sites) for column in ("hidden", "named")}
    return pd.crosstab(bare["hidden"], bare["named"])


def markdown(name: str, trials: pd.DataFrame) -> str:
    """The summary as a page."""
    rows = [
        (row.what, row.group, str(row.count), _text(row.value), f"{_text(row.low)} - {_text(row.high)}")
        for row in rates(trials).itertuples()
    ]
    intervals = "Shares with 95 % intervals of Clopper and Pearson, medians with those of order statistics."
    blocks = [
        Paragraph(f"{len(trials)} campaigns. {intervals}"),
        TableBlock(("what", "group", "of", "value", "95 %"), tuple(rows), "llrrl"),
    ]
    for base in BASES:
        part = trials[trials["base"] == base]
        if len(part):
            blocks += [Heading(f"What was named: base {base}"), _table(confusion(part))]
    wrong = trials["outcome"].isin(["wrong", "failed"])
    blocks += _listed("Wrong or failed", trials[wrong])
    abstained = (trials["kind"] == "off_list") & (trials["outcome"] == "unexplained")
    blocks += _listed("Neither right nor wrong", trials[~wrong & ~abstained & (trials["outcome"] != "right")])
    return to_markdown(Page(f"Blind trials: {name}", tuple(blocks)))


def _listed(heading: str, trials: pd.DataFrame) -> list[Block]:
    """Trials one a row, those whose effect counts as undetectable last."""
    if trials.empty:
        return []
    shown = "id kind base size gap_caused numerics_gap detectable hidden verdict named outcome reason".split()
    rows = trials.sort_values(["detectable", "kind", "base", "hidden"], ascending=[False, True, True, True])
    rows = rows.round({"gap_caused": 2, "numerics_gap": 2}).assign(
        detectable=rows["detectable"].map({True: "yes", False: "no"})
    )
    return [Heading(heading), _table(rows[shown].set_index("id"))]


def metrics(trials: pd.DataFrame) -> dict[str, float]:
    """The figures by name, for a dashboard."""
    return {f"{row.what}, {row.group}": float(row.value) for row in rates(trials).itertuples()}


def _without_sites(names: str) -> str:
    return " + ".join(sorted(name.partition(":")[0] for name in names.split(" + ")))


def _grouped(what: str, trials: pd.DataFrame, hit: Callable[[pd.DataFrame], pd.Series]) -> list[dict]:
    groups = {"all": trials}
    groups |= {f"base {base}": trials[trials["base"] == base] for base in BASES}
    larger = trials["gap_caused"] > (1 + 2 * NEAR) * trials["size"]
    sizes = sorted(set(trials["size"]) - {0.0})
    groups |= {f"gap {size:g}": trials[(trials["size"] == size) & ~larger] for size in sizes}
    groups |= {"gap larger than asked for": trials[larger & (trials["size"] > 0)]}
    groups |= {"from Exudyn": trials[trials["kind"] == "exudyn"]}
    return [_share(what, group, hit(group), name) for name, group in groups.items()]


def _share(what: str, trials: pd.DataFrame, hit: pd.Series, group: str = "all") -> dict:
    return _of_counts(what, group, int(np.count_nonzero(hit)), len(trials))


def _of_counts(what: str, group: str, hits: int, count: int) -> dict:
    low, high = interval(hits, count) if count else (math.nan, math.nan)
    value = hits / count if count else math.nan
    return {"what": what, "group": group, "count": count, "value": value, "low": low, "high": high}


def _of_values(what: str, values: pd.Series) -> dict:
    """A share of values between 0 and 1, of which a trial may have a half."""
    known = values.dropna()
    return _of_counts(what, "all", round(known.sum()), len(known))


def _of_sums(what: str, part: pd.Series, whole: pd.Series) -> dict:
    return _of_counts(what, "all", int(part.sum()), int(whole.sum()))


def _median(what: str, values: pd.Series, group: str = "all") -> dict:
    """Median with the interval between two of the sorted values, by the binomial distribution of how many lie below."""
    known = np.sort(values.dropna().to_numpy(float))
    count = known.size
    found = {"what": f"{what}, median", "group": group, "count": count}
    if not count:
        return found | dict.fromkeys(("value", "low", "high"), math.nan)
    low = max(int(binom.ppf((1 - LEVEL) / 2, count, 0.5)) - 1, 0)
    return found | {"value": float(np.median(known)), "low": float(known[low]), "high": float(known[count - 1 - low])}


def _text(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"


def _table(frame: pd.DataFrame) -> TableBlock:
    rows = tuple((str(name), *map(_cell, row)) for name, row in frame.iterrows())
    return TableBlock((frame.index.name, *map(str, frame.columns)), rows)


def _cell(value) -> str:
    """The value as text; nothing for a count of zero, and for a number that is not known."""
    return value if isinstance(value, str) else str(value) if value and not math.isnan(value) else ""
