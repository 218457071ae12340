"""Base classes of effects: see `Effect`, and docs/how_to/add_effect.md for how to write one."""

import importlib
import math
import re
import string
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, ClassVar, Literal, NamedTuple, get_args

import numpy as np
from pydantic import ConfigDict, Field, create_model, model_validator

from jointgap.core.candidates import Candidate, LawFamily, Parameter
from jointgap.core.errors import InputError
from jointgap.core.formula import (
    ADD,
    DEEPEST_STACK,
    LONGEST_FORMULA,
    NOTHING,
    NUMBER,
    POWER,
    VARIABLE,
    Program,
    compile_formula,
)
from jointgap.core.section import ConfigModel
from jointgap.core.sites import SLIDER_CRANK, Sites
from jointgap.core.units import quantity
from jointgap.core.words import joined

#: Width [m/s] of the sign of the slider's velocity in its friction: sgn v = tanh(v / 0.01 m/s).
SLIDER_SIGN_SPEED = 0.01

#: Width [rad/s] of the sign of a speed of rotation in friction: sgn w = tanh(w / 0.1 rad/s).
CRANK_SIGN_SPEED = 0.1

CRANK_SIGN = f"sgn w = tanh(w / {CRANK_SIGN_SPEED:g} rad/s)"

FRICTION_SURVEY = "Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083-1138"

#: Share of a quantity that is barely detectable: scale of the steps of finite differences.
DETECTABLE_SHARE = 0.02

#: Groups of effects, in the order in which a fit tries them.
GROUPS = ("slider", "crank", "bodies", "pins", "clearances")

#: Values of a fit's coordinates by key.
Values = Mapping[str, float]

#: Candidates of an effect, one for each site.
Candidates = Iterable[Candidate]

#: Numbers by record and name for the equations of motion. ``sites``: those of the laws by body;
#: ``formulas``: programs by body.
Records = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class MotionScale:
    """Magnitudes of the motion of a body on a slide that set the steps of a fit; of a body on a
    pivot the force acts at the distance `stroke`.

    Attributes
    ----------
    stroke, speed, turning : float
        Half the stroke [m], root mean square speed on the slide [m/s]; root mean square speed of
        the crank, or of the body on the pivot [rad/s].
    force : float
        A barely detectable force on the body [N].
    guide : float
        Guide force [N].
    middle : float
        Position at mid-stroke [m]; of a body on a pivot the mean of its extreme angles [rad].
    swing : float
        Half the difference of the extreme angles of a body on a pivot [rad].
    """

    stroke: float
    speed: float
    turning: float
    force: float
    guide: float
    middle: float
    swing: float = 0.0

    @classmethod
    def of(cls, mechanism: Any, turning: float) -> "MotionScale":
        """For a `mechanism` (`jointgap.config.Mechanism`) with the crank speed `turning`
        [rad/s]."""
        crank, rod = mechanism.crank.length, mechanism.rod.length
        mass = mechanism.slider.mass + 0.5 * mechanism.rod.mass
        inertia = mass * crank * turning**2 / math.sqrt(2.0)
        speed = crank * turning / math.sqrt(2.0)
        return cls(crank, speed, turning, DETECTABLE_SHARE * inertia, inertia * crank / rod, rod)


