"""Interface between a mechanism model and the identification.

A user's own model implements `Model`. It lists its measured data (`Series`), its uncertain
parameters (`Parameter`) and the effects that it might lack (`Candidate`). `Driven`, `Linearised`
and `Windowed` are optional extensions. All quantities are in SI units.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """A scalar that a fit varies.

    Attributes
    ----------
    name : str
        Such as ``slider_mass`` or ``force_N``.
    nominal : float
        Default value. The amplitude of an effect has the default 0: no effect.
    low, high : float
        Hard bounds with a uniform prior between them; infinite for none.
    step : float
        Positive step of finite differences: about the smallest change that exceeds the noise.
    unit : str
        SI unit, ``'1'`` for pure numbers.
    run : str, optional
        Run that the parameter belongs to, such as a run's speed; None if all runs share it.
    integer : bool
        The model rounds the value to the nearest integer. Fits and random draws keep it fixed.
    search_values : tuple of float
        The only values that a search evaluates; empty for a free search.
    """

    name: str
    nominal: float
    low: float = -math.inf
    high: float = math.inf
    step: float = 1.0
    unit: str = "1"
    run: str | None = None
    integer: bool = False
    search_values: tuple[float, ...] = ()

    @property
    def key(self) -> str:
        """``name``, or ``name@run`` for a parameter of one run; unique in a model."""
        return self.name if self.run is None else f"{self.name}@{self.run}"


@dataclass(frozen=True)
class Candidate:
    """An effect that the model might lack.

    Attributes
    ----------
    name, site : str
        Name of the effect and where it acts, for the verdict.
    coordinates : tuple of Parameter
        Parameters of the effect that a fit varies. Close to zero amplitude the response should be
        linear in the amplitudes, so write an amplitude with a phase as a cosine and a sine part.
    amplitudes : tuple of str
        Keys of the coordinates that are 0 without the effect. The other coordinates are shape
        parameters, such as an exponent or a frequency.
    initial_guesses : tuple of mapping
        Start values of all shape parameters; one empty mapping if there are none. A guess may also
        contain the amplitude if the effect has only one. Use this if the response is not linear at
        zero amplitude, such as for the clearance of an ideal joint: fits then start there.
    parameters : callable
        Converts values of the coordinates to the parameters in the verdict; identity by default.
    replaces : mapping of str to str
        Nuisances with the same meaning, each with the amplitude that replaces it. A fit of the
        effect fixes the nuisance at its nominal value; the amplitude is the deviation from it.
    sensor : bool
        True for a sensor fault: it changes the reading and not the motion.
    has_site : bool
        The effect has candidates at several sites, so that the label contains the site.
    carrier : str
        Label of the constant effect that this one modulates, either in time with the shape
        parameter ``frequency_Hz`` or with the crank angle at ``order`` (cycles per revolution). Its
        amplitudes are the cosine and sine parts. Initial frequencies or orders come from the
        spectrum of the residual.
    is_perturbation : bool
        The amplitude changes a known quantity, such as a clearance; at the lower bound nothing of
        that quantity is left. Both bounds are finite.
    search_range : tuple of float
        Lowest and highest amplitude of a search on a logarithmic grid; empty for other effects. Set
        it if the response is so nonsmooth in the single amplitude that fits converge only from
        nearby. For a perturbation the grid is logarithmic in the remaining quantity.
    families : tuple of LawFamily
        General laws that contain the effect as a special case.
    regress_with : str
        Label of an effect that linear regressions fit together with this one. For example, a
        high-pass filter removes the mean, which a sensor bias changes too.
    formula : str
        Formula of a user-defined law; its coefficients are the coordinates.
    middles : mapping of str to float
        Of an effect that oscillates in time, by run: the time [s] to which its cosine and sine
        parts refer, in the middle of the record, since about its ends phase and frequency would be
        confused. `parameters` gets it as ``middle_s``.

    Raises
    ------
    ValueError
        `search_range`, amplitudes in `initial_guesses`, or bounds of a perturbation are invalid.
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
    regress_with: str = ""
    formula: str = ""
    middles: Mapping[str, float] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        sizes = [
            guess[key] for guess in self.initial_guesses for key in guess.keys() & self.amplitudes
        ]
        sizes += self.search_range
        lowest = min(self.search_range, default=math.inf)
        if sizes and (
            len(self.amplitudes) > 1 or 0.0 in sizes or lowest <= self.vanishing_amplitude
        ):
            raise ValueError(
                f"{self.name}: initial_guesses and search_range accept values of a single"
                f" amplitude, not 0, in search_range above {self.vanishing_amplitude:g};"
                f" got {sizes}"
            )
        bounds = [(p.low, p.high) for p in self.coordinates if p.name in self.amplitudes]
        if self.is_perturbation and not np.isfinite(bounds).all():
            raise ValueError(f"{self.name}: the amplitude of a perturbation needs finite bounds")

    @property
    def label(self) -> str:
        """``name``, or ``name:site`` if `has_site`; unique among a model's candidates."""
        return f"{self.name}:{self.site}" if self.has_site else self.name

    @property
    def exclusion_group(self) -> str:
        """A hypothesis contains at most one effect per group: the law's label for a sensor fault
        with a family, otherwise the effect's own label."""
        return self.families[0].law.label if self.sensor and self.families else self.label

    @property
    def claims(self) -> frozenset[str]:
        """The `exclusion_group` and the replaced nuisances; two effects of one hypothesis have none
        in common."""
        return frozenset((self.exclusion_group, *self.replaces))

    @property
    def is_nonsmooth(self) -> bool:
        """Whether gradients are useless for the effect, so that only the search finds it. Gradients
        do work for small perturbations."""
        return bool(self.search_range) and not self.is_perturbation

    @property
    def vanishing_amplitude(self) -> float:
        """First amplitude [SI] without remaining quantity: the lower bound for a perturbation, else
        0."""
        if not self.is_perturbation:
            return 0.0
        return next(p.low for p in self.coordinates if p.key == self.amplitudes[0])

    def coordinates_in(self, runs: Sequence[str]) -> tuple[Parameter, ...]:
        """The coordinates of `runs`: those of a single run among them, and those of all runs."""
        return tuple(p for p in self.coordinates if p.run in (None, *runs))


