"""`jointgap.simulate` and its result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from jointgap.app.derivatives import derivatives_of
from jointgap.app.result import Result
from jointgap.config import Mechanism, Optimise, Scenario, Simulate
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.variations import change
from jointgap.core import parquet, schema
from jointgap.core.errors import InputError
from jointgap.core.facts import Fact
from jointgap.core.joints import FROM_FRAME
from jointgap.core.parquet import with_units
from jointgap.core.words import format_name
from jointgap.designs.statistics import contacts, time_shares
from jointgap.motion.mechanism_warnings import sentences
from jointgap.motion.slider_crank import simulate as simulated
from jointgap.scenario.figures import FIGURES

if TYPE_CHECKING:
    from jointgap.app.linkage_motion import LinkageMotion
    from jointgap.core.plot import Drawing

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
        Unexpected properties of the contacts and derivatives.
    derivatives : mapping of str to pandas.DataFrame
        By key of `simulate`'s ``derivatives``: rows as of `samples`, at the same crank angles, and
        its columns of numbers; units of these tables in their ``attrs["units"]``.
    """

    mechanism: Mechanism
    options: Simulate
    samples: pd.DataFrame
    events: pd.DataFrame
    steps: int
    remarks: tuple[str, ...] = ()
    derivatives: Mapping[str, pd.DataFrame] = field(default_factory=dict)

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
        default = "orbits" if loose else "drive_and_guide"
        names = sorted(_MOTION_FIGURES, key=lambda name: name != default)
        return {  # titles without the paper's figure numbers
            name: FIGURES[_MOTION_FIGURES[name]].title.partition(" (")[0]
            for name in names
            if loose or name not in _OF_LOOSE_JOINTS
        }

    def _draw(self, name: str) -> "Drawing":
        from jointgap.scenario.kinematics import linkage_frames, motion_table

        mechanism, figure = self.mechanism.applied(), _MOTION_FIGURES[name]
        tables = {"trajectory": self.samples, "events": self.events}
        if "kinematics" in FIGURES[figure].tables:
            revolution = self.samples.iloc[: self.options.samples_per_revolution + 1]
            tables["kinematics"] = motion_table(
                linkage_frames(mechanism, revolution), revolution["crank_angle"].to_numpy()
            )
        # the figures expect a scenario: the last revolution is the settled one
        settled = Optimise(ensemble={"settled_revolution": self.options.revolutions})
        scenario = Scenario(mechanism=mechanism, simulate=self.options)
        return FIGURES.draw(figure, tables, scenario.model_copy(update={"optimise": settled}))

    @property
    def facts(self) -> list[Fact]:
        """Lengths, speed, contacts and largest forces."""
        mechanism, revolutions = self.mechanism.applied(), self.options.revolutions
        time = self.samples["time"].to_numpy()
        last = (revolutions - 1) * self.options.samples_per_revolution
        speed = 60.0 * revolutions / (time[-1] - time[0])
        facts = [
            Fact("crank_length", 1e3 * mechanism.crank.length, "mm"),
            Fact("rod_length", 1e3 * mechanism.rod.length, "mm"),
            Fact("crank_speed", speed, "rpm", "speed of the crank"),
            Fact("revolutions", revolutions),
        ]

        def add(joint: str, key: str, value: float, unit: str, label: str) -> None:
            facts.append(Fact(f"{joint}/{key}", value, unit, f"{format_name(joint)}: {label}"))

        for joint in FROM_FRAME:
            if joint in mechanism.loose:
                joint_contacts = contacts(self.events, joint)
                shares = time_shares(joint_contacts, time[0], time[-1])
                add(joint, "clearance", 1e3 * mechanism.clearance(joint), "mm", "radial clearance")
                label = "impacts (beginnings of contact)"
                add(joint, "impacts", len(joint_contacts), "", label)
                add(joint, "time_in_contact", 100 * (1 - shares["flight"]), "%", "time in contact")
            force = np.hypot(self.samples[f"{joint}_force_x"], self.samples[f"{joint}_force_y"])
            peaks = self.events.loc[self.events["joint"] == joint, "peak_force"].dropna()
            largest = float(max([force.max(), *peaks]))
            add(joint, "largest_force", largest, "N", "largest force, including the start")
            settled = float(force[last:].max())
            label = "largest force in the last revolution"
            add(joint, "largest_force_last_revolution", settled, "N", label)
        return facts


def simulate(
    mechanism: Mechanism | LinkageFile,
    options: Simulate | None = None,
    *,
    perturbation=None,
    derivatives: Sequence[str] = (),
    **keys: Any,
) -> "Motion | LinkageMotion":
    """Simulate a slider-crank or another planar linkage with loose or ideal joints.

    The motion starts with coincident joint centres and the velocities of the mechanism without
    clearance.

    Parameters
    ----------
    mechanism : Mechanism or LinkageFile
        From `jointgap.load_mechanism`, or created in Python.
    options : Simulate, optional
        Drive and sampling.
    perturbation : (4,) or (6,) array_like, optional
        Of a slider-crank: initial clearance vectors r2 x, r2 y, r3 x, r3 y, r1 x, r1 y [m]; zero by
        default.
    derivatives : sequence of str
        Numbers of the mechanism or of the drive, by the keys that `jointgap.change` takes, by which
        the samples are differentiated, through impacts and separations: ``"rod.length"``,
        ``"joints.crank_pin.clearance"``, ``"speed"``. The result has a table for each.
    **keys
        Keys of `jointgap.Simulate`, which override `options`: ``speed``, ``revolutions``,
        ``drive``, ``start_angle``, ``samples_per_revolution``, ``tolerance``. Text with units, such
        as ``"600 rpm"``, or SI numbers.

    Returns
    -------
    Motion or LinkageMotion

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
    >>> run = jg.simulate(mechanism, speed="600 rpm", derivatives=["slider.mass"])
    >>> run.derivatives["slider.mass"].attrs["units"]["crank_torque"]
    'N*m/kg'
    """
    options = simulate_options(options, keys)
    if isinstance(mechanism, LinkageFile):
        from jointgap.app.linkage_motion import simulated_linkage

        if perturbation is not None:
            raise InputError("perturbation: only of slider-cranks; a linkage starts with zero")
        return simulated_linkage(mechanism, options, derivatives)
    run = simulated(checked_mechanism(mechanism), options, perturbation)
    samples = with_units(schema.TRAJECTORY, run.samples)
    events = with_units(schema.EVENTS, run.events)
    tables, remarks = derivatives_of(mechanism, options, derivatives, perturbation)
    remarks = (*sentences(mechanism, options.highest_speed), *remarks)
    return Motion(mechanism, options, samples, events, run.steps, remarks, tables)


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
    wrong = "text" if isinstance(value, str) else f"of type {type(value).__name__}"
    raise InputError(f"{name}: is {wrong}, not a {kind.__name__}; {fix}")
