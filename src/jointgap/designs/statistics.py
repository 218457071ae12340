"""Statistics of one motion: contacts, journal orbits, Poincaré section, periodicity."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jointgap.config import Mechanism, Simulate
from jointgap.core import schema
from jointgap.core.errors import InputError
from jointgap.core.joints import JOINT_NUMBERS

# Distance, over the smallest clearance, below which a motion is periodic: the depth of a contact
REPEATS = 1e-3


@dataclass(frozen=True)
class Periodicity:
    """Whether a motion is periodic."""

    distances: np.ndarray  # By number of revolutions, from 1 [m]
    clearance: float  # Smallest clearance [m]

    @property
    def period(self) -> int | None:
        """Period in revolutions; None where the motion is not periodic."""
        repeats = np.flatnonzero(self.distances <= REPEATS * self.clearance)
        return int(repeats[0]) + 1 if len(repeats) else None

    @property
    def verdict(self) -> str:
        nearest = self.period or int(np.argmin(self.distances)) + 1
        distance, turns = self.distances[nearest - 1], self.period or len(self.distances)
        revolutions = f"{turns} revolution{'s' * (turns > 1)}"
        words = f"to {distance:.2g} m, {distance / self.clearance:.2g} of the clearance"
        if self.period is None:
            return f"no period within {revolutions}: closest after {nearest}, {words}"
        return f"period {self.period}: the motion repeats after {revolutions} {words}"


@dataclass(frozen=True)
class Cycles:
    """Statistics of one motion."""

    section: pd.DataFrame
    revolutions: pd.DataFrame
    impacts: pd.DataFrame
    eccentricity: pd.DataFrame
    periodicity: Periodicity
    first: int  # First settled revolution

    @property
    def summary(self) -> str:
        lines = [f"from revolution {self.first} on: {self.periodicity.verdict}"]
        settled = self.revolutions[self.revolutions["revolution"] >= self.first]
        for joint, rows in settled.groupby("joint", sort=False):
            flight, impact, contact = (
                100.0 * rows[f"share_{mode}"].mean() for mode in ("flight", "impact", "contact")
            )
            lines.append(
                f"{joint}: flight {flight:.1f} %, impact {impact:.1f} %, contact {contact:.1f} % of"
                f" the time; {rows['contacts'].mean():.1f} contacts per revolution; peak force"
                f" {rows['peak_force'].max():.4g} N"
            )
        return "\n".join(lines)


def cycles(
    samples: pd.DataFrame,
    events: pd.DataFrame,
    mechanism: Mechanism,
    options: Simulate,
    first: int = 2,
    angle: float = 0.0,
) -> Cycles:
    applied, per_turn = mechanism.applied(), options.samples_per_revolution
    if not applied.loose:
        raise InputError("statistics of clearances: all joints are ideal; make a joint loose")
    begin = (first - 1) * per_turn
    vectors = np.hstack([clearance_vectors(samples.iloc[begin:], joint) for joint in applied.loose])
    begin_time = samples["time"].iloc[min(begin, len(samples) - 1)]
    return Cycles(
        section=poincare_section(samples, applied.loose, per_turn, angle, first),
        revolutions=_joint_revolutions(samples, events, applied.loose, per_turn),
        impacts=_impact_distribution(
            events, applied.loose, begin_time, max(options.revolutions - first + 1, 1)
        ),
        eccentricity=eccentricity_band(samples, applied.loose, per_turn, first),
        periodicity=periodicity(
            vectors, per_turn, min(applied.clearance(joint) for joint in applied.loose)
        ),
        first=first,
    )


def contacts(events: pd.DataFrame, joint: str) -> pd.DataFrame:
    own = events[events["joint"] == joint]
    begins, ends = (
        own[own["event"] == kind].reset_index(drop=True) for kind in ("impact", "separation")
    )
    begins = begins[["time", "crank_angle", "approach_speed"]].rename(columns={"time": "begin"})
    ends = ends[["time", "impulse", "peak_force", "maxima"]].rename(columns={"time": "end"})
    return begins.join(ends)


def time_shares(contact_frame: pd.DataFrame, begin: float, end: float) -> dict[str, float]:
    """Shares of the time that a joint spends in flight, in impacts and in contact; their sum is 1.

    An impact is a contact whose penetration has at most one maximum.
    """
    start, stop = contact_frame["begin"].to_numpy(), contact_frame["end"].fillna(np.inf).to_numpy()
    length = np.clip(np.minimum(stop, end) - np.maximum(start, begin), 0.0, None) / (end - begin)
    impacts = contact_frame["maxima"].to_numpy() <= 1  # False for NaN, a contact that has not ended
    impact, contact = float(length[impacts].sum()), float(length[~impacts].sum())
    return {"flight": 1.0 - impact - contact, "impact": impact, "contact": contact}


def _joint_revolutions(
    samples: pd.DataFrame, events: pd.DataFrame, joints: Iterable[str], per_turn: int
) -> pd.DataFrame:
    """The table `JOINT_REVOLUTIONS`."""
    rows, times = [], samples["time"].to_numpy()
    for joint in joints:
        frame, force = contacts(events, joint), samples[f"{joint}_normal_force"].to_numpy()
        for number, first in enumerate(range(0, len(samples) - 1, per_turn), 1):
            begin, end = times[first], times[first + per_turn]
            began = frame[(frame["begin"] >= begin) & (frame["begin"] < end)]
            ended = began[began["end"] <= end]
            peaks = force[first : first + per_turn + 1].max(), ended["peak_force"].max()
            shares = time_shares(frame, begin, end).values()
            most = began["approach_speed"].max(), ended["impulse"].max(), np.nanmax(peaks)
            rows.append((number, joint, *shares, len(began), *most))
    return pd.DataFrame(rows, columns=schema.JOINT_REVOLUTIONS.names)


def _impact_distribution(
    events: pd.DataFrame, joints: Iterable[str], begin: float, revolutions: int
) -> pd.DataFrame:
    """The table `IMPACT_DISTRIBUTION`, from `begin` [s] on."""
    rows = []
    for joint in joints:
        frame = contacts(events, joint)
        for name in ("approach_speed", "impulse", "peak_force"):
            own = frame.loc[frame["begin"] >= begin, name].dropna()
            quantiles = own.quantile([0.05, 0.5, 0.95])
            rows.append((joint, name, len(own) / revolutions, own.mean(), *quantiles, own.max()))
    return pd.DataFrame(rows, columns=schema.IMPACT_DISTRIBUTION.names)


def clearance_vectors(samples: pd.DataFrame, joint: str, rates: bool = False) -> np.ndarray:
    """Clearance vector of a joint at the samples of a trajectory, (n, 2) [m], or its rate [m/s].

    Zero where the centres coincide; the rate is then NaN, unless it is zero, because its direction
    is not stored.
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


