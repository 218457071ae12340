"""A fresh store for each test, copied from one that was migrated once; scenarios to publish into it."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from jointgap.track.store import create_store, default_address
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
    create_store(first)

    def make() -> Path:
        folder = tmp_path_factory.mktemp("my results")
        shutil.copy(first / "mlflow.db", folder)
        return folder

    return make


@pytest.fixture
def results(new_results) -> Path:
    """A results folder that holds an empty store."""
    return new_results()


@pytest.fixture
def client(results: Path):
    """MLflow's own view of the store."""
    return client_of(results)


def client_of(results: Path):
    """MLflow's own view of the store in `results`."""
    from mlflow.tracking import MlflowClient

    return MlflowClient(tracking_uri=default_address(results))


def arguments(results: Path, files: dict[str, Path]) -> dict:
    """What `publish` takes."""
    figure = results / "made_up/figures/figure 5.png"
    figure.parent.mkdir(parents=True)
    figure.write_bytes(b"a picture")
    benchmarks = results / "made_up/benchmarks"
    return {
        "scenario_name": "made_up",
        "options": synthetic.scenario(),
        "tables": files,
        "figures": [figure],
        "benchmarks": [
            synthetic.benchmark(benchmarks / "simulate.tsv", 3.5),
            synthetic.benchmark(benchmarks / "surrogate/r2.tsv", 10.0),
            synthetic.benchmark(benchmarks / "surrogate/gamma2.tsv", 20.0),
        ],
        "tracking_uri": None,
        "results_folder": results,
    }


@pytest.fixture
def simulated(results: Path) -> dict:
    """What `publish` takes, for a scenario of which only the simulation is done."""
    return arguments(results, synthetic.simulated(results / "made_up"))


@pytest.fixture
def finished(results: Path) -> dict:
    """What `publish` takes, for a scenario that is done."""
    return arguments(results, synthetic.finished(results / "made_up"))
