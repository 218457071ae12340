"""Statistics of one motion: contacts, journal orbits, Poincaré section, periodicity."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

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
        repeating = np.flatnonzero(self.distances <= REPEATS * self.clearance)
        return int(repeating[0]) + 1 if len(repeating) else None

    @property
    def summary(self) -> str:
        """Period, and closest return, in a sentence."""
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
    settled_revolution: int

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Its tables by name."""
        return {
            "poincare_section": self.section,
            "joint_revolutions": self.revolutions,
            "impact_distribution": self.impacts,
            "eccentricity": self.eccentricity,
        }

    @property
    def summary(self) -> str:
        """Period, and a line for each joint."""
        lines = [f"from revolution {self.settled_revolution} on: {self.periodicity.summary}"]
        settled = self.revolutions.query(f"revolution >= {self.settled_revolution}")
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
    settled_revolution: int = 2,
    angle: float = 0.0,
) -> Cycles:
    """Statistics of a motion from `settled_revolution` on; the section is at a crank `angle`
    [rad]."""
    applied, per_turn = mechanism.applied(), options.samples_per_revolution
    joints = applied.loose
    if not joints:
        raise InputError("statistics of clearances: all joints are ideal; make a joint loose")
    section = poincare_section(samples, joints, per_turn, angle, settled_revolution)
    settled = samples.iloc[(settled_revolution - 1) * per_turn :]
    vectors = np.hstack([clearance_vectors(settled, joint) for joint in joints])
    tables = [
        _joint_tables(samples, events, joint, per_turn, settled_revolution) for joint in joints
    ]
    return Cycles(
        section,
        *(pd.concat(frames, ignore_index=True) for frames in zip(*tables, strict=True)),
        periodicity=periodicity(vectors, per_turn, min(map(applied.clearance, joints))),
        settled_revolution=settled_revolution,
    )


def contacts(events: pd.DataFrame, joint: str) -> pd.DataFrame:
    """Contacts of a joint: begin, end, approach speed, impulse, peak force, maxima."""
    of_joint = events[events["joint"] == joint]
    begins, ends = (
        of_joint[of_joint["event"] == kind].reset_index(drop=True)
        for kind in ("impact", "separation")
    )
    begins = begins[["time", "crank_angle", "approach_speed"]].rename(columns={"time": "begin"})
    ends = ends[["time", "impulse", "peak_force", "maxima"]].rename(columns={"time": "end"})
    return begins.join(ends)


def time_shares(contact_frame: pd.DataFrame, begin: float, end: float) -> dict[str, float]:
    """Shares of the time that a joint spends in flight, in impacts and in contact; their sum is 1.

    An impact is a contact whose penetration has at most one maximum.
    """
    stops = contact_frame["end"].fillna(np.inf).clip(upper=end)
    shares = (stops - contact_frame["begin"].clip(lower=begin)).clip(lower=0.0) / (end - begin)
    is_impact = contact_frame["maxima"] <= 1  # False for NaN, a contact that has not ended
    impact, contact = float(shares[is_impact].sum()), float(shares[~is_impact].sum())
    return {"flight": 1.0 - impact - contact, "impact": impact, "contact": contact}


