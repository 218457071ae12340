"""The Python interface."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from jointgap.campaign import plan, verdict_json
from jointgap.campaign import sentences as say
from jointgap.campaign.campaign_files import MECHANISM, VERDICT
from jointgap.campaign.figures import FIGURES as CAMPAIGN_FIGURES
from jointgap.campaign.state import FALSE_ALARM_RATE
from jointgap.config import (
    Mechanism,
    Optimise,
    Runs,
    Scenario,
    Simulate,
    Surrogate,
    load,
    read_yaml,
)
from jointgap.config.designs import ALL_MEASURES, Sweep
from jointgap.config.variations import change
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import FROM_FRAME, outputs
from jointgap.core.parquet import read_table, with_units
from jointgap.core.results_folder import ResultsFolder
from jointgap.core.units import plain_numbers
from jointgap.core.words import format_name, joined, number, reading_unit, rounded_gap
from jointgap.designs import ensemble as designs_ensemble
from jointgap.designs.run import failures, table_of
from jointgap.designs.sampling import designs_of
from jointgap.designs.stages import DESIGN_STAGES
from jointgap.designs.statistics import contacts, time_shares
from jointgap.dynamics.mechanism_warnings import sentences
from jointgap.dynamics.simulation import simulate as simulated
from jointgap.scenario.figures import FIGURES
from jointgap.scenario.outcome import headline, outcome, remarks
from jointgap.scenario.stages import SCENARIO_STAGES

if TYPE_CHECKING:
    from jointgap.core.plot import Drawing

_COLUMN = 24
"""Longest value in the aligned column of a summary."""

Row = tuple[str, float | int | str, str]
"""Quantity, value and unit of a line of a summary."""


class Result:
    """A result with a text form, a table for notebooks, and figures.

    Attributes
    ----------
    remarks : tuple of str
        Warnings and limitations.
    figures : mapping of str to str
        Names for `plot`, with the titles of the figures; the first is the default.
    """

    remarks: tuple[str, ...]
    figures: Mapping[str, str]
    _HEADLINE: str

    def _rows(self) -> Sequence[Row]:
        """The lines of the summary."""
        raise NotImplementedError

    def _draw(self, name: str) -> "Drawing":
        """The figure `name`, which is one of `figures`."""
        raise NotImplementedError

    def plot(self, name: str | None = None) -> "Drawing":
        """Draw a figure of the result.

        Parameters
        ----------
        name : str, optional
            One of `figures`; the first by default.

        Returns
        -------
        Drawing
            Displayed in a notebook; ``.save("name.png")`` writes it (also ``.svg``), ``.figure`` is
            the matplotlib figure, ``.data`` the table of the plotted data.

        Raises
        ------
        InputError
            No such figure.
        """
        name = name or next(iter(self.figures), None)
        if name is None:
            raise InputError(f"plot: there are no figures; see {type(self).__name__}.remarks")
        if name not in self.figures:
            raise InputError(
                f"plot: no figure '{name}' of this {type(self).__name__};"
                f" {did_you_mean(name, self.figures)}"
            )
        return self._draw(name)

    def summary(self) -> pd.DataFrame:
        """The result in numbers.

        Returns
        -------
        pandas.DataFrame
            Columns quantity, value and unit.
        """
        return pd.DataFrame(self._rows(), columns=["quantity", "value", "unit"])

    def _shown(self) -> pd.DataFrame:
        table = self.summary()
        return table.assign(value=[_in_digits(row.value, row.unit) for row in table.itertuples()])

    def __repr__(self) -> str:
        table = self._shown()
        names = table["quantity"].str.len().max()
        values = max((len(value) for value in table["value"] if len(value) <= _COLUMN), default=0)
        lines = [
            f"{row.quantity:<{names}}  {row.value:>{values}} {row.unit}".rstrip()
            for row in table.itertuples()
        ]
        return "\n".join(
            [self._HEADLINE, *lines, *(f"Remark: {remark}" for remark in self.remarks)]
        )

    def _repr_html_(self) -> str:
        """A small table for a notebook."""
        rows = "".join(
            f"<tr><td style='text-align:left'>{escape(row.quantity)}</td>"
            f"<td style='text-align:right'>{escape(row.value)}</td><td>{escape(row.unit)}</td></tr>"
            for row in self._shown().itertuples()
        )
        remarks = "".join(f"<p>Remark: {escape(remark)}</p>" for remark in self.remarks)
        caption = f"<caption><b>{escape(self._HEADLINE)}</b></caption>"
        return f"<table>{caption}<tbody>{rows}</tbody></table>{remarks}"


def _in_digits(value: float | int | str, unit: str) -> str:
    """A formatted value: lengths to the micrometre, otherwise as of `number`."""
    if isinstance(value, str | int):
        return str(value)
    return f"{value:.3f}" if unit == "mm" else number(value)


_TABLES = {"trajectory", "events", "kinematics"}
_MOTION_FIGURES = {spec.call: name for name, spec in FIGURES.items() if set(spec.tables) <= _TABLES}
_OF_LOOSE_JOINTS = ("orbits", "contact_forces", "impacts", "animation")


@dataclass(frozen=True, repr=False)
class Motion(Result):
    """One simulated motion, made by `jointgap.simulate`.

    Attributes
    ----------
    mechanism : Mechanism
        The simulated mechanism.
    options : Simulate
        Drive and sampling.
    samples : pandas.DataFrame
        One row per sample, in SI units (``samples.attrs["units"]`` by column, or `unit`). NaN where
        a quantity is undefined.
    events : pandas.DataFrame
        One row per beginning or end of contact; units as of `samples`.
    steps : int
        Integration steps, including rejected ones.
    remarks : tuple of str
        Unexpected properties of the contacts.
    """

    mechanism: Mechanism
    options: Simulate
    samples: pd.DataFrame
    events: pd.DataFrame
    steps: int
    remarks: tuple[str, ...] = ()

    _HEADLINE = "Simulated motion"

    def unit(self, column: str) -> str:
        """The unit of a column of `samples` or `events`.

        Parameters
        ----------
        column : str
            Its name.

        Returns
        -------
        str
            For example ``"rad"``; ``"1"`` for pure numbers, empty for text.

        Raises
        ------
        InputError
            No such column.

        Examples
        --------
        >>> run.unit("crank_angle")
        'rad'
        """
        return parquet.unit_in(self.events.attrs["units"] | self.samples.attrs["units"], column)

    @property
    def figures(self) -> Mapping[str, str]:
        """Names for `plot`, with the titles of the figures; the first is the default."""
        loose = self.mechanism.applied().loose
        first = "orbits" if loose else "drive_and_guide"
        names = sorted(_MOTION_FIGURES, key=lambda name: name != first)
        titles = {
            name: FIGURES[_MOTION_FIGURES[name]].title.partition(" (")[0] for name in names
        }  # without the paper's figure numbers
        return {
            name: title for name, title in titles.items() if loose or name not in _OF_LOOSE_JOINTS
        }

    def _draw(self, name: str) -> "Drawing":
        from jointgap.scenario.kinematics import linkage_frames, motion_table

        mechanism, spec = self.mechanism.applied(), FIGURES[_MOTION_FIGURES[name]]
        frames = {"trajectory": self.samples, "events": self.events}
        if "kinematics" in spec.tables:
            first = self.samples.iloc[: self.options.samples_per_revolution + 1]
            frames["kinematics"] = motion_table(
                linkage_frames(mechanism, first), first["crank_angle"].to_numpy()
            )
        # the figures expect a scenario: the last revolution is the settled one
        last = Optimise(ensemble={"settled_revolution": self.options.revolutions})
        scenario = Scenario(mechanism=mechanism, simulate=self.options).model_copy(
            update={"optimise": last}
        )
        return FIGURES.draw(_MOTION_FIGURES[name], frames, scenario)

    def _rows(self) -> list[Row]:
        mechanism, revolutions = self.mechanism.applied(), self.options.revolutions
        time = self.samples["time"].to_numpy()
        last = (revolutions - 1) * self.options.samples_per_revolution
        rows: list[Row] = [
            ("crank length", 1e3 * mechanism.crank.length, "mm"),
            ("rod length", 1e3 * mechanism.rod.length, "mm"),
            ("speed of the crank", 60.0 * revolutions / (time[-1] - time[0]), "rpm"),
            ("revolutions", revolutions, ""),
        ]
        for joint in FROM_FRAME:
            words = format_name(joint)
            force = np.hypot(self.samples[f"{joint}_force_x"], self.samples[f"{joint}_force_y"])
            if joint in mechanism.loose:
                own = contacts(self.events, joint)
                rows += [
                    (f"{words}: radial clearance", 1e3 * mechanism.clearance(joint), "mm"),
                    (f"{words}: impacts (beginnings of contact)", len(own), ""),
                    (
                        f"{words}: time in contact",
                        100 * (1 - time_shares(own, time[0], time[-1])["flight"]),
                        "%",
                    ),
                ]
            peaks = self.events.loc[self.events["joint"] == joint, "peak_force"].dropna()
            rows.append(
                (
                    f"{words}: largest force, including the start",
                    float(max([force.max(), *peaks])),
                    "N",
                )
            )
            rows.append(
                (f"{words}: largest force in the last revolution", float(force[last:].max()), "N")
            )
        return rows


def simulate(
    mechanism: Mechanism, options: Simulate | None = None, *, perturbation=None, **keys: Any
) -> Motion:
    """Simulate a slider-crank with loose or ideal joints.

    The motion starts with coincident joint centres and the velocities of the mechanism without
    clearance.

    Parameters
    ----------
    mechanism : Mechanism
        From `jointgap.load_mechanism`, or created in Python.
    options : Simulate, optional
        Drive and sampling.
    perturbation : (4,) or (6,) array_like, optional
        Initial clearance vectors r2 x, r2 y, r3 x, r3 y, r1 x, r1 y [m]; zero by default.
    **keys
        Keys of `jointgap.Simulate`, which override `options`: ``speed``, ``revolutions``,
        ``drive``, ``start_angle``, ``samples_per_revolution``, ``tolerance``. Text with units, such
        as ``"600 rpm"``, or SI numbers.

    Returns
    -------
    Motion

    Raises
    ------
    InputError
        Unknown key or invalid value.
    SimulationError
        The integration failed; the message contains time, crank angle and state.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> run = jg.simulate(mechanism, speed="600 rpm", revolutions=2)
    >>> len(run.samples), run.unit("slider_position")
    (7201, 'm')
    >>> run.plot("impacts").save("impacts.png")
    """
    options = simulate_options(options, keys)
    run = simulated(checked_mechanism(mechanism), options, perturbation)
    samples, events = (
        with_units(schema.TRAJECTORY, run.samples),
        with_units(schema.EVENTS, run.events),
    )
    return Motion(
        mechanism, options, samples, events, run.steps, sentences(mechanism, options.highest_speed)
    )


def checked_mechanism(mechanism: Any) -> Mechanism:
    """The `mechanism`; InputError for any other type."""
    return _of_kind(mechanism, Mechanism, "mechanism", "load one with load_mechanism(path)")


def simulate_options(options: Any, keys: Mapping[str, Any]) -> Simulate:
    """The `options`, a `Simulate` or None, with the values of `keys`."""
    if options is None:
        return Simulate(**keys)
    options = _of_kind(
        options, Simulate, "options", "write Simulate(speed='600 rpm') or speed='600 rpm'"
    )
    return change(options, keys) if keys else options


def _of_kind(value: Any, kind: type, name: str, fix: str) -> Any:
    if isinstance(value, kind):
        return value
    given = "text" if isinstance(value, str) else f"of type {type(value).__name__}"
    raise InputError(f"{name}: is {given}, not a {kind.__name__}; {fix}")


def _given(**keys: Any) -> dict[str, Any]:
    """The arguments that are not None."""
    return {key: value for key, value in keys.items() if value is not None}


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
    runs = Runs(**_given(vary=vary, members=members, perturbation=perturbation, seed=seed))
    motions = designs_ensemble.ensemble_runs(
        checked_mechanism(mechanism), simulate_options(options, keys), runs
    )
    designs_ensemble.write_ensemble(motions, folder, workers)
    return Motions(Path(folder))


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
        """One row per design: its parameters, its measures, and the reason of a failure.

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
        return {
            name: column.description for name, column in _MEASURES.items() if name in self._measured
        }

    @cached_property
    def _measured(self) -> dict[str, float]:
        """Medians by measure [SI], without undefined ones."""
        names = [column.name for column in self._drawn.measured]
        frame = self.read(*names)
        return {name: float(frame[name].median()) for name in names if frame[name].notna().any()}

    def _draw(self, name: str):
        from jointgap.designs.sweep import measure_over_parameters

        axes = self._drawn.axes
        return measure_over_parameters(self.read(*(axis.key for axis in axes), name), axes, name)

    def _rows(self) -> Sequence[Row]:
        rows: list[Row] = [
            ("designs", self._drawn.number, ""),
            ("failed", failures(self.dataset).total(), ""),
        ]
        for axis in self._drawn.axes:
            values = self.read(axis.key)[axis.key]
            if axis.column.kind != "float":
                rows.append(
                    (f"{axis.key}, varied", ", ".join(sorted(map(str, values.unique()))), "")
                )
                continue
            unit, factor = reading_unit(axis.unit)
            rows += [
                (f"{axis.key}, smallest", factor * float(values.min()), unit),
                (f"{axis.key}, largest", factor * float(values.max()), unit),
            ]
        for name, median in self._measured.items():
            unit, factor = reading_unit(_MEASURES[name].unit)
            rows.append(
                (
                    _MEASURES[name].description.partition(";")[0],
                    factor * median,
                    "" if unit == "1" else unit,
                )
            )
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

    The memory is independent of the number of designs, except for a Latin hypercube. Infeasible or
    failed designs are rows with their reason. Existing results are kept: an interrupted sweep
    resumes, and a larger `number` extends a Sobol sequence.

    Parameters
    ----------
    mechanism : Mechanism
    options : Simulate, optional
        Drive and sampling of all designs, except varied values.
    folder : Path or str
        Output folder of the dataset ``designs`` and the summary.
    parameters : mapping
        Varied parameters: a word (``speed``; ``clearance``, ``friction``, ``restitution`` of every
        loose joint; ``crank_length``, ``rod_length``) or the path of a key such as
        ``mechanism.slider.mass``. Values: a list, or ``{"from": "0.1 mm", "to": "1 mm"}`` with
        ``"distribution"`` ``uniform`` (default), ``log_uniform``, ``normal`` (with ``mean`` and
        ``deviation``) or ``triangular`` (with ``peak``).
    design : str, optional
        ``"sobol"`` (default), ``"latin_hypercube"`` or ``"grid"``.
    number : int, optional
        Number of designs; 1024 by default.
    seed : int, optional
        Of the samples; 0 by default.
    window : sequence of two, optional
        Crank angles in the first revolution for an additional error of the transmission angle; by
        default the whole revolution.
    best_lengths : bool, optional
        Whether to compute the best lengths of each design by the paper's method; False by default.
    designs_per_job : int, optional
        Designs per file; 5000 by default.
    workers : int, optional
        Threads; the number of cores by default. Results do not depend on it.
    **keys
        Keys of `jointgap.Simulate`, as `jointgap.simulate` takes them.

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
    given = _given(parameters=parameters, design=design, number=number, seed=seed, window=window)
    given |= _given(best_lengths=best_lengths, designs_per_job=designs_per_job)
    scenario = Scenario(
        mechanism=checked_mechanism(mechanism),
        simulate=simulate_options(options, keys),
        sweep=load.validate(Sweep, plain_numbers(given), "sweep"),
    )
    DESIGN_STAGES["sweep"].function(scenario, Path(folder), workers)
    return SweptDesigns(Path(folder), designs_of(scenario))


