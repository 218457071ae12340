"""Reading campaign files, and their schema."""

from pathlib import Path
from typing import Any

from jointgap.config.campaign_file import Campaign
from jointgap.config.channels import CHANNELS
from jointgap.config.load import read_yaml, validate, with_mechanism
from jointgap.config.nuisance_bounds import NUISANCES


def load_campaign(path: Path | str) -> Campaign:
    """The campaign in a YAML or JSON file; its mechanism and its runs' files are looked for from its folder on.

    Raises
    ------
    InputError
        No such file, unknown key, wrong type or unit, runs without a use; all with key, value and mend.
    """
    path = Path(path)
    data = with_mechanism(read_yaml(path), (path.parent,), f"{path}: ")
    if isinstance(data.get("folder", ""), str):
        data = data | {"folder": path.parent / data.get("folder", "")}
    return validate(Campaign, data, str(path))


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
