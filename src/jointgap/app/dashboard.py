"""The dashboard: links to comparisons in MLflow's pages, and MLflow's server."""

import json
import os
import socket
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from jointgap.core.errors import InputError
from jointgap.core.files import package_data
from jointgap.core.publish import (
    EXPERIMENT,
    OUTPUT,
    artifact_folder,
    opened,
    sqlite_file,
    store_address,
)

if TYPE_CHECKING:  # slow imports
    from mlflow.entities import Experiment
    from mlflow.tracking import MlflowClient

HOST = "127.0.0.1"
_PORTS = 100  # ports to try
_MOST_COMPARED = 50  # runs per link

_TRAINING = "workflowType=machine_learning"
"""Without it MLflow's pages look for traces of language models."""

_VIEW = "jointgap"
"""Name of the view, stored in a tag of the experiment, that has the columns."""

_CHARACTER, _MARGIN, _NAMES = 8, 40, 240
"""Widths [px] of a character, of a column's margins, of the column of names."""


def dashboard(results: Path, port: int = 5000, say: Callable[[str], object] = print) -> None:
    """Print the links, then become MLflow's server until it is interrupted."""
    address = store_address(results)
    is_remote, file = address.startswith("http"), sqlite_file(address)
    if file is not None and not file.exists():
        raise InputError(f"{file}: no such store; run `make run` (or `jointgap track`) first")
    base = address.rstrip("/") if is_remote else f"http://{HOST}:{free_port(port)}"
    links = addresses(address, base)
    for title, link in {"dashboard": f"{base}/#/experiments?{_TRAINING}", **links}.items():
        say(f"{title}: {link}")
    if not links:
        say("nothing published yet")
    if not is_remote:
        say("The server starts in a few seconds. Stop it with Ctrl-C.")
        _become_server(address, artifact_folder(address, results), base.rpartition(":")[2])


def _become_server(address: str, artifacts: Path, port: str) -> None:
    """Replace this process by MLflow's server command, which then receives all signals."""
    # a browser may keep its connection open; request logs would hide the links
    uvicorn = "--timeout-graceful-shutdown 1 --log-level warning"
    command = [sys.executable, *"-m mlflow server --workers 1".split()]
    command += ["--host", HOST, "--port", port, "--uvicorn-opts", uvicorn]
    command += ["--backend-store-uri", address, "--artifacts-destination", artifacts.as_uri()]
    sys.stdout.flush()
    os.execve(sys.executable, command, os.environ | {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"})


def free_port(first: int) -> int:
    """The first free port from `first` on."""
    ports = range(first, min(first + _PORTS, 65536))
    for port in ports:
        with socket.socket() as probe:
            # a port just released counts as free
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with suppress(OSError):
                probe.bind((HOST, port))
                return port
    raise InputError(f"no free port from {first} to {ports[-1]}; give another --port")


def addresses(store: str, base: str) -> dict[str, str]:
    """Links by title: tables of runs, or training curves."""
    links = {}
    query = f"tags.`{OUTPUT}` = '' and attributes.status = 'FINISHED'"
    with opened(store) as client:
        for stage, comparison in package_data("app/compared_runs.yaml").items():
            title, columns = comparison["title"], comparison["columns"]
            experiment = client.get_experiment_by_name(EXPERIMENT + stage)
            if experiment is None or experiment.lifecycle_stage == "deleted":
                continue
            number = experiment.experiment_id
            runs = client.search_runs(
                [number],
                query,
                max_results=_MOST_COMPARED,
                order_by=["attributes.run_name"],
            )
            metrics = {name for run in runs for name in run.data.metrics}
            curves = sorted(name for name in metrics if name.startswith("log10_mse/"))
            if columns and runs:
                _set_columns(client, experiment, columns)
                view = f"{_TRAINING}&viewStateShareKey={_VIEW}"
                links[title] = f"{base}/#/experiments/{number}/runs?{view}"
            elif curves:
                lists = {
                    "runs": [run.info.run_id for run in runs],
                    "experiments": [number],
                    "metric": curves[0],
                    "plot_metric_keys": curves,
                }
                keys = "&".join(f"{key}={quote(json.dumps(value))}" for key, value in lists.items())
                links[title] = f"{base}/#/metric?{keys}&x_axis=step&{_TRAINING}"
    return links


def _set_columns(client: "MlflowClient", experiment: "Experiment", columns: Sequence[str]) -> None:
    """Store a view of the table of runs with these `columns`, each as wide as its name."""
    shown = {"attributes.`Run Name`": _NAMES}
    for column in columns:
        kind, _, name = column.partition(".")
        shown[f"{kind}.`{name}`"] = _CHARACTER * len(name) + _MARGIN
    view = {"selectedColumns": list(shown)[1:], "columnOrder": list(shown), "columnWidths": shown}
    tag, content = f"mlflow.sharedViewState.{_VIEW}", json.dumps(view)
    if experiment.tags.get(tag) != content:
        client.set_experiment_tag(experiment.experiment_id, tag, content)
