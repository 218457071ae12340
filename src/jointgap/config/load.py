"""Reads configurations and campaign files, and writes their JSON schemas."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, Field, ValidationError

from jointgap.config.campaign import NUISANCE_RULES, NUISANCES, Campaign
from jointgap.config.channels import CHANNEL_RULES, CHANNELS
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.mechanism import Mechanism
from jointgap.config.scenario import Scenario
from jointgap.config.yaml_files import (
    complete_mechanism,
    merge,
    read_json,
    read_yaml,
    with_effect_files,
    with_file,
)
from jointgap.core.errors import InputError, did_you_mean
from jointgap.core.section import ConfigModel, Name, Word, complaints, entry_name

_MOST_LINES = 20  # of an error


def validate(model: type[BaseModel], data: Any, source: str) -> Any:
    """`data` as a `model`, or one InputError with all wrong keys."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        lines = complaints(error, data)
        if len(lines) > _MOST_LINES:
            lines[_MOST_LINES:] = [f"and {len(lines) - _MOST_LINES} more"]
        raise InputError(*(f"{source}: {line}" for line in lines)) from error


def load_mechanism(path: Path | str) -> Mechanism | LinkageFile:
    """The mechanism in a file, or a shipped one by its name such as ``"erkaya2009"``.

    Parameters
    ----------
    path : Path or str
        A YAML or JSON file, whose keys are in config/README.md; or one of `shipped_mechanisms`.

    Returns
    -------
    Mechanism or LinkageFile
        A slider-crank, or another linkage: a file with ``bodies``.

    Raises
    ------
    InputError
        No such file, unknown key, or invalid value; the message contains file, key, value and a
        hint.

    Examples
    --------
    >>> import jointgap as jg
    >>> mechanism = jg.load_mechanism("erkaya2009")
    >>> mechanism.crank.length, mechanism.loose
    (0.15, ('crank_pin', 'piston_pin'))
    """
    content = complete_mechanism(str(path), (Path(),), "mechanism")
    if "mechanism" in content:
        raise InputError(
            f"{path}: is a configuration or campaign file; give the mechanism file that it"
            " refers to"
        )
    kind = LinkageFile if isinstance(content, Mapping) and "bodies" in content else Mechanism
    return validate(kind, content, str(path))


def _with_mechanism(
    data: dict[str, Any], folders: tuple[Path, ...], source: str = ""
) -> dict[str, Any]:
    """`data` with the complete content of its mechanism, with files resolved in `folders`."""
    if "mechanism" not in data:
        return data
    content = complete_mechanism(data["mechanism"], folders, f"{source}mechanism")
    return data | {"mechanism": content}


def _with_drive_file(
    data: dict[str, Any], folders: tuple[Path, ...], source: str
) -> dict[str, Any]:
    """`data` of a `source` with the file of a measured drive resolved in `folders`."""
    if "simulate" not in data:
        return data
    key = f"{source}: simulate.drive.file"
    return data | {"simulate": with_file(data["simulate"], "drive", folders, key)}


_DEFAULT_SECTIONS: dict[str, Any] = {
    name: {}
    for name, field in Scenario.model_fields.items()
    if isinstance(field.default, BaseModel)
}
_RESERVED = ("campaigns", "blind", "logs", "mlflow-artifacts")  # folders of other results


class Configuration(ConfigModel):
    """The keys of a configuration besides the sections of its scenarios."""

    removed: ClassVar = {"fit_parts": "delete it: the fits of a campaign are one job"}

    run: Annotated[tuple[Name, ...], Field(min_length=1)] | None = Field(
        None, description="scenarios to run; all by default"
    )
    scenarios: Annotated[dict[Word, dict[str, Any] | None], Field(min_length=1)] = Field(
        description="scenarios by name, each with the keys that differ from the common sections"
    )
    campaigns: tuple[str, ...] = Field(
        (), description="paths of the campaign files to analyse; none by default"
    )
    anyway: bool = Field(
        False, description="analyse also campaigns whose channels contradict each other"
    )


def resolve(
    config: Mapping[str, Any],
    folders: tuple[Path, ...] = (Path(),),
    source: str = "configuration",
    whole: bool = True,
) -> dict[str, Scenario]:
    """The scenarios that a configuration runs; `whole`: with sections that only have defaults."""
    allowed = {*Configuration.model_fields, *Scenario.model_fields}
    for key in config:
        if instead := {**Configuration.removed, **Scenario.removed}.get(key):
            raise InputError(f"{source}: key '{key}' was removed; {instead}")
        if key not in allowed:
            raise InputError(f"{source}: unknown key '{key}'; {did_you_mean(key, allowed)}")
    common = {key: config[key] for key in config if key in Scenario.model_fields}
    settings = {key: config[key] for key in config if key not in common}
    settings = validate(Configuration, settings, source)
    scenarios = {}
    for name in settings.run or settings.scenarios:
        where = f"{source}, scenario {name}"
        if name not in settings.scenarios:
            hint = did_you_mean(name, settings.scenarios)
            raise InputError(f"{source}: run lists '{name}'; {hint}")
        if name in _RESERVED:
            raise InputError(f"{where}: the name is reserved for other results; choose another one")
        keys = settings.scenarios[name] or {}
        content = merge(common, keys)
        if "mechanism" not in content:
            raise InputError(
                f"{where}: key 'mechanism' is missing; give the path of a mechanism file"
            )
        mechanism = keys.get("mechanism", common.get("mechanism"))  # a whole one, not merged
        content["mechanism"] = complete_mechanism(mechanism, folders, f"{where}: mechanism")
        scenarios[name] = _with_drive_file(content, folders, where)
    # after all files were found
    defaults = _DEFAULT_SECTIONS if whole else {}
    return {
        name: validate(Scenario, defaults | content, f"{source}, scenario {name}")
        for name, content in scenarios.items()
    }


