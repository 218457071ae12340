"""Other values in a scenario: by a word, such as clearance, for all loose joints at once, or by the path of a key."""

from typing import Any

from jointgap.config.change import OF_LOOSE_JOINTS, loose_paths, radius_with
from jointgap.config.load import validate
from jointgap.config.scenario import DrivenMechanism
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import FROM_FRAME
from jointgap.core.units import to_si
from jointgap.section import Section

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
