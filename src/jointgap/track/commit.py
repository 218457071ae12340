"""Which commit of the project made the results."""

import subprocess
from pathlib import Path


def commit(folder: Path = Path(__file__).parent) -> str:
    """The commit that `folder` is checked out at, with ``-changed`` where tracked files differ; ``unknown`` outside git.

    Parameters
    ----------
    folder : Path
        A folder under version control; by default the package's.
    """
    head = _git(folder, "rev-parse", "HEAD")
    tracked = _git(folder, "ls-files", "--error-unmatch", ".")  # a package in .venv of another project is not tracked
    if head is None or tracked is None:
        return "unknown"
    return head.strip() + ("-changed" if _git(folder, "diff-index", "--name-only", "HEAD") else "")


def _git(folder: Path, *words: str) -> str | None:
    # a checkout that belongs to another user is only read, so it may be trusted
    command = ["git", "-C", str(folder), "-c", "safe.directory=*", *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout if done.returncode == 0 else None