@dataclass(frozen=True)
class LawFamily:
    """A general law with a shape parameter; one shape gives the effect.

    After an effect is identified, the shape is fitted too: the effect is reported alone only if the
    data exclude all other known shapes.

    Attributes
    ----------
    law : Candidate
        The general law; one coordinate, not an amplitude, is the shape. It is no candidate of the
        model and takes no part in the search.
    shape : str
        Key of the shape parameter.
    effect_shape : float
        [1] Shape at which the law equals the effect.
    known_shapes : tuple of float
        [1] Shapes of established laws.
    values : callable
        Converts values of the effect's coordinates to those of the law, without the shape.
    inactive_at_default : int
        Number of other coordinates without influence at `effect_shape`, such as the phase of a
        variation with amplitude 0. Fits do not start at that shape, where their gradient is 0.
    """

    law: Candidate
    shape: str
    effect_shape: float
    known_shapes: tuple[float, ...]
    values: Callable[[Mapping[str, float]], dict[str, float]]
    inactive_at_default: int = 0


@dataclass(frozen=True)
class Series:
    """One channel of one run: samples over time, or statistics over the crank angle.

    Attributes
    ----------
    run, channel, unit : str
        Names of the run and of the channel, and the SI unit.
    value : (n,) array
        Measured values; NaN for gaps (and everywhere in a preflight).
    time, angle : (n,) array
        Time [s] and crank angle [rad] of the samples; NaN if unknown. The angle continues over
        cycles. A model without a crank gives the phase of its motion.
    held_out : (n,) bool array
        True for samples that are used for neither fitting nor selection.
    stated_noise : (n,) array, optional
        Standard deviation of the noise [unit]; None to estimate it. For statistics it follows from
        the number of cycles.
    resolution : float
        Step of the sensor [unit], which causes rounding noise; 0 if unknown.
    jitter : float, optional
        Standard deviation of the time stamps [s]; its noise is proportional to the rate of the
        channel. None to estimate it.
    statistic : bool
        True if the values are statistics over cycles, with independent noise of `stated_noise`.
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
        """Standard deviation of the rounding noise [unit]."""
        return self.resolution / math.sqrt(12.0)

    @property
    def key(self) -> tuple[str, str]:
        """Run and channel."""
        return self.run, self.channel

    def variation(self, values: np.ndarray) -> float:
        """Standard deviation [unit] of `values` (n,); at most that of one revolution if the unit is
        rad, because such an angle can increase without limit."""
        deviation = float(np.nanstd(values))
        one_revolution = 2.0 * math.pi / math.sqrt(12.0)
        return min(deviation, one_revolution) if self.unit == "rad" else deviation


Effects = Sequence[tuple[Candidate, Mapping[str, float]]]
"""Active effects, each with the values of its coordinates by name."""


class Model(Protocol):
    """A simulation model together with the measured data."""

    name: str
    """Title."""
    series: Sequence[Series]
    """All measured channels of all runs."""
    nuisances: Sequence[Parameter]
    """Uncertain parameters; every hypothesis fits them again."""
    candidates: Sequence[Candidate]
    """Effects that the model might lack."""
    numerics: Sequence[str]
    """Labels of equally good solver variants, besides the default; may be empty."""

    def simulate(
        self, run: str, values: Mapping[str, float], effects: Effects = (), numerics: int = 0
    ) -> Mapping[str, np.ndarray]:
        """Simulate the sensor readings of a run.

        Parameters
        ----------
        run : str
        values : mapping of str to float
            All nuisances of the run by name, without ``@run``.
        effects : sequence
            Active effects. The readings include the sensor faults among them.
        numerics : int
            0 for the default solver, i for the variant ``self.numerics[i - 1]``.

        Returns
        -------
        mapping of str to (n,) array
            Readings by channel at the samples of the run's series [unit of the series].

        Raises
        ------
        InputError, SimulationError
            A simulation with these values is impossible; the message gives the reason.
        """


@runtime_checkable
class Driven(Protocol):
    """A model that is driven by a measured quantity, whose errors reach the readings."""

    def drive_errors(self, run: str, values: Mapping[str, float]) -> Mapping[str, np.ndarray]:
        """Effect of the errors of the drive on the readings of a run.

        Parameters
        ----------
        run : str
        values : mapping of str to float
            As in `Model.simulate`.

        Returns
        -------
        mapping of str to (n, k) array
            By channel [unit of the channel]: the change by one standard deviation of each of k
            independent errors. Unaffected channels are absent.
        """


Variation = tuple[Mapping[str, float], Effects]
"""Values and effects of a run near those of another one, in the form of `Model.simulate`."""


@runtime_checkable
class Linearised(Protocol):
    """A model that linearises its motion, so that many derivatives cost about one simulation."""

    def changes(
        self,
        run: str,
        values: Mapping[str, float],
        effects: Effects,
        variations: Sequence[Variation],
    ) -> Sequence[Mapping[str, np.ndarray] | None] | None:
        """Linearised changes of the sensor readings of a run.

        Parameters
        ----------
        run, values, effects
            As in `Model.simulate`.
        variations : sequence of Variation
            Each differs little from `values` and `effects`.

        Returns
        -------
        sequence of mapping of str to (n,) array, or None
            For each variation the change of the readings by channel [unit of the channel]: its
            readings minus those of `values` and `effects`. None for a variation that the
            linearisation does not support; None instead of the sequence if it supports none, for
            example because the motion does not become periodic.
        """


@dataclass(frozen=True)
class StateEstimate:
    """States of the windows of a run, from a filter.

    Attributes
    ----------
    states : object
        The model's own record of the states; its attribute ``slow`` has shape (k, d).
    deviance : float
        -2 log marginal likelihood of the readings, without its constant.
    readings : float
        Number of readings.
    """

    states: Any
    deviance: float
    readings: float


class WindowedRun(Protocol):
    """A run with fixed parameter values, divided into k windows with a start state each.

    A state has d numbers: pairs of an angle [rad] and its rate, scaled to about 1.
    """

    size: int
    """d, the numbers in a state."""
    turns: float
    """Length of the record in revolutions."""
    channels: Sequence[str]
    """Channels that depend on the state."""

    def filter_states(
        self,
        measured: Mapping[str, np.ndarray],
        noise: Mapping[str, np.ndarray],
        per_turn: int,
        jump: float,
        turns: float,
        most: float = math.inf,
    ) -> StateEstimate:
        """Estimate the states of all windows by a filter.

        Parameters
        ----------
        measured, noise : mapping of str to (n,) array
            Readings and their standard deviations by channel; NaN for gaps.
        per_turn : int
            Windows per revolution.
        jump : float
            Standard deviation of the jump between the end of a window and the next start state.
        turns : float
            Length of the analysed part from the start of the record, in revolutions.
        most : float
            Deviance above which the filter may end early; the states are then incomplete.
        """

    def deviance_of(
        self,
        predicted: Mapping[str, np.ndarray],
        measured: Mapping[str, np.ndarray],
        noise: Mapping[str, np.ndarray],
    ) -> float:
        """Deviance of readings that were predicted without estimated states, comparable with that
        of `filter_states`; parameters as there."""

    def states_from(self, slow: np.ndarray, per_turn: int) -> Any:
        """States of `per_turn` windows per revolution from known values `slow` (k, d); None if
        their number differs from k."""

    def steady_states(self, states: Any) -> Any:
        """The `states` of the steady motion, in which no window jumps; None if there is none."""

    def simulate(self, states: Any) -> tuple[Mapping[str, np.ndarray], np.ndarray, Any, np.ndarray]:
        """Simulate all windows from their states.

        Returns
        -------
        readings : mapping of str to (n,) array
            By channel; NaN in windows whose simulation failed.
        ends : (k, d) array
            States at the ends of the windows.
        further : tuple of (k, ...) arrays
            Other quantities that windows pass to the next one.
        succeeded : (k,) bool array
        """

    def window_of(self, time: np.ndarray, states: Any) -> np.ndarray:
        """Index of the window that contains each of the times [s] (n,)."""


@runtime_checkable
class Windowed(Protocol):
    """A model with unmeasured states, such as the position of a pin in its bearing."""

    def windows(
        self, run: str, values: Mapping[str, float], effects: Effects = ()
    ) -> WindowedRun | None:
        """A run in windows; None if its motion has no unmeasured state. Arguments as in
        `Model.simulate`."""


def runs_of(model: Model) -> tuple[str, ...]:
    """Names of the runs of a model, in the order of its series."""
    return tuple(dict.fromkeys(series.run for series in model.series))
