"""Reading configurations and campaign files, and their JSON schemas; errors name the key, the value and the fix."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from jointgap.config.campaign_file import Campaign
from jointgap.config.channels import CHANNELS
from jointgap.config.config_errors import complaints
from jointgap.config.mechanism_config import Mechanism
from jointgap.config.nuisance_bounds import NUISANCES
from jointgap.config.scenario import SECTIONS, Scenario
from jointgap.errors import InputError, did_you_mean


def read_yaml(path: Path | str) -> dict[str, Any]:
    """The mapping in a YAML (or JSON) file.

    Raises
    ------
    InputError
        No such file, not YAML, or not a mapping; with the line where YAML knows it.
    """
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8 (byte {error.start}); save it as UTF-8") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise InputError(f"{path}{where}: is not YAML: {getattr(error, 'problem', error)}") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: must be a mapping of keys to values, not {type(content).__name__}")
    return content


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with `over` laid on it: mappings merge key by key, everything else is replaced."""
    merged = dict(base)
    for key, value in over.items():
        both = isinstance(merged.get(key), Mapping) and isinstance(value, Mapping)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def validate(model: type[BaseModel], data: Any, source: str) -> Any:
    """`data` as a `model`, or one InputError that names every wrong key.

    Parameters
    ----------
    model : type
        A configuration class.
    data : mapping
        As read from YAML or JSON.
    source : str
        File or place the data came from, for the message.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError("\n".join(f"{source}: {line}" for line in complaints(error, model))) from error


def load_mechanism(path: Path | str) -> Mechanism:
    """The mechanism in a file (see config/README.md for its keys)."""
    return validate(Mechanism, read_yaml(path), str(path))


def _existing_file(path: str, folders: tuple[Path, ...], key: str) -> Path:
    """The file at `path`, looked for in `folders`."""
    for folder in folders:
        if os.path.isfile(folder / path):  # a Path's own is_file fails on a name that is too long
            return folder / path
    places = ", ".join(str(folder) for folder in folders)
    raise InputError(f"{key}: no file '{path}' (looked in {places}); give a path relative to one of these")


def _mechanism_data(mechanism: Any, folders: tuple[Path, ...], source: str = "") -> Any:
    """The content of a mechanism given by its path, looked for in `folders`; anything else as it is."""
    return (
        read_yaml(_existing_file(mechanism, folders, f"{source}mechanism")) if isinstance(mechanism, str) else mechanism
    )


def _with_mechanism(data: dict[str, Any], folders: tuple[Path, ...], source: str = "") -> dict[str, Any]:
    """`data` with the content of the mechanism that it gives by a path, looked for in `folders`."""
    return data | {"mechanism": _mechanism_data(data["mechanism"], folders, source)} if "mechanism" in data else data


def _with_drive_file(data: dict[str, Any], folders: tuple[Path, ...]) -> dict[str, Any]:
    """`data` with the file of a measured drive looked for in `folders`."""
    simulate = data.get("simulate")
    drive = simulate.get("drive") if isinstance(simulate, Mapping) else None
    file = drive.get("file") if isinstance(drive, Mapping) else None
    if not isinstance(file, str):
        return data
    path = str(_existing_file(file, folders, "simulate.drive.file"))
    return data | {"simulate": dict(simulate) | {"drive": dict(drive) | {"file": path}}}


_NOT_OF_SCENARIOS = ("run", "scenarios", "campaigns", "fit_parts")


def resolve(
    config: Mapping[str, Any], folders: tuple[Path, ...] = (Path(),), source: str = "configuration"
) -> dict[str, Scenario]:
    """The scenarios that a configuration asks to run.

    Parameters
    ----------
    config : mapping
        Base sections, ``scenarios`` (overrides by name) and ``run`` (names to run; all when absent); ``campaigns`` and
        ``fit_parts`` are passed over.
    folders : tuple of Path
        Where mechanism files are looked for, first found wins.
    source : str
        What to call the configuration in errors.

    Returns
    -------
    dict of str to Scenario
        In the order of ``run``.

    Raises
    ------
    InputError
        Unknown scenario or key, wrong type, impossible value.
    """
    allowed = {*_NOT_OF_SCENARIOS, *Scenario.model_fields}
    for key in config:
        if key not in allowed:
            raise InputError(f"{source}: unknown key '{key}'; {did_you_mean(str(key), allowed)}")
    scenarios = config.get("scenarios") or {}
    if not isinstance(scenarios, Mapping) or not scenarios:
        raise InputError(
            f"{source}: scenarios must map at least one name to its overrides, e.g. 'scenarios: {{mine: {{}}}}'"
        )
    names = config.get("run", list(scenarios))
    if not isinstance(names, list | tuple) or not names:
        raise InputError(f"{source}: run = {names!r} must be a list of scenario names")
    base = {key: value for key, value in config.items() if key not in _NOT_OF_SCENARIOS}
    resolved = {}
    for name in names:
        if not isinstance(name, str | int) or name not in scenarios:
            raise InputError(f"{source}: run names '{name}'; {did_you_mean(str(name), map(str, scenarios))}")
        over = scenarios[name] or {}
        where = f"{source}, scenario {name}"
        if not isinstance(over, Mapping):
            raise InputError(f"{where}: = {over!r} must be a mapping of overrides")
        if not str(name).replace("_", "").replace("-", "").isalnum():
            raise InputError(f"{where}: use letters, digits, '_' and '-' only, for the name becomes a folder")
        if "mechanism" not in base and "mechanism" not in over:
            raise InputError(f"{where}: key 'mechanism' is missing; give the path of a mechanism file")
        data = merge(
            base | {"mechanism": _mechanism_data(base.get("mechanism", {}), folders)},
            over | ({"mechanism": _mechanism_data(over["mechanism"], folders)} if "mechanism" in over else {}),
        )
        resolved[str(name)] = validate(Scenario, _with_drive_file(data, folders), where)
    return resolved


def load_campaign(path: Path | str) -> Campaign:
    """The campaign in a YAML or JSON file; its mechanism and its runs' files are looked for from its folder on.

    Raises
    ------
    InputError
        No such file, unknown key, wrong type or unit, runs without a use; all with key, value and fix.
    """
    path = Path(path)
    data = _with_mechanism(read_yaml(path), (path.parent,), f"{path}: ")
    if isinstance(data.get("folder", ""), str):
        data = data | {"folder": path.parent / data.get("folder", "")}
    return validate(Campaign, data, str(path))


def options_for(scenario: Scenario, stage: str) -> str:
    """What `stage` reads of a scenario, as JSON text in SI: the value of its ``--options``."""
    return scenario.model_dump_json(include=set(SECTIONS[stage]))


def parse_options(options: str) -> Scenario:
    """The scenario in an ``--options`` argument: JSON text, or the path of a YAML or JSON file."""
    if options.lstrip().startswith("{"):
        return validate(Scenario, parse_json(options, "--options"), "--options")
    # a JSON file is read as such: YAML takes 1e-9 for a text
    data = _read_json(options) if options.endswith(".json") else read_yaml(options)
    folders = (Path(), Path(options).parent)
    data = data | {"mechanism": _mechanism_data(data.get("mechanism", {}), folders)}
    return validate(Scenario, _with_drive_file(data, folders), options)


def _read_json(path: str) -> dict[str, Any]:
    try:
        data = parse_json(Path(path).read_text(encoding="utf-8"), path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8 (byte {error.start}); save it as UTF-8") from error
    if not isinstance(data, dict):
        raise InputError(f"{path}: must be a mapping of keys to values, not {type(data).__name__}")
    return data


def parse_json(text: str, source: str) -> Any:
    """What a JSON `text` holds; an InputError that names its `source` where it is no JSON, or has a NaN."""

    def refuse(constant: str) -> float:
        raise InputError(f"{source}: holds {constant}, which is not a number; remove it")

    try:
        return json.loads(text, parse_constant=refuse)
    except json.JSONDecodeError as error:
        raise InputError(f"{source}: is not JSON: {error.msg} at character {error.pos}") from error


def json_schema() -> dict[str, Any]:
    """The JSON schema of a configuration: base sections, ``scenarios`` and ``run``."""
    schema = Scenario.model_json_schema()
    sections = schema.pop("properties")
    sections["mechanism"] = {
        "anyOf": [{"type": "string", "description": "path of a mechanism file"}, sections["mechanism"]]
    }
    contact = schema["$defs"]["Joint"]["properties"]["contact"]
    schema["$defs"]["Joint"]["properties"]["contact"] = {"anyOf": [{"type": "string"}, contact]}
    boxes = schema["$defs"]["Optimise"]["properties"]["boxes"]
    boxes["additionalProperties"] = {"anyOf": [boxes["additionalProperties"], {"type": "null"}]}
    names = {"type": "array", "items": {"type": "string"}, "description": "scenarios to run; all when absent"}
    campaigns = {
        "type": "array",
        "items": {"type": "string"},
        "description": "paths of the campaign files to analyse; none when absent",
    }
    fit_parts = {
        "type": ["integer", "null"],
        "minimum": 1,
        "description": "jobs that share the fits of a campaign; null: two where joints are loose, else one",
    }
    overrides = {
        "type": "object",
        "minProperties": 1,
        "description": "scenarios by name; each holds the keys in which it differs from the sections beside",
        "additionalProperties": {"type": ["object", "null"], "propertyNames": {"enum": sorted(sections)}},
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "jointgap configuration",
        "type": "object",
        "additionalProperties": False,
        "required": ["scenarios"],
        "properties": {
            "run": names,
            "scenarios": overrides,
            "campaigns": campaigns,
            "fit_parts": fit_parts,
            **sections,
        },
        "$defs": schema["$defs"],
    }


def campaign_json_schema() -> dict[str, Any]:
    """The JSON schema of a campaign file."""
    schema = Campaign.model_json_schema()
    sections, parts = schema["properties"], schema["$defs"]
    sections["mechanism"] = {
        "anyOf": [{"type": "string", "description": "path of a mechanism file"}, sections["mechanism"]]
    }
    parts["Joint"]["properties"]["contact"] = {"anyOf": [{"type": "string"}, parts["Joint"]["properties"]["contact"]]}
    parts["MotorDrive"]["required"].remove("kind")  # there is no other under `motor`
    sections["channels"] |= {"propertyNames": {"enum": list(CHANNELS)}, "minProperties": 1}
    bound = {"type": ["number", "string"]}
    sections["nuisance"] |= {
        "propertyNames": {"enum": list(NUISANCES)},
        "additionalProperties": {
            "anyOf": [
                {"type": "string", "description": "percentage of nominal, either way"},
                {"type": "array", "items": bound, "minItems": 2, "maxItems": 2},
            ]
        },
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "jointgap campaign",
        "type": "object",
        "additionalProperties": False,
        "required": ["name", "mechanism", "runs", "channels"],
        "properties": sections,
        "$defs": parts,
    }
