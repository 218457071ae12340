"""The surrogates that a scenario's networks were trained to, as functions of the crank angle."""

from functools import partial

from jointgap.core import schema
from jointgap.core.joints import JOINT_NUMBERS, number_of
from jointgap.dynamics.kinematics import Fit
from jointgap.networks.clearance import ClearanceNetwork, crank_speed
from jointgap.networks.network import Network
from jointgap.scenario.results import CLEARANCE, ScenarioResults, outputs_of


def trained_surrogates(results: ScenarioResults) -> dict[str, dict[str, Fit]]:
    """The surrogates ``networks`` (default seed) and ``clearance`` of a scenario that trains any, by output."""
    if not results.scenario.networks:
        return {}
    fits = results.read(schema.FIT)
    networks = {output: Network.from_frame(fit) for output, fit in fits.groupby("output", sort=False)}
    fit = results.read(schema.CLEARANCE_FIT)
    speed = crank_speed(results.read(schema.TRAJECTORY)) if fit["speed"].isna().any() else None
    mechanism = results.scenario.mechanism
    numbers = [JOINT_NUMBERS[joint] for joint in mechanism.applied().loose]
    joints = {number: ClearanceNetwork.from_frame(fit, number, speed) for number in numbers}
    return {
        "networks": {output: network.values_and_slopes for output, network in networks.items()},
        CLEARANCE: {output: partial(joints[number_of(output)].output, output) for output in outputs_of(mechanism)},
    }