@dataclass(frozen=True)
class FitContext:
    """Input of `Effect.candidates`.

    Attributes
    ----------
    mechanism : jointgap.config.Mechanism
    scale : MotionScale
    nuisances : mapping of str to Parameter
        Nuisances shared by all runs, by name.
    constant_speed : bool
        Whether the crank is driven at a constant speed.
    frequency_Hz : float
        Start value for the frequency of an oscillating force.
    runs : sequence of str
    middles : mapping of str to float
        Middle of the record [s] by run, as far as it is known.
    scales : mapping of str to MotionScale
        By body, where they differ from `scale`.
    """

    mechanism: Any
    scale: MotionScale
    nuisances: Mapping[str, Parameter]
    constant_speed: bool
    frequency_Hz: float
    runs: Sequence[str]
    middles: Mapping[str, float] = field(default_factory=dict)
    scales: Mapping[str, MotionScale] = field(default_factory=dict)

    def at(self, body: str) -> MotionScale:
        """Magnitudes of the motion of a body."""
        return self.scales.get(body, self.scale)

    def replaced(self, amplitudes: Mapping[str, str]) -> dict[str, str]:
        """`amplitudes` by the nuisance that they replace, as far as the campaign has it."""
        return {nuisance: key for nuisance, key in amplitudes.items() if nuisance in self.nuisances}


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect.

    Attributes
    ----------
    unit : str
        SI, by its pint name; empty for pure numbers.
    meaning : str
        Symbol in the law and description.
    example, default : float
        A typical value; the value of an entry without the parameter (default: required).
    compiled : str
        Its name in the compiled law.
    off : float
        Its value there without the effect.
    odd : bool
        Whether mirroring changes its sign; see `Effect.mirrored`.
    step : function
        Barely detectable size, for a fitted parameter that is 0 without the effect.
    gt, ge, lt, le, multiple_of : float
        Limits.
    """

    unit: str
    meaning: str
    example: float
    default: Any = ...
    compiled: str = ""
    off: float = 0.0
    odd: bool = False
    step: Callable[[MotionScale], float] | None = None
    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None
    multiple_of: float | None = None

    @property
    def limits(self) -> dict[str, float]:
        """Limits by name."""
        limits = {key: getattr(self, key) for key in ("gt", "ge", "lt", "le", "multiple_of")}
        return {key: limit for key, limit in limits.items() if limit is not None}


parameter = EffectParameter


def amplitude(
    name: str, step: float, unit: str, low: float = -math.inf, high: float = math.inf
) -> Parameter:
    """A coordinate `name` of a fit that is 0 without the effect; `step`, `low` and `high` in
    `unit`."""
    return Parameter(name, 0.0, low, high, step, unit)


def size_and_angle(values: Values, size: str, angle: str) -> dict[str, float]:
    """The parameters `size` and `angle` [rad], from the values of the coordinates ``cosine`` and
    ``sine``."""
    cosine, sine = values["cosine"], values["sine"]
    return {size: math.hypot(cosine, sine), angle: math.atan2(sine, cosine)}


class Effect(ConfigModel):
    """A physical effect besides contact and friction in the joints; active if a mechanism file
    lists it.

    A subclass with the decorator `register_effect` is a law; `effects_of` places it at the sites of
    a mechanism: ``{site}`` in its texts is then the name of the body or joint. Its entry in a
    mechanism file has the keys ``name``, those of `KEYS`, and ``parameters``. Symbols of the laws:
    velocity v and position x of the body, crank speed w and angle theta, time t.

    Attributes
    ----------
    LAW_NAME, ORDER, DESCRIBED : str, int, mapping of str to `parameter`
        Name of the law (of the class, in snake case), position in the catalogue and parameters, set
        by `register_effect`.
    ON : str
        Kind of its sites: a key of `SITES`.
    RULE : str
        Name of the effect; default: ``{site}_LAW_NAME``, or ``LAW_NAME`` of a mechanism.
    ALIASES : mapping of str to str
        Name at a site where it does not follow the rule.
    OF_SLIDER_CRANK : tuple of str
        The only sites of a slider-crank at which it acts; None: all.
    ANY_LINKAGE : bool
        Whether it acts in linkages other than the slider-crank.
    NAME : str
        Name at its site.
    GROUP : str
        One of `GROUPS`.
    BODY, SITE : str
        The body or joint at which it is placed; its location in a verdict, if that is another one
        (``{joint}``: of body and frame). Effects with several locations have the key ``site``.
    PLACES : str
        Attribute of `jointgap.core.sites.Sites` with the values of that key; empty without it.
    LAW, REFERENCE : str
        Equation with the symbols of the parameters' descriptions; its source, or ``definition``.
    WORDS : str
        Name in a verdict; may contain ``{site}``.
    KEYS : mapping of str to (type, Field)
        Further keys of an entry besides ``name`` and ``parameters``.
    PARAMETERS : ConfigModel
        Parameters, with units in their names, if they are not class attributes (`parameter`).
    ANGLE : str
        The parameter that is the phase or direction [rad] of the parameter with a ``step``; a fit
        varies ``cosine`` and ``sine`` instead.
    OPTIONAL : bool
        Whether an entry may omit ``parameters``.
    ADDS_TO : mapping of str to (str, str)
        For a `DataEffect`: body and key of the mechanism file to which each parameter is added.
    DRIVE : str
        The required kind of drive; empty for all.
    MEMBERS : mapping of str to float
        For the law of a family: its members (their `LAW_NAME`, once placed their `NAME`) and the
        shape [1] of each. The shape is fitted once a member is found.
    SHAPE, IN_USE : str, tuple of float
        For the law of a family: the shape parameter, and shapes of common laws.
    ACTS_AT_ZERO : bool
        Whether it changes the mechanism even with amplitude 0.
    SEVERAL : bool
        Whether several entries may act at one location; their sum acts.
    """

    model_config = ConfigDict(ignored_types=(EffectParameter,))

    NAME: ClassVar[str]
    LAW_NAME: ClassVar[str]
    ORDER: ClassVar[int]
    ON: ClassVar[str]
    RULE: ClassVar[str] = ""
    ALIASES: ClassVar[Mapping[str, str]] = {}
    OF_SLIDER_CRANK: ClassVar[tuple[str, ...] | None] = None
    ANY_LINKAGE: ClassVar[bool] = True
    GROUP: ClassVar[str]
    SITE: ClassVar[str] = ""
    BODY: ClassVar[str]
    PLACES: ClassVar[str] = ""
    SITES: ClassVar[Sites]
    LAW: ClassVar[str]
    REFERENCE: ClassVar[str] = "definition"
    WORDS: ClassVar[str]
    KEYS: ClassVar[Mapping[str, Any]] = {}
    PARAMETERS: ClassVar[type[ConfigModel] | None] = None
    DESCRIBED: ClassVar[Mapping[str, EffectParameter]]
    ANGLE: ClassVar[str] = ""
    OPTIONAL: ClassVar[bool] = False
    ADDS_TO: ClassVar[Mapping[str, tuple[str, str]]] = {}
    DRIVE: ClassVar[str] = ""
    MEMBERS: ClassVar[Mapping[str, float]] = {}
    SHAPE: ClassVar[str] = ""
    IN_USE: ClassVar[tuple[float, ...]] = (0.0, 0.5, 1.0)
    ACTS_AT_ZERO: ClassVar[bool] = False
    SEVERAL: ClassVar[bool] = False

    @classmethod
    def described_at(cls, sites: Sites) -> Mapping[str, EffectParameter]:
        """Its parameters in a mechanism."""
        return cls.DESCRIBED

    @classmethod
    def adds_to_at(cls, site: str, sites: Sites) -> Mapping[str, tuple[str, str]]:
        """Body and key to which each of its parameters is added."""
        return {key: (body.format(site=site), datum) for key, (body, datum) in cls.ADDS_TO.items()}

    @classmethod
    def sites(cls) -> tuple[str, ...]:
        """Possible values of the key ``site``; () if there is no choice."""
        return get_args(cls.model_fields["site"].annotation) if "site" in cls.model_fields else ()

    @property
    def place(self) -> str:
        """Its site."""
        return getattr(self, "site", self.SITE)

    def changes_data(self, mechanism: Any) -> bool:
        """Whether it only changes data of `mechanism`; see `DataEffect`."""
        return False

    def check(self, mechanism: Any) -> None:
        """ValueError if it cannot act in `mechanism`, to which all data effects were applied."""

    def compile_into(self, records: Records) -> None:
        """Write its parameters into the records of the equations of motion."""
        site = records["sites"].setdefault(self.BODY, {})
        for key, described in self.DESCRIBED.items():
            if described.compiled:
                site[described.compiled] = getattr(self.parameters, key)

    def largest_force(self, stroke: float) -> float:
        """Approximate largest force [N] on the slider over a `stroke` [m]; 0 if it has no stated
        force."""
        return abs(getattr(self.parameters, "force_N", 0.0))

    def mirrored(self) -> "Effect":
        """The effect mirrored at the slide, which makes a clockwise crank turn
        counter-clockwise."""
        odd = [key for key, described in self.DESCRIBED.items() if described.odd]
        return self.with_parameters(**{key: -getattr(self.parameters, key) for key in odd})

    def with_parameters(self, **values: Any) -> "Effect":
        """The effect with other values of parameters."""
        return self.model_copy(update={"parameters": self.parameters.model_copy(update=values)})

    @classmethod
    def candidate(
        cls,
        *coordinates: Parameter,
        site: str = "",
        amplitudes: tuple[str, ...] = (),
        **attributes: Any,
    ) -> Candidate:
        """The candidate of this effect.

        Parameters
        ----------
        *coordinates : Parameter
            Coordinates of a fit.
        site : str
            If there is a choice.
        amplitudes : tuple of str
            Keys of the coordinates that are 0 without the effect; all by default.
        **attributes
            Other attributes of a `Candidate`.
        """
        keys = amplitudes or tuple(coordinate.key for coordinate in coordinates)
        return Candidate(
            cls.NAME, site or cls.SITE, coordinates, keys, has_site=bool(site), **attributes
        )

    @classmethod
    def sizes(cls, scale: MotionScale) -> tuple[Parameter, ...]:
        """Coordinates of the parameters with a ``step``, or of their cosine and sine parts."""
        coordinates = []
        for key, described in cls.DESCRIBED.items():
            if described.step is None:
                continue
            high = math.inf if described.le is None else float(described.le)
            low = -math.inf if described.ge is None else float(described.ge)
            if cls.ANGLE:
                low = -high
            for name in ("cosine", "sine") if cls.ANGLE else (key,):
                step, unit = described.step(scale), described.unit or "1"
                coordinates.append(amplitude(name, step, unit, low, high))
        return tuple(coordinates)

    @classmethod
    def stated(cls, values: Values) -> dict[str, float]:
        """Parameters for the verdict, from the values of a fit's coordinates."""
        if not cls.ANGLE:
            return dict(values)
        (size,) = (key for key, described in cls.DESCRIBED.items() if described.step)
        return size_and_angle(values, size, cls.ANGLE)

    @classmethod
    def families(cls, context: FitContext) -> tuple[LawFamily, ...]:
        """The law families that contain it."""
        laws = (law for law in effects_of(cls.SITES).values() if cls.NAME in law.MEMBERS)
        return tuple(law.family(cls, context.at(cls.BODY)) for law in laws)

    @classmethod
    def name_at_same_site(cls, law: type["Effect"]) -> str:
        """Name of another law at the same site."""
        return placed(law, cls.BODY, cls.SITES).NAME

    @classmethod
    def family(
        cls,
        member: type["Effect"],
        scale: MotionScale,
        sizes=(),
        shape_details=(),
        values: Callable = dict,
        **attributes: Any,
    ) -> LawFamily:
        """This law as family of a `member`: a fit varies the shape, `sizes` (default: those of the
        law) and `shape_details`, which are inactive at the member's shape.
        """
        sizes = sizes or cls.sizes(scale)
        member_shape, bounds = cls.MEMBERS[member.NAME], cls.DESCRIBED[cls.SHAPE]
        shape = Parameter(cls.SHAPE, member_shape, float(bounds.ge), float(bounds.le), 0.1)
        keys = tuple(size.key for size in sizes)
        law = cls.candidate(*sizes, *shape_details, shape, amplitudes=keys, **attributes)
        inactive = len(shape_details)
        return LawFamily(
            law, cls.SHAPE, member_shape, cls.IN_USE, values, inactive_at_default=inactive
        )

    @classmethod
    def candidates(cls, context: FitContext) -> Candidates:
        """One candidate for each site where it can act; default: the parameters with a ``step``."""
        sizes = cls.sizes(context.at(cls.BODY))
        if not sizes or cls.MEMBERS:
            return []
        return [cls.candidate(*sizes, parameters=cls.stated, families=cls.families(context))]

    @classmethod
    def simulated(cls, values: Values) -> tuple[Values, float]:
        """Values that are simulated instead of `values`, and the factor on their effect."""
        return values, 1.0


