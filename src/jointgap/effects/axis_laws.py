"""Force laws of a body with one degree of freedom: those of the slider, for a body that slides or
turns.

On a body that turns the position is an angle and the force a torque. The laws keep their equations;
the names and units of their parameters change.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from jointgap.core.candidates import Candidate, LawFamily, Parameter
from jointgap.effects import EFFECTS
from jointgap.effects.base import (
    Effect,
    FitContext,
    MotionScale,
    ParameterDescription,
    parameters_of,
)

SITE = "axis"
BACKLASH = "backlash"

_PREFIX = "slider_"
_OTHER_NAMES = {"harmonic_force": "oscillating_force"}  # without the prefix
_OF_SLIDERS = re.compile(r", sgn v = tanh\([^)]*\)| of the guide|, not locked to the crank")
_NOT_ON_AN_AXIS = ("gas_pressure", "slider_force_table", "discovered_slider_force")

_ROTARY_KEYS = {
    "force_N": "torque_N_m",
    "damping_N_s_m": "damping_N_m_s",
    "drag_N_s2_m2": "drag_N_m_s2",
    "stiffness_N_m": "stiffness_N_m_rad",
    "rest_position_m": "rest_angle_rad",
    "speed_m_s": "speed_rad_s",
    "stribeck_speed_m_s": "stribeck_speed_rad_s",
    "tightest_position_m": "tightest_angle_rad",
    "length_m": "span_rad",
    "play_m": "play_rad",
}
"""Parameter of a law on a body that turns, by that on a body that slides."""

_ROTARY_WORDS = {"force": "torque", "position": "angle", "length": "angle"}

_ROTARY_UNITS = {
    "N": "N*m",
    "N*s/m": "N*m*s",
    "N*s^2/m^2": "N*m*s^2",
    "N/m": "N*m/rad",
    "m": "rad",
    "m/s": "rad/s",
}


class AxisLaw(NamedTuple):
    """A law that an axis can lack."""

    name: str
    words: str  # Name in a verdict
    law: str  # Equation
    effect: type[Effect] | None  # None: a play, which is no force


def _renamed(name: str) -> str:
    """The name of a law of the slider on an axis."""
    return _OTHER_NAMES.get(name, name.removeprefix(_PREFIX))


def _laws() -> Iterator[AxisLaw]:
    for effect in EFFECTS.values():
        if effect.GROUP == "slider" and effect.NAME not in _NOT_ON_AN_AXIS:
            words = re.sub(r" (of|on) the slider( guide)?", "", effect.WORDS)
            law = _OF_SLIDERS.sub("", effect.LAW)
            yield AxisLaw(_renamed(effect.NAME), words, law, effect)
    law = "the motion reaches the rest through a play of play_m or play_rad"
    yield AxisLaw(BACKLASH, "a backlash", law, None)


AXIS_LAWS = {law.name: law for law in _laws()}
"""Every law by its name; those of families are no candidates themselves."""


def axis_parameters(name: str) -> list[ParameterDescription]:
    """Parameters of the law `name`, on a body that slides and on one that turns."""
    if name == BACKLASH:
        described = [ParameterDescription("play_m", "m", ">= 0", "", "width of the play")]
    else:
        described = [
            p._replace(meaning=p.meaning.replace("slider ", "").replace(" along +x", ""))
            for p in parameters_of(AXIS_LAWS[name].effect)
        ]
    rotary = [
        ParameterDescription(
            _ROTARY_KEYS[p.name],
            _ROTARY_UNITS.get(p.unit, p.unit),
            p.bounds,
            p.default,
            re.sub("|".join(_ROTARY_WORDS), lambda word: _ROTARY_WORDS[word[0]], p.meaning),
        )
        for p in described
        if p.name in _ROTARY_KEYS
    ]
    return described + rotary


def axis_candidates(
    scale: MotionScale, middles: Mapping[str, float], turns: bool
) -> list[Candidate]:
    """The force laws that an axis can lack; `middles` [s] of the records by run; `turns`: its
    position is an angle."""
    frequency = scale.turning / 6.0
    context = FitContext(None, scale, {}, True, frequency, list(middles), middles)
    candidates = []
    for law in AXIS_LAWS.values():
        for candidate in law.effect.candidates(context) if law.effect else ():
            candidates.append(_on_axis(candidate, turns))
    return candidates


def backlash_candidate(scale: MotionScale, turns: bool) -> Candidate:
    """The play through which a given motion reaches the rest of the mechanism."""
    key, unit = ("play_rad", "rad") if turns else ("play_m", "m")
    play = Parameter(key, 0.0, 0.0, 2.0 * scale.stroke, 0.02 * scale.stroke, unit)
    return Candidate(BACKLASH, SITE, (play,), (key,))


def _on_axis(candidate: Candidate, turns: bool) -> Candidate:
    """A candidate of the slider with the names and units of an axis."""
    keys = _ROTARY_KEYS if turns else {}
    units = _ROTARY_UNITS if turns else {}

    def converted(function: Callable[[Mapping[str, float]], dict[str, float]]) -> Callable:
        back = {new: old for old, new in keys.items()}

        def convert(values: Mapping[str, float]) -> dict[str, float]:
            sliding = function({back.get(key, key): value for key, value in values.items()})
            return {keys.get(key, key): value for key, value in sliding.items()}

        return convert

    return replace(
        candidate,
        name=_renamed(candidate.name),
        site=SITE,
        coordinates=tuple(
            replace(p, name=keys.get(p.name, p.name), unit=units.get(p.unit, p.unit))
            for p in candidate.coordinates
        ),
        amplitudes=tuple(keys.get(key, key) for key in candidate.amplitudes),
        initial_guesses=tuple(
            {keys.get(key, key): value for key, value in guess.items()}
            for guess in candidate.initial_guesses
        ),
        parameters=converted(candidate.parameters),
        carrier=_renamed(candidate.carrier),
        families=tuple(
            _family_on_axis(family, turns, keys, converted) for family in candidate.families
        ),
    )


def _family_on_axis(
    family: LawFamily, turns: bool, keys: Mapping[str, str], converted: Callable
) -> LawFamily:
    shape = keys.get(family.shape, family.shape)
    return replace(
        family, law=_on_axis(family.law, turns), shape=shape, values=converted(family.values)
    )


def law_numbers(name: str, parameters: Mapping[str, Any]) -> dict[str, float]:
    """Numbers of the compiled law with the stated `parameters`."""
    back = {new: old for old, new in _ROTARY_KEYS.items()}
    effect, records = AXIS_LAWS[name].effect, {"sites": {}}
    values = {back.get(key, key): value for key, value in parameters.items()}
    effect(name=effect.NAME, parameters=values).compile_into(records)
    return records["sites"][effect.BODY]
