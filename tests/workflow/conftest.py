"""One run of the smoke configuration, shared by all tests of the workflow."""

from dataclasses import dataclass
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from benchmarks.project import copy_project, run, smoke_command


@dataclass(frozen=True)
class SmokeRun:
    """A folder in which the smoke configuration has run to its end, and what was printed."""

    folder: Path
    first: CompletedProcess


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the tests that share runs of the workflow in one process of pytest-xdist."""
    here = Path(__file__).parent
    for item in items:
        if item.path.is_relative_to(here):
            item.add_marker(pytest.mark.xdist_group("workflow"))


@pytest.fixture(scope="session")
def smoke(tmp_path_factory: pytest.TempPathFactory) -> SmokeRun:
    """The whole chain in a folder with a space in its path, for a user whose HOME cannot be written."""
    folder = copy_project(tmp_path_factory.mktemp("smoke") / "a project")
    first = run(folder, *smoke_command("--cores", "2"), HOME="/dev/null/home")
    assert first.returncode == 0, first.stdout[-3000:] + first.stderr[-6000:]
    return SmokeRun(folder, first)


@pytest.fixture
def fresh_project(tmp_path: Path) -> Path:
    """A copy of the project in which nothing has run."""
    return copy_project(tmp_path / "fresh project")