_WRITTEN = SCENARIO_STAGES["optimise"].writes


@dataclass(frozen=True, repr=False)
class Optimum(Result):
    """Optimised link lengths and their re-simulated effects; made by `jointgap.optimise`.

    Attributes
    ----------
    mechanism : Mechanism
        With the new lengths; effects that only modify its data are applied.
    original : Motion
        The motion with the original lengths.
    tables : mapping of str to pandas.DataFrame
        Results of the search by name, in SI units (``attrs["units"]``): ``optima``,
        ``resimulated``, ``worth``, ``loads`` and others, as in the workflow.
    """

    mechanism: Mechanism
    original: Motion
    tables: Mapping[str, pd.DataFrame]
    _outcome: Any  # jointgap.scenario.outcome.Outcome, which is not in the documentation

    @property
    def _HEADLINE(self) -> str:
        return f"Link lengths with the smallest {self._outcome.goal.words.removeprefix('largest ')}"

    @property
    def lengths(self) -> tuple[float, float]:
        """Crank and rod length [m]."""
        return self._outcome.lengths

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Labels of the active bounds and constraints."""
        return self._outcome.bounds

    @property
    def gain(self) -> float:
        """Relative reduction of the objective [1]: simulated again, median.

        By default of the RMS error of the transmission angle, over a settled revolution or over the
        configured window.
        """
        return float(self._outcome.gain["reduction"])

    @property
    def interval(self) -> tuple[float, float]:
        """5 % and 95 % quantile of `gain` over pairs of runs from slightly different starts [1].

        An interval that contains 0 means no significant gain.
        """
        return tuple(self._outcome.gain[["reduction_low", "reduction_high"]].astype(float))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings and limitations of the lengths found."""
        return remarks(self._outcome)

    @property
    def figures(self) -> Mapping[str, str]:
        """Names for `plot`, with the titles of the figures; the first is the default."""
        return {name: FIGURES[name].title for name in ("valley", "resimulation")}

    def _draw(self, name: str):
        frames = {f"optimise_{table}": frame for table, frame in self.tables.items()}
        return FIGURES.draw(name, frames, self._outcome.scenario)

    def _rows(self) -> list[Row]:
        found, gain = self._outcome, self._outcome.gain
        (old_crank, old_rod), (crank, rod) = found.original, found.lengths
        before, after = (row for _, row in found.pair("optimise_worth", "simulated").iterrows())
        words = f"RMS {found.goal.words}" if found.is_of_angle else found.goal.words
        size, unit = f"{words} over {found.stretch_label(found.stretch)}", found.goal.unit
        shares = {
            "": "reduction",
            ", 5 % of pairs of runs": "reduction_low",
            ", 95 % of pairs of runs": "reduction_high",
        }
        return [
            ("crank length", 1e3 * crank, "mm"),
            ("change of the crank length", 1e3 * (crank - old_crank), "mm"),
            ("rod length", 1e3 * rod, "mm"),
            ("change of the rod length", 1e3 * (rod - old_rod), "mm"),
            ("active bounds", joined(found.bounds) or "none", ""),
            *(
                (f"{size}, {when}", value, unit)
                for when, value in zip(("before", "after"), found.sizes, strict=True)
            ),
            *(
                (f"reduction{which}", 100.0 * float(gain[share]), "%")
                for which, share in shares.items()
            ),
            *(
                (
                    f"change of the {format_name(name)}",
                    1e3 * float(after[name] - before[name]),
                    "mm",
                )
                for name in ("stroke", "outer_dead_centre", "inner_dead_centre")
            ),
            ("largest force in a pin, before", float(found.peak_force[0]), "N"),
            ("largest force in a pin, after", float(found.peak_force[1]), "N"),
        ]


