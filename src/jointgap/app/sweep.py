"""`jointgap.sweep` and its result."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from jointgap.app.motion import checked_mechanism, simulate_options
from jointgap.app.result import Result
from jointgap.config import Mechanism, Scenario, Simulate, load
from jointgap.config.designs import Sweep
from jointgap.config.linkage_file import LinkageFile
from jointgap.core import parquet
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.facts import Fact
from jointgap.core.units import plain_numbers
from jointgap.designs.dataset import failures, table_of
from jointgap.designs.sampling import designs_of
from jointgap.designs.stages import write_sweep


@dataclass(frozen=True, repr=False)
class SweptDesigns(Result):
    """The designs of a sweep, made by `jointgap.sweep`.

    Attributes
    ----------
    folder : Path
        Contains ``designs``, a dataset of Parquet files for pandas, polars and duckdb, and
        ``summary.html``.
    """

    folder: Path
    _drawn: Any  # jointgap.designs.sampling.Designs, which is not in the documentation

    _HEADLINE = "Designs of a sweep: medians of the measures"

    @property
    def dataset(self) -> Path:
        """The folder of Parquet files, one row per design."""
        return self.folder / "designs"

    @cached_property
    def designs(self) -> pd.DataFrame:
        """One row per design and start: parameters, measures, and the reason of a failure.

        In SI units (``attrs["units"]``). For large sweeps, `read` single columns instead.
        """
        return self.read(*table_of(self._drawn).names)

    def read(self, *columns: str) -> pd.DataFrame:
        """Read some columns of all designs.

        Parameters
        ----------
        *columns : str
            Names of columns of `designs`.

        Returns
        -------
        pandas.DataFrame
            In SI units (``attrs["units"]`` by column).

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
        frame = parquet.read_columns(self.dataset, columns).to_pandas()
        frame.attrs["units"] = {name: units[name] for name in columns}
        return frame

    @property
    def remarks(self) -> tuple[str, ...]:
        """Reasons of failed designs."""
        return tuple(
            f"{count} designs failed: {why}" for why, count in failures(self.dataset).most_common()
        )

    @property
    def figures(self) -> Mapping[str, str]:
        """Names for `plot`, those of the measures, with their labels; the first is the default."""
        frame = self.read(*(column.name for column in self._drawn.measured))
        descriptions = {column.name: column.description for column in self._drawn.measured}
        return {name: descriptions[name] for name in frame if frame[name].notna().any()}

    def _draw(self, name: str):
        from jointgap.designs.figures import measure_over_parameters

        axes, columns = self._drawn.axes, self._drawn.measured
        measure = next(column for column in columns if column.name == name)
        designs = self.read(*(axis.key for axis in axes), name)
        return measure_over_parameters(designs, axes, measure)

    @property
    def facts(self) -> list[Fact]:
        """Number of designs and of failures, and the median of each measure."""
        from jointgap.designs.sweep import sweep_study

        facts = sweep_study(self._drawn, self.dataset).facts
        return [fact for fact in facts if "/" not in fact.name or fact.name.endswith("/median")]


def sweep(
    mechanism: Mechanism | LinkageFile,
    options: Simulate | None = None,
    *,
    folder: Path | str,
    parameters: Mapping[str, Any],
    workers: int | None = None,
    **keys: Any,
) -> SweptDesigns:
    """Simulate and measure many designs, and write them to a dataset of Parquet files.

    The memory is independent of the number of designs, except for a Latin hypercube. Infeasible or
    failed designs are rows with their reason. Existing results are kept: an interrupted sweep
    resumes, and a larger `number` extends a Sobol sequence.

    Parameters
    ----------
    mechanism : Mechanism or LinkageFile
    options : Simulate, optional
        Drive and sampling of all designs, except varied values.
    folder : Path or str
        Output folder of the dataset ``designs`` and the summary.
    parameters : mapping
        Varied parameters: a word (``speed``; ``clearance``, ``friction``, ``restitution`` of every
        loose joint; of a slider-crank ``crank_length``, ``rod_length``) or the path of a key as
        `change` takes it, such as ``slider.mass``, of a linkage ``bodies.rocker.length``. Values: a
        list, or ``{"from": "0.1 mm", "to": "1 mm"}`` with ``"distribution"`` ``uniform`` (default),
        ``log_uniform``, ``normal`` (with ``mean`` and ``deviation``) or ``triangular`` (with
        ``peak``).
    workers : int, optional
        Threads; the number of cores by default. Results do not depend on it.
    **keys
        Keys of the section ``sweep`` (config/README.md): ``design`` (``"sobol"``, the default,
        ``"latin_hypercube"`` or ``"grid"``), ``number`` of designs (1024 by default), ``seed``,
        ``window`` (two crank angles in the first revolution for an additional error of the
        transmission angle), ``best_lengths`` (whether to compute the best lengths of each design by
        the paper's method), ``starts`` per design (all but the first slightly perturbed; each has a
        row), ``trajectories`` (numbers of the designs whose samples and events are written) and
        ``designs_per_job`` (designs per file). Keys of `jointgap.Simulate` as `jointgap.simulate`
        takes them.

    Returns
    -------
    SweptDesigns

    Raises
    ------
    InputError
        Unknown key, invalid value, or a folder that contains another sweep or is not writable;
        raised before any simulation.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> swept = jg.sweep(
    ...     mechanism, folder="results/sweep", number=64, revolutions=2,
    ...     parameters={"clearance": {"from": "0.1 mm", "to": "1 mm"}, "friction": {"from": 0, "to":
    0.2}}, ... )
    >>> swept.designs[["clearance", "friction", "piston_pin_peak_force"]].shape
    (64, 3)
    >>> swept.plot("angle_error_rms").save("error.png")
    """
    settings = {key: keys.pop(key) for key in Sweep.model_fields if key in keys}
    settings["parameters"] = parameters
    is_linkage = isinstance(mechanism, LinkageFile)
    scenario = Scenario(
        mechanism=mechanism if is_linkage else checked_mechanism(mechanism),
        simulate=simulate_options(options, keys),
        sweep=load.validate(Sweep, plain_numbers(settings), "sweep"),
    )
    write_sweep(scenario, Path(folder), workers)
    return SweptDesigns(Path(folder), designs_of(scenario))