class DataEffect(Effect):
    """An effect that only changes data of the mechanism."""

    def changes_data(self, mechanism: Any) -> bool:
        return True

    def apply(self, data: dict[str, Any]) -> None:
        """Change `data`, the content of a mechanism file in SI; InputError if required data are
        missing."""
        for key, (body, datum) in self.ADDS_TO.items():
            body_data(data, body)[datum] += getattr(self.parameters, key)


def body_data(data: dict[str, Any], body: str) -> dict[str, Any]:
    """The entry of a body in a mechanism file's `data`."""
    return data["bodies"][body] if "bodies" in data else data[body]


def joint_data(data: dict[str, Any], effect: str, joint: str) -> dict[str, Any]:
    """The entry of a `joint` in a mechanism file's `data`; InputError if the joint is only
    ``ideal``."""
    entry = data["joints"].get(joint, "ideal")
    if entry == "ideal":
        raise InputError(
            f"effects: {effect} requires the data of {joint}; write the joint as a mapping with"
            " journal, journal_radius, bearing_radius and contact, and 'loose: false' for an ideal"
            " joint"
        )
    return entry


#: Laws in the order of registration.
LAWS: list[type[Effect]] = []

#: Sites of each kind.
SITES: dict[str, Callable[[Sites], Iterable[str]]] = {
    "mechanism": lambda sites: ("",),
    "slide": lambda sites: sites.slides,
    "slide or track": lambda sites: (*sites.slides, *sites.tracks),
    "pivot": lambda sites: (sites.crank, *sites.pivots),
    "crank": lambda sites: (sites.crank,),
    "body": lambda sites: [body for body in sites.bodies if body != sites.crank],
    "revolute": lambda sites: sites.revolutes,
}


