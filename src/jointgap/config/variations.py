"""Sections with other values: what differs is given as in a file, and all of it is checked again."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

from jointgap.config.load import validate
from jointgap.config.mechanism import Mechanism
from jointgap.config.scenario import DrivenMechanism
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import FROM_FRAME, JOINTS
from jointgap.core.section import Section
from jointgap.core.units import to_si

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


_LINKS = {"crank_length": "crank", "rod_length": "rod"}

VARIED_BY_WORD = {"speed": "rad/s"} | OF_LOOSE_JOINTS | dict.fromkeys(_LINKS, "m")
"""What can be varied by a word, with its unit: the crank's speed, the data of every loose joint, and lengths of links,
whose mass centres keep their share of the length.
"""


def with_values(base: DrivenMechanism, changes: dict[str, Any], source: str) -> DrivenMechanism:
    """A driven mechanism with other values. What holds none of them has been checked and is taken over as it is."""
    data = dict(base)
    for key, value in sorted(changes.items(), key=lambda change: _turn(change[0])):
        for path in _paths(data, key, source):
            holder, last = _holder(data, path, key, source)
            value_in_place = _value_in_place(holder, key, value, source)
            if key in _LINKS:
                holder["mass_centre"] *= value_in_place / holder[last]
            holder[last] = value_in_place
    words = ", ".join(f"{key} = {value}" for key, value in changes.items())
    changed = validate(DrivenMechanism, data, f"{source}, {words}")
    unread = [key for key in changes if key in ("speed", "simulate.speed")]
    if unread and changed.simulate.drive.kind == "measured":
        raise InputError(f"{source}.{unread[0]}: a measured drive does not read simulate.speed; vary something else")
    return changed


def _turn(key: str) -> int:
    """When a key is set: a word after the paths that it builds on, and a clearance after the radius of the journal."""
    return 2 if key == "clearance" else int(key in VARIED_BY_WORD)


def unit_of(base: DrivenMechanism, key: str, source: str) -> str:
    """SI unit of the number at a `key`, as `jointgap.core.units.to_si` takes it; '' for a pure number."""
    if key in VARIED_BY_WORD:
        return VARIED_BY_WORD[key].replace("1", "")
    data = dict(base)
    path = _paths(data, key, source)[0]
    _holder(data, path, key, source)  # complains where there is no such key
    holder: Any = base
    for step in path[:-1]:
        holder = _effect(holder, step) if isinstance(holder, tuple) else getattr(holder, step)
    described = type(holder).model_json_schema()["properties"][path[-1]]
    units = {kind["unit"] for kind in (described, *described.get("anyOf", ())) if "unit" in kind}
    if not units:
        raise InputError(f"{source}.{key}: is no number with a unit; list its values instead of giving a range")
    return units.pop().replace("1", "")


def _effect(effects: tuple, name: str) -> Any:
    return next(each for each in effects if name in (each.name, f"{each.name}@{each.place}"))


def _inside(holder: dict | list, key: Any) -> Any:
    """What `holder` has at `key`, opened: a section as a mapping, effects as a list, either a copy to be changed."""
    inner = holder[key]
    if isinstance(inner, Section | dict):
        holder[key] = inner = dict(inner)
    elif isinstance(inner, tuple):
        holder[key] = inner = [dict(effect) for effect in inner]
    return inner


def _paths(data: dict, key: str, source: str) -> list[tuple[str, ...]]:
    """Where the value of `key` belongs in `data`, a driven mechanism opened as far as `_inside` has been."""
    if key == "speed":
        return [("simulate", "speed")]
    if key in _LINKS:
        return [("mechanism", _LINKS[key], "length")]
    if key in VARIED_BY_WORD:
        joints = _inside(_inside(data, "mechanism"), "joints")
        loose = [name for name in FROM_FRAME if _is_loose(joints[name])]
        inside = loose_paths(loose, key, f"{source}.{key}")
        return [("mechanism", *path[:-1], "bearing_radius" if key == "clearance" else key) for path in inside]
    path = tuple(key.split("."))
    if path[:2] == ("mechanism", "contacts"):
        raise InputError(
            f"{source}.{key}: contacts are copied into the joints; vary mechanism.joints.<joint>.contact.{path[-1]}"
        )
    if len(path) < 2:
        raise InputError(f"{source}.{key}: no such word; {did_you_mean(key, VARIED_BY_WORD)} Else give a path of keys")
    return [path]


def _is_loose(joint: Any) -> bool:
    """Of a joint as `_inside` has it: the word ideal, a section or a mapping."""
    return joint != "ideal" and (joint["loose"] if isinstance(joint, dict) else joint.loose)


def _holder(data: Any, path: tuple[str, ...], key: str, source: str) -> tuple[dict, str]:
    """The mapping that holds the end of `path`, and the key there.

    Effects go by their name, or by name@site if listed twice.
    """
    for depth, step in enumerate(path):
        entries = _places(data) if isinstance(data, list) else data if isinstance(data, dict) else {}
        if step not in entries:
            place = ".".join(path[:depth]) or "the scenario"
            folded = (
                "; effects which only change data are folded in, so vary the key itself, such as mechanism.slider.mass"
                if path[:depth] == ("mechanism", "effects")
                else ""
            )
            hint = did_you_mean(step, entries) if entries else "nothing is listed there"
            raise InputError(f"{source}.{key}: {place} has no '{step}'; {hint}{folded}")
        if depth == len(path) - 1:
            if isinstance(data, list):
                raise InputError(
                    f"{source}.{key}: names a whole effect; go on to a number, such as {key}.parameters.<name>"
                )
            return data, step
        data = _inside(data, entries[step] if isinstance(data, list) else step)
    raise AssertionError("a path has at least one step")


def _places(effects: list[dict]) -> dict[str, int]:
    names = [effect["name"] for effect in effects]
    return {
        name if names.count(name) == 1 else f"{name}@{effect['site']}": place
        for place, (name, effect) in enumerate(zip(names, effects, strict=True))
    }


def _value_in_place(holder: dict, key: str, value: Any, source: str) -> Any:
    """The value as the scenario holds it: of a clearance the bearing's radius, of a length metres."""
    if key == "clearance":
        return radius_with(holder, value, f"{source}.clearance")
    if key not in _LINKS:
        return value
    try:
        return to_si(value, "m")
    except ValueError as error:
        raise InputError(f"{source}.{key} = {value!r}: {error}") from error


def stored_value(changed: DrivenMechanism, key: str, value: Any, source: str) -> float | int | str | bool | None:
    """What the table of runs says of a varied value: in SI, as the scenario understood it."""
    data = dict(changed)
    holder, last = _holder(data, _paths(data, key, source)[0], key, source)
    stored = holder[last]
    if key == "clearance":
        stored = float(f"{stored - holder['journal_radius']:.12g}")
    return stored if isinstance(stored, float | int | str | bool | None) else str(value)