def check_all_sections(scenario: Scenario, name: str, source: str = "configuration") -> None:
    """InputError where the sections of a scenario, with defaults, are inconsistent, or its
    mechanism is no slider-crank."""
    source = f"{source}, scenario {name}"
    scenario.check_slider_crank(f"{source}: ")
    validate(Scenario, scenario.model_dump(by_alias=True), source)


def is_complete(config: Mapping[str, Any]) -> bool:
    """Whether a configuration is complete: it contains the scenarios that it runs, and their
    mechanisms.

    An incomplete one, such as a change of speed, overrides the shipped configuration.
    """
    scenarios = config.get("scenarios")
    try:
        contents = [scenarios[name] for name in config.get("run", scenarios)]
        return bool(contents) and (
            "mechanism" in config or all("mechanism" in content for content in contents)
        )
    except (KeyError, TypeError):  # a missing scenario, or not mappings
        return False


def load_campaign(path: Path | str) -> Campaign:
    """The campaign in a YAML or JSON file; relative paths in it start from its folder."""
    path = Path(path)
    folders = (path.parent,)
    data = _with_mechanism(read_yaml(path), folders, f"{path}: ")
    if isinstance(runs := data.get("runs"), list):
        keys = [f"{path}: runs.{entry_name(runs, number)}" for number in range(len(runs))]
        data["runs"] = [
            with_effect_files(run, folders, key) for run, key in zip(runs, keys, strict=True)
        ]
    if isinstance(data.get("folder", ""), str):
        data["folder"] = path.parent / data.get("folder", "")
    return validate(Campaign, data, str(path))


def mechanism_as_written(path: Path | str) -> Any:
    """The mechanism of a campaign file as its user wrote it, with units and without defaults."""
    path = Path(path)
    return _with_mechanism(read_yaml(path), (path.parent,), f"{path}: ").get("mechanism")


def parse_options(options: str) -> Scenario:
    """The scenario of an ``--options`` argument: JSON text, or the path of a YAML or JSON file."""
    if options.lstrip().startswith("{"):
        return validate(Scenario, read_json(options, "--options"), "--options")
    data = read_yaml(options)
    if "scenarios" in data:
        raise InputError(
            f"{options}: contains several scenarios; extract one with "
            f"`jointgap config {options} --scenario NAME > NAME.json` and give NAME.json"
        )
    folders = (Path(), Path(options).parent)
    return validate(
        Scenario, _with_drive_file(_with_mechanism(data, folders), folders, options), options
    )


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
    # not required with counts_per_turn and rate
    schema["$defs"]["Channel"]["required"].remove("unit")
    bounds = {
        "type": "array",
        "items": {"type": ["number", "string"]},
        "minItems": 2,
        "maxItems": 2,
    }
    share = {
        "type": "string",
        "description": "percentage of nominal, or amount, in both directions",
    }
    schema["properties"]["channels"]["propertyNames"] = _names(CHANNELS, CHANNEL_RULES)
    schema["properties"]["nuisance"] |= {
        "propertyNames": _names(NUISANCES, NUISANCE_RULES),
        "additionalProperties": {"anyOf": [share, bounds]},
    }
    return schema | {"title": "jointgap campaign"}


def _names(known: Iterable[str], rules: Iterable[str]) -> dict[str, Any]:
    """The names of a slider-crank, and those of other linkages by rules with {part}."""
    of_parts = (rule.replace("{part}", ".+") for rule in rules)
    return {"anyOf": [{"enum": [*known]}, {"pattern": f"^({'|'.join(of_parts)})$"}]}


def _schema(model: type[ConfigModel]) -> dict[str, Any]:
    """The schema of a file in which mechanisms and contacts may be given by name, and mechanisms by
    a base."""
    schema = model.model_json_schema()
    for joint in ("Joint", "Pin", "Slide"):
        properties = schema["$defs"][joint]["properties"]
        contact = properties["contact"]
        either = {"anyOf": [{"type": "string"}, contact], "description": contact["description"]}
        properties["contact"] = either
    path = {"type": "string", "description": "path of a mechanism file, or name of a shipped one"}
    base = {
        "type": "string",
        "description": "path or name of the mechanism that the other keys modify",
    }
    over = {"type": "object", "required": ["base"], "properties": {"base": base}}
    mechanism = schema["properties"]["mechanism"]
    mechanism["anyOf"] = [path, over, *mechanism["anyOf"]]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
