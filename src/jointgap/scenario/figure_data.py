"""Data shared by several figures of a scenario."""

import numpy as np
import pandas as pd

from jointgap.config import Joint, Scenario
from jointgap.core.joints import JOINT, JOINT_NUMBERS

MODES = ("flight", "impact", "contact")
SMALLEST_FORCE = 1.0  # [N] lower end of force axes


def round_number(value: float) -> float:
    """The largest of 1, 2, 5, 10, 20 ... up to `value`, at least 1."""
    if not 1.0 < value < np.inf:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= value))


def revolution(trajectory: pd.DataFrame, scenario: Scenario, number: int) -> pd.DataFrame:
    """The samples of one revolution, both ends included."""
    samples = scenario.simulate.samples_per_revolution
    return trajectory.iloc[(number - 1) * samples : number * samples + 1].reset_index(drop=True)


def loose_joints(scenario: Scenario) -> dict[str, int]:
    """Names of the loose joints from the frame to the slider, with their numbers in the names of
    columns."""
    return {joint: JOINT_NUMBERS[joint] for joint in scenario.mechanism.applied().loose}


def degrees(crank_angle: pd.Series) -> np.ndarray:
    """Crank angle of an abscissa [deg], continuous; the first revolution begins in [0, 360)."""
    angle = np.degrees(crank_angle.to_numpy())
    return angle - 360.0 * np.floor(angle[0] / 360.0 + 1e-9)


def contacts_of(events: pd.DataFrame, joint: str) -> pd.DataFrame:
    """One row per contact of a joint: its start, with the values at its end; null where it has not
    ended."""
    events = events[events["joint"] == joint]
    starts = events[events["event"] == "impact"].reset_index(drop=True)
    ends = events[events["event"] == "separation"].reset_index(drop=True)
    return starts[["crank_angle", "approach_speed"]].join(
        ends[["impulse", "peak_force", "maxima", "duration"]]
    )


def eccentricity(samples: pd.DataFrame, name: str, joint: Joint | None) -> np.ndarray:
    """Journal's centre relative to its bearing's centre (n, 2) [m], in `samples` of the trajectory;
    nan where the direction is undefined, because the centres coincide.
    """
    # the table's vector points to the centre of the joint's body, which carries the journal or the
    # bearing
    sign = 1.0 if joint is not None and joint.journal == JOINT[name].body else -1.0
    r, gamma = (
        samples[f"{quantity}{JOINT_NUMBERS[name]}"].to_numpy() for quantity in ("r", "gamma")
    )
    return np.column_stack([sign * r * np.cos(gamma), sign * r * np.sin(gamma)])
