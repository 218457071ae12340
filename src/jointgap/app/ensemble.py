"""`jointgap.ensemble` and its result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.app.motion import checked_mechanism, simulate_options, without_none
from jointgap.config import Mechanism, Runs, Simulate
from jointgap.core.parquet import read_table
from jointgap.designs import ensemble as designs_ensemble


@dataclass(frozen=True)
class Motions:
    """The motions of an ensemble in a folder, made by `jointgap.ensemble`.

    Attributes
    ----------
    folder : Path
        Contains ``runs.parquet``, ``events.parquet`` and ``samples.parquet``.
    """

    folder: Path

    @cached_property
    def runs(self) -> pd.DataFrame:
        """One row per run: its varied values, its start, and the reason of a failure."""
        return read_table(self.folder / designs_ensemble.RUNS)

    @cached_property
    def events(self) -> pd.DataFrame:
        """One row per beginning or end of contact, of all runs (column ``run``)."""
        return read_table(self.folder / designs_ensemble.EVENTS)

    @cached_property
    def samples(self) -> pd.DataFrame:
        """One row per sample, of all runs (column ``run``); read the file in parts for large
        ensembles."""
        return read_table(self.folder / designs_ensemble.SAMPLES)


def ensemble(
    mechanism: Mechanism,
    options: Simulate | None = None,
    *,
    folder: Path | str,
    vary: Mapping[str, Sequence[Any] | Mapping[str, Any]] | None = None,
    members: int | None = None,
    perturbation: float | str | None = None,
    seed: int | None = None,
    workers: int | None = None,
    **keys: Any,
) -> Motions:
    """Simulate all combinations of varied values, each from several starts, and write them to
    Parquet.

    The memory is independent of the number of runs. Failed runs are listed in the table of runs;
    the others continue.

    Parameters
    ----------
    mechanism : Mechanism
    options : Simulate, optional
        Drive and sampling of all runs, except varied values.
    folder : Path or str
        Output folder of the three files.
    vary : mapping, optional
        Lists of values by parameter: ``speed``, ``clearance``, ``friction``, ``restitution`` (of
        every loose joint), or the path of a key such as ``mechanism.slider.mass``.
        ``{"from": "200 rpm", "to": "1200 rpm", "number": 6}`` gives equidistant values.
    members : int, optional
        Starts per combination, of which the first is not perturbed; 10 by default.
    perturbation : float or str, optional
        Standard deviation of the initial positions; ``"1e-7 m"`` by default.
    seed : int, optional
        Of the perturbations; 0 by default.
    workers : int, optional
        Threads; the number of cores by default. Results do not depend on it.
    **keys
        Keys of `jointgap.Simulate`, as `jointgap.simulate` takes them.

    Returns
    -------
    Motions

    Raises
    ------
    InputError
        Unknown key, invalid value, or a folder that is not writable.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> sweep = jg.ensemble(
    ...     mechanism, folder="results/sweep", vary={"clearance": ["0.1 mm", "0.5 mm"], "friction":
    [0, 0.1]}, ...     members=1, revolutions=2,
    ... )
    >>> sweep.runs[["clearance", "friction", "events"]].shape
    (4, 3)
    """
    runs = Runs(**without_none(vary=vary, members=members, perturbation=perturbation, seed=seed))
    motions = designs_ensemble.ensemble_runs(
        checked_mechanism(mechanism), simulate_options(options, keys), runs
    )
    designs_ensemble.write_ensemble(motions, folder, workers)
    return Motions(Path(folder))
