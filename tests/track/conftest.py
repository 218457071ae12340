"""A fresh store for each test, copied from one that was migrated once."""

import shutil
from pathlib import Path

import pytest

from jointgap.track.store import create_store


@pytest.fixture(scope="session")
def empty_store(tmp_path_factory) -> Path:
    results = tmp_path_factory.mktemp("empty store")
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        create_store(results)
    return results / "mlflow.db"


@pytest.fixture
def results(tmp_path: Path, empty_store: Path, monkeypatch) -> Path:
    """A results folder, with a space in its name, that holds an empty store."""
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    folder = tmp_path / "my results"
    folder.mkdir()
    shutil.copy(empty_store, folder)
    return folder
