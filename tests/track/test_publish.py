"""Publishing: nothing twice, what changed is replaced, what was interrupted is made again, one error for a store."""

import os
import socket
import subprocess
import sys
import time

import pytest

from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.core.publish import check_store, opened, store_address
from tests.track import synthetic
from tests.track.conftest import client_of, publish, runs_of
from tests.track.synthetic import numbers, scenario


@pytest.fixture
def simulated(results):
    """The tables of a scenario of which only the simulation is done."""
    return synthetic.simulated(results / "made_up")


def states(done: dict) -> dict[str, str]:
    return {name: run["state"] for name, run in done["runs"].items()}


def number_of_runs(client) -> int:
    """Deleted ones too."""
    from mlflow.entities import ViewType

    experiments = [found.experiment_id for found in client.search_experiments()]
    return len(client.search_runs(experiments, run_view_type=ViewType.ALL))


def test_a_run_says_what_it_is(results, simulated, client):
    done = publish(results, simulated)
    assert states(done) == {"simulate": "written", "figures": "written"}
    run = runs_of(client)["jointgap-simulate/made_up"]
    assert run.info.status == "FINISHED" and run.info.run_id == done["runs"]["simulate"]["run_id"]
    tags = run.data.tags
    assert tags["jointgap.scenario"] == "made_up" and tags["jointgap.stage"] == "simulate"
    assert tags["mlflow.source.git.commit"] and tags["mlflow.note.content"] == "made up"


def test_publishing_twice_changes_nothing(results, simulated, client):
    first, second = publish(results, simulated), publish(results, simulated)
    assert set(states(second).values()) == {"kept"} and second["deleted"] == 0
    assert [run["run_id"] for run in first["runs"].values()] == [run["run_id"] for run in second["runs"].values()]
    assert number_of_runs(client) == 2


def test_a_changed_option_replaces_the_runs_that_read_it(results, simulated, client):
    old = publish(results, simulated)["runs"]
    new = publish(results, simulated, options=scenario(optimise={"ratio_limit": 0.28}))
    assert states(new) == {"simulate": "kept", "figures": "written"} and new["deleted"] == 1
    assert client.get_run(old["figures"]["run_id"]).info.lifecycle_stage == "deleted"
    assert len(runs_of(client)) == 2


def test_a_changed_table_replaces_its_run(results, simulated, client):
    old = publish(results, simulated)["runs"]
    parquet.write(schema.TRAJECTORY, numbers(schema.TRAJECTORY, 50, salt=3), simulated["trajectory"])
    assert states(publish(results, simulated)) == {"simulate": "written", "figures": "kept"}
    assert old["simulate"]["run_id"] != runs_of(client)["jointgap-simulate/made_up"].info.run_id


def test_scenarios_do_not_touch_each_others_runs(results, simulated, client):
    publish(results, simulated)
    other = publish(results, simulated, "other")
    assert set(states(other).values()) == {"written"} and other["deleted"] == 0
    assert len(runs_of(client)) == 4


@pytest.mark.parametrize("status", ["RUNNING", "FAILED", "KILLED"])
def test_an_interrupted_run_of_the_same_content_is_made_again(results, simulated, client, status):
    run = publish(results, simulated)["runs"]["simulate"]["run_id"]
    client.update_run(run, status)
    done = publish(results, simulated)
    assert states(done) == {"simulate": "written", "figures": "kept"} and done["deleted"] == 1
    assert {run.info.status for run in runs_of(client).values()} == {"FINISHED"}


def test_nested_runs_follow_a_new_parent(results, client):
    files = synthetic.learned(results / "made_up")
    old = publish(results, files)["runs"]
    client.delete_run(old["surrogate"]["run_id"])
    new = publish(results, files)
    assert states(new)["surrogate"] == "written" and states(new)["surrogate/r2"] == "kept"
    nested = client.get_run(new["runs"]["surrogate/r2"]["run_id"])
    assert nested.data.tags["mlflow.parentRunId"] == new["runs"]["surrogate"]["run_id"]


def test_an_output_that_is_no_longer_there_leaves_the_experiment(results, client):
    files = synthetic.learned(results / "made_up")
    publish(results, files)
    done = publish(results, {name: path for name, path in files.items() if not name.endswith("/r3")})
    assert "surrogate/r3" not in done["runs"] and "jointgap-surrogate/made_up r3" not in runs_of(client)


def test_an_experiment_that_was_deleted_comes_back(results, simulated, client):
    run = publish(results, simulated)["runs"]["simulate"]["run_id"]
    client.delete_experiment(client.get_run(run).info.experiment_id)
    publish(results, simulated)
    assert len(runs_of(client)) == 2


def test_a_store_that_was_moved_with_its_folder_is_refused(results, simulated, tmp_path):
    publish(results, simulated)
    moved = results.rename(tmp_path / "moved")
    files = {name: moved / "made_up" / path.name for name, path in simulated.items()}
    with pytest.raises(InputError, match=r"mlflow\.db was made elsewhere.*put it back there, or move the file away"):
        publish(moved, files)


KILLED = """
import os, sys
from pathlib import Path
from jointgap.core import publish
Path.rename = lambda *given: os._exit(9)  # killed at the end of the making
with publish.opened(publish.store_address(Path(sys.argv[1]))):
    pass
"""


def test_a_store_whose_making_was_interrupted_is_made_again(tmp_path):
    assert subprocess.run([sys.executable, "-c", KILLED, tmp_path], check=False).returncode == 9
    assert not (tmp_path / "mlflow.db").exists()
    publish(tmp_path, synthetic.simulated(tmp_path / "made_up"))
    assert len(runs_of(client_of(tmp_path))) == 2


@pytest.mark.parametrize("address", ["http://127.0.0.1:{}", "postgres://host/runs", "nowhere://x"])
def test_a_store_that_does_not_answer_is_one_error(address):
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        address = address.format(closed.getsockname()[1])
        begun = time.monotonic()
        with pytest.raises(InputError, match=r"MLflow store .*start the server, correct its address") as refused:
            check_store(address)
    assert time.monotonic() - begun < 60 and len(refused.value.args) == 1


def test_a_password_is_not_shown():
    with pytest.raises(InputError, match=r"http://joe:\*\*\*@") as refused:
        check_store("http://joe:secret@127.0.0.1:9")
    assert "secret" not in str(refused.value)


def test_a_file_that_is_no_store_is_one_error(results, simulated):
    (results / "mlflow.db").write_bytes(b"a letter to somebody" * 100)
    with pytest.raises(InputError, match=r"mlflow\.db cannot be reached or used .*move it away"):
        publish(results, simulated)
    assert (results / "mlflow.db").read_bytes().startswith(b"a letter")


def test_a_file_need_not_be_there_before_the_first_job(tmp_path):
    check_store(f"sqlite:///{tmp_path / 'new.db'}")
    assert not list(tmp_path.iterdir())


def test_the_environment_names_the_store(results, simulated, monkeypatch, tmp_path):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{os.path.relpath(tmp_path)}/shared.db")
    assert store_address(results) == f"sqlite:///{tmp_path}/shared.db"
    publish(results, simulated)
    assert len(runs_of(client_of(results))) == 2 and (tmp_path / "mlflow-artifacts/simulate").is_dir()


def test_publishing_needs_no_network(results, simulated, monkeypatch):
    def refuse(*given):
        raise AssertionError(f"network: {given}")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    assert states(publish(results, simulated)) == {"simulate": "written", "figures": "written"}
    with opened(store_address(results)) as client:
        assert len(runs_of(client)) == 2
