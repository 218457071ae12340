"""The catalogue of effects in words: parameters with units and bounds, and what to write into a mechanism file."""

from typing import NamedTuple, get_args

from pydantic_core import PydanticUndefined

from jointgap.effects.base import Effect

_SIGNS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}


class ParameterDescription(NamedTuple):
    """One parameter of an effect."""

    name: str
    unit: str  # "" for text and mappings, "1" for pure numbers
    bounds: str  # such as "0 .. 15"; "" for none
    default: str  # "" where it has to be given
    meaning: str


def parameters_of(effect: type[Effect]) -> list[ParameterDescription]:
    """The parameters of an effect in the order of its section."""
    section = effect.model_fields["parameters"].annotation
    properties = section.model_json_schema()["properties"]
    rows = []
    for name, field in section.model_fields.items():
        schema = properties[name]
        number = next(iter(schema.get("anyOf", [schema])))
        numeric = number.get("type") in ("number", "integer")
        unit = schema.get("unit", "1") if numeric else ""
        stated = numeric and field.default is not None
        text = (
            "none" if field.default is None or not isinstance(field.default, str | bool) else str(field.default).lower()
        )
        default = "" if field.default is PydanticUndefined else f"{field.default:g}" if stated else text
        rows.append(ParameterDescription(name, unit, _bounds(number), default, schema["description"]))
    return rows


def _bounds(schema: dict) -> str:
    if {"minimum", "maximum"} <= schema.keys():
        return f"{schema['minimum']:g} .. {schema['maximum']:g}"
    return ", ".join(f"{sign} {schema[key]:g}" for key, sign in _SIGNS.items() if key in schema)


def example(effect: type[Effect]) -> dict:
    """An entry of a mechanism's effects with typical values."""
    entry = {"name": get_args(effect.model_fields["name"].annotation)[0]}
    if "site" in effect.model_fields:
        entry["site"] = get_args(effect.model_fields["site"].annotation)[0]
    section = effect.model_fields["parameters"].annotation
    return entry | {
        "parameters": {
            name: field.examples[0] for name, field in section.model_fields.items() if field.examples[0] is not None
        }
    }
