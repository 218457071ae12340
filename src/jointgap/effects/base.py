"""What every effect's page has: see `Effect`, and docs/extending.md for how to write one."""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, get_args

from pydantic import Field, create_model

from jointgap.core.candidates import Candidate, Parameter
from jointgap.core.errors import InputError
from jointgap.core.joints import PINS
from jointgap.quantities import quantity
from jointgap.section import Section

SLIDER_SIGN_SPEED = 0.01
"""Width [m/s] of the sign of the slider's velocity in its friction: sgn v = tanh(v / 0.01 m/s)."""

CRANK_SIGN_SPEED = 0.1
"""Width [rad/s] of the sign of a speed of rotation in friction: sgn w = tanh(w / 0.1 rad/s)."""

SLIDER_SIGN = f"sgn v = tanh(v / {SLIDER_SIGN_SPEED:g} m/s)"
CRANK_SIGN = f"sgn w = tanh(w / {CRANK_SIGN_SPEED:g} rad/s)"

FRICTION_SURVEY = "Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083-1138"

DETECTABLE_SHARE = 0.02
"""Share of a quantity that noise could just hide: steps of finite differences are of this order."""

LARGEST_SIZE = 200.0
"""How many times the first amplitude a blind trial may give an effect that nothing else bounds."""

GROUPS = ("slider", "crank", "bodies", "pins", "clearances")
"""What effects act on, in the order in which a fit tries them."""


Values = Mapping[str, float]
"""Values of a fit's coordinates by key."""

Candidates = Iterable[Candidate]

Records = dict[str, dict[str, Any]]
"""Fields by record of `jointgap.dynamics.parameters.Parameters`; and programs under ``formulas``."""


@dataclass(frozen=True)
class MotionScale:
    """Magnitudes of the motion from which the steps of a fit follow.

    Attributes
    ----------
    stroke, speed, turning : float
        Half the stroke [m], slider's speed [m/s] and crank's speed [rad/s], root mean squares.
    force : float
        A force on the slider [N] that noise could just hide.
    guide : float
        The guide's force [N].
    middle : float
        Slider's position at mid-stroke [m].
    """

    stroke: float
    speed: float
    turning: float
    force: float
    guide: float
    middle: float

    @classmethod
    def of(cls, mechanism: Any, turning: float) -> "MotionScale":
        """Of a `mechanism` (`jointgap.config.Mechanism`) whose crank turns at `turning` [rad/s]."""
        crank, rod = mechanism.crank.length, mechanism.rod.length
        mass = mechanism.slider.mass + 0.5 * mechanism.rod.mass
        inertia = mass * crank * turning**2 / math.sqrt(2.0)
        speed = crank * turning / math.sqrt(2.0)
        return cls(crank, speed, turning, DETECTABLE_SHARE * inertia, inertia * crank / rod, rod)


@dataclass(frozen=True)
class FitContext:
    """What an effect needs to know to say how a fit varies it.

    Attributes
    ----------
    mechanism : jointgap.config.Mechanism
    scale : MotionScale
    nuisances : mapping of str to Parameter
        Those that all runs share, by name.
    constant_speed : bool
        Whether the crank is driven at a constant speed.
    frequency_Hz : float
        Of a force that oscillates by itself, before data suggest one.
    runs : sequence of str
    starts : mapping of str to int
        From how many starts the motion may have come, by run of which nobody knows where it began.
    """

    mechanism: Any
    scale: MotionScale
    nuisances: Mapping[str, Parameter]
    constant_speed: bool
    frequency_Hz: float
    runs: Sequence[str]
    starts: Mapping[str, int]

    def replaced(self, amplitudes: Mapping[str, str]) -> dict[str, str]:
        """Of `amplitudes` by nuisance that is an effect's own parameter: those whose nuisance the campaign has."""
        return {nuisance: key for nuisance, key in amplitudes.items() if nuisance in self.nuisances}


class TrialContext(NamedTuple):
    """What a blind trial knows when it hides an effect.

    Attributes
    ----------
    rig : validation.effects.RigScales
        Its `force`, `velocity` and `stroke` say how large the motion is.
    rng : numpy.random.Generator
    site : str
        Where an effect with a choice of sites is to act; else empty.
    """

    rig: Any
    rng: Any
    site: str


class TrialSize(NamedTuple):
    """How a blind trial hides an effect: by one number, 0 where the effect is absent; all else is drawn once and stays.

    Attributes
    ----------
    parameters : function
        From the amplitude to the parameters that a verdict states.
    first, largest, smallest : float
        Amplitude to begin the search with, and its bounds.
    """

    parameters: Callable[[float], dict[str, float]]
    first: float
    largest: float
    smallest: float = 0.0

    @classmethod
    def of(cls, key: str, first: float, largest: float | None = None, sign: float = 1.0, **drawn: float) -> "TrialSize":
        """The amplitude, from `first` up to `largest`, times `sign` is the parameter `key`; others are as `drawn`."""
        bound = LARGEST_SIZE * first if largest is None else largest
        return cls(lambda amplitude: {key: sign * amplitude, **drawn}, first, bound)