def optimise(
    mechanism: Mechanism,
    options: Simulate | None = None,
    *,
    networks: bool = False,
    surrogate: Surrogate | None = None,
    **keys: Any,
) -> Optimum:
    """Optimise the link lengths for the smallest error of the transmission angle, or for another
    objective.

    The mechanism is simulated. A genetic and a local optimiser search crank and rod length: with
    frozen joint motion, or, for a force or torque, on a grid of simulations with and without
    clearance. The optima are simulated again from several slightly perturbed starts. The result has
    the smallest objective over a settled revolution (for the transmission angle: or over the
    configured window). Requires pymoo: the extra ``learn``.

    Parameters
    ----------
    mechanism : Mechanism
        With the original lengths, which define the desired transmission angle.
    options : Simulate, optional
        Drive and sampling; the revolution ``ensemble.settled_revolution`` (4 by default) is used.
    networks : bool
        Whether to search also with networks trained on the motion, as in the paper (requires
        PyTorch: the extra ``learn``). The best re-simulated lengths of all searches are returned.
    surrogate : Surrogate, optional
        Training of the networks.
    **keys
        Keys of `jointgap.Optimise`: ``objective`` (``"transmission_angle"``,
        ``"largest_pin_force"`` or ``"torque_ripple"``), ``boxes`` (bounds of the lengths by name,
        the first for the result; default: 5 % around the mechanism's lengths), ``constraints``
        (stroke, dead centres, space, largest pin force), ``ratio_limit``, ``window``, ``genetic``,
        ``ensemble``. Keys of `jointgap.Simulate` as `jointgap.simulate` takes them, such as
        ``speed``, override `options`.

    Returns
    -------
    Optimum

    Raises
    ------
    InputError
        Unknown key, invalid value, no loose joint, no lengths that satisfy the constraints, or a
        missing package.
    SimulationError
        The simulation failed.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> box = {"crank_length": ("147 mm", "153 mm"), "rod_length": ("555 mm", "564 mm")}
    >>> best = jg.optimise(mechanism, speed="600 rpm", boxes={"near": box})
    >>> best.plot("valley").save("valley.png")
    """
    from jointgap.lengths.optimise import optimise as optimised

    driven = {key: keys.pop(key) for key in Simulate.model_fields if key in keys}
    simulated_so = simulate_options(options, driven)
    sections = {
        "mechanism": checked_mechanism(mechanism),
        "simulate": simulated_so,
        "optimise": Optimise(**keys),
    }
    if networks or surrogate:
        sections |= {"surrogate": surrogate or Surrogate(), "networks": True}
    scenario = Scenario(**sections)
    applied = scenario.mechanism.applied()
    if not applied.loose:
        raise InputError(
            "optimise: all joints are ideal, so the optimum cannot be checked with clearance; make"
            " a joint loose"
        )
    motion = simulate(mechanism, scenario.simulate)
    trained = {}
    if "surrogate" in sections:
        from jointgap.networks.train import train  # slow import: PyTorch

        for name in outputs(applied.loose):
            if "_" not in name:  # the search requires the clearance vectors only
                trained[name] = train(motion.samples, name, scenario.surrogate)
    fits = (
        {"networks": {name: own[0].network.values_and_slopes for name, own in trained.items()}}
        if trained
        else {}
    )
    # without networks all samples are used: only the two ends are training points
    points = scenario.surrogate.training_points if trained else 2
    found = optimised(applied, scenario.simulate, scenario.optimise, points, motion.samples, fits)
    tables = {
        table.name: getattr(found, table.name.removeprefix("optimise_")) for table in _WRITTEN
    }
    errors = [one.errors() for own in trained.values() for one in own]
    errors = pd.concat(errors) if errors else pd.DataFrame(columns=schema.FIT_ERRORS.names)
    result = outcome(tables | {"fit_errors": errors}, scenario)
    if result.status == "infeasible":
        advice = remarks(result)[0].rstrip(".")
        raise InputError(f"optimise: {headline(result)}; {advice[0].lower()}{advice[1:]}")
    shown = {
        table.name.removeprefix("optimise_"): with_units(table, tables[table.name])
        for table in _WRITTEN
    }
    return Optimum(applied.with_lengths(*result.lengths), motion, shown, result)


