"""The registry of a scenario's figures, and the data that several of them show."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.core.plot import Figures

if TYPE_CHECKING:
    from jointgap.dynamics.kinematics import Fit

Tables = Mapping[str, pd.DataFrame]
FIGURES = Figures()
figure = FIGURES.figure
NETWORKS_PART, MOTION_PART, CONTACT_PART, OPTIMUM_PART = "Networks", "Motion", "Contact", "Optimum"
"""Categories: sections of the report."""

NETWORKS = "networks"
"""Name of the surrogate that the paper's networks make."""


def round_number(value: float) -> float:
    """The largest of 1, 2, 5, 10, 20 ... up to `value`, at least 1: a factor to draw by."""
    if not 1.0 < value < np.inf:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= value))


def revolution(trajectory: pd.DataFrame, scenario: Scenario, number: int) -> pd.DataFrame:
    """The samples of one revolution, both ends included."""
    samples = scenario.simulate.samples_per_revolution
    return trajectory.iloc[(number - 1) * samples : number * samples + 1].reset_index(drop=True)


def first_and_settled(trajectory: pd.DataFrame, scenario: Scenario) -> dict[str, tuple[str, pd.DataFrame]]:
    """Colour and samples of the first and of the settled revolution, by title."""
    settled = scenario.optimise.ensemble.settled_revolution
    return {
        "first revolution": ("first", revolution(trajectory, scenario, 1)),
        f"settled revolution ({settled})": ("settled", revolution(trajectory, scenario, settled)),
    }


def loose_joints(scenario: Scenario) -> dict[str, int]:
    """Names of the loose joints from the frame to the slider, with their numbers in the names of columns."""
    return {joint: JOINT_NUMBERS[joint] for joint in scenario.mechanism.applied().loose}


def degrees(crank_angle: pd.Series) -> np.ndarray:
    """Crank angle for an abscissa, from the start of its revolution on [deg]: the revolution begins in [0, 360)."""
    angle = np.degrees(crank_angle.to_numpy())
    return angle - 360.0 * np.floor(angle[0] / 360.0 + 1e-9)


def predictions(
    surrogates: Mapping[str, Mapping[str, "Fit"]], trajectory: pd.DataFrame, scenario: Scenario
) -> pd.DataFrame:
    """Values and rates of the surrogates at the samples of the first revolution: the frame ``predictions``."""
    first = revolution(trajectory, scenario, 1)
    angle, speed = first["crank_angle"].to_numpy(), first["crank_speed"].to_numpy()
    frames = []
    for surrogate, fits in surrogates.items():
        for output, fit in fits.items():
            value, slope = fit(angle)
            columns = {"crank_angle": angle, "value": value, "rate": slope * speed}
            frames.append(pd.DataFrame({"surrogate": surrogate, "output": output} | columns))
    return pd.concat(frames, ignore_index=True)


def predicted(tables: Tables, output: str) -> pd.DataFrame:
    """What the network of one `output` predicts: rows of the frame ``predictions``."""
    frame = tables["predictions"]
    return frame[(frame["surrogate"] == NETWORKS) & (frame["output"] == output)].reset_index(drop=True)


def by_source(tables: Tables) -> dict[str, pd.DataFrame]:
    """The table kinematics by source."""
    return dict(list(tables["kinematics"].groupby("source")))
