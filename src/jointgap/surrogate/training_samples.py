"""What the second surrogate learns from: samples of the simulation chosen where the motion needs them.

The motion is simulated once more, sampled very finely. A coarse grid between the samples that are held out is kept,
and of the rest those that interpolation between kept neighbours would miss: near impacts, and where a joint's sliding
turns round and friction jumps within a millionth of a second. No sample that is held out is kept.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from jointgap import tables
from jointgap.errors import InputError
from jointgap.joints import JOINT_NUMBERS
from jointgap.paper.printed import reference_mse
from jointgap.surrogate.fit_errors import Grid
from jointgap.surrogate.network import Scaling

KINDS = ("r", "gamma", "gamma_dot", "gamma_ddot", "r_dot", "r_ddot")
ORDERS = {"r": 0, "gamma": 0, "gamma_dot": 1, "gamma_ddot": 2, "r_dot": 1, "r_ddot": 2}
PER_HELD_OUT = 2  # samples kept everywhere, per sample held out
MISSED = 0.3  # error of the interpolation, in errors allowed, that makes a sample be kept


def column(kind: str, joint: int) -> str:
    """Column of the trajectory: r_dot of joint 2 is r2_dot."""
    quantity, _, dots = kind.partition("_")
    return f"{quantity}{joint}{'_' * bool(dots)}{dots}"


@dataclass(frozen=True)
class Samples:
    """What a joint's network learns from, at n rising crank angles."""

    crank_angle: np.ndarray  # shape (n,)
    values: dict[str, np.ndarray]  # shape (n,); by kind: r, gamma and their derivatives by the crank angle
    simulated: dict[str, np.ndarray]  # shape (n,); the same as the simulation has them, derivatives by time
    scales: dict[str, float]  # Error allowed in each of them

    @property
    def shares(self) -> np.ndarray:
        """Share of the revolution that each sample stands for, (n,): samples are dense where the motion is quick."""
        widths = np.gradient(self.crank_angle)
        return widths / widths.sum()

    @classmethod
    def of(cls, trajectory: pd.DataFrame, fine: pd.DataFrame, joint: int, training_points: int) -> "Samples":
        """Samples of the first revolution of `fine` that are none of `trajectory`'s."""
        angle = fine["crank_angle"].to_numpy()
        angle = angle[angle - angle[0] <= 2.0 * np.pi * (1.0 + 1e-9)]
        held_out = trajectory["crank_angle"].to_numpy()
        ratio = int(np.round((held_out[1] - held_out[0]) / (angle[1] - angle[0])))
        if ratio < 2 * PER_HELD_OUT or not np.allclose(held_out[: len(angle[::ratio])], angle[::ratio], atol=1e-9):
            raise InputError(
                "the fine sampling must have a multiple of the trajectory's samples, "
                f"{2 * PER_HELD_OUT} times as many at least"
            )
        part = {name: fine[name].to_numpy()[: len(angle)] for name in ("crank_speed", "crank_acceleration")}
        speed, mean = part["crank_speed"], float(part["crank_speed"].mean())
        simulated, scales = {}, {}
        for kind in KINDS:
            name = column(kind, joint)
            simulated[kind] = fine[name].to_numpy()[: len(angle)]
            spread = Scaling.of(Grid.of(trajectory, name, training_points).training.values).range
            allowed = reference_mse(name if name in tables.outputs(JOINT_NUMBERS) else f"r{joint}")
            scales[kind] = spread * allowed**0.5 / mean ** ORDERS[kind]
        values = dict(simulated)
        for quantity in ("r", "gamma"):
            rate = simulated[f"{quantity}_dot"] / speed
            values[f"{quantity}_dot"] = rate
            values[f"{quantity}_ddot"] = (simulated[f"{quantity}_ddot"] - rate * part["crank_acceleration"]) / speed**2
        kept = _chosen(angle, values, scales, ratio)
        chosen = ({kind: row[kept] for kind, row in rows.items()} for rows in (values, simulated))
        return cls(angle[kept], *chosen, scales)


def _chosen(angle: np.ndarray, values: dict[str, np.ndarray], scales: dict[str, float], ratio: int) -> np.ndarray:
    """Indices of the samples to keep, rising."""
    table = np.column_stack([values[kind] / scale for kind, scale in scales.items()])
    usable = np.isfinite(table).all(axis=1)
    usable[::ratio] = False
    step = ratio // PER_HELD_OUT
    kept = np.arange(step // 2, len(angle), step)
    return refined(angle, table, kept[usable[kept]], usable, MISSED)


def refined(angle: np.ndarray, table: np.ndarray, kept: np.ndarray, usable: np.ndarray, missed: float) -> np.ndarray:
    """Indices `kept`, and those of further samples, that interpolation between kept neighbours would miss; rising."""
    while True:
        between = (kept[:-1] + kept[1:]) // 2
        between = np.where(usable[between], between, between + 1)
        between = between[(between > kept[:-1]) & (between < kept[1:]) & usable[between]]
        errors = np.abs(CubicSpline(angle[kept], table[kept])(angle[between]) - table[between]).max(axis=1)
        if not (errors > missed).any():
            return kept
        kept = np.union1d(kept, between[errors > missed])
