"""Sections with other values: what differs is given as in a file, and all of it is checked again."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

from jointgap.config.load import validate
from jointgap.config.mechanism_config import Mechanism
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import JOINTS
from jointgap.core.units import to_si
from jointgap.section import Section

AnySection = TypeVar("AnySection", bound=Section)

OF_LOOSE_JOINTS = {"clearance": "m", "friction": "1", "restitution": "1", "stiffness": "1"}
"""Words that stand for a value of every loose joint, with its unit: the radial clearance, and three of the contact (the
stiffness in N/m^exponent).
"""


def change(section: AnySection, changes: Mapping[str, Any]) -> AnySection:
    """A mechanism, or another part of a configuration, with other values.

    What is given stays as it is: sections cannot be changed in place. All values are checked again, units included.

    Parameters
    ----------
    section : Mechanism, Simulate, Joint, Contact or another section
        What to change a copy of.
    changes : mapping
        New values by key, nested as in a file (``{"slider": {"mass": "1.2 kg"}}``) or by the path of a key
        (``{"slider.mass": "1.2 kg"}``). Of a mechanism further: ``clearance`` (radial), ``friction``,
        ``restitution`` and ``stiffness`` set those of every loose joint, ``joints.crank_pin.clearance`` sets the
        bearing's radius of one, an entry of ``contacts`` changes the joints that refer to it, and an effect goes by its
        name (``effects.gravity.parameters...``), or by ``name@site`` where it is listed twice.

    Returns
    -------
    section of the same kind

    Raises
    ------
    InputError
        No such key, or a value that is impossible; the message names it.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> heavier = jg.change(mechanism, {"slider.mass": "1.2 kg", "clearance": "0.2 mm"})
    >>> heavier.slider.mass, round(heavier.clearance("crank_pin"), 9)
    (1.2, 0.0002)
    """
    name = type(section).__name__
    data = section.model_dump()
    given = _nested(changes)
    if isinstance(section, Mechanism):
        _copy_contacts(section, given, name)
        for word in OF_LOOSE_JOINTS:
            if word in given:
                value = given.pop(word)
                for path in loose_paths(section.loose, word, f"{name}: {word}"):
                    _put(given, path, value)
    _lay(data, given, name, "")
    if isinstance(section, Mechanism):
        _clearances_to_radii(data["joints"], name)
    return validate(type(section), data, name)


def loose_paths(joints: Sequence[str], word: str, named: str) -> list[tuple[str, ...]]:
    """Where a value of every loose joint stands in a mechanism."""
    if not joints:
        raise InputError(f"{named}: the mechanism has no loose joint to change it in; make one loose")
    inside = (word,) if word == "clearance" else ("contact", word)
    return [("joints", joint, *inside) for joint in joints]


def radius_with(joint: Mapping[str, Any], clearance: Any, named: str) -> float:
    """The bearing's radius [m] of a `joint` that gets another radial `clearance`; `named` is what errors call it."""
    try:
        return to_si(joint["journal_radius"], "m") + to_si(clearance, "m")
    except ValueError as error:
        raise InputError(f"{named} = {clearance!r}: {error}") from error


def _nested(changes: Mapping[str, Any]) -> dict[str, Any]:
    """`changes` with the paths among their keys taken apart: ``slider.mass`` is the key mass within slider."""
    nested: dict[str, Any] = {}
    for key, value in changes.items():
        _put(nested, tuple(str(key).split(".")), _nested(value) if isinstance(value, Mapping) else value)
    return nested


def _put(data: dict[str, Any], path: tuple[str, ...], value: Any) -> None:
    for step in path[:-1]:
        inner = data.get(step)
        data[step] = inner if isinstance(inner, dict) else {}
        data = data[step]
    both = isinstance(value, dict) and isinstance(data.get(path[-1]), dict)
    data[path[-1]] = data[path[-1]] | value if both else value


def _lay(data: dict[str, Any], over: Mapping[str, Any], name: str, place: str) -> None:
    """Lay `over` on `data`, key by key; a section of another kind is replaced whole."""
    for key, value in over.items():
        there = data.get(key)
        if isinstance(there, list | tuple) and isinstance(value, Mapping):
            for effect, changed in _by_name(there, value, name, f"{place}{key}"):
                _lay(effect, changed, name, f"{place}{key}.")
        elif isinstance(there, dict) and isinstance(value, Mapping) and value.get("kind") in (None, there.get("kind")):
            _lay(there, value, name, f"{place}{key}.")
        else:
            data[key] = value


def _by_name(effects: Any, changes: Mapping[str, Any], name: str, place: str) -> Iterator[tuple[dict, Mapping]]:
    """Effects of a list with what changes of each, by its name."""
    names = [effect["name"] for effect in effects]
    listed = {
        key if names.count(key) == 1 else f"{key}@{effect['site']}": effect
        for key, effect in zip(names, effects, strict=True)
    }
    for key, changed in changes.items():
        if key not in listed or not isinstance(changed, Mapping):
            hint = did_you_mean(key, listed) if listed else "give the list of effects that it shall have"
            raise InputError(f"{name}: {place} has no '{key}'; {hint}")
        yield listed[key], changed


def _copy_contacts(mechanism: Mechanism, given: dict[str, Any], name: str) -> None:
    """Let joints follow the entries of contacts that they refer to: their contacts are copies, once read."""
    for key in given.get("contacts") or {}:
        old = mechanism.contacts.get(key)
        if old is None:
            continue
        own = {joint: mechanism.joint(joint) for joint in JOINTS}
        following = [joint for joint, data in own.items() if data is not None and data.contact == old]
        alike = [other for other, contact in mechanism.contacts.items() if contact == old]
        if len(alike) > 1 and following:
            raise InputError(
                f"{name}: contacts.{key} is the same as contacts.{next(other for other in alike if other != key)}, so "
                f"it cannot be told which joints refer to it; change joints.{following[0]}.contact and so on instead"
            )
        for joint in following:
            _put(given, ("joints", joint, "contact"), dict(given["contacts"][key]))


def _clearances_to_radii(joints: dict[str, Any], name: str) -> None:
    for key, joint in joints.items():
        if isinstance(joint, dict) and "clearance" in joint:
            clearance, named = joint.pop("clearance"), f"{name}: joints.{key}.clearance"
            if "journal_radius" not in joint:
                raise InputError(f"{named}: give journal_radius too, for the joint has none")
            joint["bearing_radius"] = radius_with(joint, clearance, named)