def register_effect(order: int) -> Callable[[type[Effect]], type[Effect]]:
    """Add the decorated law to the catalogue at the position `order`."""

    def decorate(law: type[Effect]) -> type[Effect]:
        attributes = {key: value for base in law.__mro__[::-1] for key, value in vars(base).items()}
        law.LAW_NAME = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", law.__name__).lower()
        law.ORDER = order
        law.DESCRIBED = {
            key: value for key, value in attributes.items() if isinstance(value, EffectParameter)
        }
        LAWS.append(law)
        return law

    return decorate


def numbers_of(laws: Iterable[type[Effect]]) -> dict[str, float]:
    """Numbers of the compiled laws with their values without effects, by name."""
    described = (each for law in laws for each in law.DESCRIBED.values() if each.compiled)
    return {each.compiled: each.off for each in described}


@cache
def effects_of(sites: Sites) -> dict[str, type[Effect]]:
    """Every effect that can act in a mechanism by its name, in the order of the catalogue."""
    effects = {}
    for law in sorted(LAWS, key=lambda law: law.ORDER):
        for site in _sites_of(law, sites):
            effect = placed(law, site, sites)
            effects[effect.NAME] = effect
    return effects


def _sites_of(law: type[Effect], sites: Sites) -> Iterator[str]:
    is_general = sites != SLIDER_CRANK
    for site in SITES[law.ON](sites):
        if law.ANY_LINKAGE if is_general else site in (law.OF_SLIDER_CRANK or (site,)):
            yield site


