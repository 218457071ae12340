"""`simulate`: one motion of a mechanism, that draws itself."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from jointgap import tables
from jointgap.api.result import Result, Row
from jointgap.config import Mechanism, Optimise, Scenario, Simulate
from jointgap.config.change import change
from jointgap.dynamics import simulate as simulated
from jointgap.dynamics.model.mechanism_warnings import sentences
from jointgap.ensembles.cycle_statistics import contacts, time_shares
from jointgap.errors import InputError
from jointgap.figures.catalogue import SPECS
from jointgap.joints import FROM_FRAME
from jointgap.report.plain_words import in_words

_TABLES = {"trajectory", "events", "kinematics"}
_FIGURES = {spec.function.partition(":")[2]: name for name, spec in SPECS.items() if set(spec.tables) <= _TABLES}
_OF_LOOSE_JOINTS = ("orbits", "contact_forces", "impacts", "animation")


@dataclass(frozen=True, repr=False)
class Motion(Result):
    """One simulated motion, made by `jointgap.simulate`.

    Attributes
    ----------
    mechanism : Mechanism
        What moved.
    options : Simulate
        How it was driven and sampled.
    samples : pandas.DataFrame
        One row a sample, in SI units; ``samples.attrs["units"]`` has them by column, `unit` one of them. NaN where a
        quantity is undefined.
    events : pandas.DataFrame
        One row a beginning or end of contact; units as of `samples`.
    steps : int
        Integration steps taken, rejected ones included.
    remarks : tuple of str
        Where contacts do otherwise than one may think.
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
            Such as ``"rad"``; ``"1"`` for pure numbers, empty for text.

        Raises
        ------
        InputError
            No such column.

        Examples
        --------
        >>> run.unit("crank_angle")
        'rad'
        """
        units = self.events.attrs["units"] | self.samples.attrs["units"]
        return tables.unit_in(units, column)

    @property
    def figures(self) -> Mapping[str, str]:
        """Names that `plot` takes, with the titles of the figures; the first one is drawn without a name."""
        loose = self.mechanism.applied().loose
        names = sorted(_FIGURES, key=lambda name: name != ("orbits" if loose else "drive_and_guide"))
        titles = {name: SPECS[_FIGURES[name]].title.partition(" (")[0] for name in names}  # the paper's numbers apart
        return {name: title for name, title in titles.items() if loose or name not in _OF_LOOSE_JOINTS}

    def _draw(self, name: str):
        from jointgap.figures.draw_figures import draw
        from jointgap.kinematics import linkage_frames, motion_table

        frames = {"trajectory": self.samples, "events": self.events}
        if "kinematics" in SPECS[_FIGURES[name]].tables:
            frames["kinematics"] = motion_table(
                linkage_frames(self._scenario.mechanism, self._first), self._first["crank_angle"].to_numpy()
            )
        return draw(_FIGURES[name], frames, self._scenario)

    @cached_property
    def _first(self) -> pd.DataFrame:
        return self.samples.iloc[: self.options.samples_per_revolution + 1]

    @cached_property
    def _scenario(self) -> Scenario:
        """What figures take for a scenario: its settled revolution is the last one."""
        scenario = Scenario(mechanism=self.mechanism.applied(), simulate=self.options)
        last = Optimise(ensemble={"settled_revolution": self.options.revolutions})
        return scenario.model_copy(update={"optimise": last})

    def _rows(self) -> list[Row]:
        mechanism, revolutions = self.mechanism.applied(), self.options.revolutions
        time = self.samples["time"].to_numpy()
        last = self.samples.iloc[(revolutions - 1) * self.options.samples_per_revolution :]
        rows: list[Row] = [
            ("crank length", 1e3 * mechanism.crank.length, "mm"),
            ("rod length", 1e3 * mechanism.rod.length, "mm"),
            ("speed of the crank", 60.0 * revolutions / (time[-1] - time[0]), "rpm"),
            ("revolutions", revolutions, ""),
        ]
        for joint in FROM_FRAME:
            words = in_words(joint)
            if joint in mechanism.loose:
                own = contacts(self.events, joint)
                rows += [
                    (f"{words}: radial clearance", 1e3 * mechanism.clearance(joint), "mm"),
                    (f"{words}: impacts (contacts that begin)", len(own), ""),
                    (f"{words}: time in contact", 100 * (1 - time_shares(own, time[0], time[-1])["flight"]), "%"),
                ]
            peaks = self.events.loc[self.events["joint"] == joint, "peak_force"].dropna()
            largest = max([_largest_force(self.samples, joint), *peaks])
            rows.append((f"{words}: largest force, the start included", largest, "N"))
            rows.append((f"{words}: largest force in the last revolution", _largest_force(last, joint), "N"))
        return rows


def _largest_force(samples: pd.DataFrame, joint: str) -> float:
    return float(np.hypot(samples[f"{joint}_force_x"], samples[f"{joint}_force_y"]).max())


def simulate(mechanism: Mechanism, options: Simulate | None = None, *, perturbation=None, **keys: Any) -> Motion:
    """Simulate a slider-crank, any of its joints loose.

    It starts with coincident joint centres and the velocities of the mechanism without clearance.

    Parameters
    ----------
    mechanism : Mechanism
        From `jointgap.load_mechanism`, or made in Python.
    options : Simulate, optional
        How it is driven and sampled; defaults where absent.
    perturbation : (4,) or (6,) array_like, optional
        Clearance vectors at the start instead of zero: r2 x, r2 y, r3 x, r3 y, r1 x, r1 y [m].
    **keys
        Keys of `jointgap.Simulate`, which go over `options`: ``speed``, ``revolutions``, ``drive``, ``start_angle``,
        ``samples_per_revolution``, ``tolerance``. With units as text, ``"600 rpm"``; plain numbers are in SI.

    Returns
    -------
    Motion

    Raises
    ------
    InputError
        An unknown key or an impossible value, named with what to do.
    SimulationError
        The integration cannot go on; the message holds time, crank angle and state.

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
        tables.with_units(table, frame)
        for table, frame in ((tables.TRAJECTORY, run.samples), (tables.EVENTS, run.events))
    )
    return Motion(mechanism, options, samples, events, run.steps, sentences(mechanism))


def checked_mechanism(mechanism: Any) -> Mechanism:
    """The `mechanism`, if it is one."""
    if not isinstance(mechanism, Mechanism):
        raise InputError(f"mechanism: is {_kind(mechanism)}, no Mechanism; load one with load_mechanism(path)")
    return mechanism


def simulate_options(options: Any, keys: Mapping[str, Any]) -> Simulate:
    """The `options`, a `Simulate` or None, with other values of some `keys`."""
    if options is None:
        return Simulate(**keys)
    if not isinstance(options, Simulate):
        raise InputError(
            f"options: is {_kind(options)}, no Simulate; write Simulate(speed='600 rpm') or speed='600 rpm'"
        )
    return change(options, keys) if keys else options


def _kind(value: Any) -> str:
    return "text" if isinstance(value, str) else f"of type {type(value).__name__}"
