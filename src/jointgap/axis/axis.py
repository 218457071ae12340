"""`Axis`: the base class of a model of your own."""

import inspect
import math
from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numba
import numpy as np

from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError
from jointgap.core.units import coherent, dimension_of, format_dimension
from jointgap.effects.axis_laws import AXIS_LAWS, SITE

MOTION = ("position", "velocity", "acceleration", "time")
"""Arguments that every method may have; further ones are measured channels."""

_STEP_SHARE = 0.02  # [1] Step of a parameter over the width of its bounds


@dataclass(frozen=True)
class AxisParameter:
    """An uncertain parameter of an `Axis`, made by `parameter`."""

    nominal: float
    unit: str
    low: float
    high: float
    each_run: bool = False


@dataclass(frozen=True)
class AxisEffect:
    """An effect that an `Axis` might lack, made by `effect`."""

    unit: str
    low: float
    high: float
    step: float
    guesses: tuple[float, ...]
    parts: tuple[str, ...]

    def names(self, attribute: str) -> list[str]:
        """Attributes of ``self`` in the methods."""
        return [f"{attribute}_{part}" for part in self.parts] or [attribute]

    def candidate(self, attribute: str) -> Candidate:
        names = self.names(attribute)
        parameters = tuple(
            Parameter(name, 0.0, self.low, self.high, self.step, self.unit) for name in names
        )
        guesses = tuple({names[0]: guess} for guess in self.guesses) or ({},)
        return Candidate(attribute, SITE, parameters, tuple(names), guesses)


def effect(
    unit: str = "1",
    *,
    step: float,
    low: float = 0.0,
    high: float = math.inf,
    guesses: Sequence[float] = (),
    parts: Sequence[str] = (),
) -> Any:
    """An effect of the class itself that the model might lack: 0 unless it is identified.

    Parameters
    ----------
    unit : str
        SI unit of its size by its pint name.
    step : float
        About the smallest size that exceeds the noise, in `unit`.
    low, high : float
        Bounds of the size in `unit`.
    guesses : sequence of float
        Sizes at which fits start, if the readings do not depend linearly on it from 0 on.
    parts : sequence of str
        Names of several sizes, such as ``("cosine", "sine")``: methods read
        ``self.name_cosine``.

    Raises
    ------
    ValueError
        0 is outside of the bounds, or `guesses` are given for several parts.
    """
    _check_unit(unit)
    if not low <= 0.0 <= high or not low < high or not step > 0.0:
        raise ValueError(
            f"effect('{unit}', step={step:g}, low={low:g}, high={high:g}): the bounds must include"
            " 0, where the effect is absent, and the step be above 0"
        )
    if parts and guesses:
        raise ValueError("effect: guesses are for an effect with one size; remove parts")
    return AxisEffect(unit, low, high, step, tuple(guesses), tuple(parts))


def parameter(
    nominal: float, unit: str = "1", *, low: float, high: float, each_run: bool = False
) -> Any:
    """An uncertain parameter of an `Axis`, which every fit estimates.

    Parameters
    ----------
    nominal : float
        Start value in `unit`.
    unit : str
        SI unit by its pint name, such as ``kg*m**2``; ``1`` for a pure number.
    low, high : float
        Bounds in `unit`; all values between are equally probable before the fit.
    each_run : bool
        Whether each run has its own value, such as the zero of a sensor.

    Raises
    ------
    ValueError
        `nominal` is outside of the bounds, or a bound is infinite.
    """
    _check_unit(unit)
    if not -math.inf < low < high < math.inf or not low <= nominal <= high:
        raise ValueError(
            f"parameter({nominal:g}, '{unit}', low={low:g}, high={high:g}): give finite bounds,"
            " low < high, with the start value between them"
        )
    return AxisParameter(nominal, unit, low, high, each_run)