@cache
def placed(law: type[Effect], site: str, sites: Sites) -> type[Effect]:
    """The effect of a law at a site of a mechanism."""
    words = site.replace("_", " ")

    lengths = ", ".join(
        f"{link}.length + {letter}"
        for link, letter in zip(sites.links, string.ascii_lowercase, strict=False)
    )

    def at_site(text: str) -> str:
        text = text.replace("{links}", joined(sites.links))
        text = text.replace("{lengths}", lengths)
        if law.ON == "revolute" and sites != SLIDER_CRANK:
            text = text.replace("the {site}", f"joint {site}")
        return text.replace("{site}", words) if site else text

    name = law.ALIASES.get(site) or name_rule(law).replace("{site}", site)
    title = "".join(part[:1].upper() + part[1:] for part in name.split("_"))
    described = law.described_at(sites)
    section, options = law.PARAMETERS, {"__module__": law.__module__}
    if section is None:
        fields = {}
        for key, value in described.items():
            default = Field(
                value.default, description=at_site(value.meaning), examples=[value.example]
            )
            fields[key] = (quantity(value.unit, **value.limits), default)
        section = create_model(f"{title}Parameters", __base__=_Parameters, **options, **fields)
        section.__doc__ = f"Parameters of ``{name}``."
        section.PLACE = law, site, sites
    keys: dict[str, Any] = {"name": (Literal[name], ...)}
    if law.PLACES:
        of = Literal[tuple(getattr(sites, law.PLACES))]
        keys["site"] = (of, Field(description="the joint"))
    keys |= law.KEYS | {"parameters": (section, section() if law.OPTIONAL else ...)}
    effect = create_model(title, __base__=(law, _Placed), **options, **keys)
    effect.__doc__ = at_site(law.__doc__)
    effect.NAME, effect.SITES, effect.DESCRIBED = name, sites, described
    effect.LAW, effect.WORDS = at_site(law.LAW), at_site(law.WORDS)
    effect.BODY, joints = site, {**sites.slides, **sites.pivots, sites.crank: sites.drive}
    shown = (law.SITE or site).replace("{joint}", joints.get(site, ""))
    shown = shown.replace("{links}", ", ".join(sites.links))
    effect.SITE = shown.replace("{bearings}", " or ".join(sites.bearings))
    effect.ADDS_TO = law.adds_to_at(site, sites)
    members = {other.LAW_NAME: other for other in LAWS if other.__module__ == law.__module__}
    effect.MEMBERS = {
        placed(members[member], site, sites).NAME: shape for member, shape in law.MEMBERS.items()
    }
    return effect


