"""`sweep`: many designs, each simulated and measured, on disk."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap import tables
from jointgap.api.result import Result, Row
from jointgap.api.simulated_motion import checked_mechanism, simulate_options
from jointgap.config import Mechanism, Scenario, Simulate, validate
from jointgap.config.sweep_config import Sweep
from jointgap.designs.design_of_experiments import designs_of
from jointgap.designs.designs_to_parquet import table_of
from jointgap.designs.sweep_page import failures
from jointgap.errors import InputError, did_you_mean
from jointgap.report.plain_words import reading_unit
from jointgap.stages.scenario_stages import SCENARIO_STAGES
from jointgap.tables.sweep_tables import ALL_MEASURES


@dataclass(frozen=True, repr=False)
class SweptDesigns(Result):
    """Many designs, each simulated and measured, made by `jointgap.sweep`.

    Attributes
    ----------
    folder : Path
        Holds ``designs``, Parquet files that are one table for pandas, polars and duckdb, and ``summary.html``.
    """

    folder: Path
    _drawn: Any  # jointgap.designs.design_of_experiments.Designs, which the documentation has no page of

    _HEADLINE = "Designs of a sweep: medians of what was measured"

    @property
    def dataset(self) -> Path:
        """The folder of Parquet files, a row a design."""
        return self.folder / "designs"

    @cached_property
    def designs(self) -> pd.DataFrame:
        """One row a design: its parameters, what was measured, and the reason where it failed.

        In SI units (``attrs["units"]``). Of large sweeps read some columns instead: `read`.
        """
        return self.read(*table_of(self._drawn).names)

    def read(self, *columns: str) -> pd.DataFrame:
        """Some columns of all designs, without the others in memory.

        Parameters
        ----------
        *columns : str
            Names of columns of `designs`.

        Returns
        -------
        pandas.DataFrame
            In SI units, which ``attrs["units"]`` holds by column.

        Raises
        ------
        InputError
            No such column.

        Examples
        --------
        >>> swept.read("friction", "piston_pin_peak_force").max()
        """
        units = {column.name: column.unit for column in table_of(self._drawn).columns}
        if unknown := [name for name in columns if name not in units]:
            raise InputError(f"read: no column '{unknown[0]}'; {did_you_mean(unknown[0], units)}")
        frame = tables.read_columns(self.dataset, columns).to_pandas()
        frame.attrs["units"] = {name: units[name] for name in columns}
        return frame

    @property
    def remarks(self) -> tuple[str, ...]:
        """Why designs failed, where some did."""
        return tuple(f"{count} designs failed: {why}" for why, count in failures(self.dataset).most_common())

    @property
    def figures(self) -> Mapping[str, str]:
        """Names that `plot` takes, those of the measures, with what they are; the first one is drawn without a name."""
        return {name: column.description for name, column in _MEASURES.items() if name in self._measured}

    @cached_property
    def _measured(self) -> dict[str, float]:
        """Medians by measure [SI], where some design has one."""
        names = [column.name for column in self._drawn.measured]
        frame = self.read(*names)
        return {name: float(frame[name].median()) for name in names if frame[name].notna().any()}

    def _draw(self, name: str):
        from jointgap.designs.sweep_figures import measure_over_parameters

        axes = self._drawn.axes
        return measure_over_parameters(self.read(*(axis.key for axis in axes), name), axes, _MEASURES[name])

    def _rows(self) -> Sequence[Row]:
        rows: list[Row] = [("designs", self._drawn.number, "")]
        rows.append(("failed", sum(failures(self.dataset).values()), ""))
        for axis in self._drawn.axes:
            values = self.read(axis.key)[axis.key]
            if axis.column.kind != "float":
                rows.append((f"{axis.key}, varied", ", ".join(sorted(map(str, values.unique()))), ""))
                continue
            unit, factor = reading_unit(axis.unit)
            rows.append((f"{axis.key}, smallest", factor * float(values.min()), unit))
            rows.append((f"{axis.key}, largest", factor * float(values.max()), unit))
        for name, median in self._measured.items():
            unit, factor = reading_unit(_MEASURES[name].unit)
            rows.append((_MEASURES[name].description.partition(";")[0], factor * median, "" if unit == "1" else unit))
        return rows


_MEASURES = {column.name: column for column in ALL_MEASURES}


def sweep(
    mechanism: Mechanism,
    options: Simulate | None = None,
    *,
    folder: Path | str,
    parameters: Mapping[str, Any],
    design: str | None = None,
    number: int | None = None,
    seed: int | None = None,
    window: Sequence[float | str] | None = None,
    best_lengths: bool | None = None,
    designs_per_job: int | None = None,
    workers: int | None = None,
    **keys: Any,
) -> SweptDesigns:
    """Simulate and measure many designs, and write them to a dataset of Parquet files.

    Memory does not grow with the number of designs, but of a Latin hypercube, which is drawn whole. A design that is
    impossible, or whose simulation fails, is a row with its reason. What the folder holds already is kept: a sweep that
    was interrupted goes on, and one with a larger `number` of the same Sobol sequence simulates the new designs alone.

    Parameters
    ----------
    mechanism : Mechanism
    options : Simulate, optional
        Drive and samples of all designs, where they are not varied.
    folder : Path or str
        Where ``designs``, the dataset, and the summary are written.
    parameters : mapping
        What varies, by a word (``speed``; ``clearance``, ``friction``, ``restitution`` of every loose joint;
        ``crank_length``, ``rod_length``) or by the path of a key such as ``mechanism.slider.mass``: a list of values,
        or ``{"from": "0.1 mm", "to": "1 mm"}``, with ``"distribution"`` one of ``uniform`` (default), ``log_uniform``,
        ``normal`` (with ``mean`` and ``deviation``) and ``triangular`` (with ``peak``).
    design : str, optional
        ``"sobol"`` (default), ``"latin_hypercube"`` or ``"grid"``.
    number : int, optional
        Designs; 1024 by default.
    seed : int, optional
        Of the drawing; 0 by default.
    window : sequence of two, optional
        Crank angles of the first revolution over which the error of the transmission angle is measured too; all of it
        by default.
    best_lengths : bool, optional
        Whether each design is measured too by its best lengths by the paper's method; False by default.
    designs_per_job : int, optional
        Designs of a file; 5000 by default.
    workers : int, optional
        Threads; as many as there are cores by default. Results do not depend on it.
    **keys
        Keys of `jointgap.Simulate`, as `jointgap.simulate` takes them.

    Returns
    -------
    SweptDesigns

    Raises
    ------
    InputError
        An unknown key, an impossible value, or a folder that holds another sweep or cannot be written; before anything
        is simulated.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> swept = jg.sweep(
    ...     mechanism, folder="results/sweep", number=64, revolutions=2,
    ...     parameters={"clearance": {"from": "0.1 mm", "to": "1 mm"}, "friction": {"from": 0, "to": 0.2}},
    ... )  # fmt: skip
    >>> swept.designs[["clearance", "friction", "piston_pin_peak_force"]].shape
    (64, 3)
    >>> swept.plot("angle_error_rms").save("error.png")
    """
    given = {"parameters": parameters, "design": design, "number": number, "seed": seed, "window": window}
    given |= {"best_lengths": best_lengths, "designs_per_job": designs_per_job}
    scenario = Scenario(
        mechanism=checked_mechanism(mechanism),
        simulate=simulate_options(options, keys),
        sweep=validate(Sweep, {key: value for key, value in given.items() if value is not None}, "sweep"),
    )
    SCENARIO_STAGES["sweep"].function(scenario, Path(folder), workers)
    return SweptDesigns(Path(folder), designs_of(scenario))
