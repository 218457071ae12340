"""What identification needs of a model: candidates, parameters, families of laws."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """A number that a fit varies.

    Attributes
    ----------
    name : str
        Such as ``slider_mass`` or ``force_N``.
    nominal : float
        What it is where nothing says otherwise; of an effect's size: 0, at which the effect is
        absent.
    low, high : float
        Hard bounds, flat inside; infinite for none.
    step : float
        A typical change, > 0: about what noise could hide. Differences are taken over steps of this
        order.
    unit : str
        SI unit, ``'1'`` for pure numbers.
    run : str, optional
        The one run that it belongs to, such as a run's speed; None where all runs share it.
    whole : bool
        Counts by the whole number next to it: chi2 is flat but for its steps, so that draws about a
        fit hold it.
    tried : tuple of float
        The values that a search tries, where it is not free to choose.
    """

    name: str
    nominal: float
    low: float = -math.inf
    high: float = math.inf
    step: float = 1.0
    unit: str = "1"
    run: str | None = None
    whole: bool = False
    tried: tuple[float, ...] = ()

    @property
    def key(self) -> str:
        """``name``, or ``name@run`` of a run's own."""
        return self.name if self.run is None else f"{self.name}@{self.run}"


@dataclass(frozen=True)
class Candidate:
    """An effect that could be missing, as a fit sees it.

    Attributes
    ----------
    name, site : str
        As a verdict states them.
    coordinates : tuple of Parameter
        What a fit varies; those with a run belong to that run alone, such as a phase. Near the
        effect's absence the motion should depend on the `amplitudes` about linearly, so an
        amplitude with a phase has two coordinates, its cosine and sine parts.
    amplitudes : tuple of str
        Keys of the coordinates that are 0 where the effect is absent; the rest are shape parameters
        (an exponent, a frequency).
    initial_guesses : tuple of mappings
        Values of all shape parameters to start from; one empty mapping where there are none. Where
        the motion is not about linear in an amplitude from 0 on, such as the clearance of a joint
        that was ideal, guesses hold the amplitude too, if it is the only one: finite amplitudes are
        then simulated, and fits start there. So do those of an amplitude whose value something else
        has told.
    parameters : function
        From values of the coordinates to the parameters that a verdict states. The coordinates
        themselves by default.
    replaces : mapping of str to str
        Nuisances that are this effect's own parameter, and the amplitude that stands for each: a
        nuisance is held at nominal where the effect is fitted, and the amplitude is what it is
        beyond that.
    sensor : bool
        Whether it is a fault of a sensor: it acts on what is read, not on the motion.
    has_site : bool
        Whether the effect could be at another site too, so that its label needs the site.
    carrier : str
        Label of a steady effect that this one is, but for swinging: in time at its shape parameter
        ``frequency_Hz``, or in step with the crank at ``order``, cycles per revolution. Its
        amplitudes are the parts with the cosine and with the sine. Frequencies or orders to start
        from are then searched in the residual.
    is_perturbation : bool
        Whether its amplitude is the change of a known quantity, such as a clearance, down to the
        lower bound where nothing is left of that: small changes then say little of large ones. Both
        bounds are finite.
    search_range : tuple of two floats
        Of an effect with one amplitude on which the motion depends so roughly that a fit converges
        from near by alone: between which values it is searched, evenly in its logarithm; () of
        others. Of the perturbation of a known quantity evenly in the logarithm of what is left of
        that.
    families : tuple of LawFamily
        Laws of which the effect is one shape.
    frees : str
        Label of an effect whose size is free in a linear regression with this one: a high-pass
        removes the mean of what other effects change too.
    formula : str
        Of a law that the user states: the formula, whose parameters are the coordinates.
    """

    name: str
    site: str
    coordinates: tuple[Parameter, ...]
    amplitudes: tuple[str, ...]
    initial_guesses: tuple[Mapping[str, float], ...] = ({},)
    parameters: Callable[[Mapping[str, float]], dict[str, float]] = field(
        default=dict, compare=False
    )
    replaces: Mapping[str, str] = field(default_factory=dict)
    sensor: bool = False
    has_site: bool = False
    carrier: str = ""
    is_perturbation: bool = False
    search_range: tuple[float, ...] = ()
    families: tuple["LawFamily", ...] = field(default=(), compare=False)
    frees: str = ""
    formula: str = ""

    def __post_init__(self) -> None:
        """Refuse finite amplitudes that nothing could be derived from."""
        finite = [*self.search_range]
        finite += [
            guess[key] for guess in self.initial_guesses for key in self.amplitudes if key in guess
        ]
        least = min(self.search_range, default=np.inf)
        if finite and (
            len(self.amplitudes) > 1 or 0.0 in finite or least <= self.vanishing_amplitude
        ):
            raise ValueError(
                f"{self.name}: initial_guesses and search_range hold values of a single amplitude,"
                f" none of them 0, those of a search_range above {self.vanishing_amplitude:g}; got"
                f" {finite}"
            )
        if self.is_perturbation and not all(
            np.isfinite((p.low, p.high)).all()
            for p in self.coordinates
            if p.name in self.amplitudes
        ):
            raise ValueError(
                f"{self.name}: the perturbation of a known quantity needs finite bounds"
            )

    @property
    def label(self) -> str:
        """``name``, or ``name:site`` where there is a choice; unique among a model's candidates."""
        return f"{self.name}:{self.site}" if self.has_site else self.name

    @property
    def exclusion_group(self) -> str:
        """What at most one effect of a hypothesis can have: one sensor errs by one fault of a
        family, so that is the law's label; of other effects it is their own."""
        return self.families[0].law.label if self.sensor and self.families else self.label

    @property
    def claims(self) -> frozenset[str]:
        """What no two effects of a hypothesis share: their `exclusion_group` and the nuisances that
        they replace."""
        return frozenset((self.exclusion_group, *self.replaces))

    @property
    def is_nonsmooth(self) -> bool:
        """Whether samples depend so roughly on it that no slope leads to it: the search alone does.
        Small changes of what is there are told by slopes too."""
        return bool(self.search_range) and not self.is_perturbation

    @property
    def vanishing_amplitude(self) -> float:
        """Where the first amplitude [SI] leaves nothing of what it changes: at 0, but for a
        perturbation."""
        if not self.is_perturbation:
            return 0.0
        return next(p.low for p in self.coordinates if p.key == self.amplitudes[0])

    def coordinates_in(self, runs: Sequence[str]) -> tuple[Parameter, ...]:
        """The coordinates that matter to `runs`."""
        return tuple(p for p in self.coordinates if p.run in (None, *runs))