def parameter(unit: str, meaning: str, example: float, default: Any = ..., **limits: float) -> tuple[Any, Any]:
    """A parameter of an effect's page.

    Parameters
    ----------
    unit : str
        SI, by its pint name; empty for pure numbers.
    meaning : str
        Its symbol in the law, and what it is.
    example, default : float
        A typical value; what it is where an entry leaves it out, if it may.
    **limits : float
        ``gt``, ``ge``, ``lt``, ``le``, ``multiple_of``.
    """
    return quantity(unit, **limits), Field(default, description=meaning, examples=[example])


def random_sign(rng: Any) -> float:
    """-1 or 1, drawn by a `numpy.random.Generator`."""
    return float(rng.choice([-1.0, 1.0]))


def amplitude(name: str, step: float, unit: str, low: float = -math.inf, high: float = math.inf) -> Parameter:
    """A coordinate `name` of a fit that is 0 where its effect is absent; `step`, `low` and `high` in `unit`."""
    return Parameter(name, 0.0, low, high, step, unit)


def order_of_crank(whole: Iterable[int], runs: Sequence[str]) -> Parameter:
    """The order of an effect in step with the crank [cycles per revolution]: of the `whole` ones, and the halves beside
    them where there is one run alone, as in which of two turns a run began nobody knows.

    Parameters
    ----------
    whole : iterable of int
        Rising.
    runs : sequence of str
        Of the campaign.
    """
    orders = [float(order) for order in whole]
    if len(runs) == 1:
        orders = sorted({*orders, *(k + 0.5 for k in range(int(orders[-1])))})
    return Parameter("order", orders[0], orders[0], orders[-1], 1e-3, whole=True, tried=tuple(orders))


def stated_order(value: float) -> float:
    """The whole or half order next to a fitted `value`."""
    doubled = round(2.0 * value)
    return doubled // 2 if doubled % 2 == 0 else doubled / 2.0


def from_cosine_and_sine(amplitude: str, angle: str, values: Values) -> dict[str, float]:
    """The parameters called `amplitude` and `angle` [rad] of the coordinates ``cosine`` and ``sine`` in `values`."""
    cosine, sine = values["cosine"], values["sine"]
    return {amplitude: math.hypot(cosine, sine), angle: math.atan2(sine, cosine)}


