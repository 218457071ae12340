"""The trained networks of a scenario as functions of the crank angle."""

from collections.abc import Mapping

import pandas as pd

from jointgap.config.scenario_results import ScenarioResults
from jointgap.motion.kinematics import Fit
from jointgap.networks.network import Network


def trained_surrogates(results: ScenarioResults) -> dict[str, dict[str, Fit]]:
    """The paper's ``networks`` (default seed) by output; empty without networks."""
    if not results.scenario.networks:
        return {}
    weights = results.read("fit").groupby("output", sort=False)
    return {
        "networks": {
            output: Network.from_frame(frame).values_and_slopes for output, frame in weights
        }
    }


def predictions(surrogates: Mapping[str, Mapping[str, Fit]], samples: pd.DataFrame) -> pd.DataFrame:
    """The frame ``predictions``: values and rates of the surrogates at the samples of the first
    revolution."""
    angle, speed = samples["crank_angle"].to_numpy(), samples["crank_speed"].to_numpy()
    frames = []
    for surrogate, fits in surrogates.items():
        for output, fit in fits.items():
            value, slope = fit(angle)
            columns = {"crank_angle": angle, "value": value, "rate": slope * speed}
            frames.append(pd.DataFrame({"surrogate": surrogate, "output": output} | columns))
    return pd.concat(frames, ignore_index=True)