@dataclass(frozen=True)
class LawFamily:
    """A law of which effects of the list are single shapes; which shapes data allow is asked once
    one of them is found.

    Attributes
    ----------
    law : Candidate
        The law; one of its coordinates, no amplitude, is the shape. No candidate of the model:
        never searched.
    shape : str
        Key of that coordinate.
    own : float
        [1] The shape at which the law is the effect that has this family.
    in_use : tuple of float
        [1] Shapes of laws in use, listed or not: the effect is named alone where all but its own
        are excluded.
    values : function
        From values of the effect's coordinates to those of the law that do the same; the shape is
        left out.
    inactive_at_default : int
        How many other coordinates of the law do nothing at the shape `own`, such as the place of a
        variation that is none. No fit begins there, since none would move them.
    """

    law: Candidate
    shape: str
    own: float
    in_use: tuple[float, ...]
    values: Callable[[Mapping[str, float]], dict[str, float]]
    inactive_at_default: int = 0


@dataclass(frozen=True)
class Series:
    """One channel of one run as it is compared: samples over time, or statistics over the crank
    angle.

    Attributes
    ----------
    run, channel, unit : str
        SI unit.
    value : (n,) array
        As measured; NaN where nothing was (and everywhere in a preflight).
    time, angle : (n,) array
        Of the samples [s], [rad]; NaN where not known. `angle` runs on over cycles; without a crank
        it is any phase.
    held_out : (n,) bool array
        Samples that take no part in fitting or choosing.
    stated_noise : (n,) array or None
        Standard deviation that the user states (or that follows from the number of cycles, for
        statistics) [unit].
    resolution : float
        Step in which the sensor reads [unit], whose rounding is a noise of its own; 0 where it is
        not known.
    jitter : float or None
        Standard deviation of the time stamps [s], which makes a noise that grows with the channel's
        rate; None to estimate it.
    statistic : bool
        Whether values are statistics over cycles: their noise is independent and `stated_noise` is
        theirs.
    """

    run: str
    channel: str
    unit: str
    value: np.ndarray
    time: np.ndarray
    angle: np.ndarray
    held_out: np.ndarray
    stated_noise: np.ndarray | None = None
    statistic: bool = False
    resolution: float = 0.0
    jitter: float | None = 0.0

    @property
    def rounding(self) -> float:
        """Standard deviation of the rounding to the sensor's steps [unit]."""
        return self.resolution / math.sqrt(12.0)

    @property
    def key(self) -> tuple[str, str]:
        """Run and channel."""
        return self.run, self.channel

    def variation(self, values: np.ndarray) -> float:
        """Standard deviation [unit] of `values` (n,); of an angle that runs on, no more than over a
        turn, however long the record.
        """
        varies = float(np.nanstd(values))
        return min(varies, 2.0 * math.pi / math.sqrt(12.0)) if self.unit == "rad" else varies


