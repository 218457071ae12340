"""Poincare section: the state once a revolution."""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.errors import InputError
from jointgap.sweep.orbits import clearance_vectors


def poincare_section(
    samples: pd.DataFrame, joints: Iterable[str], per_turn: int, angle: float = 0.0, first: int = 1
) -> pd.DataFrame:
    """Clearance vectors and their rates at one crank angle of every revolution: `jointgap.tables.POINCARE_SECTION`.

    Parameters
    ----------
    samples : DataFrame
        Table `jointgap.tables.TRAJECTORY`.
    joints : iterable of str
        The loose joints.
    per_turn : int
        Samples per revolution.
    angle : float
        Crank angle of the section [rad], anywhere in a revolution; the sample nearest to it is taken.
    first : int
        First revolution that counts (1 = the first).

    Raises
    ------
    InputError
        No revolution is left.
    """
    turned = (angle - samples["crank_angle"].iloc[0]) % (2.0 * np.pi)
    row = round(turned / (2.0 * np.pi) * per_turn) % per_turn
    chosen = samples.iloc[row + (first - 1) * per_turn : -1 : per_turn]
    if chosen.empty:
        raise InputError(
            f"the section from revolution {first} on is empty, for there are {(len(samples) - 1) // per_turn} revolutions; "
            "simulate more, or begin earlier"
        )
    frames = []
    for joint in joints:
        place, rate = (clearance_vectors(chosen, joint, rates) for rates in (False, True))
        columns = dict(zip(("x", "y", "x_dot", "y_dot"), np.hstack([place, rate]).T, strict=True))
        numbers = {"revolution": first + np.arange(len(chosen)), "crank_angle": chosen["crank_angle"].to_numpy()}
        frames.append(pd.DataFrame({"joint": joint} | numbers | columns))
    return pd.concat(frames, ignore_index=True)[[column.name for column in tables.POINCARE_SECTION.columns]]