@dataclass(frozen=True)
class Finding:
    """One parameter of an effect named by a verdict.

    Attributes
    ----------
    effect : str
        Label, such as ``Coulomb friction of the slider``.
    name, site : str
        In configuration files.
    parameter : str
        Of the effect.
    size : float or str
        Value in `unit`, or an identified formula.
    unit : str
        SI unit, ``"1"`` for pure numbers.
    sd : float or None
        Standard error; None if unknown.
    interval : tuple of float or None, or None
        90 % interval; an open end is None; None if unknown.
    """

    effect: str
    name: str
    site: str
    parameter: str
    size: float | str
    unit: str
    sd: float | None
    interval: tuple[float | None, float | None] | None


@dataclass(frozen=True, repr=False)
class Verdict(Result):
    """Result of a campaign, made by `jointgap.analyse` or `jointgap.read_verdict`.

    Attributes
    ----------
    folder : Path
        Contains ``verdict.json``, the identified mechanism, and all tables (`jointgap.read_table`).
    document : dict
        Content of ``verdict.json``.
    """

    folder: Path
    document: dict[str, Any]

    @property
    def _HEADLINE(self) -> str:
        return f"Campaign {self.document['campaign']}: {self.sentence}"

    @property
    def kind(self) -> str:
        """``named``, ``named_with_remaining_misfit``, ``ambiguous``, ``unexplained``,
        ``no_disagreement`` or ``parameters_only``.
        """
        return self.document["verdict"]

    @property
    def sentence(self) -> str:
        return say.answer(self.document)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """The named effects, one entry per parameter."""
        found = []
        for effect in self.document["effects"]:
            words, name, site = say.format_effect(effect), effect["name"], effect["site"]
            for parameter, own in effect["parameters"].items():
                size, interval = (
                    (own["value"], say.estimate_unit(effect, parameter), own.get("sd")),
                    own.get("interval_90"),
                )
                found.append(
                    Finding(words, name, site, parameter, *size, interval and tuple(interval))
                )
        return tuple(found)

    @property
    def effect(self) -> str | None:
        """Label of the first named effect (all: `findings`), or None."""
        return self.findings[0].effect if self.findings else None

    @property
    def size(self) -> float | str | None:
        """The first parameter of `effect`, in `unit`."""
        return self.findings[0].size if self.findings else None

    @property
    def unit(self) -> str | None:
        """SI unit of `size`."""
        return self.findings[0].unit if self.findings else None

    @property
    def interval(self) -> tuple[float | None, float | None] | None:
        """90 % interval of `size`."""
        return self.findings[0].interval if self.findings else None

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism with the named effects, to simulate or optimise."""
        return load.load_mechanism(self.folder / MECHANISM)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings about the data."""
        return tuple(ResultsFolder(self.folder).read("remarks")["remark"])

    @property
    def figures(self) -> Mapping[str, str]:
        """Names for `plot`, with the titles of the figures; the first is the default."""
        return {name: spec.title for name, spec in CAMPAIGN_FIGURES.items()}

    def _draw(self, name: str):
        from jointgap.campaign.page import figure_tables

        frames = figure_tables(ResultsFolder(self.folder), CAMPAIGN_FIGURES[name].tables)
        return CAMPAIGN_FIGURES.draw(name, frames, self.document)

    def _rows(self) -> list[Row]:
        rows: list[Row] = [("verdict", format_name(self.kind), "")]
        rows += [
            (name, say.format_estimate(*row), "")
            for name, *row in say.parameter_rows(self.document["effects"])
        ]
        rows += [
            (f"explanation {place}", joined(map(say.format_effect, effects)), "")
            for place, effects in enumerate(self.document["equivalent"], 1)
        ]
        words = {"identify": "data used for fitting", "confirm": "held-out data"}
        proposed = (
            self.document["effects"] or self.document["best_known"] or self.document["equivalent"]
        )
        for role, gap in self.document["gap"].items():
            for when, value in gap.items():
                if value is not None and (proposed or when == "before"):
                    rows.append(
                        (f"gap on {words[role]} {when} (1: noise alone)", rounded_gap(value), "")
                    )
        return rows


