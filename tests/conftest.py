"""What all tests may use."""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from jointgap.core.publish import opened, store_address
from tests.scenario import published_tables
from tests.scenario.mlflow_store import client_of, publish

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@pytest.fixture
def page_text(tmp_path: Path) -> Callable[[str], str]:
    """A function that opens an address in headless Chromium, lets its scripts run and returns the
    page as HTML."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip("needs Chromium (Debian: apt-get install chromium)")

    def open_page(address: str, patience_ms: int = 20_000, until: str = "") -> str:
        """Content of the page; again with more patience while `until` is not on it and the machine
        may be just busy."""
        for patience in (patience_ms, 4 * patience_ms, 16 * patience_ms):
            if until in (page := dump(address, patience)):
                break
        return page

    def dump(address: str, patience_ms: int) -> str:
        done = subprocess.run(
            [
                browser,
                "--headless",
                "--no-sandbox",  # root, as in most containers, may not start it otherwise
                "--disable-gpu",
                "--disable-dev-shm-usage",
                # pages bring their own
                "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",
                f"--user-data-dir={tmp_path / 'browser'}",
                "--window-size=1920,2000",  # what lies outside the window some pages draw later
                f"--virtual-time-budget={patience_ms}",
                "--dump-dom",
                address,
            ],
            env={**os.environ, "HOME": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return open_page


@pytest.fixture(scope="session", autouse=True)
def _no_server():
    """The store of the results folder is the one to use, whatever the environment says."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        yield


@pytest.fixture(scope="session")
def new_results(tmp_path_factory) -> Callable[[], Path]:
    """Makes results folders, with a space in their names, that hold an empty store."""
    first = tmp_path_factory.mktemp("empty store")
    with opened(store_address(first)):
        pass

    def make() -> Path:
        folder = tmp_path_factory.mktemp("my results")
        shutil.copy(first / "mlflow.db", folder)
        return folder

    return make


@pytest.fixture(scope="session")
def finished(new_results) -> Path:
    """A results folder with a finished scenario that is published; for tests that only look."""
    results = new_results()
    publish(
        results,
        published_tables.finished(results / "paper"),
        "paper",
        published_tables.scenario(simulate={"revolutions": 4}),
    )
    return results


@pytest.fixture
def results(new_results) -> Path:
    """A results folder that holds an empty store."""
    return new_results()


@pytest.fixture
def client(results: Path):
    """MLflow's own view of the store."""
    return client_of(results)
