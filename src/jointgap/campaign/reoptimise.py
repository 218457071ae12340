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
    OptimiseLinkage,
    Simulate,
    Surrogate,
)
from jointgap.config.campaign import Campaign
from jointgap.config.linkage_file import LinkageFile
from jointgap.core.errors import InputError, SimulationError
from jointgap.core.schema import CAMPAIGN_OPTIMUM
from jointgap.lengths.linkages import LinkageProblem, find_lengths
from jointgap.lengths.optimise import optimise
from jointgap.motion.linkage import simulate_linkage
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
) -> tuple[dict[str, Mechanism | LinkageFile], float]:
    """The models ``base`` and ``augmented`` under the known loads of the fastest fitted run, and
    its speed [rad/s], negative if clockwise; none if the effects do not change the optimum."""
    runs = [run for run in campaign.runs if run.role != "confirm"]
    fastest, options = max(runs, key=lambda run: run.speed), campaign.optimise_linkage
    is_searched = options is not None or isinstance(campaign.mechanism, Mechanism)
    if not is_searched or all(candidate.sensor for candidate in outcome.chosen.hypothesis):
        return {}, fastest.speed
    # with ideal joints the transmission angle depends on the lengths only
    is_of_angle = options is None or options.objective.endswith("transmission_angle")
    models = dict(zip(("base", "augmented"), mechanisms(campaign, outcome), strict=True))
    models = {name: model.applied() for name, model in models.items()}
    models = {name: model for name, model in models.items() if model.loose or not is_of_angle}
    if fastest.side < 0.0:
        models = {name: mechanism.mirrored() for name, mechanism in models.items()}
    loads = loads_of_runs.get(fastest.id, ())
    models = {name: with_loads(mechanism, loads) for name, mechanism in models.items()}
    return models, fastest.side * fastest.speed


def optimal_lengths(
    models: Mapping[str, Mechanism | LinkageFile],
    speed: float,
    options: OptimiseLinkage | None = None,
) -> pd.DataFrame:
    """Table `CAMPAIGN_OPTIMUM`: simulate each model and optimise the lengths, of a slider-crank
    within 2 %."""
    rows = []
    for name, model in models.items():
        try:
            optima = _of_linkage(model, speed, options) if options else _optima(model, abs(speed))
        except (InputError, SimulationError) as error:
            optima = [{"failed": str(error)}]
        rows += [{"model": name} | row for row in optima]
    return pd.DataFrame(rows, columns=CAMPAIGN_OPTIMUM.names)


def check_lengths(campaign: Campaign) -> None:
    """InputError where `optimise_linkage` does not suit the mechanism."""
    if options := campaign.optimise_linkage:
        speed = max(run.speed for run in campaign.runs)
        file = campaign.mechanism.applied()
        try:
            problem = LinkageProblem(file, _simulate(file, speed, options.ensemble), options)
            problem.check()
            _ = problem.region
        except InputError as error:
            raise InputError(f"optimise_linkage: {error}") from None


def _simulate(model: Mechanism | LinkageFile, speed: float, ensemble: Ensemble) -> Simulate:
    return Simulate(
        speed=speed,
        tolerance=min(_TOLERANCE_M, tolerance_for(model)),
        revolutions=ensemble.settled_revolution,
        samples_per_revolution=_SAMPLES_PER_REVOLUTION,
    )


def _of_linkage(file: LinkageFile, speed: float, options: OptimiseLinkage) -> list[dict]:
    """A row for each length; with a clockwise crank the file is the mirror image."""
    side = {name: -1.0 if speed < 0.0 and name.endswith(".y") else 1.0 for name in options.lengths}
    bounds = {
        name: tuple(sorted(side[name] * end for end in ends))
        for name, ends in options.lengths.items()
    }
    options = options.model_copy(update={"lengths": bounds})
    simulate = _simulate(file, abs(speed), options.ensemble)
    problem = LinkageProblem(file, simulate, options)
    found = find_lengths(problem, simulate_linkage(file, simulate).samples)
    size = found.gains.loc[problem.goal.measure]
    shared = {
        "source": "ideal_joints" if problem.goal.load else found.search.source,
        "objective": problem.goal.words,
        "at_edge": found.search.region.active(found.lengths) != "none",
        "reduction": found.estimate,
        "resimulated": size["reduction"],
        "before": size["original"],
        "after": size["size"],
    }
    pairs = zip(problem.names, problem.original, found.lengths, strict=True)
    return [
        {"length": name, "original": side[name] * old, "optimum": side[name] * new} | shared
        for name, old, new in pairs
    ]


def _optima(mechanism: Mechanism, speed: float) -> list[dict]:
    """A row for each source of joint motion and each length."""
    ensemble = Ensemble(members=3, settled_revolution=_REVOLUTIONS)
    options = _simulate(mechanism, speed, ensemble)
    original = {"crank_length": mechanism.crank.length, "rod_length": mechanism.rod.length}
    low, high = 1.0 - _BOX_SHARE, 1.0 + _BOX_SHARE
    box = Box(**{name: (low * length, high * length) for name, length in original.items()})
    search = Optimise(
        boxes={"near": box},
        ratio_limit=(1 + _RATIO_MARGIN) * original["crank_length"] / original["rod_length"],
        genetic=Genetic(population=8, generations=10),
        ensemble=ensemble,
    )
    points = Surrogate().training_points  # the search leaves them out
    samples = simulate(mechanism, options).samples
    result = optimise(mechanism, options, search, points, samples, {})
    resimulated, optima = result["optimise_resimulated"], result["optimise_optima"]
    steady = resimulated.query("stretch == 'settled' and measure == 'rms'").set_index("point")
    optima = optima[optima["point"] == optima["source"] + "_near_local"]
    optima = optima.assign(
        objective="RMS error of the transmission angle",
        at_edge=optima["active_bounds"] != "none",
        reduction=optima["rms_reduction"],
        resimulated=optima["point"].map(steady["reduction"]),
        before=optima["point"].map(steady["original_error"]),
        after=optima["point"].map(steady["error"]),
    )
    parts = [
        optima.assign(length=name, original=length, optimum=optima[name])
        for name, length in original.items()
    ]
    columns = [name for name in CAMPAIGN_OPTIMUM.names if name not in ("model", "failed")]
    return pd.concat(parts).sort_index(kind="stable")[columns].to_dict("records")
