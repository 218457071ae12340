"""Stage reoptimise: optimal link lengths with and without the identified effects."""

from collections.abc import Mapping

import pandas as pd

from jointgap.config import Box, Ensemble, Genetic, Mechanism, Optimise, Simulate, Surrogate
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.joints import outputs
from jointgap.core.schema import CAMPAIGN_OPTIMUM
from jointgap.dynamics.simulation import simulate
from jointgap.lengths.optimise import optimise
from jointgap.rig.simulate_run import tolerance_for

# [1] half width of the search box relative to the lengths: it shows whether the optimum moves
_BOX_SHARE = 0.02
_RATIO_MARGIN = 0.02  # [1] by which the limit of the length ratio exceeds the mechanism's own
_SURROGATE = Surrogate(iterations=300, seeds=(0,))
_REVOLUTIONS = 3  # the last one is in steady state
_SAMPLES_PER_REVOLUTION = 3600  # as in the shipped scenarios
_TOLERANCE_M = 1e-10  # or less for small clearances


def reoptimise(models: Mapping[str, Mechanism], speed: float) -> pd.DataFrame:
    """Simulate each model, train networks of the clearance vectors and optimise the lengths within
    2 %."""
    rows = []
    for name, mechanism in models.items():
        if mechanism.applied().loose:
            try:
                rows += [{"model": name} | row for row in _optima(mechanism.applied(), speed)]
            except (InputError, SimulationError) as error:
                rows.append({"model": name, "failed": str(error)})
    return pd.DataFrame(rows, columns=CAMPAIGN_OPTIMUM.names)


def _optima(mechanism: Mechanism, speed: float) -> list[dict]:
    """One row for each source of joint motion."""
    from jointgap.networks.train import train  # PyTorch takes seconds to start

    steps = {"revolutions": _REVOLUTIONS, "samples_per_revolution": _SAMPLES_PER_REVOLUTION}
    options = Simulate(speed=speed, tolerance=min(_TOLERANCE_M, tolerance_for(mechanism)), **steps)
    trajectory = simulate(mechanism, options).samples
    clearance = [name for name in outputs(mechanism.loose) if "_" not in name]
    fits = {
        name: train(trajectory, name, _SURROGATE)[0].network.values_and_slopes for name in clearance
    }
    crank, rod = mechanism.crank.length, mechanism.rod.length
    sides = {"crank_length": crank, "rod_length": rod}
    box = Box(
        **{
            key: (length * (1 - _BOX_SHARE), length * (1 + _BOX_SHARE))
            for key, length in sides.items()
        }
    )
    search = Optimise(
        boxes={"near": box},
        ratio_limit=(1 + _RATIO_MARGIN) * crank / rod,
        genetic=Genetic(population=8, generations=10),
        ensemble=Ensemble(members=3, settled_revolution=_REVOLUTIONS),
    )
    result = optimise(
        mechanism, options, search, _SURROGATE.training_points, trajectory, {"network": fits}
    )
    resimulated, optima = result["optimise_resimulated"], result["optimise_optima"]
    settled = resimulated.query("stretch == 'settled' and measure == 'rms'").set_index("point")[
        "reduction"
    ]
    optima = optima[optima["point"] == optima["source"] + "_near_local"]
    found = optima.assign(
        at_edge=optima["active_bounds"] != "none",
        reduction=optima["rms_reduction"],
        resimulated=optima["point"].map(settled),
        rms_before=optima["rms"] / (1.0 - optima["rms_reduction"]),
        rms_after=optima["rms"],
    )
    return found[CAMPAIGN_OPTIMUM.names[1:-1]].to_dict("records")
