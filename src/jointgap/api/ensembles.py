"""`ensemble`: many motions, on disk."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.api.simulated_motion import checked_mechanism, simulate_options
from jointgap.config import Mechanism, Runs, Simulate
from jointgap.ensembles.ensemble import EVENTS, RUNS, SAMPLES, ensemble_runs, write_ensemble
from jointgap.tables import read_table


@dataclass(frozen=True)
class Motions:
    """Many motions in a folder, made by `jointgap.ensemble`.

    Attributes
    ----------
    folder : Path
        Holds ``runs.parquet``, ``events.parquet`` and ``samples.parquet``, for any program that reads Parquet.
    """

    folder: Path

    @cached_property
    def runs(self) -> pd.DataFrame:
        """One row a run: what it differs in, how it started, and why it failed where it did."""
        return read_table(self.folder / RUNS)

    @cached_property
    def events(self) -> pd.DataFrame:
        """One row a beginning or end of contact, of all runs (column ``run``)."""
        return read_table(self.folder / EVENTS)

    @cached_property
    def samples(self) -> pd.DataFrame:
        """One row a sample, of all runs (column ``run``); of large ensembles read the file in parts instead."""
        return read_table(self.folder / SAMPLES)


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
    """Simulate every combination of varied values, each from several starts, and write all to Parquet.

    Memory does not grow with the number of runs. A run that fails is told in the table of runs, and the others go on.

    Parameters
    ----------
    mechanism : Mechanism
    options : Simulate, optional
        Drive and samples of all runs, where they are not varied.
    folder : Path or str
        Where the three files are written.
    vary : mapping, optional
        Lists of values by what they set: ``speed``, ``clearance``, ``friction``, ``restitution`` (of every loose
        joint), or the path of a key such as ``mechanism.slider.mass``. ``{"from": "200 rpm", "to": "1200 rpm",
        "number": 6}`` stands for values evenly apart.
    members : int, optional
        Starts of each combination, of which the first is not perturbed; 10 by default.
    perturbation : float or str, optional
        Standard deviation of the perturbed starting positions; ``"1e-7 m"`` by default.
    seed : int, optional
        Of the perturbations; 0 by default.
    workers : int, optional
        Threads; as many as there are cores by default. Results do not depend on it.
    **keys
        Keys of `jointgap.Simulate`, as `jointgap.simulate` takes them.

    Returns
    -------
    Motions

    Raises
    ------
    InputError
        An unknown key, an impossible value, or a folder that cannot be written.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> sweep = jg.ensemble(
    ...     mechanism, folder="results/sweep", vary={"clearance": ["0.1 mm", "0.5 mm"], "friction": [0, 0.1]},
    ...     members=1, revolutions=2,
    ... )  # fmt: skip
    >>> sweep.runs[["clearance", "friction", "events"]].shape
    (4, 3)
    """
    given = {"vary": vary, "members": members, "perturbation": perturbation, "seed": seed}
    runs = Runs(**{key: value for key, value in given.items() if value is not None})
    write_ensemble(ensemble_runs(checked_mechanism(mechanism), simulate_options(options, keys), runs), folder, workers)
    return Motions(Path(folder))
