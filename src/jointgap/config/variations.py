"""Copies of sections with changed values, given as in a file and validated again."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from jointgap.config.linkage_file import LinkageFile
from jointgap.config.load import validate
from jointgap.config.mechanism import Link, Mechanism, OfAnyKind
from jointgap.config.scenario import DrivenMechanism
from jointgap.config.yaml_files import leaves
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.joints import JOINTS
from jointgap.core.section import ConfigModel
from jointgap.core.units import plain_numbers, to_si

AnyConfigModel = TypeVar("AnyConfigModel", bound=ConfigModel)

OF_LOOSE_JOINTS = {"clearance": "m", "friction": "1", "restitution": "1", "stiffness": "1"}
"""Words for a value of every loose joint, with its unit (of the stiffness N/m^exponent)."""

_LINKS = {"crank_length": "crank", "rod_length": "rod"}

VARIED_BY_WORD = {"speed": "rad/s"} | OF_LOOSE_JOINTS | dict.fromkeys(_LINKS, "m")
"""Words for varied parameters, with their units."""


def set_at(data: Any, path: Sequence[str], value: Any, source: str) -> Any:
    """A copy of `data`, sections or mappings, with a `value` at a `path`; `source` is for error
    messages.

    Effects are identified by their name, or by name@site where one is listed twice. A mapping is
    merged with the existing one, unless its kind differs.
    """
    if not path:
        entries = _entries(data)
        is_merged = isinstance(value, Mapping) and entries
        if not is_merged or value.get("kind") not in (None, entries.get("kind")):
            return value
        for key, inner_value in value.items():
            data = set_at(data, str(key).split("."), inner_value, source)
        return data
    step, *inner_path = path
    entries = _entries(data)
    if isinstance(data, list | tuple):
        entry(data, step, source, "a point" if "x" in entries else "effects")
        if not (inner_path or "x" in entries or isinstance(value, Mapping)):
            raise InputError(
                f"{source}: is a whole effect; give the path of a number, such as"
                f" {step}.parameters.<name>"
            )
    entries[step] = set_at(entries.get(step), inner_path, value, source)
    return list(entries.values()) if isinstance(data, list | tuple) else entries


def value_at(data: Any, path: Sequence[str], source: str, title: str = "the scenario") -> Any:
    """The value at a `path` in `data`, sections or mappings; `source` and `title` are for error
    messages."""
    for depth, step in enumerate(path):
        data = entry(data, step, source, ".".join(path[:depth]) or title)
    return data


def entry(data: Any, step: str, source: str, parent: str) -> Any:
    """The entry `step` of `data`, which is at `parent`; or an InputError with the existing
    entries."""
    entries = _entries(data)
    if step in entries:
        return entries[step]
    hint = did_you_mean(step, entries) if entries else "it is empty"
    if parent == "mechanism.effects":
        hint += (
            "; effects that only change data are applied: vary the key itself, such as"
            " mechanism.slider.mass"
        )
    raise InputError(f"{source}: {parent} has no '{step}'; {hint}")


def _entries(data: Any) -> dict[str, Any]:
    """The entries of `data` by key, or by name for a list of effects, of a point x and y; a
    copy."""
    if not isinstance(data, list | tuple):
        return dict(data) if isinstance(data, ConfigModel | Mapping) else {}
    if len(data) == 2 and all(isinstance(coordinate, float) for coordinate in data):
        return dict(zip("xy", data, strict=True))
    if not all(isinstance(effect, ConfigModel | Mapping) for effect in data):
        return {}
    effects = [dict(effect) for effect in data]
    names = [effect.get("name") for effect in effects]
    keys = (
        name if names.count(name) == 1 else f"{name}@{effect.get('site')}"
        for name, effect in zip(names, effects, strict=True)
    )
    return dict(zip(keys, data, strict=True))


def change(section: AnyConfigModel, changes: Mapping[str, Any]) -> AnyConfigModel:
    """Copy a mechanism, or another section of a configuration, with other values.

    Sections are immutable. All values are validated again, units included.

    Parameters
    ----------
    section : Mechanism, LinkageFile, Simulate, Joint, Contact or another section
        ConfigModel to copy.
    changes : mapping
        New values by key, nested as in a file (``{"slider": {"mass": "1.2 kg"}}``) or by the path
        of a key (``{"slider.mass": "1.2 kg"}``). Additional keys of a mechanism: ``clearance``
        (radial), ``friction``, ``restitution`` and ``stiffness`` change every loose joint;
        ``joints.crank_pin.clearance`` changes the bearing's radius of one; an entry of ``contacts``
        changes the joints that refer to it; ``frame.points.C.x`` is a coordinate. The length of a
        link scales its mass centre, as in sweeps and in `optimise`, unless ``mass_centre`` is given
        too. Effects are identified by
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
    name, is_mechanism = type(section).__name__, isinstance(section, OfAnyKind)
    data = dict(section)
    changes = {str(key): value for key, value in plain_numbers(changes).items()}
    # apply contacts to the joints that refer to them before the joints' own changes
    for key in sorted(changes, key=lambda key: not key.startswith("contacts")):
        paths = [tuple(key.split("."))]
        if is_mechanism and key in OF_LOOSE_JOINTS:
            paths = _loose_joint_paths(section.loose, key, f"{name}: {key}")
        for path in paths:
            data = set_at(data, path, changes[key], name)
        if is_mechanism and key.startswith("contacts"):
            data = _with_contacts(section, data, name)
    changed = {".".join(path) for path, _ in leaves(changes)}
    return _validated(section, data, changed, name, name)


