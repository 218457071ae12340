"""Addresses in MLflow's interface that open a comparison of the scenarios."""

import json
from urllib.parse import quote

from jointgap.track.mlflow_store import Store, StoredRun


def addresses(store_address: str, base: str) -> dict[str, str]:
    """What to open, by what it shows; empty when nothing is published.

    Parameters
    ----------
    store_address : str
        The MLflow store.
    base : str
        Where its interface is served, e.g. ``http://127.0.0.1:5000``.
    """
    store = Store(store_address)
    found = {}
    optima = _published(store, "optimise")
    if optima:
        experiment, runs = optima
        query = {"runs": [run.run_id for run in runs], "experiments": [experiment]}
        found["optima of all scenarios"] = f"{base}/#/compare-runs?{_query(query)}"
    for stage, words in (("campaign", "verdicts of all campaigns"), ("blind", "scores of all blind trials")):
        published = _published(store, stage)
        if published:
            experiment, runs = published
            query = {"runs": [run.run_id for run in runs], "experiments": [experiment]}
            found[words] = f"{base}/#/compare-runs?{_query(query)}"
    networks = _published(store, "surrogate")
    if networks:
        experiment, _ = networks
        found["MSE curves of all scenarios"] = (
            f"{base}/#/experiments/{experiment}/runs?compareRunsMode=CHART&{_TRAINING}"
        )
    return found


_TRAINING = "workflowType=machine_learning"  # the interface has another face, for language models


def _published(store: Store, stage: str) -> tuple[str, list[StoredRun]] | None:
    """The stage's experiment and the complete run of each scenario in it."""
    experiment = store.experiment(stage, create=False)
    if experiment is None:
        return None
    runs = [
        run
        for run in store.runs(experiment, {"jointgap.stage": stage})
        if run.complete and not run.tags["jointgap.output"]
    ]
    return (experiment, runs) if runs else None


def _query(values: dict[str, list[str]]) -> str:
    """Values as the interface reads them: as JSON."""
    return (
        "&".join(f"{key}={quote(json.dumps(value, separators=(',', ':')))}" for key, value in values.items())
        + f"&{_TRAINING}"
    )