def name_rules() -> list[str]:
    """Rules of the names of effects at a site, with ``{site}``."""
    return list(dict.fromkeys(name_rule(law) for law in LAWS if law.ON != "mechanism"))


@cache
def effects_named(name: str) -> tuple[type[Effect], ...]:
    """The effects whose rule gives a `name`, in a mechanism with a site of that name: of several
    the words are the same and the parameters different."""
    found = []
    for law in LAWS:
        match = re.fullmatch(name_rule(law).replace("{site}", r"([a-zA-Z]\w*)"), name)
        if match and law.ON != "mechanism":
            site = match[1]
            found.append(placed(law, site, Sites(site, site, (site,), {site: site})))
    return tuple(found)


def name_rule(law: type[Effect]) -> str:
    """Name of the effects of a law, with ``{site}``."""
    return law.RULE or ("" if law.ON == "mechanism" else "{site}_") + law.LAW_NAME


class _Placed:
    """A placed effect: its class exists in no module."""

    def __reduce__(self) -> tuple:
        keys = {name: value for name, value in self.__dict__.items() if name != "parameters"}
        place = _law_of(type(self)), self.BODY, self.SITES
        return _restored, (*place, keys, dict(self.parameters.__dict__))


class _Parameters(ConfigModel):
    """Parameters of a placed effect."""

    PLACE: ClassVar[tuple[type[Effect], str, Sites]]

    def __reduce__(self) -> tuple:
        law, site, sites = self.PLACE
        return _restored_parameters, (_name_of(law), site, sites, dict(self.__dict__))


def _name_of(law: type[Effect]) -> tuple[str, str]:
    return law.__module__, law.__name__


def _law_of(effect: type[Effect]) -> tuple[str, str]:
    """Module and name of the law of a placed effect."""
    return _name_of(effect.__mro__[1])


def _effect_class(law: tuple[str, str], site: str, sites: Sites) -> type[Effect]:
    return placed(getattr(importlib.import_module(law[0]), law[1]), site, sites)


def _restored_parameters(law: tuple, site: str, sites: Sites, values: dict) -> ConfigModel:
    section = _effect_class(law, site, sites).model_fields["parameters"].annotation
    return section.model_construct(**values)


def _restored(law: tuple, site: str, sites: Sites, keys: dict, values: dict) -> Effect:
    effect = _effect_class(law, site, sites)
    section = effect.model_fields["parameters"].annotation
    return effect.model_construct(**keys, parameters=section.model_construct(**values))


