"""Many writers at once, on PostgreSQL and on a server of MLflow that stands on it: nothing is lost, nothing twice.

Needs PostgreSQL, which scripts/services starts: `make test-cluster`.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
import uuid
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.project import ROOT
from jointgap.errors import InputError
from jointgap.track.dashboard import free_port
from jointgap.track.store_check import check
from tests.track.writers import KINDS

pytestmark = pytest.mark.cluster

WRITERS = 16
SERVICES = ROOT / "scripts/services"


def service(verb: str, folder: Path) -> str:
    """What scripts/services prints; a test fails where it does, as where PostgreSQL is not installed."""
    done = subprocess.run(
        [SERVICES, verb, folder, "postgresql"], capture_output=True, text=True, timeout=120, check=False
    )
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


def address_in(folder: Path) -> str:
    """The address that `start` prints, also of a server that runs already."""
    return service("start", folder).partition("MLFLOW_TRACKING_URI=")[2]


@pytest.fixture
def database(services) -> Iterator[str]:
    """Address of a database in which nothing is, not even tables."""
    import psycopg2

    name, server = f"runs_{uuid.uuid4().hex[:8]}", address_in(services)

    def say(command: str) -> None:
        connection = psycopg2.connect(server)
        connection.autocommit = True
        connection.cursor().execute(command)
        connection.close()

    say(f"CREATE DATABASE {name}")
    yield f"{server.rpartition('/')[0]}/{name}"
    say(f"DROP DATABASE {name} WITH (FORCE)")


@pytest.fixture
def mlflow_server(database, tmp_path) -> Iterator[str]:
    """Address of a server of MLflow that stands on the database."""
    address = f"http://127.0.0.1:{free_port(5100)}"
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", database, "--workers", "2"]
    command += ["--port", address.rpartition(":")[2], "--artifacts-destination", (tmp_path / "artifacts").as_uri()]
    with open(tmp_path / "server.log", "w") as log:
        quiet = os.environ | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
        server = subprocess.Popen(command, stdout=log, stderr=log, env=quiet, start_new_session=True)
    try:
        deadline = time.monotonic() + 180
        while not answers(address) and time.monotonic() < deadline:
            time.sleep(0.2)
        yield address
    finally:
        os.killpg(server.pid, signal.SIGTERM)
        server.wait(timeout=60)


def answers(address: str) -> bool:
    try:
        urllib.request.urlopen(f"{address}/health", timeout=2).close()
    except OSError:
        return False
    return True


@pytest.fixture(params=["a database", "a server of MLflow"])
def store(request) -> str:
    """Address of a store in which nothing is."""
    return request.getfixturevalue({"a database": "database", "a server of MLflow": "mlflow_server"}[request.param])


def published_by_all(address: str, folder: Path, kind: str, writers: int = WRITERS) -> None:
    """So many `writers` publish at once, each a process, and none of them fails."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.track.writers", address, folder, str(writers), kind],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, ""), done.stdout + done.stderr


def runs_of(address: str) -> list:
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=address)
    return client.search_runs([found.experiment_id for found in client.search_experiments()])


def names_of(runs: list) -> Counter:
    return Counter(run.info.run_name for run in runs)


def test_writers_of_different_runs_lose_nothing_and_write_nothing_twice(store, tmp_path):
    published_by_all(store, tmp_path, "different")
    runs = runs_of(store)
    wanted = Counter(f"writer_{n}{end}" for n in range(WRITERS) for end in ("", " nested"))
    assert names_of(runs) == wanted and {run.info.status for run in runs} == {"FINISHED"}
    assert {run.data.tags["jointgap.stage"] for run in runs} == set(KINDS)
    assert all(len(run.inputs.dataset_inputs) == 2 for run in runs)


def test_writers_of_the_same_runs_leave_one_of_each(store, tmp_path):
    published_by_all(store, tmp_path, "same")
    runs = {run.info.run_name: run for run in runs_of(store)}
    assert names_of(runs_of(store)) == {"same": 1, "same nested": 1}
    assert runs["same nested"].data.tags["mlflow.parentRunId"] == runs["same"].info.run_id


HOLD = """
import sys, time
from jointgap.track.store_lock import locked
with locked(sys.argv[1]):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_writer_that_is_killed_lets_the_next_one_in(database):
    command = [sys.executable, "-c", HOLD, database]
    first = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert first.stdout.readline() == "held\n"
    second = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        with pytest.raises(subprocess.TimeoutExpired):
            second.wait(timeout=3)
        first.kill()
        assert second.stdout.readline() == "held\n"
    finally:
        for process in (first, second):
            process.kill()
            process.communicate()


def test_artifacts_of_a_database_lie_in_the_results_folder(database, tmp_path):
    published_by_all(database, tmp_path, "same", writers=1)
    (note,) = (tmp_path / "results").rglob("note.md")
    assert note.is_relative_to(tmp_path / "results/mlflow-artifacts/simulate")


@pytest.mark.parametrize(("changed", "into"), [(":{password}@", ":wrong@"), ("/{name}", "/no_such_database")])
def test_a_wrong_password_and_a_database_that_is_not_there_are_told_at_once(database, changed, into):
    password, name = database.partition("@")[0].rpartition(":")[2], database.rpartition("/")[2]
    wrong = database.replace(changed.format(password=password, name=name), into)
    begun = time.monotonic()
    with pytest.raises(InputError, match=r"cannot be reached or refuses .*FATAL") as refused:
        check(wrong)
    assert time.monotonic() - begun < 10 and password not in str(refused.value)
    check(database)


def test_a_crashed_server_leaves_no_process_and_keeps_its_address():
    folder = Path(tempfile.mkdtemp(prefix="jointgap-services-", dir="/tmp"))
    folder.chmod(0o755)
    try:
        address = address_in(folder)
        assert address_in(folder) == address  # what runs stays
        data = folder / "postgresql/data"
        os.kill(int((data / "postmaster.pid").read_text().split()[0]), signal.SIGKILL)
        service("stop", folder)
        assert not [place for place in Path("/proc").glob("[0-9]*/cwd") if reads(place) == str(data)]
        assert address_in(folder) == address
        check(address)
    finally:
        service("stop", folder)
        shutil.rmtree(folder)


def reads(link: Path) -> str:
    try:
        return os.readlink(link)
    except OSError:  # ended meanwhile
        return ""
