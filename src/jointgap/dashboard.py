"""The dashboard: MLflow's interface on this machine, and an address that opens a comparison of the scenarios."""

import http.client
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from jointgap.errors import InputError
from jointgap.track.store import address_for, artifacts_beside
from jointgap.track.view import addresses

HOST = "127.0.0.1"
PATIENCE = 90.0  # seconds for the interface to answer; it takes about five


def dashboard(
    results: Path, port: int = 5000, tracking_uri: str | None = None, say: Callable[[str], object] = print
) -> None:
    """Serve MLflow's interface until interrupted, and print what to open.

    Parameters
    ----------
    results : Path
        Folder of the default store.
    port : int
        Port to start looking for a free one.
    tracking_uri : str, optional
        Another store; ``None`` takes ``MLFLOW_TRACKING_URI``, else the one in `results`. A server is already serving:
        then only the addresses are printed.
    say : callable
        Takes the lines to show.

    Raises
    ------
    InputError
        No store, no free port, or the interface does not start.
    """
    address = address_for(results, tracking_uri)
    if address.startswith("http"):
        _announce(address, address.rstrip("/"), say)
        return
    file = Path(address.removeprefix("sqlite:///"))
    if address.startswith("sqlite:///") and not file.is_file():
        raise InputError(f"{file}: no such file; run `make run` (or `jointgap track`) first, then open the dashboard")
    port = free_port(port)
    with _interrupted_by_signals(), _server(address, artifacts_beside(address, results), port) as server:
        _wait_until_it_answers(server, port)
        _announce(address, f"http://{HOST}:{port}", say)
        say("Ctrl-C ends it.")
        try:
            server.wait()
        except KeyboardInterrupt:
            say("dashboard: ended")


def free_port(first: int) -> int:
    """The first port from `first` on that nothing on this machine listens on.

    Raises
    ------
    InputError
        Not one of a hundred is free.
    """
    for port in range(first, min(first + 100, 65536)):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # one just given up counts as free
            try:
                probe.bind((HOST, port))
            except OSError:
                continue
            return port
    raise InputError(f"no free port from {first} to {min(first + 99, 65535)}; give another --port")


@contextmanager
def _interrupted_by_signals() -> Iterator[None]:
    """Let a request to end, or a closed terminal, end the dashboard as Ctrl-C does."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # a job in the background starts with SIGINT ignored
    before = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    try:
        yield
    except KeyboardInterrupt:  # while it was still starting
        return
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _server(address: str, artifacts: Path, port: int) -> Iterator[subprocess.Popen]:
    """MLflow's server and all its workers; none of them is left afterwards."""
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", address]
    command += ["--artifacts-destination", artifacts.as_uri()]  # of what is published through it
    command += ["--host", HOST, "--port", str(port), "--workers", "1"]
    command += ["--uvicorn-opts", "--timeout-graceful-shutdown 1"]  # a browser may keep its connection open
    quiet = {"MLFLOW_DISABLE_TELEMETRY": "true", "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
    with tempfile.TemporaryDirectory(prefix="jointgap-dashboard-") as folder:
        with open(Path(folder, "log"), "w+", encoding="utf-8") as log:
            server = subprocess.Popen(
                command,
                cwd=folder,
                env={**os.environ, **quiet},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # a process group of its own, so that the workers can be ended with it
            )
            server.log = log
            try:
                yield server
            finally:
                _end(server)


def _end(server: subprocess.Popen) -> None:
    """End the server's process group: kindly, and after five seconds by force."""
    for number, patience in ((signal.SIGTERM, 5.0), (signal.SIGKILL, 5.0)):
        try:
            os.killpg(server.pid, number)
        except ProcessLookupError:
            break
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline and _group_lives(server):
            time.sleep(0.05)
    server.wait()


def _group_lives(server: subprocess.Popen) -> bool:
    server.poll()  # else the ended server itself stays in its group
    try:
        os.killpg(server.pid, 0)
    except ProcessLookupError:
        return False
    return True


def _wait_until_it_answers(server: subprocess.Popen, port: int) -> None:
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if server.poll() is not None:
            break
        if _answers(port):
            return
        time.sleep(0.1)
    server.log.seek(0)
    last = [line for line in server.log.read().splitlines() if line.strip()][-5:]
    raise InputError("the interface of MLflow did not start:\n" + "\n".join(last))


def _answers(port: int) -> bool:
    connection = http.client.HTTPConnection(HOST, port, timeout=2)
    try:
        connection.request("GET", "/health")
        return connection.getresponse().status == 200
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()


def _announce(store: str, base: str, say: Callable[[str], object]) -> None:
    say(f"dashboard: {base}")
    found = addresses(store, base)
    for what, address in found.items():
        say(f"{what}: {address}")
    if not found:
        say("nothing published yet")
