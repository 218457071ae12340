"""Several processes, killed processes, servers that are there and servers that are not."""

import signal
import socket
import subprocess
import sys
import time

import pytest

from jointgap.errors import InputError
from jointgap.track.mlflow_store import address_for, create_store
from jointgap.track.publish import publish
from tests.track import synthetic
from tests.track.conftest import client_of

PUBLISH = """
import sys
from pathlib import Path
from jointgap.track.publish import publish
from tests.track.synthetic import scenario, simulated
name, results = sys.argv[1], Path(sys.argv[2])
publish(name, scenario(), simulated(results / name), [], [], None, results)
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


def test_three_processes_publish_at_once_into_a_store_that_is_not_there_yet(tmp_path):
    names = ["one", "two", "three"]
    processes = [start(PUBLISH, name, tmp_path) for name in names]
    printed = [process.communicate(timeout=120) for process in processes]
    assert [process.returncode for process in processes] == [0, 0, 0], printed
    assert printed == [("", "")] * 3  # no chatter
    client = client_of(tmp_path)
    experiment = client.get_experiment_by_name("jointgap-simulate").experiment_id
    runs = client.search_runs([experiment])
    assert sorted(run.info.run_name for run in runs) == sorted(names)
    assert {run.info.status for run in runs} == {"FINISHED"}


def test_a_process_killed_half_way_leaves_nothing_that_the_next_does_not_mend(results):
    script = DIE + PUBLISH.replace("simulated", "learned")
    killed = start(script, "made_up", results)
    killed.communicate(timeout=120)
    assert killed.returncode == -signal.SIGKILL
    client = client_of(results)
    assert "RUNNING" in statuses(client)
    done = publish("made_up", synthetic.scenario(), synthetic.learned(results / "made_up"), [], [], None, results)
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
        with pytest.raises(InputError, match=rf"{address} cannot be reached.*MLFLOW_TRACKING_URI"):
            publish(**simulated | {"tracking_uri": address})
    assert time.monotonic() - begun < 15


def test_the_address_in_the_environment_is_used(simulated, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    with pytest.raises(InputError, match=r"http://127\.0\.0\.1:9 cannot be reached"):
        publish(**simulated)


def test_a_relative_address_is_taken_from_the_working_folder(simulated, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "sqlite:///own.db")
    assert address_for(simulated["results_folder"]) == f"sqlite:///{tmp_path / 'own.db'}"


def test_a_store_that_is_no_database_is_named_with_the_mend(tmp_path):
    (tmp_path / "mlflow.db").write_text("not a database, but long enough to be read as one" * 10)
    with pytest.raises(InputError, match=r"mlflow\.db cannot be used .*delete the file"):
        create_store(tmp_path)