def analyse(
    campaign: Path | str, folder: Path | str | None = None, anyway: bool = False
) -> Verdict:
    """Compare the measured runs of a campaign with its model, and identify the effect that the
    model lacks.

    Parameters
    ----------
    campaign : Path or str
        A campaign file (keys: config/README.md), or a folder with one.
    folder : Path or str, optional
        Output folder of all tables, the identified mechanism and ``verdict.json``; by default
        ``results/campaigns/{name of the campaign}``. Conclusions of an earlier analysis there are
        removed.
    anyway : bool
        Whether to continue if channels contradict each other, for example because two columns are
        swapped.

    Returns
    -------
    Verdict

    Raises
    ------
    InputError
        The campaign or its data are invalid, channels contradict each other, or the folder is not
        writable.
    SimulationError
        The model could not be simulated.

    Examples
    --------
    >>> import jointgap as jg
    >>> verdict = jg.analyse("config/campaigns/demonstration.yaml")
    >>> verdict.effect, verdict.unit
    ('Coulomb friction of the slider', 'N')
    >>> verdict.plot("gaps").save("gaps.png")
    """
    from jointgap.campaign.analyse import analyse as run

    campaign = campaign_file(campaign)
    folder = Path(folder or Path("results/campaigns") / load.load_campaign(campaign).name)
    return Verdict(folder, run(campaign, folder, anyway=anyway))