class Effect(Section):
    """A physical effect beyond contact and friction in the joints; off unless a mechanism file lists it.

    A subclass with the decorator `page` is an effect of the catalogue. Its entry in a mechanism file has the keys
    ``name`` (that of the class, in snake case), those of `KEYS`, and ``parameters``. In the laws v and x are the
    slider's velocity and position, w is the crank's speed and theta its angle, t is time.

    Attributes
    ----------
    NAME, ORDER : str, int
        Its name and its place in the catalogue, from `page`.
    GROUP : str
        What it acts on, of `GROUPS`; with ``slider`` the law in `slider_force` is switched on.
    SITE : str
        Where it acts; where there is a choice, the entry has the key ``site``.
    LAW, REFERENCE : str
        Its equation in the symbols that the parameters' descriptions name, and where that stands, or ``definition``.
    WORDS : str
        What a verdict calls it; may hold ``{site}``.
    KEYS : mapping of str to (type, Field)
        Keys of an entry beside ``name`` and ``parameters``.
    PARAMETERS : mapping of str to (type, Field), or Section
        Its parameters, with units in their names; see `parameter`.
    OPTIONAL : bool
        Whether an entry may leave out ``parameters``, which all have defaults.
    COMPILED : mapping of str to str
        Parameter that each field of `jointgap.dynamics.parameters.EffectParameters` takes over as it is.
    ADDS_TO : mapping of str to (str, str)
        Body and its key in a mechanism file to which each parameter is added; such an effect is nothing but other data.
    DRIVE : str
        The one kind of drive that it goes with; empty for all.
    MEMBERS : mapping of str to float
        Of the law of a family: effects that it is, and the shape [1] at which it is each.
    ACTS_AT_ZERO : bool
        Whether it changes the mechanism even where its amplitude is 0.
    """

    NAME: ClassVar[str]
    ORDER: ClassVar[int]
    GROUP: ClassVar[str]
    SITE: ClassVar[str]
    LAW: ClassVar[str]
    REFERENCE: ClassVar[str]
    WORDS: ClassVar[str]
    KEYS: ClassVar[Mapping[str, Any]] = {}
    PARAMETERS: ClassVar[Mapping[str, Any] | type[Section]]
    OPTIONAL: ClassVar[bool] = False
    COMPILED: ClassVar[Mapping[str, str]] = {}
    ADDS_TO: ClassVar[Mapping[str, tuple[str, str]]] = {}
    DRIVE: ClassVar[str] = ""
    MEMBERS: ClassVar[Mapping[str, float]] = {}
    ACTS_AT_ZERO: ClassVar[bool] = False

    @classmethod
    def sites(cls) -> tuple[str, ...]:
        """The sites among which an entry chooses; () where there is no choice."""
        return get_args(cls.model_fields["site"].annotation) if "site" in cls.model_fields else ()

    @property
    def place(self) -> str:
        """Where it acts: its site, or the one chosen where there is a choice."""
        return getattr(self, "site", self.SITE)

    def changes_data(self, mechanism: Any) -> bool:
        """Whether it is nothing but other data of `mechanism`, which `apply` writes."""
        return bool(self.ADDS_TO) or type(self).apply is not Effect.apply

    def apply(self, data: dict[str, Any]) -> None:
        """Fold an effect that is nothing but other data into `data`, the content of a mechanism file in SI.

        Raises
        ------
        InputError
            Data that it needs are not there.
        """
        for key, (body, datum) in self.ADDS_TO.items():
            data[body][datum] += getattr(self.parameters, key)

    def check(self, mechanism: Any) -> None:
        """ValueError where it cannot act in `mechanism`, in which all effects that are nothing but data are folded."""

    def compile_into(self, records: Records) -> None:
        """Write its numbers into the records of the equations of motion, which hold those of the mechanism without
        it.
        """
        records["effects"] |= {field: getattr(self.parameters, key) for field, key in self.COMPILED.items()}
        if self.GROUP == "slider":
            records["effects"]["on_slider"] = True

    def largest_force(self, stroke: float) -> float:
        """About the largest force [N] on the slider that it states, over a `stroke` [m]; 0 where it states none."""
        return abs(getattr(self.parameters, "force_N", 0.0))

    def mirrored(self) -> "Effect":
        """The effect as seen from behind, where a clockwise crank turns counter-clockwise: the slide is the mirror."""
        return self

    def with_parameters(self, **values: Any) -> "Effect":
        """The effect with other values of parameters."""
        return self.model_copy(update={"parameters": self.parameters.model_copy(update=values)})

    @classmethod
    def candidate(
        cls, *coordinates: Parameter, site: str = "", amplitudes: tuple[str, ...] = (), **attributes: Any
    ) -> Candidate:
        """This effect as a fit sees it.

        Parameters
        ----------
        *coordinates : Parameter
            What a fit varies.
        site : str
            Where there is a choice.
        amplitudes : tuple of str
            Keys of the coordinates that are 0 where the effect is absent; all by default.
        **further
            Other attributes of a `Candidate`.
        """
        keys = amplitudes or tuple(coordinate.key for coordinate in coordinates)
        return Candidate(cls.NAME, site or cls.SITE, coordinates, keys, has_site=bool(site), **attributes)

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        """How a fit varies it where it could be missing: one candidate for each site; none where it cannot act."""
        return ()

    @classmethod
    def simulated(cls, values: Values) -> tuple[Values, float]:
        """Values of a fit's coordinates that can be simulated in place of `values`, and what share of their effect
        acts.
        """
        return values, 1.0

    @classmethod
    def trial(cls, context: TrialContext) -> TrialSize | None:
        """How a blind trial hides it, None where it cannot act on this rig; an effect without this method is not
        hidden.
        """
        return None


def joint_data(data: dict[str, Any], effect: str, joint: str) -> dict[str, Any]:
    """The data of a `joint` in a mechanism file's `data`, which the `effect` changes.

    Raises
    ------
    InputError
        There are none.
    """
    entry = data["joints"][joint]
    if entry == "ideal":
        raise InputError(
            f"effects: {effect} needs the data of {joint}; write the joint as a mapping with journal, journal_radius, "
            "bearing_radius and contact, and 'loose: false' where it is to be ideal otherwise"
        )
    return entry


def data_of_pins(data: dict[str, Any], effect: str) -> list[dict[str, Any]]:
    """The data of those pins in a mechanism file's `data` that have any, which the `effect` changes.

    Raises
    ------
    InputError
        Neither has.
    """
    described = [pin for pin in PINS if data["joints"][pin] != "ideal"] or PINS
    return [joint_data(data, effect, pin) for pin in described]


def page(order: int) -> Callable[[type[Effect]], type[Effect]]:
    """Make an effect of the catalogue, at the place `order`, of the class that is decorated."""

    def decorate(cls: type[Effect]) -> type[Effect]:
        name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", cls.__name__).lower()
        section, options = cls.PARAMETERS, {"__module__": cls.__module__}
        if not isinstance(section, type):
            section = create_model(f"{cls.__name__}Parameters", __base__=Section, **options, **section)
            section.__doc__ = f"Parameters of ``{name}``."
        parameters = (section, section() if cls.OPTIONAL else ...)
        effect = create_model(
            cls.__name__, __base__=cls, **options, name=(Literal[name], ...), **cls.KEYS, parameters=parameters
        )
        effect.__doc__, effect.NAME, effect.ORDER = cls.__doc__, name, order
        if section is not cls.PARAMETERS:
            setattr(effect, section.__name__, section)  # where pickle looks for it
            section.__qualname__ = f"{effect.__name__}.{section.__name__}"
        return effect

    return decorate


PIN = {"site": (Literal["crank_pin", "piston_pin"], Field(description="the pin"))}
"""The key ``site`` of effects in a pin."""