class FormulaParameters(ConfigModel):
    """Parameters of ``discovered_slider_force``, ``discovered_crank_torque`` and others."""

    formula: str = Field(
        description=(
            "SI; of v, x (slider), w, theta (crank), t, pi, sin cos tan tanh exp log sqrt abs sgn,"
            " bars, ^"
        ),
        examples=["-a*v*|v| + b*sin(theta)"],
    )
    coefficients: dict[str, quantity("")] = Field(
        {}, description="names in the formula -> numbers, SI", examples=[{"a": 1.2, "b": 3.0}]
    )

    @model_validator(mode="after")
    def _formula_can_be_read(self):
        compile_formula(self.formula, self.coefficients)
        return self


def _sum(left: Program, right: Program) -> Program:
    """The program of the sum of two formulas."""
    if not len(left.codes):
        return right
    shifted = right.codes + np.outer(right.codes[:, 0] == NUMBER, [0, len(left.numbers)])
    codes = np.vstack([left.codes, shifted, [[ADD, 0]]])
    is_binary = (codes[:, 0] >= ADD) & (codes[:, 0] <= POWER)
    steps = np.where(codes[:, 0] <= VARIABLE, 1, np.where(is_binary, -1, 0))
    if len(codes) > LONGEST_FORMULA or np.cumsum(steps).max() > DEEPEST_STACK:
        raise InputError(
            "effects: the formulas on one body are together too long or nested too deeply; shorten"
            " them"
        )
    return Program(codes, np.concatenate([left.numbers, right.numbers]))


class DiscoveredLaw(Effect):
    """A law given by a formula; its candidates are the single terms of a regression."""

    REFERENCE = "by regression, e.g. Brunton, Proctor and Kutz, PNAS 113 (2016) 3932-3937"
    KEYS = {"label": (str, Field("", description="name in tables and figures"))}
    PARAMETERS = FormulaParameters

    @property
    def place(self) -> str:
        """Its label, so that a body may have several labelled laws; else its site."""
        return self.label or self.SITE

    def compile_into(self, records: Records) -> None:
        super().compile_into(records)
        program = compile_formula(self.parameters.formula, self.parameters.coefficients)
        programs = records["formulas"]
        programs[self.BODY] = _sum(programs.get(self.BODY, NOTHING), program)

    @property
    def odd_variables(self) -> tuple[str, ...]:
        """Variables that change their sign in the mirror image: angles and their rates."""
        return "theta", "w"

    def mirrored(self) -> Effect:
        odd = rf"\b({'|'.join(self.odd_variables)})\b"
        formula = re.sub(odd, r"(-\1)", self.parameters.formula, flags=re.ASCII)
        return self.with_parameters(formula=formula)


class ParameterDescription(NamedTuple):
    """One parameter of an effect."""

    name: str
    unit: str  # "" for text and mappings, "1" for pure numbers
    bounds: str  # such as "0 .. 15"; "" for none
    default: str  # "" if required
    meaning: str


def parameters_of(effect: type[Effect]) -> list[ParameterDescription]:
    """The parameters of an effect in order."""
    section, rows = effect.model_fields["parameters"].annotation, []
    for name, schema in section.model_json_schema()["properties"].items():
        number = next(iter(schema.get("anyOf", [schema])))
        is_number = number.get("type") in ("number", "integer")
        unit = schema.get("unit", "1") if is_number else ""
        field = section.model_fields[name]
        default = "" if field.is_required() else _default(field.default)
        description = schema["description"]
        rows.append(ParameterDescription(name, unit, _bounds(number), default, description))
    return rows


def _default(value: Any) -> str:
    if isinstance(value, str | bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, int | float) else "none"


def _bounds(schema: dict) -> str:
    if {"minimum", "maximum"} <= schema.keys():
        return f"{schema['minimum']:g} .. {schema['maximum']:g}"
    signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    return ", ".join(f"{sign} {schema[key]:g}" for key, sign in signs.items() if key in schema)


def example(effect: type[Effect]) -> dict[str, Any]:
    """An example entry of a mechanism file."""
    site = {"site": effect.sites()[0]} if effect.sites() else {}
    fields = effect.model_fields["parameters"].annotation.model_fields
    examples = {name: field.examples[0] for name, field in fields.items()}
    parameters = {name: value for name, value in examples.items() if value is not None}
    return {"name": effect.NAME} | site | {"parameters": parameters}
