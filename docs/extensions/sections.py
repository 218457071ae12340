"""Typed sections of the configuration in the reference: their fields with units, from the fields'
own descriptions."""

import types
import typing

from pydantic_core import PydanticUndefined
from sphinx.application import Sphinx

from jointgap.core.section import ConfigModel
from jointgap.effects.base import Effect


def _is_section(item) -> bool:
    return isinstance(item, type) and issubclass(item, ConfigModel) and not issubclass(item, Effect)


def _signature(app: Sphinx, what, name, item, options, signature, result):
    """Names and defaults alone: the types stand with the fields."""
    if not _is_section(item):
        return None
    shown = []
    for field, info in item.model_fields.items():
        plain = isinstance(info.default, bool | int | float | str) or info.default is None
        default = f"={info.default!r}" if plain else "=..."
        shown.append(field if info.is_required() else field + default)
    return f"({', '.join(shown)})", None


def _fields(app: Sphinx, what, name, item, options, lines: list[str]) -> None:
    """Append the fields, in the form that numpydoc reads."""
    if not _is_section(item) or not item.model_fields:
        return
    properties = item.model_json_schema()["properties"]
    lines += ["", "Attributes", "----------"]
    for field, info in item.model_fields.items():
        key = properties[field]
        unit = key.get("unit", "")
        words = [_kind(info.annotation)] + ([f"[{unit}]"] if unit and unit != "1" else [])
        if not info.is_required() and info.default is not PydanticUndefined:
            words.append("optional")
        lines += [
            f"{field} : {', '.join(words)}",
            f"    {key.get('description') or info.description or ''}",
        ]
    lines.append("")


def _kind(annotation) -> str:
    """A type in few words: that of the items of a union or a sequence by its name."""
    origin, inside = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return _kind(inside[0])
    if origin is typing.Literal:
        return "{" + ", ".join(repr(one) for one in inside) + "}"
    if origin in (typing.Union, types.UnionType):
        kinds = dict.fromkeys(_kind(one) for one in inside)
        return " or ".join(kinds) if len(kinds) < 5 else "one of the effects"
    if inside and origin is not None:
        kinds = dict.fromkeys(_kind(one) for one in inside if one is not ...)
        return f"{origin.__name__} of {', '.join(kinds)}"
    return "None" if annotation is type(None) else getattr(annotation, "__name__", str(annotation))


def _leave_out(app: Sphinx, what, name, item, skip, options):
    """What pydantic adds to every section says nothing of ours."""
    return True if name.startswith("model_") else None


def setup(app: Sphinx) -> dict:
    """Before numpydoc reads the docstrings."""
    app.connect("autodoc-process-signature", _signature, priority=400)
    app.connect("autodoc-process-docstring", _fields, priority=400)
    app.connect("autodoc-skip-member", _leave_out)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
