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
from dataclasses import dataclass
from pathlib import Path

from jointgap.errors import InputError
from jointgap.track.compare_links import addresses
from jointgap.track.mlflow_store import address_for, artifacts_beside

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
            server.process.wait()
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


@dataclass(frozen=True)
class _Server:
    """MLflow's server and the file of what it prints."""

    process: subprocess.Popen
    log: Path

    def printed(self) -> str:
        return self.log.read_text(encoding="utf-8", errors="replace")


@contextmanager
def _server(address: str, artifacts: Path, port: int) -> Iterator[_Server]:
    """MLflow's server and all its workers; none of them is left afterwards."""
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", address]
    command += ["--artifacts-destination", artifacts.as_uri()]  # of what is published through it
    command += ["--host", HOST, "--port", str(port), "--workers", "1"]
    command += ["--uvicorn-opts", "--timeout-graceful-shutdown 1"]  # a browser may keep its connection open
    quiet = {"MLFLOW_DISABLE_TELEMETRY": "true", "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
    with tempfile.TemporaryDirectory(prefix="jointgap-dashboard-") as folder:
        log = Path(folder, "log")
        with open(log, "w", encoding="utf-8") as file:
            process = subprocess.Popen(
                command,
                cwd=folder,
                env={**os.environ, **quiet},
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # a process group of its own, so that the workers can be ended with it
            )
        try:
            yield _Server(process, log)
        finally:
            _end(process)


def _end(process: subprocess.Popen) -> None:
    """End the server's process group: kindly, and after five seconds by force."""
    for number, patience in ((signal.SIGTERM, 5.0), (signal.SIGKILL, 5.0)):
        try:
            os.killpg(process.pid, number)
        except ProcessLookupError:
            break
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline and _group_lives(process):
            time.sleep(0.05)
    process.wait()


def _group_lives(process: subprocess.Popen) -> bool:
    process.poll()  # else the ended server itself stays in its group
    try:
        os.killpg(process.pid, 0)
    except ProcessLookupError:
        return False
    return True


def _wait_until_it_answers(server: _Server, port: int) -> None:
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if server.process.poll() is not None:
            break
        # another server may have taken the port since it was found free: ours must say that it listens
        if "Uvicorn running on" in server.printed() and _answers(port):
            return
        time.sleep(0.1)
    last = [line for line in server.printed().splitlines() if line.strip()][-5:]
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
