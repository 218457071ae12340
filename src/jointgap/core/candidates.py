"""Interface of a model for identification: candidates, parameters, families of laws."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """A fit parameter.

    Attributes
    ----------
    name : str
        Such as ``slider_mass`` or ``force_N``.
    nominal : float
        Default value; 0 for an effect's size, at which the effect is absent.
    low, high : float
        Hard bounds with a uniform prior; infinite for none.
    step : float
        A typical change, > 0, of the order of the noise; scale of difference quotients.
    unit : str
        SI unit, ``'1'`` for pure numbers.
    run : str, optional
        The run that it belongs to, such as for a run's speed; None if common to all runs.
    whole : bool
        Whether it is rounded to an integer: chi2 is piecewise constant in it, so samples around a fit keep it fixed.
    tried : tuple of float
        Discrete values for a search, if any.
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
        """``name``, or ``name@run`` for a parameter of one run."""
        return self.name if self.run is None else f"{self.name}@{self.run}"


@dataclass(frozen=True)
class Candidate:
    """An effect that the model may lack, as parametrised for a fit.

    Attributes
    ----------
    name, site : str
        As in a verdict.
    coordinates : tuple of Parameter
        Fit parameters; those with a run belong to that run only, such as a phase. The motion should be approximately
        linear in the `amplitudes` near 0, so an amplitude with a phase has two coordinates: cosine and sine parts.
    amplitudes : tuple of str
        Keys of the coordinates that are 0 where the effect is absent; the others are shape parameters (an exponent, a
        frequency).
    initial_guesses : tuple of mappings
        Initial values of all shape parameters; one empty mapping without shape parameters. If the motion is nonlinear
        in a single amplitude near 0, such as the clearance of an ideal joint, guesses include the amplitude, at which
        fits then start; likewise if the amplitude's value was estimated otherwise.
    parameters : function
        From values of the coordinates to the parameters of a verdict; by default the identity.
    replaces : mapping of str to str
        Nuisances that are this effect's own parameter, with the corresponding amplitude: the nuisance is fixed at
        nominal in a fit of the effect, and the amplitude is the difference.
    sensor : bool
        Whether it is a sensor fault, which acts on readings and not on the motion.
    has_site : bool
        Whether the effect could be at several sites, so that its label includes the site.
    steady_counterpart : str
        Label of the steady effect that this one modulates: in time with the shape parameter ``frequency_Hz``, or with
        the crank at ``order`` cycles per revolution. Its amplitudes are the cosine and sine parts. Initial frequencies
        or orders are then searched in the residual.
    is_perturbation : bool
        Whether its amplitude is the change of a known quantity, such as a clearance, down to a lower bound where that
        quantity vanishes: the motion is then nonlinear in it. Both bounds are finite.
    search_range : tuple of two floats
        For an effect with one amplitude whose chi2 has many local minima: range of a global search, even in the
        logarithm of the amplitude (of the remaining quantity for a perturbation); () for others.
    families : tuple of LawFamily
        Laws of which the effect is a special case.
    """

    name: str
    site: str
    coordinates: tuple[Parameter, ...]
    amplitudes: tuple[str, ...]
    initial_guesses: tuple[Mapping[str, float], ...] = ({},)
    parameters: Callable[[Mapping[str, float]], dict[str, float]] = field(default=dict, compare=False)
    replaces: Mapping[str, str] = field(default_factory=dict)
    sensor: bool = False
    has_site: bool = False
    steady_counterpart: str = ""
    is_perturbation: bool = False
    search_range: tuple[float, ...] = ()
    families: tuple["LawFamily", ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        """Reject inconsistent finite amplitudes."""
        finite = [*self.search_range]
        finite += [guess[key] for guess in self.initial_guesses for key in self.amplitudes if key in guess]
        least = min(self.search_range, default=np.inf)
        if finite and (len(self.amplitudes) > 1 or 0.0 in finite or least <= self.vanishing_amplitude):
            raise ValueError(
                f"{self.name}: initial_guesses and search_range require a single amplitude with values other than 0, "
                f"and a search_range above {self.vanishing_amplitude:g}; got {finite}"
            )
        if self.is_perturbation and not all(
            np.isfinite((p.low, p.high)).all() for p in self.coordinates if p.name in self.amplitudes
        ):
            raise ValueError(f"{self.name}: the perturbation of a known quantity requires finite bounds")

    @property
    def label(self) -> str:
        """``name``, or ``name:site`` with several sites; unique among a model's candidates."""
        return f"{self.name}:{self.site}" if self.has_site else self.name

    @property
    def exclusion_group(self) -> str:
        """Only one effect of a hypothesis may have the same group: the law's label for a family of faults of one
        sensor, otherwise the effect's own label."""
        return self.families[0].law.label if self.sensor and self.families else self.label

    @property
    def claims(self) -> frozenset[str]:
        """Resources that no two effects of a hypothesis share: `exclusion_group` and replaced nuisances."""
        return frozenset((self.exclusion_group, *self.replaces))

    @property
    def is_rough(self) -> bool:
        """Whether samples are so irregular in it that only a global search finds it, not derivatives; small changes of
        an existing quantity are found by derivatives too."""
        return bool(self.search_range) and not self.is_perturbation

    @property
    def vanishing_amplitude(self) -> float:
        """First amplitude [SI] at which the changed quantity vanishes: 0, except for a perturbation."""
        if not self.is_perturbation:
            return 0.0
        return next(p.low for p in self.coordinates if p.key == self.amplitudes[0])

    def coordinates_in(self, runs: Sequence[str]) -> tuple[Parameter, ...]:
        """The coordinates that apply to `runs`."""
        return tuple(p for p in self.coordinates if p.run in (None, *runs))


@dataclass(frozen=True)
class LawFamily:
    """A law of which several effects are special cases; the compatible shapes are determined once one was identified.

    Attributes
    ----------
    law : Candidate
        The law; one of its coordinates, not an amplitude, is the shape. It is not a candidate of the model.
    shape : str
        Key of that coordinate.
    own : float
        [1] Shape at which the law equals the effect with this family.
    in_use : tuple of float
        [1] Shapes of known laws: the effect is named without alternatives if all but its own are excluded.
    values : function
        From values of the effect's coordinates to the equivalent ones of the law, without the shape.
    idle_at_own : int
        Number of other coordinates of the law that have no effect at the shape `own`, such as the position of a
        variation of zero size. No fit starts there, because it could not change them.
    """

    law: Candidate
    shape: str
    own: float
    in_use: tuple[float, ...]
    values: Callable[[Mapping[str, float]], dict[str, float]]
    idle_at_own: int = 0


@dataclass(frozen=True)
class Series:
    """One channel of one run for comparison: samples over time, or statistics over the crank angle.

    Attributes
    ----------
    run, channel, unit : str
        SI unit.
    value : (n,) array
        As measured; NaN for missing samples (all in a preflight).
    time, angle : (n,) array
        Of the samples [s], [rad]; NaN if unknown. `angle` is continuous over cycles; without a crank it is any phase.
    held_out : (n,) bool array
        Samples that are not used for fitting or model selection.
    stated_noise : (n,) array or None
        Standard deviation stated by the user (or, for statistics, from the number of cycles) [unit].
    resolution : float
        Quantisation step of the sensor [unit]; 0 if unknown.
    jitter : float or None
        Standard deviation of the time stamps [s], whose noise is proportional to the channel's rate; None to estimate
        it.
    statistic : bool
        Whether values are statistics over cycles, with independent noise of `stated_noise`.
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
        """Standard deviation of the quantisation [unit]."""
        return self.resolution / math.sqrt(12.0)

    @property
    def key(self) -> tuple[str, str]:
        return self.run, self.channel

    def variation(self, values: np.ndarray) -> float:
        """Standard deviation [unit] of `values` (n,); for a continuous angle at most that over one turn."""
        varies = float(np.nanstd(values))
        return min(varies, 2.0 * math.pi / math.sqrt(12.0)) if self.unit == "rad" else varies


Effects = Sequence[tuple[Candidate, Mapping[str, float]]]
"""Acting effects, each with the values of its coordinates by name."""


class Model(Protocol):
    """A simulation, and measured data in comparable form."""

    name: str  # for titles
    series: Sequence[Series]  # all measurements
    nuisances: Sequence[Parameter]  # uncertain parameters, fitted with every hypothesis
    candidates: Sequence[Candidate]  # possible missing effects
    numerics: Sequence[str]  # labels of equally accurate solver variants; `simulate` counts them from 1

    def simulate(
        self, run: str, values: Mapping[str, float], effects: Effects = (), numerics: int = 0
    ) -> Mapping[str, np.ndarray]:
        """The simulated readings of a run.

        Parameters
        ----------
        run : str
        values : mapping of str to float
            All nuisances of the run, by name (not key).
        effects : sequence
            Includes sensor faults, which act on the readings.
        numerics : int
            0 for the default solver, i for `self.numerics[i - 1]`.

        Returns
        -------
        mapping of str to (n,) array
            By channel, at the samples of the run's series.

        Raises
        ------
        InputError, SimulationError
            The simulation failed for these values; the message contains the reason.
        """


@runtime_checkable
class Driven(Protocol):
    """A model driven by a measured, and therefore inexact, motion."""

    def drive_errors(self, run: str, values: Mapping[str, float]) -> Mapping[str, np.ndarray]:
        """Sensitivity of the readings of a run to errors of its drive.

        Parameters
        ----------
        run : str
        values : mapping of str to float
            As of `Model.simulate`.

        Returns
        -------
        mapping of str to (n, k) array
            By channel [unit of the channel]: response to one standard deviation of each of k independent errors;
            unaffected channels are omitted.
        """


@dataclass(frozen=True)
class FoundStates:
    """Window states of a run, estimated by a filter."""

    states: Any  # including `slow`, the states of the windows (k, d)
    deviance: float  # minus twice the log marginal likelihood of the readings, up to a constant
    readings: float  # number of readings


class WindowedRun(Protocol):
    """A run at given parameter values, divided into windows that each have their own state.

    A state consists of pairs: an angle [rad] and its rate, scaled to order 1.
    """

    size: int  # d, numbers per state
    turns: float  # turns in the record
    channels: Sequence[str]  # that determine states

    def find(
        self,
        measured: Mapping[str, np.ndarray],
        noise: Mapping[str, np.ndarray],
        per_turn: int,
        jump: float,
        turns: float,
    ) -> FoundStates:
        """Estimate the states of the windows, `per_turn` of them, in the record's first `turns` by a filter.

        `measured` and `noise`: readings and their standard deviations at the series' samples, NaN where missing;
        `jump`: standard deviation of a state relative to the end of the previous window.
        """

    def known(self, slow: np.ndarray, per_turn: int) -> Any:
        """Known states (k, d) of `per_turn` windows; None if their number is not k."""

    def settled(self, states: Any) -> Any:
        """`states` of a motion that began long before the record, without jumps between windows; None if this does
        not determine them."""

    def simulate(self, states: Any) -> tuple[Mapping[str, np.ndarray], np.ndarray, Any, np.ndarray]:
        """Readings in windows from their states by channel (NaN for failed windows), states at the windows' ends (k,
        d), a tuple of further arrays (k, ...) to pass on, and which windows (k,) were simulated.
        """

    def window_of(self, time: np.ndarray, states: Any) -> np.ndarray:
        """Window index (n,) of each of the times [s] of a series."""


@runtime_checkable
class Windowed(Protocol):
    """A model whose state is not determined by a record, such as that of pins in their bearings."""

    def windows(self, run: str, values: Mapping[str, float], effects: Effects = ()) -> WindowedRun | None:
        """A run in windows, `values` and `effects` as in `Model.simulate`; None if its motion has no such state."""


def runs_of(model: Model) -> tuple[str, ...]:
    """The runs of a model, in order."""
    return tuple(dict.fromkeys(series.run for series in model.series))