def _validated(
    section: AnyConfigModel, data: dict[str, Any], changed: set[str], source: str, title: str
) -> AnyConfigModel:
    """`data` as a section of the same kind, with the mass centres for `changed` lengths and the
    radii for clearances; unchanged sections are not validated again."""
    path, mechanism, mechanism_data = "", section, data
    if isinstance(section, DrivenMechanism):
        path, mechanism, mechanism_data = "mechanism.", section.mechanism, data["mechanism"]
    links = {path: section} if isinstance(section, Link) else {}
    if isinstance(mechanism, OfAnyKind):
        places = "bodies." if isinstance(mechanism, LinkageFile) else ""
        links = {f"{path}{places}{link}.": mechanism.body(link) for link in mechanism.sites.links}
        if isinstance(mechanism_data, dict):
            _clearances_to_radii(mechanism_data["joints"], source)
    for path, link in links.items():
        length, centre = f"{path}length", f"{path}mass_centre"
        if length in changed and centre not in changed:
            value = si_number(value_at(data, length.split("."), source), "m", f"{source}: {length}")
            middle, ratio = link.mass_centre, value / link.length
            is_point = isinstance(middle, tuple)
            scaled = (middle[0] * ratio, middle[1]) if is_point else middle * ratio
            data = set_at(data, centre.split("."), scaled, source)
    return validate(type(section), data, title)


def _loose_joint_paths(joints: Sequence[str], word: str, source: str) -> list[tuple[str, ...]]:
    """Paths of the values of all loose joints in a mechanism."""
    if not joints:
        raise InputError(
            f"{source}: the mechanism has no loose joint to change; make a joint loose"
        )
    keys = (word,) if word == "clearance" else ("contact", word)
    return [("joints", joint, *keys) for joint in joints]


def _with_contacts(
    mechanism: Mechanism | LinkageFile, data: dict[str, Any], source: str
) -> dict[str, Any]:
    """`data` whose joints follow the entries of contacts that they refer to; validated joints
    contain copies."""
    names = mechanism.joints if isinstance(mechanism, LinkageFile) else JOINTS
    joints = {name: mechanism.joint(name) for name in names}
    for key, contact in mechanism.contacts.items():
        referring = [name for name, joint in joints.items() if joint and joint.contact == contact]
        if not referring or not isinstance(data["contacts"].get(key), Mapping):
            continue
        equal = [name for name, entry in mechanism.contacts.items() if entry == contact]
        if len(equal) > 1:
            duplicate = next(name for name in equal if name != key)
            raise InputError(
                f"{source}: contacts.{key} equals contacts.{duplicate}, so the joints that refer to"
                f" it are ambiguous; change joints.{referring[0]}.contact and so on instead"
            )
        for joint in referring:
            path = ("joints", joint, "contact")
            data = set_at(data, path, data["contacts"][key], source)
    return data


def _clearances_to_radii(joints: Any, source: str) -> None:
    """Converts the radial clearance of joints to the bearing's radius."""
    for key, joint in joints.items() if isinstance(joints, Mapping) else ():
        if isinstance(joint, dict) and "clearance" in joint and "slide" not in joint:
            key = f"{source}: joints.{key}.clearance"
            if "journal_radius" not in joint:
                raise InputError(f"{key}: the joint has no journal_radius; give it too")
            clearance = si_number(joint.pop("clearance"), "m", key)
            joint["bearing_radius"] = si_number(joint["journal_radius"], "m", key) + clearance


