"""Costs of this process: processor time and simulated runs of a rig."""

import os
from threading import Lock

_lock = Lock()
_simulated = {"runs": 0, "revolutions": 0.0}


def count_run(revolutions: float = 0.0) -> None:
    """Count a simulated run of so many `revolutions`, as far as `count_revolutions` does not count
    them."""
    with _lock:
        _simulated["runs"] += 1
        _simulated["revolutions"] += float(revolutions)


def count_revolutions(revolutions: float) -> None:
    """Count simulated revolutions, or other work that takes as long."""
    with _lock:
        _simulated["revolutions"] += float(revolutions)


def costs_so_far() -> dict[str, float]:
    """Processor time [s] with that of ended child processes, simulated runs, and simulated
    revolutions."""
    return {"cpu_seconds": sum(os.times()[:4]), **_simulated}
