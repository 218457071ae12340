"""The trained surrogates of a scenario as functions of the crank angle."""

from collections.abc import Mapping
from functools import partial

import pandas as pd

from jointgap.core.joints import number_of
from jointgap.dynamics.kinematics import Fit
from jointgap.networks.clearance import ClearanceNetwork, crank_speed
from jointgap.networks.network import Network
from jointgap.scenario.results import ScenarioResults, outputs_of


def trained_surrogates(results: ScenarioResults) -> dict[str, dict[str, Fit]]:
    """The surrogates ``networks`` (default seed) and ``clearance`` by output; empty without
    networks."""
    if not results.scenario.networks:
        return {}
    fits, fit = results.read("fit").groupby("output", sort=False), results.read("clearance_fit")
    speed = crank_speed(results.read("trajectory")) if fit["speed"].isna().any() else None
    joints = {
        number: ClearanceNetwork.from_frame(fit, number, speed) for number in fit["joint"].unique()
    }
    outputs = outputs_of(results.scenario.mechanism)
    return {
        "networks": {output: Network.from_frame(own).values_and_slopes for output, own in fits},
        "clearance": {
            output: partial(joints[number_of(output)].output, output) for output in outputs
        },
    }


def predictions(surrogates: Mapping[str, Mapping[str, Fit]], first: pd.DataFrame) -> pd.DataFrame:
    """The frame ``predictions``: values and rates of the surrogates at the samples of the first
    revolution."""
    angle, speed = first["crank_angle"].to_numpy(), first["crank_speed"].to_numpy()
    frames = []
    for surrogate, fits in surrogates.items():
        for output, fit in fits.items():
            value, slope = fit(angle)
            columns = {"crank_angle": angle, "value": value, "rate": slope * speed}
            frames.append(pd.DataFrame({"surrogate": surrogate, "output": output} | columns))
    return pd.concat(frames, ignore_index=True)
