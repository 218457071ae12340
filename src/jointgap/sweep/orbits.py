"""Orbits of the journals in their bearings."""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from jointgap.config import Mechanism
from jointgap.joints import JOINT, JOINT_NUMBERS


def clearance_vectors(samples: pd.DataFrame, joint: str, rates: bool = False) -> np.ndarray:
    """Clearance vector of a joint at the samples of a trajectory, (n, 2) [m], or its rate [m/s].

    Zero where the centres coincide; there the rate, whose direction the table does not hold, is NaN unless it is zero.
    """
    number = JOINT_NUMBERS[joint]
    r, gamma = samples[f"r{number}"].to_numpy(), samples[f"gamma{number}"].to_numpy()
    along = np.stack([np.cos(gamma), np.sin(gamma)], axis=1)
    if not rates:
        return np.where(r[:, None] == 0.0, 0.0, r[:, None] * along)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    speed, turning = samples[f"r{number}_dot"].to_numpy(), samples[f"gamma{number}_dot"].to_numpy()
    at_rest = (r == 0.0) & (speed == 0.0)
    return np.where(at_rest[:, None], 0.0, speed[:, None] * along + (r * turning)[:, None] * across)


def journal_centre(samples: pd.DataFrame, mechanism: Mechanism, joint: str) -> np.ndarray:
    """Centre of the journal seen from the centre of its bearing, along the fixed x and y, (n, 2) [m].

    The clearance vector, turned round where the body at its end carries the bearing.
    """
    carrier = mechanism.joint(joint).journal
    return (1.0 if carrier == JOINT[joint].body else -1.0) * clearance_vectors(samples, joint)


def eccentricity_band(samples: pd.DataFrame, joints: Iterable[str], per_turn: int, first: int) -> pd.DataFrame:
    """Distance of the centres over revolutions, by crank angle: the table `jointgap.tables.ECCENTRICITY`.

    Parameters
    ----------
    samples : DataFrame
        Table `jointgap.tables.TRAJECTORY`.
    joints : iterable of str
        The loose joints.
    per_turn : int
        Samples per revolution.
    first : int
        First revolution that counts (1 = the first).
    """
    frames = []
    angle = samples["crank_angle"].to_numpy()[:per_turn]
    for joint in joints:
        r = samples[f"r{JOINT_NUMBERS[joint]}"].to_numpy()[:-1].reshape(-1, per_turn)[first - 1 :]
        low, high = np.quantile(r, [0.05, 0.95], axis=0)
        columns = {"crank_angle": angle, "mean": r.mean(axis=0), "low": low, "high": high}
        frames.append(pd.DataFrame({"joint": joint} | columns))
    return pd.concat(frames, ignore_index=True)
