"""The four ways side by side, and from which cost of a simulation on it pays to learn first.

Learning from M simulations and training for T seconds serves N optima, each of which takes a search of s seconds. A way
that learns nothing takes n simulations for each optimum to the same gain, and o seconds besides; where it did not come
as far, n is the largest number that it tried, and learning pays from a lower cost on than what is told. With t seconds
for a simulation

    M t + T + N s = N (n t + o)    at    t = (T + N (s - o)) / (N n - M).

Dearer simulations favour learning where N n > M; where not, it never pays.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
import pandas as pd

from jointgap.length_searches.compare_searches import FROZEN, NETWORKS, SIMULATION, SURROGATE, WAYS, Compared
from jointgap.length_searches.settings import SETTINGS

OPTIMA = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000)
"""Numbers of optima for which it is worked out, besides that of the configuration."""


def summary(compared: Compared) -> pd.DataFrame:
    """Table compare_searches_summary."""
    searches = compared.searches
    # of a design whose error no way lowers there is no share
    best = searches["optimum"].map(searches.groupby("optimum")["gain"].max())
    wanted = searches["optimum"].nunique()
    shared = np.where(searches["way"].isin((NETWORKS, SURROGATE)), searches["simulations"] / wanted,
                      searches["simulations"])  # fmt: skip
    searches = searches.assign(share=np.where(best > 0.0, searches["gain"] / best, np.nan), shared=shared)
    missed = compared.predictions.groupby(["way", "budget"], dropna=False)["missed"]
    rows = []
    for (way, budget), of in searches.groupby(["way", "budget"], dropna=False):
        means = of.groupby("repetition")[["gain", "share", "cpu_time"]].mean()
        columns = {name: means[name].fillna(0.0) for name in means} | {"missed": missed.get_group((way, budget))}
        row: dict = {"way": way, "budget": budget, "simulations": of["shared"].mean()}
        for name, values in columns.items():
            row |= {name: values.mean(), f"{name}_low": values.min(), f"{name}_high": values.max()}
        rows.append(row)
    order = {way: place for place, way in enumerate(WAYS)}
    frame = pd.DataFrame(rows)
    return frame.sort_values(["way", "budget"], key=lambda each: each.map(order) if each.name == "way" else each,
                             ignore_index=True)  # fmt: skip


def gain_of_simulations(progress: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Mean gain of searches by simulation after so many simulations: numbers (n,) and gains (n,)."""
    numbers = np.unique(progress["simulations"])
    curves = []
    for _, rows in progress.groupby(["repetition", "optimum"]):
        place = np.searchsorted(rows["simulations"].to_numpy(), numbers, side="right") - 1
        curves.append(np.where(place >= 0, np.maximum(rows["gain"].to_numpy()[np.maximum(place, 0)], 0.0), 0.0))
    return numbers, np.mean(curves, axis=0)


def break_even(compared: Compared, optima: int) -> pd.DataFrame:
    """Table compare_searches_break_even."""
    return pd.DataFrame(_break_even(compared, sorted({*OPTIMA, optima})))


def cost_from_which(
    simulations: float, training: float, search: float, needed: float | None, besides: float, optima: int
) -> float:
    """CPU time of a simulation from which on learning is the cheaper way [s]: 0 where it is at any, NaN where at
    none.
    """
    if needed is None:
        return 0.0
    more, saved = training + optima * (search - besides), optima * needed - simulations
    if saved <= 0.0:
        return np.nan
    return max(more / saved, 0.0)


def pays_from(break_even: pd.DataFrame, way: str, against: str, optima: int) -> np.ndarray | None:
    """CPU time of a simulation from which on a way pays, one of each repetition [s], at the budget that pays first in
    every repetition and whose gain is as good as the largest; None where no budget does.
    """
    rows = break_even[
        (break_even["way"] == way) & (break_even["against"] == against) & (break_even["optima"] == optima)
    ]
    largest = rows.groupby("budget")["gain"].mean().max()
    found = [
        of["cost"].to_numpy()
        for _, of in rows.groupby("budget")
        if of["gain"].mean() >= SETTINGS.as_good * largest and of["cost"].notna().all()
    ]
    return min(found, key=np.mean, default=None)


def _break_even(compared: Compared, numbers: list[int]) -> Iterator[dict]:
    searches = compared.searches
    simulations, gains = gain_of_simulations(compared.progress)
    frozen = searches[searches["way"] == FROZEN]
    gain_frozen, besides = frozen["gain"].mean(), max(0.0, frozen["cpu_time"].mean() - compared.cost)
    learned = searches[searches["way"].isin((NETWORKS, SURROGATE))]
    for (way, budget, repetition), rows in learned.groupby(["way", "budget", "repetition"]):
        gain, known = rows["gain"].mean(), int(rows["simulations"].iloc[0])
        training = rows["learning_time"].iloc[0] - known * compared.cost
        enough = SETTINGS.as_good * gain
        reached = np.flatnonzero(gains >= enough)
        needed = float(simulations[reached[0] if len(reached) else -1])
        for against, number in product((SIMULATION, FROZEN), numbers):
            worth = gain > 0.0
            if against == FROZEN:
                needed_there, other = (1.0 if gain_frozen >= enough else None), besides
                worth = worth and gain >= SETTINGS.as_good * gain_frozen
            else:
                needed_there, other = needed, 0.0
            cost = cost_from_which(known, max(training, 0.0), rows["search_time"].mean(), needed_there, other, number)
            yield {
                "way": way,
                "budget": budget,
                "repetition": repetition,
                "against": against,
                "optima": number,
                "gain": gain,
                "simulations": np.nan if needed_there is None else needed_there,
                "cost": cost if worth else np.nan,
            }