def read_verdict(folder: Path | str) -> Verdict:
    """Read the verdict of an earlier analysis, by `analyse` or by the workflow.

    Parameters
    ----------
    folder : Path or str
        Results folder of a campaign, such as ``results/campaigns/demonstration``.

    Returns
    -------
    Verdict

    Raises
    ------
    InputError
        The folder has no verdict.

    Examples
    --------
    >>> import jointgap as jg
    >>> jg.read_verdict("results/campaigns/demonstration").kind
    'named'
    """
    return Verdict(Path(folder), verdict_json.read(Path(folder) / VERDICT))


def campaign_file(path: Path | str) -> Path:
    """The campaign file at `path`, or the only one in a folder.

    Raises
    ------
    InputError
        The folder contains none, or several.
    """
    path = Path(path)
    if not path.is_dir():
        return path
    files = sorted(
        file
        for file in path.iterdir()
        if file.suffix in (".yaml", ".yml", ".json") and "channels" in read_yaml(file)
    )
    if len(files) != 1:
        names = ", ".join(file.name for file in files)
        what = (
            f"contains {f'several campaign files ({names})' if files else 'no campaign file'}; give"
            " the path of one"
        )
        raise InputError(f"{path}: {what}")
    return files[0]


@dataclass(frozen=True, repr=False)
class Preflight(Result):
    """Identifiability of a planned campaign, made by `jointgap.preflight`.

    Attributes
    ----------
    campaign : str
        Its name.
    detectable : pandas.DataFrame
        Smallest detectable size of every effect, with these runs and channels.
    confusability : pandas.DataFrame
        Similarity of the effects.
    advice : pandas.DataFrame or None
        Most useful further speed or channel; None if not requested.
    """

    campaign: str
    detectable: pd.DataFrame
    confusability: pd.DataFrame
    advice: pd.DataFrame | None = None

    @property
    def _HEADLINE(self) -> str:
        return f"Identifiability of the campaign {self.campaign}"

    @property
    def remarks(self) -> tuple[str, ...]:
        """Assumed noise, where the campaign states none."""
        return tuple(
            f"assumed noise: {say.names_to_labels(text)}" for text in plan.assumed(self.detectable)
        )

    @property
    def merged(self) -> list[list[str]]:
        """Groups of effects that these runs and channels cannot distinguish."""
        return plan.confusable_groups(self.confusability)

    @property
    def text(self) -> str:
        """The report of `jointgap preflight`."""
        return plan.preflight_summary(self.detectable, self.confusability, self.advice)

    @property
    def figures(self) -> Mapping[str, str]:
        """Names for `plot`, with the titles of the figures; the first is the default."""
        return {name: CAMPAIGN_FIGURES[name].title for name in ("detectable", "confusability")}

    def _draw(self, name: str):
        content = {"preflight": {"merged": self.merged}}
        return CAMPAIGN_FIGURES.draw(
            name, {each: getattr(self, each) for each in self.figures}, content
        )

    def _rows(self) -> list[Row]:
        shown = self.detectable[self.detectable["detectable"]].itertuples()
        sizes = ((row, "shows " if row.falls else "shows from ") for row in shown)
        rows: list[Row] = [
            (say.format_label(row.label), words + say.format_detectable(row), "")
            for row, words in sizes
        ]
        rows += [
            (say.format_label(label), "not detectable", "")
            for label in plan.undetectable(self.detectable)
        ]
        rows += [
            ("cannot be distinguished", joined(map(say.format_label, group)), "")
            for group in self.merged
        ]
        return rows


def preflight(campaign: Path | str, advice: bool = True) -> Preflight:
    """Analyse the identifiability of a planned campaign.

    The result contains the smallest detectable size of every effect, the effects that cannot be
    distinguished, and the most useful further speed or channel. Files of runs may be missing;
    existing ones give the number of samples. Nothing is written.

    Parameters
    ----------
    campaign : Path or str
        A campaign file, or a folder with one.
    advice : bool
        Whether to try further speeds and channels, which takes several times as long.

    Returns
    -------
    Preflight

    Raises
    ------
    InputError
        The campaign is invalid.
    SimulationError
        The model could not be simulated.

    Examples
    --------
    >>> import jointgap as jg
    >>> plan = jg.preflight("config/campaigns/demonstration.yaml", advice=False)
    >>> plan.plot("detectable").save("detectable.png")
    """
    planned = load.load_campaign(campaign_file(campaign))
    frames = plan.preflight_tables(planned, FALSE_ALARM_RATE, advice=advice)
    return Preflight(
        planned.name, **{name: with_units(schema.TABLES[name], own) for name, own in frames.items()}
    )
