"""Costs of this process: processor time and simulated runs of a rig."""

import os
from threading import Lock

_lock = Lock()
_simulated = {"runs": 0, "revolutions": 0.0}


def count_run(revolutions: float) -> None:
    """Count a simulated run with the `revolutions` of its record."""
    with _lock:
        _simulated["runs"] += 1
        _simulated["revolutions"] += float(revolutions)


def costs_so_far() -> dict[str, float]:
    """Processor time [s] with that of ended child processes, simulated runs, and revolutions of
    their records."""
    return {"cpu_seconds": sum(os.times()[:4]), **_simulated}
