"""Stage reoptimise: does what was missing move the optimum? A scenario's stages for the model before and after."""

from collections.abc import Mapping

import pandas as pd

from jointgap.config import Box, Ensemble, Genetic, Mechanism, Optimise, Simulate, Surrogate
from jointgap.core import schema
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.joints import JOINT_NUMBERS
from jointgap.dynamics.kinematics import Fit
from jointgap.dynamics.simulation import simulate
from jointgap.lengths.optimise import optimise
from jointgap.rig.simulate_run import tolerance_for

NETWORK = "network"

_BOX_SHARE = (
    0.02  # [1] of the lengths, to either side: the question is whether the optimum moves, not where the best one lies
)
_RATIO_MARGIN = 0.02  # [1] by which the largest ratio of the lengths exceeds the mechanism's own
_SURROGATE = Surrogate(iterations=300, seeds=(0,))
_REVOLUTIONS = 3  # the last one is settled
_SAMPLES_PER_REVOLUTION = 3600  # as in the shipped scenarios
_TOLERANCE_M = 1e-10  # or less where clearances are small


def reoptimise(models: Mapping[str, Mechanism], speed: float) -> pd.DataFrame:
    """Simulate, train and optimise each model anew.

    The budget is small: networks of 300 iterations, for the clearance vectors alone, which is what the optimisation
    takes of them; a box of 2 % around the lengths.
    """
    rows = [row for name, mechanism in models.items() for row in _rows(name, mechanism.applied(), speed)]
    return pd.DataFrame(rows, columns=schema.CAMPAIGN_OPTIMUM.names)


def _rows(name: str, mechanism: Mechanism, speed: float) -> list[dict]:
    if not mechanism.loose:
        return []
    try:
        return [{"model": name} | row for row in _optima(mechanism, speed)]
    except (InputError, SimulationError) as error:
        return [{"model": name, "failed": str(error)}]


def _optima(mechanism: Mechanism, speed: float) -> list[dict]:
    """One row for each source of the motion in the joints."""
    tolerance = min(_TOLERANCE_M, tolerance_for(mechanism))
    options = Simulate(
        speed=speed, revolutions=_REVOLUTIONS, samples_per_revolution=_SAMPLES_PER_REVOLUTION, tolerance=tolerance
    )
    trajectory = simulate(mechanism, options).samples
    numbers = [JOINT_NUMBERS[joint] for joint in mechanism.loose]
    fits = {output: _trained(trajectory, output) for number in numbers for output in (f"r{number}", f"gamma{number}")}
    result = optimise(mechanism, options, _search(mechanism), _SURROGATE.training_points, trajectory, {NETWORK: fits})
    optima = result.optima.query("method == 'local'")
    optima = optima[optima["point"] == optima["source"] + "_near_local"]
    settled = result.resimulated.query("stretch == 'settled' and measure == 'rms'").set_index("point")["reduction"]
    return [
        {
            "source": row["source"],
            "crank_length": row["crank_length"],
            "rod_length": row["rod_length"],
            "at_edge": row["active_bounds"] != "none",
            "reduction": row["rms_reduction"],
            "resimulated": settled[row["point"]],
            "rms_before": row["rms"] / (1.0 - row["rms_reduction"]),
            "rms_after": row["rms"],
        }
        for row in optima.to_dict("records")
    ]


def _trained(trajectory: pd.DataFrame, output: str) -> Fit:
    from jointgap.networks.train import train  # PyTorch takes seconds to start

    return train(trajectory, output, _SURROGATE)[0].network.values_and_slopes


def _search(mechanism: Mechanism) -> Optimise:
    crank, rod = mechanism.crank.length, mechanism.rod.length
    near = Box(
        crank_length=(crank * (1 - _BOX_SHARE), crank * (1 + _BOX_SHARE)),
        rod_length=(rod * (1 - _BOX_SHARE), rod * (1 + _BOX_SHARE)),
    )
    return Optimise(
        boxes={"near": near},
        ratio_limit=(1 + _RATIO_MARGIN) * crank / rod,
        genetic=Genetic(population=8, generations=10),
        ensemble=Ensemble(members=3, settled_revolution=_REVOLUTIONS),
    )
