"""The dashboard: addresses in MLflow's interface that compare the scenarios, and MLflow's own server to open them."""

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from jointgap.core.errors import InputError
from jointgap.track.experiment_views import KEY
from jointgap.track.mlflow_store import Store, address_for, artifact_folder
from jointgap.track.sqlite_store import Holds, file_of, look
from jointgap.track.store_check import check

HOST = "127.0.0.1"
_PORTS = 100  # that are tried, from the one asked for on

_COMPARED = {
    "optimise": ("optima of all scenarios", "CHART"),
    "surrogate": ("MSE curves of all scenarios", "CHART"),
    "sweep": ("all sweeps", "TABLE"),
    "campaign": ("verdicts of all campaigns", "TABLE"),
    "blind": ("scores of all blind trials", "TABLE"),
}
"""Stages whose runs are compared, with what that shows, and the way it is shown first."""

_TRAINING = "workflowType=machine_learning"  # the interface has another face, for language models


def dashboard(
    results: Path,
    port: int = 5000,
    tracking_uri: str | None = None,
    say: Callable[[str], object] = print,
    browse: bool = False,
) -> None:
    """Print what to open, then become MLflow's server until it is interrupted."""
    address = address_for(results, tracking_uri)
    remote = address.startswith("http")
    file = file_of(address)
    held = Holds.STORE if file is None else look(file)
    if held is not Holds.STORE:
        raise InputError(f"{file}: {held.value}; run `make run` (or `jointgap track`) first, then open the dashboard")
    check(address)
    base = address.rstrip("/") if remote else f"http://{HOST}:{free_port(port)}"
    say(f"dashboard: {base}")
    links = addresses(address, base)
    for title, link in links.items():
        say(f"{title}: {link}")
    if not links:
        say("nothing published yet")
    if browse and _has_screen():
        _open_when_served(next(iter(links.values()), base), base)
    if not remote:
        say("It answers in some seconds. Ctrl-C ends it.")
        _become_server(address, artifact_folder(address, results), base.rpartition(":")[2])


def _has_screen() -> bool:
    """Whether a browser has where to open; without a screen Python would take one that fills the terminal."""
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _open_when_served(link: str, base: str) -> subprocess.Popen:
    """Open `link` once something answers at `base`, in a process of its own: this one becomes the server."""
    command = [sys.executable, "-c", _WAIT_AND_OPEN, base, link]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


_WAIT_AND_OPEN = """
import sys, time, urllib.request, webbrowser
base, link = sys.argv[1:]
for _ in range(120):
    try:
        urllib.request.urlopen(base, timeout=2).close()
    except OSError:
        time.sleep(0.5)
    else:
        webbrowser.open(link)
        break
"""


def _become_server(address: str, artifacts: Path, port: str) -> None:
    """MLflow's own server command in place of this process: a signal reaches it, and nothing is left to tidy up."""
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", address, "--host", HOST, "--port", port]
    command += ["--artifacts-destination", artifacts.as_uri(), "--workers", "1"]  # of what is published through it
    # a browser may keep its connection open; every request on a line of its own would hide the addresses above
    command += ["--uvicorn-opts", "--timeout-graceful-shutdown 1 --log-level warning"]
    quiet = {"MLFLOW_DISABLE_TELEMETRY": "true", "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
    sys.stdout.flush()
    os.execve(sys.executable, command, os.environ | quiet)


def free_port(first: int) -> int:
    """The first port from `first` on that nothing on this machine listens on."""
    ports = range(first, min(first + _PORTS, 65536))
    for port in ports:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # one just given up counts as free
            try:
                probe.bind((HOST, port))
            except OSError:
                continue
            return port
    raise InputError(f"no free port from {first} to {ports[-1]}; give another --port")


def addresses(store_address: str, base: str) -> dict[str, str]:
    """Addresses by what they show; empty when nothing is published."""
    store, links = Store(store_address, Path()), {}
    for stage, (title, mode) in _COMPARED.items():
        if experiment := _published(store, stage):
            query = f"viewStateShareKey={KEY}&compareRunsMode={mode}&{_TRAINING}"
            links[title] = f"{base}/#/experiments/{experiment}/runs?{query}"
    return links


def _published(store: Store, stage: str) -> str | None:
    """The stage's experiment, if a complete run of a scenario is in it."""
    experiment = store.experiment(stage, create=False)
    if experiment is None:
        return None
    runs = store.runs(experiment, {"jointgap.stage": stage})
    return experiment if any(run.complete and not run.tags["jointgap.output"] for run in runs) else None