def _check_unit(unit: str) -> None:
    """ValueError unless it is an SI unit: methods calculate with the numbers as they are."""
    factor, dimension = coherent(1.0, unit) if unit != "1" else (1.0, None)
    if factor != 1.0:
        raise ValueError(
            f"the unit '{unit}' is no SI unit; give values in"
            f" {'rad' if dimension == dimension_of('') else format_dimension(dimension)}"
        )


class Axis:
    """A mechanism with one degree of freedom: a body that slides or turns.

    Subclasses state parameters as class attributes (`parameter`, or plain numbers for constants)
    and some of the methods below. In these, ``self`` holds the values of the parameters [SI], and
    the arguments are chosen by name: ``position`` [m or rad], ``velocity``, ``acceleration``,
    ``time`` [s], and any measured channel of the model file. Numba compiles the methods for
    simulations, so write NumPy functions of numbers that also accept arrays.

    - ``mass(self, ...)``: mass [kg], or moment of inertia [kg m^2] of a body that turns; at least
      for ``given: drive``.
    - ``force(self, ...)``: sum of all forces [N] or torques [N m] along the axis except that of the
      drive, such as weight, springs and viscous friction; default: none.
    - ``load(self, ...)``: normal force [N], or whatever else presses on the surfaces, of which dry
      friction takes a share (candidate ``load_friction``); default: the drive, if it is given.
    - ``name_of_a_channel(self, ...)``: the reading of this channel.

    Methods cannot call each other; write functions outside the class. ``time`` is 0 at the first
    sample of a run that is used. The three methods above have no ``acceleration`` where the motion
    is simulated.

    Examples
    --------
    A rod with a weight:

    >>> import numpy as np
    >>> from jointgap.axis import Axis, parameter
    >>> class Pendulum(Axis):
    ...     inertia = parameter(0.15, "kg*m**2", low=0.02, high=1.0)
    ...     gravity_torque = parameter(3.0, "N*m", low=0.3, high=20.0)
    ...
    ...     def mass(self):
    ...         return self.inertia
    ...
    ...     def force(self, position):
    ...         return -self.gravity_torque * np.sin(position)
    >>> [p.name for p in Pendulum.parameters()]
    ['inertia', 'gravity_torque']
    """

    @classmethod
    def parameters(cls, runs: Sequence[str] = ()) -> tuple[Parameter, ...]:
        """The uncertain parameters, in the order in which the class states them; those of each run
        for `runs`."""
        parameters = []
        for name, value in cls.attributes().items():
            if isinstance(value, AxisParameter):
                step = _STEP_SHARE * (value.high - value.low)
                made = Parameter(name, value.nominal, value.low, value.high, step, value.unit)
                each = runs if value.each_run else (None,)
                parameters += [replace(made, run=run) for run in each]
        return tuple(parameters)

    @classmethod
    def candidates(cls) -> tuple[Candidate, ...]:
        """The effects of the class."""
        attributes = cls.attributes().items()
        return tuple(
            value.candidate(name) for name, value in attributes if isinstance(value, AxisEffect)
        )

    @classmethod
    def attributes(cls) -> dict[str, Any]:
        """Parameters, effects, constants and methods of the class, by name."""
        return {
            name: value
            for base in cls.__mro__[::-1]
            if base not in (object, Axis)
            for name, value in vars(base).items()
            if not name.startswith("_")
        }

    @classmethod
    def methods(cls) -> dict[str, Callable]:
        """The methods of the subclass, by name."""
        return {name: value for name, value in cls.attributes().items() if callable(value)}


