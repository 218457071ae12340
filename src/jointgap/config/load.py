"""Reading configurations and campaign files, and their JSON schemas; errors name the key, the value and the fix."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError

from jointgap.config.campaign import NUISANCES, Campaign
from jointgap.config.mechanism import Mechanism
from jointgap.config.scenario import Scenario
from jointgap.config.yaml_files import Layer, leaves, mechanism_layers, merged, read_json, read_yaml, sources, with_file
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.progress import MOST_PARTS
from jointgap.core.section import Name, Section, Word, complaints, whole_number

_MOST_LINES = 20  # of an error: who has corrected these sees the others


def validate(model: type[BaseModel], data: Any, source: str) -> Any:
    """`data` as a `model`, or one InputError that names every wrong key."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        lines = complaints(error, data)
        more = [f"and {len(lines) - _MOST_LINES} more"] if len(lines) > _MOST_LINES else []
        raise InputError(*(f"{source}: {line}" for line in [*lines[:_MOST_LINES], *more])) from error


def load_mechanism(path: Path | str) -> Mechanism:
    """The mechanism in a file, or the one of a name such as ``"erkaya2009"`` that comes with jointgap.

    Parameters
    ----------
    path : Path or str
        A YAML or JSON file, whose keys are in config/README.md; or one of `shipped_mechanisms`.

    Returns
    -------
    Mechanism

    Raises
    ------
    InputError
        No such file, an unknown key, a value that is impossible; the message names file, key, value and what to do.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> mechanism.crank.length, mechanism.loose
    (0.15, ('crank_pin', 'piston_pin'))
    """
    return validate(Mechanism, _mechanism(str(path), (Path(),), "mechanism"), str(path))


def _mechanism(mechanism: Any, folders: tuple[Path, ...], key: str) -> Any:
    """The whole content of a mechanism: of its file, and of what it is laid over."""
    return merged(mechanism_layers(mechanism, folders, "", key))["mechanism"]


def _with_mechanism(data: dict[str, Any], folders: tuple[Path, ...], source: str = "") -> dict[str, Any]:
    """`data` with the whole content of its mechanism, whose files are looked for in `folders`."""
    if "mechanism" not in data:
        return data
    return data | {"mechanism": _mechanism(data["mechanism"], folders, f"{source}mechanism")}


def _with_drive_file(data: dict[str, Any], folders: tuple[Path, ...], source: str) -> dict[str, Any]:
    """`data` of a `source` with the file of a measured drive looked for in `folders`."""
    if not isinstance(data.get("simulate"), Mapping):
        return data
    return data | {"simulate": with_file(data["simulate"], "drive", folders, f"{source}: simulate.drive.file")}


_DEFAULT_SECTIONS: dict[str, Any] = {
    name: {} for name, field in Scenario.model_fields.items() if isinstance(field.default, BaseModel)
}
_RESERVED = ("campaigns", "blind", "logs", "mlflow-artifacts")  # folders of results that are no scenario's


class Configuration(Section):
    """What a configuration holds beside the sections that its scenarios share."""

    run: Annotated[tuple[Name, ...], Field(min_length=1)] | None = Field(
        None, description="scenarios to run; all when absent"
    )
    scenarios: Annotated[dict[Word, dict[str, Any] | None], Field(min_length=1)] = Field(
        description="scenarios by name; each holds the keys in which it differs from the sections beside"
    )
    campaigns: tuple[str, ...] = Field((), description="paths of the campaign files to analyse; none when absent")
    fit_parts: whole_number(ge=1, le=MOST_PARTS) | None = Field(
        None, description="jobs that share the fits of a campaign; null: two where joints are loose, else one"
    )
    anyway: bool = Field(False, description="analyse campaigns whose channels contradict each other too")


def resolve(
    config: Mapping[str, Any],
    folders: tuple[Path, ...] = (Path(),),
    source: str = "configuration",
    whole: bool = True,
) -> dict[str, Scenario]:
    """The scenarios that a configuration asks to run."""
    defaults = _DEFAULT_SECTIONS if whole else {}
    found = {}
    for name, layers in scenario_layers(config, folders, source).items():
        where = f"{source}, scenario {name}"
        found[name] = validate(Scenario, defaults | _with_drive_file(merged(layers), folders, where), where)
    return found


def check_whole(scenario: Scenario, name: str, source: str = "configuration") -> None:
    """Whether all sections of a scenario go together, those that it leaves to their defaults too."""
    validate(Scenario, scenario.model_dump(by_alias=True), f"{source}, scenario {name}")


def scenario_layers(
    config: Mapping[str, Any], folders: tuple[Path, ...] = (Path(),), source: str = "configuration"
) -> dict[str, list[Layer]]:
    """What the scenarios of a configuration are made of, by name; parameters as those of `resolve`."""
    allowed = {*Configuration.model_fields, *Scenario.model_fields}
    for key in config:
        if key in Scenario.removed:
            raise InputError(f"{source}: key '{key}' is gone; {Scenario.removed[key]}")
        if key not in allowed:
            raise InputError(f"{source}: unknown key '{key}'; {did_you_mean(key, allowed)}")
    base = {key: value for key, value in config.items() if key not in Configuration.model_fields}
    asked = validate(Configuration, {key: value for key, value in config.items() if key not in base}, source)
    layers = {}
    for name in asked.run or asked.scenarios:
        where = f"{source}, scenario {name}"
        if name not in asked.scenarios:
            raise InputError(f"{source}: run names '{name}'; {did_you_mean(name, asked.scenarios)}")
        if name in _RESERVED:
            raise InputError(f"{where}: results of another kind have that folder; choose another name")
        given = [Layer(source, base), Layer(where, asked.scenarios[name] or {})]
        lowest = next((layer for layer in reversed(given) if "mechanism" in layer.data), None)
        if lowest is None:
            raise InputError(f"{where}: key 'mechanism' is missing; give the path of a mechanism file")
        layers[name] = [
            *mechanism_layers(lowest.data["mechanism"], folders, lowest.source, f"{where}: mechanism"),
            *(Layer(each.source, {k: v for k, v in each.data.items() if k != "mechanism"}) for each in given),
        ]
    return layers


