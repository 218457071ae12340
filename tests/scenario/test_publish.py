"""Publishing is idempotent, replaces changed or interrupted runs, and reports invalid stores."""

import os
import socket
from pathlib import Path

import pytest

from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.core.publish import check_store, opened, store_address
from tests.scenario import published_tables as synthetic
from tests.scenario.mlflow_store import client_of, publish, runs_of
from tests.scenario.published_tables import numbers, scenario


@pytest.fixture
def simulated(results):
    """The tables of a scenario of which only the simulation is done."""
    return synthetic.simulated(results / "made_up")


@pytest.fixture
def published(results):
    """Publishes, and returns what became of each run, how many were deleted and their ids."""

    def publishing(files, *given, **more):
        done = publish(results, files, *given, **more)
        runs = done["runs"]
        states = {name: run["state"] for name, run in runs.items()}
        return states, done["deleted"], {name: run["run_id"] for name, run in runs.items()}

    return publishing


def number_of_runs(client) -> int:
    """Deleted ones too."""
    from mlflow.entities import ViewType

    experiments = [found.experiment_id for found in client.search_experiments()]
    return len(client.search_runs(experiments, run_view_type=ViewType.ALL))


def test_publishing_a_run_twice_changes_nothing(published, simulated, client):
    states, _, ids = published(simulated)
    assert states == {"simulate": "written", "figures": "written"}
    run = runs_of(client)["jointgap-simulate/made_up"]
    assert (run.info.status, run.info.run_id) == ("FINISHED", ids["simulate"])
    tags = run.data.tags
    assert (tags["jointgap.scenario"], tags["jointgap.stage"]) == ("made_up", "simulate")
    assert tags["mlflow.source.git.commit"] and tags["mlflow.note.content"] == "made up"
    assert published(simulated) == ({"simulate": "kept", "figures": "kept"}, 0, ids)
    assert number_of_runs(client) == 2
    states, deleted, _ = published(simulated, "other")
    assert set(states.values()) == {"written"} and deleted == 0 and len(runs_of(client)) == 4


def test_changed_or_interrupted_runs_are_replaced(published, simulated, client):
    _, _, old = published(simulated)
    other = scenario(optimise={"ratio_limit": 0.28})
    states, deleted, new = published(simulated, options=other)
    assert states == {"simulate": "kept", "figures": "written"} and deleted == 1
    assert client.get_run(old["figures"]).info.lifecycle_stage == "deleted"
    assert len(runs_of(client)) == 2
    again = {"simulate": "written", "figures": "kept"}
    parquet.write(
        schema.TRAJECTORY, numbers(schema.TRAJECTORY, 50, salt=3), simulated["trajectory"]
    )
    states, _, new = published(simulated, options=other)
    assert states == again and new["simulate"] not in (old["simulate"], None)
    client.update_run(new["simulate"], "RUNNING")  # as an interrupted one is
    states, deleted, new = published(simulated, options=other)
    assert states == again and deleted == 1
    assert {run.info.status for run in runs_of(client).values()} == {"FINISHED"}
    client.delete_experiment(client.get_run(new["simulate"]).info.experiment_id)
    published(simulated, options=other)
    assert len(runs_of(client)) == 2  # the experiment comes back


def test_nested_runs_follow_their_parent_and_outputs(results, published, client):
    files = synthetic.learned(results / "made_up")
    client.delete_run(published(files)[2]["surrogate"])
    states, _, ids = published(files)
    assert states["surrogate"] == "written" and states["surrogate/r2"] == "kept"
    assert client.get_run(ids["surrogate/r2"]).data.tags["mlflow.parentRunId"] == ids["surrogate"]
    states, _, _ = published(
        {name: path for name, path in files.items() if not name.endswith("/r3")}
    )
    assert "surrogate/r3" not in states and "jointgap-surrogate/made_up r3" not in runs_of(client)


def test_a_store_that_was_moved_or_that_is_none_is_refused(results, simulated, tmp_path):
    publish(results, simulated)
    moved = results.rename(tmp_path / "moved")
    files = {name: moved / "made_up" / path.name for name, path in simulated.items()}
    with pytest.raises(
        InputError, match=r"mlflow\.db was created elsewhere.*move it back, or move the file away"
    ):
        publish(moved, files)
    (moved / "mlflow.db").write_bytes(b"a letter to somebody" * 100)
    with pytest.raises(
        InputError, match=r"mlflow\.db cannot be reached or used .*move the file away"
    ):
        publish(moved, files)
    assert (moved / "mlflow.db").read_bytes().startswith(b"a letter")


def test_a_store_whose_making_was_interrupted_is_not_there(tmp_path, monkeypatch):
    def killed(*given, **more):
        Path(*tmp_path.glob(".mlflow-*"), "mlflow.db").write_bytes(b"half a store")
        raise KeyboardInterrupt

    monkeypatch.setattr("mlflow.tracking.MlflowClient.search_experiments", killed)
    with pytest.raises(KeyboardInterrupt), opened(store_address(tmp_path)):
        pass
    assert not (tmp_path / "mlflow.db").exists()


def test_a_store_that_does_not_answer_is_one_error_without_its_password(tmp_path):
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        server = f"127.0.0.1:{closed.getsockname()[1]}"
        for address in (f"http://joe:secret@{server}", "postgres://host/runs", "nowhere://x"):
            with pytest.raises(InputError, match="start the server, correct its address") as raised:
                check_store(address)
            assert "secret" not in str(raised.value) and len(raised.value.args) == 1
    check_store(f"sqlite:///{tmp_path / 'new.db'}")  # need not be there before the first job
    assert not list(tmp_path.iterdir())


def test_publishing_to_a_file_needs_no_network(
    new_results, results, simulated, monkeypatch, tmp_path
):
    def refuse(*given):
        raise AssertionError(f"network: {given}")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    (new_results() / "mlflow.db").rename(tmp_path / "shared.db")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{os.path.relpath(tmp_path)}/shared.db")
    assert store_address(results) == f"sqlite:///{tmp_path}/shared.db"
    publish(results, simulated)
    assert len(runs_of(client_of(results))) == 2
    assert (tmp_path / "mlflow-artifacts/simulate").is_dir()
