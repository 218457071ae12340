"""A fresh store for each test, copied from one that was made once; scenarios to publish into it."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from jointgap.config import Scenario
from jointgap.core.publish import opened, publish_records, store_address
from jointgap.scenario.mlflow_runs import scenario_records
from tests.track import synthetic


@pytest.fixture(scope="session", autouse=True)
def _no_server():
    """The store of the results folder is the one to use, whatever the environment says."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        yield


@pytest.fixture(scope="session")
def new_results(tmp_path_factory) -> Callable[[], Path]:
    """Makes results folders, with a space in their names, that hold an empty store."""
    first = tmp_path_factory.mktemp("empty store")
    with opened(store_address(first)):
        pass

    def make() -> Path:
        folder = tmp_path_factory.mktemp("my results")
        shutil.copy(first / "mlflow.db", folder)
        return folder

    return make


@pytest.fixture(scope="session")
def finished(new_results) -> Path:
    """A results folder with a finished scenario that is published; for tests that only look."""
    results = new_results()
    publish(results, synthetic.finished(results / "paper"), "paper", synthetic.scenario(simulate={"revolutions": 4}))
    return results


@pytest.fixture
def results(new_results) -> Path:
    """A results folder that holds an empty store."""
    return new_results()


@pytest.fixture
def client(results: Path):
    """MLflow's own view of the store."""
    return client_of(results)


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
