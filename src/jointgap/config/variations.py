"""Copies of sections with changed values, given as in a file and validated again."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

from jointgap.config.load import validate
from jointgap.config.mechanism import Link, Mechanism
from jointgap.config.scenario import DrivenMechanism
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import FROM_FRAME, JOINTS
from jointgap.core.section import ConfigModel
from jointgap.core.units import plain_numbers, to_si

AnyConfigModel = TypeVar("AnyConfigModel", bound=ConfigModel)

OF_LOOSE_JOINTS = {"clearance": "m", "friction": "1", "restitution": "1", "stiffness": "1"}
"""Words for a value of every loose joint, with its unit (of the stiffness N/m^exponent)."""

_LINKS = {"crank_length": "crank", "rod_length": "rod"}

_LENGTHS = [("mechanism", link, "length") for link in _LINKS.values()]
"""Paths of lengths, with which the mass centres of the links are scaled unless they are given
too."""

VARIED_BY_WORD = {"speed": "rad/s"} | OF_LOOSE_JOINTS | dict.fromkeys(_LINKS, "m")
"""Words for varied parameters, with their units."""


def set_at(data: Any, path: Sequence[str], value: Any, named: str) -> Any:
    """A copy of `data`, sections or mappings, with a `value` at a `path`; `named` is for error
    messages.

    Effects are identified by their name, or by name@site where one is listed twice. A mapping is
    merged with the existing one, unless its kind differs.
    """
    if not path:
        inner = _entries(data)
        if (
            not isinstance(value, Mapping)
            or not inner
            or value.get("kind") not in (None, inner.get("kind"))
        ):
            return value
        for key, own in value.items():
            data = set_at(data, str(key).split("."), own, named)
        return data
    step, *rest = path
    entries = _entries(data)
    if isinstance(data, list | tuple):
        entry(data, step, named, "effects")
        if not rest and not isinstance(value, Mapping):
            raise InputError(
                f"{named}: is a whole effect; give the path of a number, such as"
                f" {step}.parameters.<name>"
            )
    entries[step] = set_at(entries.get(step), rest, value, named)
    return list(entries.values()) if isinstance(data, list | tuple) else entries


def value_at(data: Any, path: Sequence[str], named: str) -> Any:
    """The value at a `path` in `data`, sections or mappings; `named` is for error messages."""
    for depth, step in enumerate(path):
        data = entry(data, step, named, ".".join(path[:depth]) or "the scenario")
    return data


def entry(data: Any, step: str, named: str, place: str) -> Any:
    """The entry `step` of `data` at a `place`, or an InputError with the existing entries."""
    entries = _entries(data)
    if step in entries:
        return entries[step]
    hint = did_you_mean(step, entries) if entries else "it is empty"
    if place == "mechanism.effects":
        hint += (
            "; effects that only change data are applied: vary the key itself, such as"
            " mechanism.slider.mass"
        )
    raise InputError(f"{named}: {place} has no '{step}'; {hint}")


def _entries(data: Any) -> dict[str, Any]:
    """The entries of `data` by key, or by name for a list of effects; a copy."""
    if not isinstance(data, list | tuple):
        return dict(data) if isinstance(data, ConfigModel | Mapping) else {}
    if not all(isinstance(each, ConfigModel | Mapping) for each in data):
        return {}
    effects = [dict(each) for each in data]
    names = [effect.get("name") for effect in effects]
    keys = (
        n if names.count(n) == 1 else f"{n}@{one.get('site')}"
        for n, one in zip(names, effects, strict=True)
    )
    return dict(zip(keys, data, strict=True))


def change(section: AnyConfigModel, changes: Mapping[str, Any]) -> AnyConfigModel:
    """Copy a mechanism, or another section of a configuration, with other values.

    Sections are immutable. All values are validated again, units included.

    Parameters
    ----------
    section : Mechanism, Simulate, Joint, Contact or another section
        ConfigModel to copy.
    changes : mapping
        New values by key, nested as in a file (``{"slider": {"mass": "1.2 kg"}}``) or by the path
        of a key (``{"slider.mass": "1.2 kg"}``). Additional keys of a mechanism: ``clearance``
        (radial), ``friction``, ``restitution`` and ``stiffness`` change every loose joint;
        ``joints.crank_pin.clearance`` changes the bearing's radius of one; an entry of ``contacts``
        changes the joints that refer to it. The length of a link scales its mass centre, as in
        sweeps and in `optimise`, unless ``mass_centre`` is given too. Effects are identified by
        name (``effects.gravity.parameters...``), or by ``name@site`` where one is listed twice.

    Returns
    -------
    section of the same kind

    Raises
    ------
    InputError
        Unknown key or invalid value.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> heavier = jg.change(mechanism, {"slider.mass": "1.2 kg", "clearance": "0.2 mm"})
    >>> heavier.slider.mass, round(heavier.clearance("crank_pin"), 9)
    (1.2, 0.0002)
    """
    name = type(section).__name__
    data, changes = dict(section), plain_numbers(changes)
    words = OF_LOOSE_JOINTS if isinstance(section, Mechanism) else ()
    # apply contacts to the joints that refer to them before the joints' own changes
    for key, value in sorted(
        changes.items(), key=lambda change: not str(change[0]).startswith("contacts")
    ):
        paths = (
            _of_loose_joints(section.loose, key, f"{name}: {key}")
            if key in words
            else [str(key).split(".")]
        )
        for path in paths:
            data = set_at(data, path, value, name)
        if isinstance(section, Mechanism) and str(key).startswith("contacts"):
            data = _with_contacts(section, data, name)
    if isinstance(section, Mechanism):
        _clearances_to_radii(data["joints"], name)
    given = set(_paths_in(changes))
    links = {"": section} if isinstance(section, Link) else {}
    if isinstance(section, Mechanism):
        links = {f"{link}.": getattr(section, link) for link in _LINKS.values()}
    for prefix, link in links.items():
        if f"{prefix}length" in given and f"{prefix}mass_centre" not in given:
            length = value_at(data, f"{prefix}length".split("."), name)
            centre = _scaled_centre(dict(link), length, f"{name}: {prefix}length")
            data = set_at(data, f"{prefix}mass_centre".split("."), centre, name)
    return validate(type(section), data, name)


def _paths_in(changes: Mapping[str, Any]) -> Iterator[str]:
    """Paths of all values in `changes`."""
    for key, value in changes.items():
        if isinstance(value, Mapping):
            yield from (f"{key}.{inner}" for inner in _paths_in(value))
        else:
            yield str(key)


def _scaled_centre(link: Mapping[str, Any], length: Any, named: str) -> float:
    """The mass centre [m] of a `link` that gets another length, as in the optimisation of the
    lengths."""
    return link["mass_centre"] * (_metres(length, named) / link["length"])


def _of_loose_joints(joints: Sequence[str], word: str, named: str) -> list[tuple[str, ...]]:
    """Paths of the values of all loose joints in a mechanism."""
    if not joints:
        raise InputError(f"{named}: the mechanism has no loose joint to change; make a joint loose")
    inside = (word,) if word == "clearance" else ("contact", word)
    return [("joints", joint, *inside) for joint in joints]


def _with_contacts(mechanism: Mechanism, data: dict[str, Any], name: str) -> dict[str, Any]:
    """`data` whose joints follow the entries of contacts that they refer to; validated joints
    contain copies."""
    joints = {joint: mechanism.joint(joint) for joint in JOINTS}
    for key, old in mechanism.contacts.items():
        following = [
            joint for joint, own in joints.items() if own is not None and own.contact == old
        ]
        if not following or not isinstance(data["contacts"].get(key), Mapping):
            continue
        if alike := [
            other
            for other, contact in mechanism.contacts.items()
            if contact == old and other != key
        ]:
            raise InputError(
                f"{name}: contacts.{key} equals contacts.{alike[0]}, so the joints that refer to it"
                f" are ambiguous; change joints.{following[0]}.contact and so on instead"
            )
        for joint in following:
            data = set_at(data, ("joints", joint, "contact"), data["contacts"][key], name)
    return data


def _clearances_to_radii(joints: Any, name: str) -> None:
    """Converts the radial clearance of joints to the bearing's radius."""
    for key, joint in joints.items() if isinstance(joints, Mapping) else ():
        if isinstance(joint, dict) and "clearance" in joint:
            clearance, named = joint.pop("clearance"), f"{name}: joints.{key}.clearance"
            if "journal_radius" not in joint:
                raise InputError(f"{named}: the joint has no journal_radius; give it too")
            joint["bearing_radius"] = _metres(joint["journal_radius"], named) + _metres(
                clearance, named
            )


