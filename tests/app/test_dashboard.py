"""The dashboard: addresses that compare scenarios, a page that shows them, a clean end."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from jointgap.app.dashboard import addresses, dashboard, free_port
from jointgap.core.errors import InputError
from jointgap.core.publish import Record, publish_records
from tests.scenario import published_tables as synthetic
from tests.scenario.mlflow_store import client_of, publish

pytestmark = pytest.mark.integration

# seconds until something that has to happen is given up: a machine may be busy with other things
PATIENCE = 600
SERVE = """
import sys
from pathlib import Path
from jointgap.app.dashboard import dashboard
dashboard(Path(sys.argv[1]), int(sys.argv[2]), say=lambda line: print(line, flush=True))
"""
VERDICT = Record(
    "campaign",
    metrics={"gap/confirm_before": 8.7, "gap/confirm_after": 1.05},
    notes={"verdict": "named", "effects": "slider_coulomb_friction:slider"},
)


class Serving:
    """A dashboard in its own process, and its output."""

    def __init__(self, results):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            command = [sys.executable, "-c", SERVE, str(results), str(probe.getsockname()[1])]
        # its own session, which a terminal interrupts
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        self.addresses = {}
        for line in self.process.stdout:
            if "Ctrl-C" in line:
                break
            what, _, address = line.strip().partition(": ")
            self.addresses[what] = address
        self.base = self.addresses["dashboard"].partition("/#")[0]
        self.wait_until_it_answers()

    def wait_until_it_answers(self) -> None:
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                return urllib.request.urlopen(self.base, timeout=PATIENCE).close()
            except OSError:
                assert self.process.poll() is None and time.monotonic() < deadline, (
                    "MLflow's server did not start"
                )
                time.sleep(0.1)

    def children(self) -> list[int]:
        """Process numbers of the server and its workers."""
        found = subprocess.run(
            ["ps", "-ww", "-eo", "pid=,args="], capture_output=True, text=True, check=True
        ).stdout
        port = self.base.rpartition(":")[2]
        return [
            int(line.split()[0])
            for line in found.splitlines()
            if "mlflow" in line and f"--port {port}" in line
        ]

    def end(self) -> None:
        """What Ctrl-C does: the terminal interrupts all that it runs."""
        os.killpg(self.process.pid, signal.SIGINT)
        self.process.communicate(timeout=PATIENCE)


@pytest.fixture
def serving(new_results, monkeypatch):
    """A dashboard over two finished scenarios."""
    results = new_results()
    for salt, name in enumerate(("paper", "frictionless")):
        publish(results, synthetic.finished(results / name, salt), name)
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_TIMEOUT", str(PATIENCE))
    server = Serving(results)
    yield server
    if server.process.poll() is None:
        server.end()


def words_of(page: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page))


def test_a_dashboard_shows_optima_and_curves_keeps_what_is_published_and_ends_with_its_workers(
    serving, page_text, new_results
):
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+", serving.base)
    shown = {
        "optima of all scenarios": ["gain_revolution_percent", "crank_length_mm", "rod_length_mm"],
        "MSE curves of all scenarios": ["log10_mse/gamma2", "log10_mse/r2"],
    }
    for what, words in shown.items():
        assert serving.addresses[what].startswith(f"{serving.base}/#/")
        page = words_of(page_text(serving.addresses[what], until=words[0]))
        assert [word for word in (*words, "paper", "frictionless") if word not in page] == []
    other = new_results()
    files = synthetic.simulated(other / "made_up")
    first, second = (publish(other, files, address=serving.base)["runs"] for _ in range(2))
    assert [{run["state"] for run in runs.values()} for runs in (first, second)] == [
        {"written"},
        {"kept"},
    ]
    client = client_of(serving.base)
    with open(
        client.download_artifacts(first["figures"]["run_id"], "figures/figure 5.png"), "rb"
    ) as file:
        assert file.read() == b"a picture"
    assert len(serving.children()) >= 2
    serving.end()
    assert serving.children() == []


def test_every_address_opens_the_runs_not_traces_and_their_table_has_lengths_gains_and_verdicts(
    serving, page_text
):
    publish_records("rig", "made up", [VERDICT], serving.base, Path())
    links = addresses(serving.base, serving.base)
    assert (
        len(links) == 3
        and [link for link in links.values() if "workflowType=machine_learning" not in link] == []
    )
    assert "workflowType=machine_learning" in serving.addresses["dashboard"]
    lengths, gains = (
        ("crank_length_mm", "rod_length_mm"),
        ("gain_revolution_percent", "gain_window_percent"),
    )
    for what, columns in {
        "optima of all scenarios": [f"metrics.`{name}`" for name in (*lengths, *gains)],
        "verdicts of all campaigns": ["tags.`jointgap.verdict`", "metrics.`gap/confirm_after`"],
    }.items():
        page = page_text(links[what], until=columns[0])
        assert set(columns) <= set(re.findall('col-id="([^"]*)"', page))
        assert (
            "Judges" not in page and "Created" in page
        )  # of language models; of the table of runs


def test_where_nothing_can_be_shown_it_is_reported_what_to_do_and_a_port_in_use_is_passed_over(
    results, monkeypatch, tmp_path
):
    with pytest.raises(InputError, match=r"mlflow\.db: no such store; run `make run`"):
        dashboard(tmp_path)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")  # which is not started again
    with pytest.raises(InputError, match=r"http://127\.0\.0\.1:9 cannot be reached"):
        dashboard(results)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert free_port(port) > port