class Equations:
    """The methods of an `Axis` as functions of one signature: ``(self, position, velocity,
    acceleration, time, inputs)``.

    Parameters
    ----------
    kind : subclass of Axis
    inputs : sequence of str
        Measured channels that methods may have as arguments: rows of ``inputs`` (k, ...).
    source : str
        File of the class, for messages.

    Raises
    ------
    InputError
        A method has an unknown argument.
    """

    def __init__(self, kind: type[Axis], inputs: Sequence[str], source: str):
        self.kind, self.source = kind, source
        attributes = kind.attributes()
        constants = {
            name: float(value) for name, value in attributes.items() if isinstance(value, Real)
        }
        self._names = [
            name for name, value in attributes.items() if isinstance(value, AxisParameter)
        ]
        effects = {
            name: value for name, value in attributes.items() if isinstance(value, AxisEffect)
        }
        for name in effects.keys() & AXIS_LAWS.keys():
            raise InputError(f"{source}: the effect {name} has the name of a known one; rename it")
        self._sizes = [size for name, value in effects.items() for size in value.names(name)]
        self._record = namedtuple("Values", [*self._names, *self._sizes, *constants])
        self._constants = tuple(constants.values())
        self._methods = kind.methods()
        self.arguments = {
            name: tuple(inspect.signature(method).parameters)[1:]
            for name, method in self._methods.items()
        }
        self._lines = {name: self._common_signature(name, inputs) for name in self._methods}

    def __contains__(self, name: str) -> bool:
        """Whether the class has the method `name`."""
        return name in self._methods

    def values(self, values: Mapping[str, float]) -> tuple:
        """What methods get as ``self``, from all parameters and present effects by name [SI]."""
        sizes = [values.get(name, 0.0) for name in self._sizes]
        return self._record(*(values[name] for name in self._names), *sizes, *self._constants)

    def _common_signature(self, name: str, inputs: Sequence[str]) -> str:
        """The code of a function with the common signature that calls the method `name`."""
        places = {argument: argument for argument in MOTION}
        places |= {channel: f"inputs[{place}]" for place, channel in enumerate(inputs)}
        arguments = self.arguments[name]
        for argument in arguments:
            if argument not in places:
                raise InputError(
                    f"{self.source}: the method {name} has the argument '{argument}'; arguments are"
                    f" {', '.join(places)}: rename it, or add the channel to the model file"
                )
        passed = ", ".join(["self", *(places[argument] for argument in arguments)])
        return f"lambda self, {', '.join(MOTION)}, inputs: method({passed})"

    def compiled(self, name: str, default: float, example: tuple) -> Callable:
        """The method `name` compiled for numbers such as the arguments `example`; without such a
        method a function that is `default`."""
        if name not in self:
            return _constant(default)
        compiled = numba.njit(self._methods[name], error_model="numpy")
        function = numba.njit(_with_method(self._lines[name], compiled), error_model="numpy")
        try:
            value = function(*example)
        except Exception as error:  # whatever the method or its compilation raises
            reason = " ".join(str(error).split())[:300]
            raise InputError(
                f"{self.source}: the method {name} cannot be compiled ({reason}); write NumPy"
                " functions of numbers, such as np.sin(position)"
            ) from error
        if not math.isfinite(value):
            raise InputError(
                f"{self.source}: the method {name} is {value} at the first sample with the start"
                " values of the parameters; correct it"
            )
        return function

    def evaluate(
        self,
        name: str,
        values: tuple,
        motion: Sequence[np.ndarray],
        inputs: np.ndarray,
        default: float = 0.0,
    ) -> np.ndarray:
        """The method `name` at all samples (n,); `motion`: the arrays (n,) of `MOTION`."""
        shape = np.shape(motion[0])
        if name not in self:
            return np.full(shape, default)
        function = _with_method(self._lines[name], self._methods[name])
        try:
            return np.broadcast_to(np.asarray(function(values, *motion, inputs), float), shape)
        except Exception as error:  # whatever the method raises
            raise InputError(
                f"{self.source}: the method {name} fails for arrays of samples:"
                f" {type(error).__name__}: {error}; use NumPy functions, which accept arrays"
            ) from error


def _with_method(line: str, method: Callable) -> Callable:
    """The function of a `line` of `Equations`, whose names are checked."""
    return eval(line, {"method": method})


_CONSTANTS: dict[float, Callable] = {}


def _constant(value: float) -> Callable:
    """A compiled function that is always `value`."""
    if value not in _CONSTANTS:

        @numba.njit
        def function(self, position, velocity, acceleration, time, inputs):
            return value

        _CONSTANTS[value] = function
    return _CONSTANTS[value]
