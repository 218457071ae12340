"""All statistics of one motion over its revolutions."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from jointgap.config import Mechanism, Simulate
from jointgap.errors import InputError
from jointgap.sweep.contacts import joint_revolutions, speed_distribution
from jointgap.sweep.orbits import clearance_vectors, eccentricity_band
from jointgap.sweep.periodicity import Periodicity, periodicity
from jointgap.sweep.poincare import poincare_section


@dataclass(frozen=True)
class Cycles:
    """Statistics of one motion.

    Attributes
    ----------
    section, revolutions, impacts, eccentricity : DataFrame
        Tables `jointgap.tables.POINCARE_SECTION`, `JOINT_REVOLUTIONS`, `IMPACT_DISTRIBUTION`, `ECCENTRICITY`.
    periodicity : Periodicity
    first : int
        First revolution that counts as settled.
    """

    section: pd.DataFrame
    revolutions: pd.DataFrame
    impacts: pd.DataFrame
    eccentricity: pd.DataFrame
    periodicity: Periodicity
    first: int

    @property
    def summary(self) -> str:
        """A few lines for the user."""
        lines = [f"from revolution {self.first} on: {self.periodicity.verdict}"]
        settled = self.revolutions[self.revolutions["revolution"] >= self.first]
        for joint, rows in settled.groupby("joint", sort=False):
            flight, impact, contact = (100.0 * rows[f"share_{mode}"].mean() for mode in ("flight", "impact", "contact"))
            lines.append(
                f"{joint}: flight {flight:.1f} %, impact {impact:.1f} %, contact {contact:.1f} % of the time; "
                f"{rows['contacts'].mean():.1f} contacts begin a revolution; peak force {rows['peak_force'].max():.4g} N"
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
    """All statistics of one motion.

    Parameters
    ----------
    samples, events : DataFrame
        Tables `jointgap.tables.TRAJECTORY` and `jointgap.tables.EVENTS`.
    mechanism, options
        What they were simulated with.
    first : int
        First revolution that counts as settled (1 = the first).
    angle : float
        Crank angle of the Poincare section [rad].

    Raises
    ------
    InputError
        No joint is loose, or less than two revolutions count.
    """
    made, per_turn = mechanism.applied(), options.samples_per_revolution
    if not made.loose:
        raise InputError("statistics of clearances: all joints are ideal; make one loose")
    begin = (first - 1) * per_turn
    settled = samples.iloc[begin:]
    vectors = np.hstack([clearance_vectors(settled, joint) for joint in made.loose])
    return Cycles(
        section=poincare_section(samples, made.loose, per_turn, angle, first),
        revolutions=joint_revolutions(samples, events, made.loose, per_turn),
        impacts=speed_distribution(
            events,
            made.loose,
            samples["time"].iloc[min(begin, len(samples) - 1)],
            max(options.revolutions - first + 1, 1),
        ),
        eccentricity=eccentricity_band(samples, made.loose, per_turn, first),
        periodicity=periodicity(vectors, per_turn, min(made.clearance(joint) for joint in made.loose)),
        first=first,
    )