def _metres(value: Any, named: str) -> float:
    try:
        return to_si(value, "m")
    except ValueError as error:
        raise InputError(f"{named} = {value!r}: {error}") from error


def with_values(base: DrivenMechanism, changes: dict[str, Any], source: str) -> DrivenMechanism:
    """A driven mechanism with other values; unchanged sections are not validated again."""
    data = dict(base)
    for key, value in sorted(
        changes.items(), key=lambda change: change[0] in VARIED_BY_WORD
    ):  # paths before words
        named = f"{source}.{key}"
        for path in _paths(data, key, named):
            if path in _LENGTHS:
                link, value = dict(value_at(data, path[:-1], named)), _metres(value, named)
                centre = (*path[:-1], "mass_centre")
                if ".".join(centre) not in changes:
                    data = set_at(data, centre, _scaled_centre(link, value, named), named)
            elif path[-1] == "clearance":
                value_at(data, path[:-1], named)  # rejects unknown joints
                value = _metres(value, named)
            else:
                value_at(data, path, named)  # rejects unknown keys
            data = set_at(data, path, value, named)
    if isinstance(data["mechanism"], dict):
        _clearances_to_radii(data["mechanism"]["joints"], source)
    words = ", ".join(f"{key} = {value}" for key, value in changes.items())
    changed = validate(DrivenMechanism, data, f"{source}, {words}")
    unread = [key for key in changes if key in ("speed", "simulate.speed")]
    if unread and changed.simulate.drive.kind == "measured":
        raise InputError(
            f"{source}.{unread[0]}: a measured drive does not use simulate.speed; vary another"
            " parameter"
        )
    return changed


