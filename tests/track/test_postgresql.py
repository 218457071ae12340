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
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from benchmarks.project import ROOT
from jointgap.core.errors import InputError
from jointgap.track.dashboard import free_port
from jointgap.track.store_check import check
from tests.track.writers import KINDS

pytestmark = pytest.mark.cluster

WRITERS = 16
PATIENCE = 600  # seconds until something that has to happen is given up: a machine may be busy with other things
SERVICES = ROOT / "scripts/services"


def service(verb: str, folder: Path) -> str:
    """What scripts/services prints; a test fails where it does, as where PostgreSQL is not installed."""
    done = subprocess.run(
        [SERVICES, verb, folder, "postgresql"], capture_output=True, text=True, timeout=PATIENCE, check=False
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
    name, server = f"runs_{uuid.uuid4().hex[:8]}", address_in(services)
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
    """Address of a server of MLflow that stands on the database."""
    address = f"http://127.0.0.1:{free_port(5100)}"
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", database, "--workers", "2"]
    command += ["--port", address.rpartition(":")[2], "--artifacts-destination", (tmp_path / "artifacts").as_uri()]
    with open(tmp_path / "server.log", "w") as log:
        quiet = os.environ | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
        server = subprocess.Popen(command, stdout=log, stderr=log, env=quiet, start_new_session=True)
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
        timeout=PATIENCE,
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
    waiting = "SELECT count(*) FROM pg_locks WHERE locktype = 'advisory' AND NOT granted"
    first = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert first.stdout.readline() == "held\n"
    second = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        wait_until(lambda: said_by(database, waiting) == [(1,)])
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
    check(database)  # loads what it needs
    begun = time.monotonic()
    with pytest.raises(InputError, match=r"cannot be reached or refuses .*FATAL") as refused:
        check(wrong)
    assert time.monotonic() - begun < 60 and password not in str(refused.value)  # MLflow itself: 100 s


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
