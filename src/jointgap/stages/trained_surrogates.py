"""The surrogates that a scenario's networks were trained to, as functions of the crank angle."""

from functools import partial

from jointgap import tables
from jointgap.joints import JOINT_NUMBERS
from jointgap.mechanism import Fit
from jointgap.stages.scenario_results import CLEARANCE, ScenarioResults, outputs_of
from jointgap.surrogate.clearance_network import ClearanceNetwork
from jointgap.surrogate.crank_speed import CrankSpeed
from jointgap.surrogate.network import Network


def trained_surrogates(results: ScenarioResults) -> dict[str, dict[str, Fit]]:
    """Both surrogates, ``networks`` (default seed) and ``clearance``: a function for each output."""
    fits = results.read(tables.FIT)
    networks = {output: Network.from_frame(fit) for output, fit in fits.groupby("output", sort=False)}
    fit = results.read(tables.CLEARANCE_FIT)
    speed = CrankSpeed.of(results.read(tables.TRAJECTORY)) if fit["speed"].isna().any() else None
    mechanism = results.scenario.mechanism
    numbers = [JOINT_NUMBERS[joint] for joint in mechanism.applied().loose]
    joints = {number: ClearanceNetwork.from_frame(fit, number, speed) for number in numbers}
    return {
        "networks": {output: network.values_and_slopes for output, network in networks.items()},
        CLEARANCE: {
            output: partial(joints[tables.number_of(output)].output, output) for output in outputs_of(mechanism)
        },
    }
