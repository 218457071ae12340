"""The dashboard: addresses that compare scenarios, a page that shows them, a clean end."""

import http.server
import os
import re
import signal
import socket
import socketserver
import subprocess
import sys
import threading
import time
import urllib.request

import pytest

from jointgap.app import dashboard as served
from jointgap.app.dashboard import dashboard, free_port
from jointgap.core.errors import InputError
from tests.track import synthetic
from tests.track.conftest import publish

pytestmark = pytest.mark.integration

SERVE = """
import sys
from pathlib import Path
from jointgap.app.dashboard import dashboard
dashboard(Path(sys.argv[1]), int(sys.argv[2]), say=lambda line: print(line, flush=True))
"""


def unused_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Serving:
    """A dashboard in a process of its own, and what it has printed."""

    def __init__(self, results):
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVE, str(results), str(unused_port())],
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # a terminal of its own
        )
        self.lines = []
        for line in self.process.stdout:
            self.lines.append(line.rstrip())
            if "Ctrl-C" in line:
                break
        self.wait_until_it_answers()

    def wait_until_it_answers(self) -> None:
        deadline = time.monotonic() + 90.0
        while True:
            try:
                return urllib.request.urlopen(self.base, timeout=2).close()
            except OSError:
                assert self.process.poll() is None and time.monotonic() < deadline, "MLflow's server did not start"
                time.sleep(0.1)

    @property
    def base(self) -> str:
        return self.lines[0].removeprefix("dashboard: ")

    def address(self, what: str) -> str:
        return next(line.partition(": ")[2] for line in self.lines if line.startswith(what))

    def children(self) -> list[int]:
        """Process numbers of the server and its workers."""
        found = subprocess.run(["ps", "-ww", "-eo", "pid=,args="], capture_output=True, text=True, check=True).stdout
        port = self.base.rpartition(":")[2]
        return [int(line.split()[0]) for line in found.splitlines() if "mlflow" in line and f"--port {port}" in line]

    def end(self) -> str:
        """What Ctrl-C does: the terminal interrupts all that it runs."""
        os.killpg(self.process.pid, signal.SIGINT)
        return self.process.communicate(timeout=30)[0]


@pytest.fixture(scope="module")
def serving(two_scenarios):
    """A dashboard over two finished scenarios."""
    server = Serving(two_scenarios)
    yield server
    if server.process.poll() is None:
        server.end()


def words(page: str) -> str:
    """What a reader sees of a page."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page))


def test_the_addresses_are_on_loopback_and_answer(serving):
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+", serving.base)
    for what in ("optima of all scenarios", "MSE curves of all scenarios"):
        assert serving.address(what).startswith(f"{serving.base}/#/")
    with urllib.request.urlopen(serving.base) as answer:
        assert answer.status == 200


def test_the_comparison_shows_the_optima_of_all_scenarios(serving, page_text):
    page = words(page_text(serving.address("optima of all scenarios"), until="crank_length_mm"))
    for word in ("Comparing 2 Runs", "paper", "frictionless", "crank_length_mm", "mechanism.contacts.steel.exponent"):
        assert word in page, word


def test_a_chart_shows_the_curves_of_all_networks(serving, page_text):
    page = words(page_text(serving.address("MSE curves of all scenarios"), until="log10_mse/gamma2"))
    for word in ("log10_mse/r2", "log10_mse/gamma2", "paper", "frictionless"):
        assert word in page, word


def test_what_is_published_through_the_dashboard_is_kept(serving, new_results):
    other = new_results()
    files = synthetic.simulated(other / "made_up")
    first, second = (publish(other, files, address=serving.base) for _ in range(2))
    assert {run["state"] for run in first["runs"].values()} == {"written"}
    assert {run["state"] for run in second["runs"].values()} == {"kept"}
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=serving.base)
    with open(client.download_artifacts(first["runs"]["figures"]["run_id"], "figures/figure 5.png"), "rb") as file:
        assert file.read() == b"a picture"


def test_ctrl_c_ends_the_dashboard_and_all_its_workers(serving):
    assert len(serving.children()) >= 2
    begun = time.monotonic()
    serving.end()
    assert time.monotonic() - begun < 10
    assert serving.children() == []


def test_without_a_store_it_says_what_to_run(tmp_path):
    with pytest.raises(InputError, match=r"mlflow\.db: there is no such store; run `make run`"):
        dashboard(tmp_path)


def test_a_port_in_use_is_passed_over():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert free_port(port) > port


def test_a_server_in_the_environment_is_not_started_again(results, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    with pytest.raises(InputError, match=r"http://127\.0\.0\.1:9 cannot be reached"):
        dashboard(results)


class Answering(http.server.BaseHTTPRequestHandler):
    """A server that answers, and says nothing."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()

    def log_message(self, *words) -> None:
        pass


def test_the_comparison_opens_in_a_browser_once_something_answers(monkeypatch, tmp_path):
    opened = tmp_path / "opened.txt"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\nprintf %s "$1" > "{opened}"\n')
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER", f"{browser} %s")
    with socketserver.TCPServer(("127.0.0.1", 0), Answering) as server:
        base = f"http://127.0.0.1:{server.server_address[1]}"
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        served._open_when_served(f"{base}/#/comparison", base).wait(timeout=60)
        server.shutdown()
        thread.join()
    assert opened.read_text() == f"{base}/#/comparison"