def stands_alone(config: Mapping[str, Any]) -> bool:
    """Whether a configuration is whole by itself: it brings the scenarios that it runs, and their mechanisms.

    One that does not, such as one that changes a speed, is laid over the shipped one.
    """
    scenarios = config.get("scenarios")
    try:
        own = [scenarios[name] for name in config.get("run", scenarios)]
        return bool(own) and ("mechanism" in config or all("mechanism" in each for each in own))
    except (KeyError, TypeError):  # a scenario that is not there, or something else than mappings
        return False


def sources_of(
    scenario: Scenario, name: str, files: Sequence[Layer], folders: tuple[Path, ...] = (Path(),)
) -> list[tuple[str, str, str]]:
    """Where the values of a scenario are written: of each key its path, its source and its value as text."""
    written = sources(files)
    own = f", scenario {name}"
    places = {"": (), own: ("scenarios", name)}  # of what is in no file of a mechanism
    found = {}
    for path, (value, source) in sources(scenario_layers(merged(files), folders, "")[name]).items():
        found[path] = (value, written[*places[source], *path][1] + source if source in places else source)
    for path, value in leaves(scenario.model_dump(mode="json")):
        if not any(path[: len(known)] == known for known in found):
            found[path] = (value, "default")
    rows = ((".".join(path), source, json.dumps(value, ensure_ascii=False)) for path, (value, source) in found.items())
    return sorted(rows)


def load_campaign(path: Path | str) -> Campaign:
    """The campaign in a YAML or JSON file; its mechanism and its runs' files are looked for from its folder on."""
    path = Path(path)
    data = _with_mechanism(read_yaml(path), (path.parent,), f"{path}: ")
    if isinstance(data.get("folder", ""), str):
        data = data | {"folder": path.parent / data.get("folder", "")}
    return validate(Campaign, data, str(path))


def mechanism_as_written(path: Path | str) -> Any:
    """The mechanism of the campaign in a file as its user wrote it, with units and without what they left out."""
    path = Path(path)
    return _with_mechanism(read_yaml(path), (path.parent,), f"{path}: ").get("mechanism")


def parse_options(options: str) -> Scenario:
    """The scenario in an ``--options`` argument: JSON text, or the path of a YAML or JSON file."""
    if options.lstrip().startswith("{"):
        return validate(Scenario, read_json(options, "--options"), "--options")
    data = read_yaml(options)
    if "scenarios" in data:
        raise InputError(
            f"{options}: holds scenarios, and one is needed; take one out with "
            f"`jointgap config {options} --scenario NAME > NAME.json` and give NAME.json"
        )
    folders = (Path(), Path(options).parent)
    return validate(Scenario, _with_drive_file(_with_mechanism(data, folders), folders, options), options)


def json_schema() -> dict[str, Any]:
    """The JSON schema of a configuration: base sections, ``scenarios`` and ``run``."""
    schema, sections = _schema(Scenario), Configuration.model_json_schema()["properties"]
    boxes = schema["$defs"]["Optimise"]["properties"]["boxes"]
    boxes["additionalProperties"] = {"anyOf": [boxes["additionalProperties"], {"type": "null"}]}
    names = {"propertyNames": {"enum": sorted(schema["properties"])}}
    sections["scenarios"]["additionalProperties"] = {"type": ["object", "null"], **names}
    schema["properties"] = sections | schema["properties"]
    return schema | {"title": "jointgap configuration", "required": ["scenarios"]}


def campaign_json_schema() -> dict[str, Any]:
    """The JSON schema of a campaign file."""
    schema = _schema(Campaign)
    schema["$defs"]["Channel"]["required"].remove("unit")  # counts_per_turn and rate say it
    bounds = {"type": "array", "items": {"type": ["number", "string"]}, "minItems": 2, "maxItems": 2}
    share = {"type": "string", "description": "percentage of nominal, or amount, either way"}
    schema["properties"]["nuisance"] |= {
        "propertyNames": {"enum": list(NUISANCES)},
        "additionalProperties": {"anyOf": [share, bounds]},
    }
    return schema | {"title": "jointgap campaign"}


def _schema(model: type[Section]) -> dict[str, Any]:
    """The schema of a file, whose mechanism may be named or laid over another one, and its contacts named."""
    schema = model.model_json_schema()
    contact = schema["$defs"]["Joint"]["properties"]["contact"]
    schema["$defs"]["Joint"]["properties"]["contact"] = {"anyOf": [{"type": "string"}, contact]}
    path = {"type": "string", "description": "path of a mechanism file, or name of one that comes with jointgap"}
    base = {"type": "string", "description": "path or name of the mechanism over which the other keys are laid"}
    over = {"type": "object", "required": ["base"], "properties": {"base": base}}
    schema["properties"]["mechanism"] = {"anyOf": [path, over, schema["properties"]["mechanism"]]}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
