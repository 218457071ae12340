"""Stage reoptimise: optimal link lengths with and without the identified effects."""

from collections.abc import Mapping, Sequence

import pandas as pd

from jointgap.campaign.augment import mechanisms
from jointgap.campaign.outcome import Outcome
from jointgap.config import (
    Box,
    Effect,
    Ensemble,
    Genetic,
    Mechanism,
    Optimise,
    Simulate,
    Surrogate,
)
from jointgap.config.campaign import Campaign
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.schema import CAMPAIGN_OPTIMUM
from jointgap.lengths.optimise import optimise
from jointgap.motion.slider_crank import simulate
from jointgap.rig.cylinder_pressure import with_loads
from jointgap.rig.simulate_run import tolerance_for

# [1] half width of the search box relative to the lengths: it shows whether the optimum moves
_BOX_SHARE = 0.02
_RATIO_MARGIN = 0.02  # [1] by which the limit of the length ratio exceeds the mechanism's own
_REVOLUTIONS = 3  # the last one is in steady state
_SAMPLES_PER_REVOLUTION = 3600  # as in the shipped scenarios
_TOLERANCE_M = 1e-10  # or less for small clearances


def models_to_optimise(
    campaign: Campaign, outcome: Outcome, loads_of_runs: Mapping[str, Sequence[Effect]]
) -> tuple[dict[str, Mechanism], float]:
    """The models ``base`` and ``augmented`` under the known loads of the fastest fitted run, and
    its speed [rad/s]; none if the effects do not change the optimum."""
    runs = [run for run in campaign.runs if run.role != "confirm"]
    fastest = max(runs, key=lambda run: run.speed)
    models = dict(zip(("base", "augmented"), mechanisms(campaign, outcome), strict=True))
    # with ideal joints the transmission angle depends on the lengths only
    is_ideal = not any(mechanism.applied().loose for mechanism in models.values())
    is_ideal = is_ideal or not isinstance(campaign.mechanism, Mechanism)
    if is_ideal or all(candidate.sensor for candidate in outcome.chosen.hypothesis):
        return {}, fastest.speed
    if fastest.direction == "clockwise":
        models = {name: mechanism.applied().mirrored() for name, mechanism in models.items()}
    loads = loads_of_runs.get(fastest.id, ())
    models = {name: with_loads(mechanism, loads) for name, mechanism in models.items()}
    return models, fastest.speed


def optimal_lengths(models: Mapping[str, Mechanism], speed: float) -> pd.DataFrame:
    """Table `CAMPAIGN_OPTIMUM`: simulate each model and optimise the lengths within 2 %."""
    rows = []
    for name, mechanism in models.items():
        if mechanism.applied().loose:
            try:
                optima = _optima(mechanism.applied(), speed)
            except (InputError, SimulationError) as error:
                optima = [{"failed": str(error)}]
            rows += [{"model": name} | row for row in optima]
    return pd.DataFrame(rows, columns=CAMPAIGN_OPTIMUM.names)


def _optima(mechanism: Mechanism, speed: float) -> list[dict]:
    """A row for each source of joint motion."""
    options = Simulate(
        speed=speed,
        tolerance=min(_TOLERANCE_M, tolerance_for(mechanism)),
        revolutions=_REVOLUTIONS,
        samples_per_revolution=_SAMPLES_PER_REVOLUTION,
    )
    crank, rod = mechanism.crank.length, mechanism.rod.length
    low, high = 1.0 - _BOX_SHARE, 1.0 + _BOX_SHARE
    box = Box(crank_length=(low * crank, high * crank), rod_length=(low * rod, high * rod))
    search = Optimise(
        boxes={"near": box},
        ratio_limit=(1 + _RATIO_MARGIN) * crank / rod,
        genetic=Genetic(population=8, generations=10),
        ensemble=Ensemble(members=3, settled_revolution=_REVOLUTIONS),
    )
    points = Surrogate().training_points  # the search leaves them out
    samples = simulate(mechanism, options).samples
    result = optimise(mechanism, options, search, points, samples, {})
    resimulated, optima = result["optimise_resimulated"], result["optimise_optima"]
    steady = resimulated.query("stretch == 'settled' and measure == 'rms'")
    optima = optima[optima["point"] == optima["source"] + "_near_local"]
    optima = optima.assign(
        at_edge=optima["active_bounds"] != "none",
        reduction=optima["rms_reduction"],
        resimulated=optima["point"].map(steady.set_index("point")["reduction"]),
        rms_before=optima["rms"] / (1.0 - optima["rms_reduction"]),
        rms_after=optima["rms"],
    )
    columns = [name for name in CAMPAIGN_OPTIMUM.names if name not in ("model", "failed")]
    return optima[columns].to_dict("records")