def eccentricity_band(
    samples: pd.DataFrame, joints: Iterable[str], per_turn: int, first: int
) -> pd.DataFrame:
    """Distance of the centres over the crank angle, range over the revolutions: the table
    `ECCENTRICITY`."""
    frames, angle = [], samples["crank_angle"].to_numpy()[:per_turn]
    for joint in joints:
        r = samples[f"r{JOINT_NUMBERS[joint]}"].to_numpy()[:-1].reshape(-1, per_turn)[first - 1 :]
        low, high = np.quantile(r, [0.05, 0.95], axis=0)
        columns = {"crank_angle": angle, "mean": r.mean(axis=0), "low": low, "high": high}
        frames.append(pd.DataFrame({"joint": joint} | columns))
    return pd.concat(frames, ignore_index=True)


def poincare_section(
    samples: pd.DataFrame, joints: Iterable[str], per_turn: int, angle: float = 0.0, first: int = 1
) -> pd.DataFrame:
    """Clearance vectors and their rates at one crank angle of every revolution:
    `POINCARE_SECTION`."""
    offset = (angle - samples["crank_angle"].iloc[0]) % (2.0 * np.pi)
    row = round(offset / (2.0 * np.pi) * per_turn) % per_turn
    chosen = samples.iloc[row + (first - 1) * per_turn : -1 : per_turn]
    if chosen.empty:
        raise InputError(
            f"the section from revolution {first} on is empty: the motion has"
            f" {(len(samples) - 1) // per_turn} revolutions; simulate more, or begin earlier"
        )
    frames = []
    for joint in joints:
        vectors = np.hstack([clearance_vectors(chosen, joint, rates) for rates in (False, True)])
        columns = {"joint": joint, "revolution": first + np.arange(len(chosen))}
        columns |= {"crank_angle": chosen["crank_angle"].to_numpy()}
        columns |= dict(zip(("x", "y", "x_dot", "y_dot"), vectors.T, strict=True))
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def periodicity(vectors: ArrayLike, per_turn: int, clearance: float) -> Periodicity:
    """Compare the last n revolutions with the n before, for every possible n."""
    vectors, distances = np.asarray(vectors), []
    revolutions = (len(vectors) - 1) // per_turn
    if revolutions < 2:
        raise InputError(
            f"periodicity needs two settled revolutions, not {revolutions}; simulate more"
        )
    for length in range(per_turn, revolutions // 2 * per_turn + 1, per_turn):
        difference = vectors[-length - 1 :] - vectors[-2 * length - 1 : -length]
        distances.append(np.linalg.norm(difference, axis=1).max())
    return Periodicity(np.array(distances), clearance)
