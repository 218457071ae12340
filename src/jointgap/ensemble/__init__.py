"""Many motions at once: what they differ in, their tables, and how far samples of a motion can be trusted.

`ensemble_runs` makes the runs of a configuration, `write_ensemble` simulates them into Parquet files.
"""

from jointgap.dynamics.ensemble import Run, march_runs, simulate_ensemble
from jointgap.ensemble.vary import ensemble_runs
from jointgap.ensemble.write import Written, write_ensemble

__all__ = ["Run", "Written", "ensemble_runs", "march_runs", "simulate_ensemble", "write_ensemble"]
