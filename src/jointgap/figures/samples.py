"""Parts of a trajectory that figures show."""

import numpy as np
import pandas as pd

from jointgap.config import Scenario


def revolution(trajectory: pd.DataFrame, scenario: Scenario, number: int) -> pd.DataFrame:
    """The samples of one revolution, both ends included.

    Parameters
    ----------
    trajectory : DataFrame
        Table `jointgap.tables.TRAJECTORY`.
    scenario : Scenario
        Says how many samples a revolution has.
    number : int
        1 for the first.
    """
    samples = scenario.simulate.samples_per_revolution
    return trajectory.iloc[(number - 1) * samples : number * samples + 1].reset_index(drop=True)


def settled_revolution(trajectory: pd.DataFrame, scenario: Scenario) -> pd.DataFrame:
    """The samples of the revolution that the scenario takes as settled."""
    return revolution(trajectory, scenario, scenario.optimise.ensemble.settled_revolution)


def degrees(crank_angle: pd.Series) -> np.ndarray:
    """Crank angle for an abscissa, running from the start of its revolution [deg]: the revolution begins in [0, 360)."""
    angle = np.degrees(crank_angle.to_numpy())
    return angle - 360.0 * np.floor(angle[0] / 360.0 + 1e-9)
