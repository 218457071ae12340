"""Contacts of a motion: how long, how hard, how often."""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from jointgap import tables

QUANTILES = {"low": 0.05, "median": 0.5, "high": 0.95}
"""Columns of a distribution beside its mean and its largest value."""

_ENDED = ("impulse", "peak_force", "maxima")


def contacts(events: pd.DataFrame, joint: str) -> pd.DataFrame:
    """The contacts of one joint, in order.

    Parameters
    ----------
    events : DataFrame
        Table `jointgap.tables.EVENTS` of one run.
    joint : str
        crank_pin, piston_pin or crank_pivot.

    Returns
    -------
    DataFrame
        begin, end [s], crank_angle at the beginning [rad], approach_speed [m/s], impulse [N s], peak_force [N], maxima of the
        penetration. A contact that lasts to the end of the run has no end and none of the last three (NaN).
    """
    own = events[events["joint"] == joint]
    begins, ends = (own[own["event"] == kind].reset_index(drop=True) for kind in ("impact", "separation"))
    found = begins[["time", "crank_angle", "approach_speed"]].rename(columns={"time": "begin"})
    found.insert(1, "end", ends["time"].reindex(found.index))
    return found.assign(**{name: ends[name].reindex(found.index) for name in _ENDED})


def time_shares(found: pd.DataFrame, begin: float, end: float) -> dict[str, float]:
    """Shares of the time from `begin` to `end` [s] in which a joint is in flight, in an impact, in contact; 1 in all.

    An impact is a contact whose penetration has one maximum at most.

    Parameters
    ----------
    found : DataFrame
        From `contacts`.
    """
    start, stop = found["begin"].to_numpy(), found["end"].fillna(np.inf).to_numpy()
    length = np.clip(np.minimum(stop, end) - np.maximum(start, begin), 0.0, None) / (end - begin)
    impacts = found["maxima"].to_numpy() <= 1  # NaN, a contact that has not ended, is none
    impact, contact = float(length[impacts].sum()), float(length[~impacts].sum())
    return {"flight": 1.0 - impact - contact, "impact": impact, "contact": contact}


def joint_revolutions(
    samples: pd.DataFrame, events: pd.DataFrame, joints: Iterable[str], per_turn: int
) -> pd.DataFrame:
    """What each joint does in each revolution: the table `jointgap.tables.JOINT_REVOLUTIONS`.

    Parameters
    ----------
    samples, events : DataFrame
        Tables `jointgap.tables.TRAJECTORY` and `jointgap.tables.EVENTS` of one run.
    joints : iterable of str
        The loose joints.
    per_turn : int
        Samples per revolution.
    """
    rows, times = [], samples["time"].to_numpy()
    for joint in joints:
        found, force = contacts(events, joint), samples[f"{joint}_normal_force"].to_numpy()
        for number, first in enumerate(range(0, len(samples) - 1, per_turn), 1):
            begin, end = times[first], times[first + per_turn]
            shares = time_shares(found, begin, end)
            began = found[(found["begin"] >= begin) & (found["begin"] < end)]
            whole = began[began["end"] <= end]
            rows.append(
                {
                    "revolution": number,
                    "joint": joint,
                    **{f"share_{mode}": share for mode, share in shares.items()},
                    "contacts": len(began),
                    "largest_approach_speed": began["approach_speed"].max(),
                    "largest_impulse": whole["impulse"].max(),
                    "peak_force": np.nanmax([force[first : first + per_turn + 1].max(), whole["peak_force"].max()]),
                }
            )
    return pd.DataFrame(rows, columns=[column.name for column in tables.JOINT_REVOLUTIONS.columns])


def speed_distribution(events: pd.DataFrame, joints: Iterable[str], begin: float, revolutions: int) -> pd.DataFrame:
    """How approach speeds, impulses and peak forces of contacts are distributed: `jointgap.tables.IMPACT_DISTRIBUTION`.

    Parameters
    ----------
    events : DataFrame
        Table `jointgap.tables.EVENTS` of one run.
    joints : iterable of str
        The loose joints.
    begin : float
        Time [s] from which on contacts that begin count.
    revolutions : int
        How many revolutions follow it.
    """
    rows = []
    for joint in joints:
        found = contacts(events, joint)
        found = found[found["begin"] >= begin]
        for name in ("approach_speed", "impulse", "peak_force"):
            values = found[name].dropna().to_numpy()
            some = len(values) > 0
            row = {"joint": joint, "quantity": name, "per_revolution": len(values) / revolutions}
            row |= {"mean": values.mean() if some else np.nan, "largest": values.max() if some else np.nan}
            quantiles = {key: np.quantile(values, share) if some else np.nan for key, share in QUANTILES.items()}
            rows.append(row | quantiles)
    return pd.DataFrame(rows, columns=[column.name for column in tables.IMPACT_DISTRIBUTION.columns])
