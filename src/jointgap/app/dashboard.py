"""The dashboard: links to comparisons in MLflow's pages, and MLflow's server."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

from jointgap.core.errors import InputError
from jointgap.core.publish import EXPERIMENT, OUTPUT, artifact_folder, opened, sqlite_file, store_address

HOST = "127.0.0.1"
_PORTS = 100  # ports to try
_MOST_COMPARED = 50  # runs per link

_COMPARED = {
    "optimise": "optima of all scenarios",
    "surrogate": "MSE curves of all scenarios",
    "sweep": "all sweeps",
    "campaign": "verdicts of all campaigns",
    "blind": "scores of all blind trials",
}
"""Stages whose runs are compared, with the link's title."""

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


def dashboard(results: Path, port: int = 5000, say: Callable[[str], object] = print, browse: bool = False) -> None:
    """Print the links, then become MLflow's server until it is interrupted."""
    address = store_address(results)
    remote, file = address.startswith("http"), sqlite_file(address)
    if file is not None and not file.exists():
        raise InputError(f"{file}: no such store; run `make run` (or `jointgap track`) first")
    base = address.rstrip("/") if remote else f"http://{HOST}:{free_port(port)}"
    links = addresses(address, base)
    for title, link in {"dashboard": base, **links}.items():
        say(f"{title}: {link}")
    if not links:
        say("nothing published yet")
    has_screen = sys.platform in ("darwin", "win32") or bool({"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys())
    if browse and has_screen:
        _open_when_served(next(iter(links.values()), base), base)
    if not remote:
        say("The server starts in a few seconds. Stop it with Ctrl-C.")
        _become_server(address, artifact_folder(address, results), base.rpartition(":")[2])


def _open_when_served(link: str, base: str) -> subprocess.Popen:
    """Open `link` once the server answers at `base`, in another process because this one becomes the server."""
    command = [sys.executable, "-c", _WAIT_AND_OPEN, base, link]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _become_server(address: str, artifacts: Path, port: str) -> None:
    """Replace this process by MLflow's server command, which then receives all signals."""
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", address, "--host", HOST, "--port", port]
    command += ["--artifacts-destination", artifacts.as_uri(), "--workers", "1"]
    # a browser may keep its connection open; request logs would hide the links
    command += ["--uvicorn-opts", "--timeout-graceful-shutdown 1 --log-level warning"]
    sys.stdout.flush()
    os.execve(sys.executable, command, os.environ | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"})


def free_port(first: int) -> int:
    """The first free port from `first` on."""
    ports = range(first, min(first + _PORTS, 65536))
    for port in ports:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a port just released counts as free
            try:
                probe.bind((HOST, port))
            except OSError:
                continue
            return port
    raise InputError(f"no free port from {first} to {ports[-1]}; give another --port")


def addresses(store: str, base: str) -> dict[str, str]:
    """Links by title: comparisons of runs with all parameters and metrics, sorted by name."""
    links = {}
    with opened(store) as client:
        for stage, title in _COMPARED.items():
            experiment = client.get_experiment_by_name(EXPERIMENT + stage)
            if experiment is None or experiment.lifecycle_stage == "deleted":
                continue
            wanted = f"tags.`{OUTPUT}` = '' and attributes.status = 'FINISHED'"
            order = ["attributes.run_name"]
            runs = client.search_runs([experiment.experiment_id], wanted, max_results=_MOST_COMPARED, order_by=order)
            curves = sorted({name for run in runs for name in run.data.metrics if name.startswith("log10_mse/")})
            asked = {
                "runs": [run.info.run_id for run in runs],
                "experiments": [experiment.experiment_id],
                **({"metric": curves[0], "plot_metric_keys": curves} if curves else {}),
            }
            query = "&".join(f"{key}={quote(json.dumps(value))}" for key, value in asked.items())
            page = f"metric?{query}&x_axis=step" if curves else f"compare-runs?{query}"
            if runs:
                links[title] = f"{base}/#/{page}"
    return links
