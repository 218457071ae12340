"""Drawing the figures of a scenario, and the data that several of them share."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from jointgap.config import Scenario
from jointgap.core import plot
from jointgap.core.errors import InputError
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.core.plot import Drawing
from jointgap.dynamics.kinematics import Fit
from jointgap.scenario.figures_catalogue import FIGURES, spec_of


def draw(name: str, tables: Mapping[str, pd.DataFrame], scenario: Scenario) -> Drawing:
    """Draw one figure."""
    spec = spec_of(name)
    for table in spec.tables:
        if table not in tables:
            raise InputError(f"figure {name} needs the table '{table}'; give it (needed: {', '.join(spec.tables)})")
    with plot.matplotlib_style():
        return spec.load()(tables, scenario)


def draw_all(
    tables: Mapping[str, pd.DataFrame], scenario: Scenario, folder: Path | str, names: Iterable[str] = FIGURES
) -> tuple[Path, ...]:
    """Draw the figures `names` (all still ones by default) and save them in `folder`; the files written.

    `tables` and `scenario` as in `draw`.
    """
    return tuple(path for name in names for path in plot.save(draw(name, tables, scenario), Path(folder) / name))


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


def settled_revolution(trajectory: pd.DataFrame, scenario: Scenario) -> pd.DataFrame:
    """The samples of a `trajectory` (table `TRAJECTORY`) in the revolution that the `scenario` takes as settled."""
    return revolution(trajectory, scenario, scenario.optimise.ensemble.settled_revolution)


def loose_joints(scenario: Scenario) -> dict[str, int]:
    """Names of the loose joints from the frame to the slider, with their numbers in the names of columns."""
    return {joint: JOINT_NUMBERS[joint] for joint in scenario.mechanism.applied().loose}


def degrees(crank_angle: pd.Series) -> np.ndarray:
    """Crank angle for an abscissa, from the start of its revolution on [deg]: the revolution begins in [0, 360)."""
    angle = np.degrees(crank_angle.to_numpy())
    return angle - 360.0 * np.floor(angle[0] / 360.0 + 1e-9)


def predictions(
    surrogates: Mapping[str, Mapping[str, Fit]], trajectory: pd.DataFrame, scenario: Scenario
) -> pd.DataFrame:
    """What surrogates say at the samples of the first revolution: the frame ``predictions`` that some figures need."""
    first = revolution(trajectory, scenario, 1)
    angle, speed = first["crank_angle"].to_numpy(), first["crank_speed"].to_numpy()
    frames = []
    for surrogate, fits in surrogates.items():
        for output, fit in fits.items():
            value, slope = fit(angle)
            columns = {"crank_angle": angle, "value": value, "rate": slope * speed}
            frames.append(pd.DataFrame({"surrogate": surrogate, "output": output} | columns))
    return pd.concat(frames, ignore_index=True)


def predicted(tables: Mapping[str, pd.DataFrame], surrogate: str, output: str) -> pd.DataFrame:
    """The rows of one `surrogate` and `output` in the frame ``predictions`` of the `tables`."""
    frame = tables["predictions"]
    chosen = frame[(frame["surrogate"] == surrogate) & (frame["output"] == output)]
    return chosen.reset_index(drop=True)


def training_rows(scenario: Scenario) -> slice:
    """The samples of a revolution at which the networks were trained."""
    return slice(None, None, scenario.simulate.samples_per_revolution // (scenario.surrogate.training_points - 1))