def _paths(data: Any, key: str, named: str) -> list[tuple[str, ...]]:
    """Paths of `key` in `data`, a driven mechanism."""
    if key == "speed":
        return [("simulate", "speed")]
    if key in _LINKS:
        return [("mechanism", _LINKS[key], "length")]
    if key in OF_LOOSE_JOINTS:
        joints = dict(value_at(data, ("mechanism", "joints"), named))
        loose = [
            name for name in FROM_FRAME if joints[name] != "ideal" and dict(joints[name])["loose"]
        ]
        return [("mechanism", *path) for path in _of_loose_joints(loose, key, named)]
    path = tuple(key.split("."))
    if path[:2] == ("mechanism", "contacts"):
        raise InputError(
            f"{named}: contacts are copied into the joints; vary"
            f" mechanism.joints.<joint>.contact.{path[-1]}"
        )
    if len(path) < 2:
        raise InputError(
            f"{named}: no such word; {did_you_mean(key, VARIED_BY_WORD)} Or give the path of a key"
        )
    return [path]


def unit_of(base: DrivenMechanism, key: str, source: str) -> str:
    """SI unit of the number at a `key`, for `jointgap.core.units.to_si`; '' for a pure number."""
    if key in VARIED_BY_WORD:
        return VARIED_BY_WORD[key].replace("1", "")
    named = f"{source}.{key}"
    path = _paths(base, key, named)[0]
    if path[-1] == "clearance":
        return VARIED_BY_WORD["clearance"]
    value_at(base, path, named)
    section = value_at(base, path[:-1], named)
    described = (
        type(section).model_json_schema()["properties"][path[-1]]
        if isinstance(section, ConfigModel)
        else {}
    )
    units = {kind["unit"] for kind in (described, *described.get("anyOf", ())) if "unit" in kind}
    if not units:
        raise InputError(
            f"{named}: is not a number with a unit; list its values instead of a range"
        )
    return units.pop().replace("1", "")
