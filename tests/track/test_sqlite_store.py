"""The file of the store: made whole or not at all, remade where it was cut short, never lost."""

import shutil
import signal
import sqlite3
from pathlib import Path

import pytest

from jointgap.core.errors import InputError
from jointgap.track.dashboard import dashboard
from jointgap.track.mlflow_store import address_for, default_address, opened
from jointgap.track.publish import publish
from jointgap.track.sqlite_store import Holds, look, make
from tests.track.conftest import client_of
from tests.track.test_processes import PUBLISH, start

DIE_AT_THE_STATEMENT = """
import os, signal, sys
import sqlalchemy
from sqlalchemy.engine import Engine
left = [int(sys.argv.pop())]
@sqlalchemy.event.listens_for(Engine, "before_cursor_execute")
def count(*of_the_statement):
    left[0] -= 1
    if left[0] == 0:
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="session")
def cut_short(tmp_path_factory) -> list[Path]:
    """What a making in place leaves when it is killed: databases with their journals, at every tenth statement."""
    import sqlalchemy
    from mlflow.store.db.utils import _initialize_tables

    folder = tmp_path_factory.mktemp("cut short")
    engine = sqlalchemy.create_engine(f"sqlite:///{folder / 'mlflow.db'}")
    made, statements = [], []

    @sqlalchemy.event.listens_for(engine, "before_cursor_execute")
    def copy(connection, cursor, statement, *others):
        statements.append(statement)
        if len(statements) % 10 == 0 and (folder / "mlflow.db").stat().st_size:
            made.append(folder / f"killed at {len(statements)}" / "mlflow.db")
            made[-1].parent.mkdir()
            for file in folder.glob("mlflow.db*"):
                shutil.copy(file, made[-1].parent)

    _initialize_tables(engine)
    engine.dispose()
    return made


def content(file: Path) -> list[str]:
    """The database as text."""
    connection = sqlite3.connect(file)
    try:
        return list(connection.iterdump())
    finally:
        connection.close()


def test_a_store_that_was_cut_short_anywhere_is_seen_to_hold_nothing(cut_short):
    assert len(cut_short) > 30
    found = {file.parent.name: look(file) for file in cut_short}
    assert set(found.values()) <= {Holds.HALF_MADE, Holds.STORE}
    assert list(found.values()).count(Holds.HALF_MADE) > 30


@pytest.mark.parametrize("place", [0, -1], ids=["early", "late"])
def test_a_store_that_was_cut_short_is_made_anew(cut_short, tmp_path, place):
    # where a table is being exchanged, MLflow by itself never comes to an end again
    stuck = [file for file in cut_short if any("_alembic_tmp_" in line for line in content(file))]
    for file in stuck[place].parent.iterdir():
        shutil.copy(file, tmp_path)
    make(tmp_path / "mlflow.db", tmp_path)
    assert look(tmp_path / "mlflow.db") is Holds.STORE
    assert [file.name for file in tmp_path.iterdir()] == ["mlflow.db"]
    with opened(default_address(tmp_path), tmp_path) as store:
        assert store.experiment("simulate") is not None


def test_a_journal_that_was_left_alone_is_not_played_into_the_new_store(cut_short, tmp_path):
    journals = [journal for file in cut_short for journal in file.parent.glob("*-journal")]
    shutil.copy(max(journals, key=lambda journal: journal.stat().st_size), tmp_path / "mlflow.db-journal")
    make(tmp_path / "mlflow.db", tmp_path)
    assert look(tmp_path / "mlflow.db") is Holds.STORE


@pytest.mark.parametrize("statement", [100, pytest.param(20, marks=pytest.mark.slow)])
def test_a_process_killed_while_it_makes_the_store_is_followed_by_one_that_publishes(tmp_path, statement):
    killed = start(DIE_AT_THE_STATEMENT + PUBLISH, "made_up", tmp_path, statement)
    killed.communicate(timeout=120)
    assert killed.returncode == -signal.SIGKILL
    assert not (tmp_path / "mlflow.db").exists()  # nothing half-made under the name of the store
    after = start(PUBLISH, "made_up", tmp_path)
    assert after.communicate(timeout=120) == ("", "") and after.returncode == 0
    assert not list(tmp_path.glob(".mlflow.db.new*"))
    assert look(tmp_path / "mlflow.db") is Holds.STORE


def test_a_store_made_by_somebody_else_meanwhile_is_kept(results, tmp_path, monkeypatch):
    store, beside = tmp_path / "mlflow.db", results / "mlflow.db"

    def slowly(file: Path, artifacts: Path) -> None:
        shutil.copy(beside, file)
        shutil.copy(beside, store)
        connection = sqlite3.connect(store)
        connection.execute(
            "INSERT INTO experiments (name, lifecycle_stage, workspace) VALUES ('theirs', 'active', 'default')"
        )
        connection.commit()
        connection.close()

    monkeypatch.setattr("jointgap.track.sqlite_store._fill", slowly)
    make(store, tmp_path)
    assert any("theirs" in line for line in content(store))


def test_a_store_of_another_version_that_holds_runs_is_left_as_it_is(simulated, results):
    publish(**simulated)
    connection = sqlite3.connect(results / "mlflow.db")
    connection.execute("UPDATE alembic_version SET version_num = '0123456789ab'")
    connection.commit()
    connection.close()
    before = content(results / "mlflow.db")
    with pytest.raises(InputError, match=r"mlflow\.db: was made by another version .*mlflow db upgrade 'sqlite:///"):
        publish(**simulated)
    assert content(results / "mlflow.db") == before


@pytest.mark.parametrize(
    "statements",
    [
        ["CREATE TABLE birds (name TEXT)", "INSERT INTO birds VALUES ('wren')"],
        ["CREATE TABLE birds (name TEXT)"],
        ["CREATE TABLE workspaces (name TEXT)", "INSERT INTO workspaces VALUES ('wren')"],
        ["CREATE TABLE birds (name TEXT)", "CREATE TABLE alembic_version (version_num TEXT)"],
    ],
    ids=["rows", "empty", "tables called alike", "alembic"],
)
def test_another_program_s_database_is_not_taken_for_a_store(simulated, results, statements):
    (results / "mlflow.db").unlink()
    connection = sqlite3.connect(results / "mlflow.db")
    for statement in statements:
        connection.execute(statement)
    connection.commit()
    connection.close()
    held = (results / "mlflow.db").read_bytes()
    with pytest.raises(InputError, match=r"mlflow\.db: is a database, but no MLflow store|and holds runs"):
        publish(**simulated)
    assert (results / "mlflow.db").read_bytes() == held


def test_a_lock_that_is_a_link_to_another_file_is_not_followed(simulated, results, tmp_path):
    (tmp_path / "precious").write_text("mine")
    (results / ".mlflow.db.lock").unlink(missing_ok=True)
    (results / ".mlflow.db.lock").symlink_to(tmp_path / "precious")
    with pytest.raises(InputError, match=r"\.mlflow\.db\.lock: cannot be written"):
        publish(**simulated)
    assert (tmp_path / "precious").read_text() == "mine"


def test_a_file_that_is_no_database_is_named_with_the_mend(simulated, results):
    (results / "mlflow.db").write_text("not a database, but long enough to be read as one" * 10)
    with pytest.raises(InputError, match=r"mlflow\.db: is no MLflow store .*delete it to publish from nothing"):
        publish(**simulated)


def test_a_store_that_another_program_holds_is_in_use_and_not_to_be_deleted(simulated, results, monkeypatch):
    publish(**simulated)
    monkeypatch.setattr("jointgap.track.sqlite_store._LONGEST_WAIT", 0.1)
    holding = sqlite3.connect(results / "mlflow.db")
    holding.execute("BEGIN EXCLUSIVE")
    with pytest.raises(InputError, match=r"mlflow\.db: is in use \(database is locked\)") as refused:
        publish(**simulated)
    holding.close()
    assert "delete" not in str(refused.value)


def test_a_store_that_cannot_be_written_is_not_to_be_deleted(simulated, results, monkeypatch):
    import mlflow.store.db.utils as theirs
    import sqlalchemy

    made = theirs.create_sqlalchemy_engine

    def read_only(address):
        engine = made(address)
        sqlalchemy.event.listen(engine, "connect", lambda one, record: one.execute("PRAGMA query_only = ON"))
        return engine

    monkeypatch.setattr(theirs, "create_sqlalchemy_engine", read_only)
    with pytest.raises(InputError, match=r"attempt to write a readonly database.*permission") as refused:
        publish(**simulated)
    assert "delete" not in str(refused.value)


def test_a_full_disk_is_named_and_leaves_no_store(tmp_path, monkeypatch):
    import resource

    most, ceiling = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, ceiling))
    try:
        with pytest.raises(InputError, match=r"mlflow\.db.*: (cannot be read or written|no space left)"):
            make(tmp_path / "mlflow.db", tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, ceiling))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["it's {x}", r'100 % "of" a\b `c`'])
def test_names_may_hold_what_has_a_meaning_elsewhere(simulated, client, name):
    given = simulated | {"scenario_name": name}
    assert {run["state"] for run in publish(**given)["runs"].values()} == {"written"}
    assert {run["state"] for run in publish(**given)["runs"].values()} == {"kept"}


def test_a_name_that_cannot_be_searched_for_is_refused_before_anything_is_written(simulated, results):
    with pytest.raises(InputError, match="both kinds of quotes") as refused:
        publish(**simulated | {"scenario_name": 'it\'s "ours"'})
    assert "delete" not in str(refused.value)
    assert not [line for line in content(results / "mlflow.db") if line.startswith('INSERT INTO "runs"')]


@pytest.mark.parametrize("folder", ["our rig's {x}", r'50 %20 "of" a\b#c', "$HOME `x`"])
def test_results_may_lie_in_any_folder(new_results, tmp_path, folder):
    results = tmp_path / folder
    shutil.copytree(new_results(), results)
    with opened(default_address(results), results) as store:
        experiment = store.experiment("simulate")
    with opened(default_address(results), results) as store:
        assert store.experiment("simulate") == experiment
    assert (results / "mlflow.db").stat().st_size and [one.name for one in tmp_path.iterdir()] == [folder]
    assert client_of(results).get_experiment(experiment).name == "jointgap-simulate"


def test_a_store_is_made_in_any_folder_and_whatever_the_working_folder(tmp_path, monkeypatch):
    results = tmp_path / 'our rig\'s "new" :results'
    results.mkdir()
    monkeypatch.chdir(results)
    with opened(default_address(results), results) as store:
        assert store.experiment("simulate") is not None
    assert {file.name for file in results.iterdir()} == {"mlflow.db", ".mlflow.db.lock"}


def test_a_folder_whose_name_no_address_can_hold_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"one with '\?' in its path, which an address cannot hold"):
        address_for(tmp_path / "what?")


def test_the_dashboard_says_of_a_store_that_was_cut_short_what_to_run(cut_short):
    with pytest.raises(InputError, match=r"mlflow\.db: it is only half made and holds nothing; run `make run`"):
        dashboard(cut_short[3].parent)


def test_the_dashboard_says_of_an_empty_file_what_to_run(tmp_path):
    (tmp_path / "mlflow.db").touch()
    with pytest.raises(InputError, match=r"mlflow\.db: there is no such store; run `make run`"):
        dashboard(tmp_path)