Effects = Sequence[tuple[Candidate, Mapping[str, float]]]
"""Effects that act, each with the values of its coordinates by name."""


class Model(Protocol):
    """A simulation, and the measured data in the form in which it is compared with them."""

    name: str  # what it is, for titles
    series: Sequence[Series]  # all that was measured
    nuisances: Sequence[
        Parameter
    ]  # parameters known within bounds only; re-fitted with every explanation
    candidates: Sequence[Candidate]  # the effects that could be missing
    numerics: Sequence[
        str
    ]  # others that are as good as the usual ones, in words; `simulate` takes their index from 1

    def simulate(
        self, run: str, values: Mapping[str, float], effects: Effects = (), numerics: int = 0
    ) -> Mapping[str, np.ndarray]:
        """What the sensors of a run would read.

        Parameters
        ----------
        run : str
        values : mapping of str to float
            Every nuisance that the run has, by name (not key).
        effects : sequence
            Sensor faults among them are applied to what is read.
        numerics : int
            0 for the usual numerics, i for `self.numerics[i - 1]`.

        Returns
        -------
        mapping of str to (n,) array
            By channel, at the samples of the run's series.

        Raises
        ------
        InputError, SimulationError
            These values cannot be simulated; the message says why.
        """


@runtime_checkable
class Driven(Protocol):
    """A model whose motion follows something that was measured, and so not exactly known."""

    def drive_errors(self, run: str, values: Mapping[str, float]) -> Mapping[str, np.ndarray]:
        """What the errors of what drives a run change in its readings.

        Parameters
        ----------
        run : str
        values : mapping of str to float
            As of `Model.simulate`.

        Returns
        -------
        mapping of str to (n, k) array
            By channel [unit of the channel]: by one standard deviation of each of k independent
            errors. Channels that are absent do not answer to them.
        """


@dataclass(frozen=True)
class FoundStates:
    """What a filter found of a run in windows."""

    states: Any  # with `slow`, the states of the windows (k, d), and whatever else the model needs
    # minus twice the logarithm of the marginal likelihood of the readings, but for a constant
    deviance: float
    readings: float  # how many there are


class WindowedRun(Protocol):
    """A run with values put in, cut in windows of which each has a state of its own.

    A state is made of pairs: an angle [rad] and its rate, in units of about 1.
    """

    size: int  # d, how many numbers a state has
    turns: float  # how many turns the record has
    channels: Sequence[str]  # that tell states

    def find(
        self,
        measured: Mapping[str, np.ndarray],
        noise: Mapping[str, np.ndarray],
        per_turn: int,
        jump: float,
        turns: float,
    ) -> FoundStates:
        """States of the windows, `per_turn` of them, of the record's first `turns`, by a filter.

        `measured` and `noise`: readings and their standard deviations at the series' samples, NaN
        where there are none; `jump`: standard deviation of a state beyond where the window before
        ends.
        """

    def known(self, slow: np.ndarray, per_turn: int) -> Any:
        """States that are known (k, d), of `per_turn` windows; None where these are not k."""

    def settled(self, states: Any) -> Any:
        """`states` of the motion that began long before the record, so that no window jumps; None
        where that tells nothing of them."""

    def simulate(self, states: Any) -> tuple[Mapping[str, np.ndarray], np.ndarray, Any, np.ndarray]:
        """What is read in windows from their states, by channel, NaN where a window cannot be
        simulated; states at the windows' ends (k, d), a tuple of arrays (k, ...) of what else they
        hand on, and which (k,) were simulated.
        """

    def window_of(self, time: np.ndarray, states: Any) -> np.ndarray:
        """In which window each of the times [s] of a series lies, (n,)."""


@runtime_checkable
class Windowed(Protocol):
    """A model whose state a record does not tell, such as that of pins in their bearings."""

    def windows(
        self, run: str, values: Mapping[str, float], effects: Effects = ()
    ) -> WindowedRun | None:
        """A run in windows, `values` and `effects` as of `Model.simulate`; None where its motion
        has no such state."""


def runs_of(model: Model) -> tuple[str, ...]:
    """The runs of a model, in order."""
    return tuple(dict.fromkeys(series.run for series in model.series))