def _joint_tables(
    samples: pd.DataFrame, events: pd.DataFrame, joint: str, per_turn: int, settled_revolution: int
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Rows of the tables `JOINT_REVOLUTIONS`, `IMPACT_DISTRIBUTION` and `ECCENTRICITY`."""
    frame, force = contacts(events, joint), samples[f"{joint}_normal_force"].to_numpy()
    times, revolutions = samples["time"].to_numpy()[::per_turn], []
    for number, (begin, end) in enumerate(pairwise(times), 1):
        begun = frame[(frame["begin"] >= begin) & (frame["begin"] < end)]
        ended = begun[begun["end"] <= end]
        sampled = force[(number - 1) * per_turn : number * per_turn + 1]
        peak = np.fmax(sampled.max(), ended["peak_force"].max())
        shares = time_shares(frame, begin, end).values()
        largest = begun["approach_speed"].max(), ended["impulse"].max(), peak
        revolutions.append((number, joint, *shares, len(begun), *largest))
    settled, impacts = frame[frame["begin"] >= times[settled_revolution - 1]], []
    count = max(len(revolutions) - settled_revolution + 1, 1)
    for name in ("approach_speed", "impulse", "peak_force"):
        values = settled[name].dropna()
        quantiles = values.quantile([0.05, 0.5, 0.95])
        row = (joint, name, len(values) / count, values.mean(), *quantiles, values.max())
        impacts.append(row)
    # distance of the centres over the crank angle, range over the revolutions
    r = samples[f"r{JOINT_NUMBERS[joint]}"].to_numpy()
    by_turn = r[:-1].reshape(-1, per_turn)[settled_revolution - 1 :]
    low, high = np.quantile(by_turn, [0.05, 0.95], axis=0)
    angle = samples["crank_angle"].to_numpy()[:per_turn]
    columns = {"crank_angle": angle, "mean": by_turn.mean(axis=0), "low": low, "high": high}
    return (
        pd.DataFrame(revolutions, columns=schema.JOINT_REVOLUTIONS.names),
        pd.DataFrame(impacts, columns=schema.IMPACT_DISTRIBUTION.names),
        pd.DataFrame({"joint": joint} | columns),
    )


def clearance_vectors(samples: pd.DataFrame, joint: str, rates: bool = False) -> np.ndarray:
    """Clearance vector of a joint at the samples of a trajectory, (n, 2) [m], or its rate [m/s].

    Zero where the centres coincide; the rate is then NaN, unless it is zero, because its direction
    is not stored.
    """
    number = JOINT_NUMBERS[joint]
    names = (f"r{number}", f"gamma{number}", f"r{number}_dot", f"gamma{number}_dot")
    r, gamma, speed, rate = samples[list(names)].to_numpy()[:, :, None].transpose(1, 0, 2)
    radial = np.hstack([np.cos(gamma), np.sin(gamma)])
    if not rates:
        return np.where(r == 0.0, 0.0, r * radial)
    tangential = np.hstack([-radial[:, 1:], radial[:, :1]])
    is_at_rest = (r == 0.0) & (speed == 0.0)
    return np.where(is_at_rest, 0.0, speed * radial + r * rate * tangential)


def poincare_section(
    samples: pd.DataFrame,
    joints: Iterable[str],
    per_turn: int,
    angle: float = 0.0,
    settled_revolution: int = 1,
) -> pd.DataFrame:
    """Clearance vectors and their rates at one crank angle of every revolution:
    `POINCARE_SECTION`."""
    offset = (angle - samples["crank_angle"].iloc[0]) % (2.0 * np.pi)
    row = round(offset / (2.0 * np.pi) * per_turn) % per_turn
    section = samples.iloc[row + (settled_revolution - 1) * per_turn : -1 : per_turn]
    if section.empty:
        raise InputError(
            f"the section from revolution {settled_revolution} on is empty: the motion has"
            f" {(len(samples) - 1) // per_turn} revolutions; simulate more, or begin earlier"
        )
    frames = []
    for joint in joints:
        vectors = np.hstack([clearance_vectors(section, joint, rates) for rates in (False, True)])
        columns = {"joint": joint, "revolution": settled_revolution + np.arange(len(section))}
        columns |= {"crank_angle": section["crank_angle"].to_numpy()}
        columns |= dict(zip(("x", "y", "x_dot", "y_dot"), vectors.T, strict=True))
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def periodicity(vectors: ArrayLike, per_turn: int, clearance: float) -> Periodicity:
    """Compare the last n revolutions with the n before, for every possible n."""
    vectors = np.asarray(vectors)
    revolutions = (len(vectors) - 1) // per_turn
    if revolutions < 2:
        raise InputError(
            f"periodicity needs two settled revolutions, not {revolutions}; simulate more"
        )
    lengths = range(per_turn, revolutions // 2 * per_turn + 1, per_turn)
    differences = [vectors[-n - 1 :] - vectors[-2 * n - 1 : -n] for n in lengths]
    distances = [np.linalg.norm(difference, axis=1).max() for difference in differences]
    return Periodicity(np.array(distances), clearance)
