"""Publishing to PostgreSQL and to an MLflow server on it (`make test-cluster`)."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
import uuid
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.project import ROOT
from jointgap.app.dashboard import free_port
from jointgap.core.errors import InputError
from jointgap.core.publish import Dataset, Record, check_store, publish_records
from tests.scenario.mlflow_store import client_of, runs_of
from tests.scenario.published_tables import simulated

pytestmark = pytest.mark.cluster

# seconds until something that has to happen is given up: a machine may be busy with other things
PATIENCE = 600
SERVICES = ROOT / "scripts/services"


def service(verb: str, folder: Path) -> str:
    """Output of scripts/services; the test fails if PostgreSQL is not installed."""
    command = [SERVICES, verb, folder, "postgresql"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    if done.returncode != 0:
        pytest.fail(done.stderr, pytrace=False)
    return done.stdout.strip()


@pytest.fixture(scope="module")
def services() -> Iterator[Path]:
    """A folder with a server of PostgreSQL, which the user that it runs as can reach."""
    folder = Path(tempfile.mkdtemp(prefix="jointgap-services-", dir="/tmp"))
    folder.chmod(0o755)
    try:
        service("start", folder)
        yield folder
    finally:
        service("stop", folder)
        shutil.rmtree(folder)


@pytest.fixture
def database(services) -> Iterator[str]:
    """Address of a database in which nothing is, not even tables."""
    name = f"runs_{uuid.uuid4().hex[:8]}"
    server = service("start", services).partition("MLFLOW_TRACKING_URI=")[2]
    said_by(server, f"CREATE DATABASE {name}")
    yield f"{server.rpartition('/')[0]}/{name}"
    said_by(server, f"DROP DATABASE {name} WITH (FORCE)")


def said_by(server: str, command: str) -> list[tuple]:
    """Rows that a command of SQL gives."""
    import psycopg2

    connection = psycopg2.connect(server)
    connection.autocommit = True
    with connection.cursor() as cursor:
        cursor.execute(command)
        rows = cursor.fetchall() if cursor.description else []
    connection.close()
    return rows


@pytest.fixture
def mlflow_server(database, tmp_path) -> Iterator[str]:
    """Address of an MLflow server on the database."""
    address = f"http://127.0.0.1:{free_port(5100)}"
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", database]
    command += ["--workers", "2", "--port", address.rpartition(":")[2]]
    command += ["--artifacts-destination", (tmp_path / "artifacts").as_uri()]
    with open(tmp_path / "server.log", "w") as log:
        quiet = os.environ | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
        server = subprocess.Popen(
            command, stdout=log, stderr=log, env=quiet, start_new_session=True
        )
    try:
        wait_until(lambda: server.poll() is not None or answers(address))
        assert server.poll() is None, (tmp_path / "server.log").read_text()[-3000:]
        yield address
    finally:
        with suppress(ProcessLookupError):
            os.killpg(server.pid, signal.SIGKILL)  # nothing that it holds is needed any more
        server.wait()


def wait_until(happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < deadline, f"nothing within {PATIENCE} s"
        time.sleep(0.1)


def answers(address: str) -> bool:
    with suppress(OSError):
        urllib.request.urlopen(f"{address}/health", timeout=2).close()
        return True
    return False


@pytest.fixture(params=["a database", "a server of MLflow"])
def store(request) -> str:
    """Address of a store in which nothing is."""
    return request.getfixturevalue(
        {"a database": "database", "a server of MLflow": "mlflow_server"}[request.param]
    )


def published(address: str, name: str, folder: Path) -> dict:
    """Results of publishing a run and a nested one."""
    files = simulated(folder / name)
    datasets = tuple(Dataset(table, path, "result") for table, path in files.items())
    curve = pd.Series(1.0 / (1 + np.arange(1000)))
    content = {"metrics": {"a": 1.0}, "curves": {"c": curve}, "files": {"note.md": b"words"}}
    own = Record("simulate", datasets=datasets, **content)
    nested = Record("simulate", "nested", metrics={"b": 2.0}, datasets=datasets)
    return publish_records(name, "made up", [own, nested], address, folder)


def test_scenarios_are_published_once(store, tmp_path):
    check_store(store)
    first, _ = (published(store, name, tmp_path) for name in ("one", "other"))
    again = published(store, "one", tmp_path)
    assert {run["state"] for run in first["runs"].values()} == {"written"}
    assert {run["state"] for run in again["runs"].values()} == {"kept"} and again["deleted"] == 0
    client = client_of(store)
    runs = runs_of(client)
    assert set(runs) == {
        f"jointgap-simulate/{name}{end}" for name in ("one", "other") for end in ("", " nested")
    }
    assert {run.info.status for run in runs.values()} == {"FINISHED"}
    assert all(len(run.inputs.dataset_inputs) == 2 for run in runs.values())
    own, nested = runs["jointgap-simulate/one"], runs["jointgap-simulate/one nested"]
    assert nested.data.tags["mlflow.parentRunId"] == own.info.run_id
    assert 280 <= len(client.get_metric_history(own.info.run_id, "c")) <= 300
    if not store.startswith("http"):  # artifacts of a database lie in the results folder
        assert all(
            note.is_relative_to(tmp_path / "mlflow-artifacts/simulate")
            for note in tmp_path.rglob("note.md")
        )


def test_a_wrong_password_or_database_is_refused(database):
    password, name = database.partition("@")[0].rpartition(":")[2], database.rpartition("/")[2]
    check_store(database)
    for known, wrong in ((f":{password}@", ":wrong@"), (f"/{name}", "/no_such_database")):
        with pytest.raises(InputError, match=r"cannot be reached or used .*FATAL") as refused:
            check_store(database.replace(known, wrong))
        assert password not in str(refused.value)