def si_number(value: Any, unit: str, source: str) -> float:
    """A `value` in SI; `source` is for the InputError where it is invalid."""
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise InputError(f"{source} = {value!r}: {error}") from error


def with_values(base: DrivenMechanism, changes: dict[str, Any], source: str) -> DrivenMechanism:
    """A driven mechanism with other values, by word or path."""
    data, changed = dict(base), set()
    # contacts before joints, paths before words
    for key in sorted(changes, key=lambda key: (key in VARIED_BY_WORD, "contacts." not in key)):
        name, value = f"{source}.{key}", changes[key]
        for path in paths_of(data, key, name):
            is_clearance = path[-1] == "clearance"
            if path[-1] in ("clearance", "length"):
                value = si_number(value, "m", name)
            value_at(data, path[:-1] if is_clearance else path, name)  # rejects unknown keys
            data = set_at(data, path, value, name)
            changed.add(".".join(path))
            if path[:2] == ("mechanism", "contacts"):
                inside = _with_contacts(base.mechanism, data["mechanism"], name)
                if inside["joints"] is data["mechanism"]["joints"]:
                    raise InputError(f"{name}: no joint has this contact; vary that of a joint")
                data = data | {"mechanism": inside}
    words = ", ".join(f"{key} = {value}" for key, value in changes.items())
    changed_base = _validated(base, data, changed, source, f"{source}, {words}")
    speed = [key for key in changes if key in ("speed", "simulate.speed")]
    if speed and changed_base.simulate.drive.kind == "measured":
        raise InputError(
            f"{source}.{speed[0]}: a measured drive does not use simulate.speed; vary another"
            " parameter"
        )
    return changed_base


def paths_of(data: Any, key: str, source: str) -> list[tuple[str, ...]]:
    """Paths of `key` in `data`, a driven mechanism."""
    if key == "speed":
        return [("simulate", "speed")]
    words = VARIED_BY_WORD
    if "bodies" in _entries(value_at(data, ("mechanism",), source)):  # a general linkage
        words = {word: unit for word, unit in words.items() if word not in _LINKS}
    elif key in _LINKS:
        return [("mechanism", _LINKS[key], "length")]
    if key in OF_LOOSE_JOINTS:
        joints = dict(value_at(data, ("mechanism", "joints"), source))
        loose = [name for name, joint in joints.items() if _is_loose(joint)]
        paths = _loose_joint_paths(loose, key, source)
        return [("mechanism", *path) for path in paths]
    path = tuple(key.split("."))
    if len(path) < 2:
        raise InputError(
            f"{source}: no such word; {did_you_mean(key, words)} (or give the path of a key)"
        )
    return [path if path[0] in ("mechanism", "simulate") else ("mechanism", *path)]


def _is_loose(joint: Any) -> bool:
    """Whether a joint, or its data, is loose; a slide is if it has a clearance."""
    content = {} if joint == "ideal" else dict(joint)
    return content.get("loose", content.get("clearance") is not None)


def number_at(section: ConfigModel, key: str, source: str) -> tuple[float, str]:
    """The number at a `key` of a section and its unit, '' for a pure number."""
    path = tuple(key.split("."))
    value = value_at(section, path, source, type(section).__name__)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{source}: is not a number")
    return float(value), _unit_at(section, path, source) or ""


def _unit_at(base: ConfigModel, path: Sequence[str], source: str) -> str | None:
    """SI unit of the number at a `path`; '' for a pure number, None if it has no unit."""
    section, schema = value_at(base, path[:-1], source), {}
    if isinstance(section, tuple) and path[-1] in ("x", "y"):  # of a point
        return "m"
    if isinstance(section, ConfigModel):
        schema = type(section).model_json_schema()["properties"].get(path[-1], {})
    units = {part["unit"] for part in (schema, *schema.get("anyOf", ())) if "unit" in part}
    return units.pop().replace("1", "") if units else None


def unit_of(base: DrivenMechanism, key: str, source: str) -> str:
    """SI unit of the number at a `key`, for `jointgap.core.units.to_si`; '' for a pure number."""
    if key in VARIED_BY_WORD:
        return VARIED_BY_WORD[key].replace("1", "")
    name = f"{source}.{key}"
    path = paths_of(base, key, name)[0]
    if path[-1] == "clearance":
        return VARIED_BY_WORD["clearance"]
    value_at(base, path, name)
    unit = _unit_at(base, path, name)
    if unit is None:
        raise InputError(f"{name}: is not a number with a unit; list its values instead of a range")
    return unit
