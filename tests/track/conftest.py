"""A fresh store for each test, copied from one that was migrated once; scenarios to publish into it."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from jointgap.track.experiment_views import View
from jointgap.track.mlflow_store import default_address, opened
from jointgap.track.publish import publish
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
    with opened(default_address(first), first):
        pass

    def make() -> Path:
        folder = tmp_path_factory.mktemp("my results")
        shutil.copy(first / "mlflow.db", folder)
        return folder

    return make


@pytest.fixture(scope="session")
def two_scenarios(new_results) -> dict[str, dict]:
    """Two finished scenarios, published into one store: by name, what `publish` took and the runs it made.

    For tests that only look.
    """
    results = new_results()
    found = {}
    for salt, name in enumerate(("paper", "frictionless")):
        options = synthetic.scenario(simulate={"revolutions": 4 + salt})
        given = arguments(results, synthetic.finished(results / name, salt), name) | {"options": options}
        found[name] = {"given": given, "runs": publish(**given)["runs"]}
    return found


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


def not_held(view: View, run) -> set[str]:
    """Columns, and what charts show, of a `view` that the `run` does not hold."""
    held = {f"metrics.{name}" for name in run.data.metrics} | {f"params.{name}" for name in run.data.params}
    held |= {f"tags.{name}" for name in run.data.tags}
    params, metrics = view.parallel
    shown = {f"metrics.{metric}" for section in view.sections for metric in section.metrics}
    shown |= {f"params.{name}" for name in params} | {f"metrics.{name}" for name in metrics}
    return (shown | set(view.columns)) - held


def arguments(results: Path, files: dict[str, Path], name: str = "made_up") -> dict:
    """What `publish` takes."""
    figure = results / name / "figures/figure 5.png"
    figure.parent.mkdir(parents=True)
    figure.write_bytes(b"a picture")
    benchmarks = results / name / "benchmarks"
    return {
        "scenario_name": name,
        "options": synthetic.scenario(),
        "sections": synthetic.SECTIONS,
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
def learned(results: Path) -> dict:
    """What `publish` takes, for a scenario of which the simulation and two networks are done."""
    return arguments(results, synthetic.learned(results / "made_up"))
