"""Several processes, killed processes, servers that are there and servers that are not."""

import errno
import os
import re
import signal
import socket
import subprocess
import sys
import time

import pytest

from jointgap.core.errors import InputError
from jointgap.track.mlflow_store import address_for
from jointgap.track.publish import publish, publish_records
from jointgap.track.run_record import Record
from tests.track import synthetic
from tests.track.conftest import client_of

PUBLISH = """
import sys
from pathlib import Path
from jointgap.track.publish import publish, publish_records
from jointgap.track.run_record import Record
from tests.track.synthetic import SECTIONS, scenario, simulated
name, results, address = sys.argv[1], Path(sys.argv[2]), (sys.argv[3:] or [None])[0]
publish(name, scenario(), SECTIONS, simulated(results / name), [], [], address, results)
"""

DIE = """
import os, signal
from jointgap.track.mlflow_store import Store
log, runs = Store._log_files, []
def die_at_the_third(self, run_id, files):
    runs.append(run_id)
    if len(runs) == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    log(self, run_id, files)
Store._log_files = die_at_the_third
"""


def start(script: str, *words: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", script, *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.parametrize("count", [3, pytest.param(16, marks=pytest.mark.slow)])
@pytest.mark.parametrize("own_results", [False, True], ids=["one results folder", "a results folder each"])
def test_processes_publish_at_once_into_a_store_that_is_not_there_yet(tmp_path, count, own_results):
    names = [f"scenario_{number}" for number in range(count)]
    address = f"sqlite:///{tmp_path / 'new' / 'shared.db'}"
    processes = [start(PUBLISH, name, tmp_path / (name if own_results else "results"), address) for name in names]
    assert_published(processes)
    runs = runs_of(address)
    assert sorted(run.info.run_name for run in runs) == sorted(names)
    assert {run.info.status for run in runs} == {"FINISHED"}


@pytest.mark.parametrize("count", [3, pytest.param(8, marks=pytest.mark.slow)])
def test_processes_that_publish_the_same_at_once_wait_for_each_other_and_log_it_once(tmp_path, count):
    address = f"sqlite:///{tmp_path / 'shared.db'}"
    processes = [start(PUBLISH, "made_up", tmp_path / str(number), address) for number in range(count)]
    assert_published(processes)
    assert [run.info.status for run in runs_of(address)] == ["FINISHED"]
    assert len(runs_of(address, deleted=True)) == 1  # none was begun and given up


def assert_published(processes: list[subprocess.Popen]) -> None:
    """All came to their end, without any chatter."""
    printed = [process.communicate(timeout=300) for process in processes]
    assert [process.returncode for process in processes] == [0] * len(processes), printed
    assert printed == [("", "")] * len(processes)


def runs_of(address: str, deleted: bool = False) -> list:
    """Runs of the simulation in the store at `address`."""
    from mlflow.entities import ViewType
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=address)
    experiment = client.get_experiment_by_name("jointgap-simulate").experiment_id
    return client.search_runs([experiment], run_view_type=ViewType.ALL if deleted else ViewType.ACTIVE_ONLY)


def test_a_process_killed_half_way_leaves_nothing_that_the_next_does_not_mend(results):
    script = DIE + PUBLISH.replace("simulated", "learned")
    killed = start(script, "made_up", results)
    killed.communicate(timeout=120)
    assert killed.returncode == -signal.SIGKILL
    client = client_of(results)
    assert "RUNNING" in statuses(client)
    done = publish(
        "made_up",
        synthetic.scenario(),
        synthetic.SECTIONS,
        synthetic.learned(results / "made_up"),
        [],
        [],
        None,
        results,
    )
    assert set(statuses(client)) == {"FINISHED"} and len(statuses(client)) == len(done["runs"])
    assert done["runs"]["simulate"]["state"] == "kept" and done["deleted"] == 1


def statuses(client) -> list[str]:
    experiments = [found.experiment_id for found in client.search_experiments()]
    return [run.info.status for run in client.search_runs(experiments)]


def test_an_unreachable_server_is_named_within_seconds(simulated):
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # nobody listens here
        address = f"http://127.0.0.1:{closed.getsockname()[1]}"
        begun = time.monotonic()
        with pytest.raises(InputError, match=rf"{address} cannot be reached.*unset MLFLOW_TRACKING_URI"):
            publish(**simulated | {"tracking_uri": address})
    assert time.monotonic() - begun < 60  # MLflow itself tries for minutes


def test_the_address_in_the_environment_is_used(simulated, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    with pytest.raises(InputError, match=r"http://127\.0\.0\.1:9 cannot be reached"):
        publish(**simulated)


def test_a_relative_address_is_taken_from_the_working_folder(simulated, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "sqlite:///own.db")
    assert address_for(simulated["results_folder"]) == f"sqlite:///{tmp_path / 'own.db'}"


@pytest.mark.parametrize("address", ["sqlite://", "sqlite:///", "sqlite:///:memory:", "sqlite:///a?timeout=3"])
def test_an_address_of_sqlite_that_names_no_file_is_refused(simulated, address):
    with pytest.raises(InputError, match=rf"{re.escape(address)}: names no file.*MLFLOW_TRACKING_URI=sqlite:////path"):
        publish(**simulated | {"tracking_uri": address})


@pytest.mark.parametrize("address", ["postgres://joe:secret@host/runs", "nowhere://x"])
def test_an_address_of_no_known_kind_is_told_with_what_to_do(simulated, address):
    with pytest.raises(
        InputError, match=r"MLflow store .* cannot be reached or refuses .*correct its address"
    ) as refused:
        publish(**simulated | {"tracking_uri": address})
    assert "secret" not in str(refused.value)


def test_a_database_whose_driver_is_missing_is_told_with_the_package_to_install(simulated, monkeypatch):
    monkeypatch.setitem(sys.modules, "psycopg2", None)  # whether it is installed or not
    address = "postgresql://joe:secret@localhost/runs"
    wanted = r"postgresql://joe:\*\*\*@localhost/runs needs the package psycopg2-binary, .*pip install"
    with pytest.raises(InputError, match=wanted):
        publish(**simulated | {"tracking_uri": address})


def test_what_mlflow_does_not_take_is_no_fault_of_the_store(results):
    refused = Record("simulate", metrics={"../no name for MLflow": 1.0})
    with pytest.raises(InputError, match=r"does not take what is published .*the store itself is sound"):
        publish_records("made_up", "", [refused], None, results)


def test_no_space_for_artifacts_is_told_with_the_file(simulated, monkeypatch):
    def full(self, run_id, folder):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "mlflow-artifacts/options.json")

    monkeypatch.setattr("mlflow.tracking.MlflowClient.log_artifacts", full)
    with pytest.raises(InputError, match=r"No space left on device: 'mlflow-artifacts/options\.json'.*free some space"):
        publish(**simulated)
