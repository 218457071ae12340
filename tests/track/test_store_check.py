"""Whether a store answers is known within seconds, and told with what to do."""

import socket
import time

import pytest

from jointgap.core.errors import InputError
from jointgap.track.store_check import check
from jointgap.track.store_lock import is_postgresql


@pytest.fixture
def closed_port():
    """A port on which nobody listens."""
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        yield closed.getsockname()[1]


@pytest.mark.parametrize(
    "kind",
    # its driver is among the packages of the cluster
    ["http://{}", pytest.param("postgresql://joe:secret@{}/runs", marks=pytest.mark.cluster)],
)
def test_a_server_that_is_not_there_is_told_at_once(closed_port, kind):
    begun = time.monotonic()
    with pytest.raises(InputError, match=r"MLflow store .* cannot be reached .*start the server") as refused:
        check(kind.format(f"127.0.0.1:{closed_port}"))
    assert time.monotonic() - begun < 60 and "secret" not in str(refused.value)


def test_a_server_that_does_not_answer_is_told_after_some_seconds():
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()  # takes the call and says nothing
        begun = time.monotonic()
        with pytest.raises(InputError, match="cannot be reached"):
            check(f"http://127.0.0.1:{silent.getsockname()[1]}")
    assert time.monotonic() - begun < 60  # MLflow itself tries for minutes


@pytest.mark.parametrize("address", ["postgres://host/runs", "nowhere://x"])
def test_an_address_of_no_known_kind_is_told(address):
    with pytest.raises(InputError, match="correct its address"):
        check(address)


def test_a_file_need_not_be_there_yet(tmp_path):
    check(f"sqlite:///{tmp_path / 'new.db'}")
    assert not list(tmp_path.iterdir())


def test_a_database_of_postgresql_is_known_by_its_address():
    assert is_postgresql("postgresql://host/runs") and is_postgresql("postgresql+psycopg2://host/runs")
    assert not is_postgresql("http://postgresql/runs")
