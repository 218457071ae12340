"""Scenarios published into an MLflow store, and its runs."""

from collections.abc import Mapping
from pathlib import Path

from jointgap.config import Scenario
from jointgap.core.publish import publish_records, store_address
from jointgap.scenario.mlflow_runs import scenario_records
from tests.scenario import published_tables as synthetic


def client_of(store: Path | str):
    """MLflow's own view of a store, at an address or in a results folder."""
    from mlflow.tracking import MlflowClient

    return MlflowClient(tracking_uri=store if isinstance(store, str) else store_address(store))


def runs_of(client) -> dict:
    """All runs of a store by the name of their experiment and their own."""
    names = {found.experiment_id: found.name for found in client.search_experiments()}
    found = client.search_runs(list(names), max_results=5000)
    runs = {f"{names[run.info.experiment_id]}/{run.info.run_name}": run for run in found}
    assert len(runs) == len(found)
    return runs


def publish(
    results: Path,
    files: Mapping[str, Path],
    name: str = "made_up",
    options: Scenario | None = None,
    address: str | None = None,
) -> dict:
    """Publish the tables of a scenario, with a figure and the costs of three jobs."""
    options, folder = options or synthetic.scenario(), results / name
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    (folder / "figures/figure 5.png").write_bytes(b"a picture")
    for job, seconds in (("simulate", 3.5), ("surrogate/r2", 10.0), ("surrogate/gamma2", 20.0)):
        synthetic.benchmark(folder / f"benchmarks/{job}.tsv", seconds)
    content = scenario_records(options, synthetic.SECTIONS, files, folder)
    return publish_records(name, "made up", content, address, results)
