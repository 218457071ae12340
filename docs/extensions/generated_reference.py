"""Reference pages from what the code itself reads: JSON schemas, records of tables, catalogues of effects and figures.

A page holds the comment `<!-- filled by the build: NAME -->` where the tables of NAME come.
"""

import inspect
import json
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml
from sphinx.application import Sphinx

from jointgap.campaign.figures import FIGURES as CAMPAIGN_FIGURES
from jointgap.core import schema
from jointgap.effects import EFFECTS
from jointgap.effects.base import example, parameters_of
from jointgap.rig.sensors import FAULTS
from jointgap.scenario.figures import FIGURES

SCHEMAS = Path(__file__).parents[2] / "workflow" / "schemas"
MARK = re.compile(r"<!-- filled by the build: (\w+) -->")

Schema = dict[str, Any]


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table; columns in which no row says anything are left out."""
    kept = [i for i in range(len(heads)) if any(row[i] for row in rows)]
    clean = [[row[i].replace("|", "\\|").replace("\n", " ") for i in kept] for row in rows]
    lines = [[heads[i] for i in kept], ["---"] * len(kept), *clean]
    return [f"| {' | '.join(line)} |" for line in lines] + [""]


def code(text: str) -> str:
    """`text` as code, nothing where there is none."""
    return f"`{text}`" if text else ""


# -- schemas ----------------------------------------------------------------------------------------------------------


class SchemaPage:
    """Tables of the keys of one schema: the top level, then each section that a key leads to, once.

    Parameters
    ----------
    file : str
        Name of the schema in workflow/schemas.
    elsewhere : mapping of str to str
        Sections that another page has, by name, with the link to it.
    required : tuple of str
        Head of the column, and what it says of a key that the schema requires; of others it gives the default.
    """

    def __init__(self, file: str, elsewhere: dict[str, str], required: tuple[str, str] = ("default", "needed")):
        self._head, self._needed = required
        self._schema = json.loads((SCHEMAS / file).read_text(encoding="utf-8"))
        self._sections = self._schema.get("$defs", {})
        self._elsewhere = elsewhere

    def lines(self) -> list[str]:
        """The page in Markdown."""
        lines = ["## Top level", "", *self._keys(self._schema)]
        for name in self._reached():
            section = self._sections[name]
            lines += [f"## {_words(name)}", ""]
            if description := section.get("description"):
                lines += [_sentence(description), ""]
            lines += self._keys(section)
        return lines

    def _reached(self) -> list[str]:
        found: list[str] = []
        waiting = [self._schema | {"$defs": {}}]
        while waiting:
            for name in _references(waiting.pop(0)):
                if name not in found and name not in self._elsewhere:
                    found.append(name)
                    waiting.append(self._sections[name])
        return found

    def _keys(self, section: Schema) -> list[str]:
        holder = section["items"] if section.get("type") == "array" and "items" in section else section
        if "properties" not in holder:
            return [f"{self._kind(section)}.", ""]
        needed = holder.get("required", ())
        rows = list(self._rows(holder["properties"], needed, ""))
        return table(["key", "unit", "value", self._head, "meaning"], rows)

    def _rows(self, properties: Schema, needed: Sequence[str], before: str) -> Iterator[list[str]]:
        for name, key in properties.items():
            default = self._needed if name in needed else _default(key)
            yield [code(before + name), _unit(key), self._kind(key), default, _cell(self._meaning(key))]
            inner = key.get("items", key) if key.get("type") == "array" else key
            if "properties" in inner and "const" not in key:
                yield from self._rows(inner["properties"], inner.get("required", ()), f"{before}{name}.")

    def _meaning(self, key: Schema) -> str:
        """The description of a key; where it has none, that of the one section that it leads to."""
        if description := key.get("description"):
            return description
        sections = list(_references(key))
        return self._sections[sections[0]].get("description", "") if len(sections) == 1 else ""

    def _kind(self, key: Schema) -> str:
        """What the value of a key may be, in words."""
        if reference := key.get("$ref"):
            return self._link(reference.rsplit("/", 1)[1])
        if "const" in key:
            return f"`{key['const']}`"
        if "enum" in key:
            return ", ".join(code(json.dumps(one) if one is None else str(one)) for one in key["enum"])
        for several in ("anyOf", "oneOf"):
            if several in key:
                kinds = [self._kind(one) for one in key[several] if not _is_text_with_unit(one)]
                return " or ".join(dict.fromkeys(kinds))
        kind = key.get("type", "any")
        if isinstance(kind, list):
            return " or ".join(_KINDS.get(one, one) for one in kind)
        if kind == "array":
            inner = key.get("items") or next(iter(key.get("prefixItems", ())), {})
            items = self._kind(inner) if inner and "properties" not in inner else ""
            return f"list of {items}" if items else "list"
        if kind == "object" and isinstance(inner := key.get("additionalProperties"), dict):
            return f"by name: {self._kind(inner)}"
        return f"{_KINDS.get(kind, kind)}{_bounds(key)}"

    def _link(self, name: str) -> str:
        if name in self._elsewhere:
            return self._elsewhere[name]
        words = _words(name)
        return f"[{words.lower()}](#{words.lower().replace(' ', '-')})"


_KINDS = {
    "boolean": "`true` or `false`",
    "integer": "whole number",
    "null": "`null`",
    "object": "section",
    "string": "text",
}
_SIGNS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<", "maxLength": "length ≤"}


def _bounds(key: Schema) -> str:
    said = [f"{sign} {key[name]:g}" for name, sign in _SIGNS.items() if name in key]
    return f", {', '.join(said)}" if said else ""


def _is_text_with_unit(key: Schema) -> bool:
    return key.get("description", "").startswith("number with a unit")


def _unit(key: Schema) -> str:
    inner = [key, *key.get("anyOf", ()), *key.get("prefixItems", ()), key.get("items", {})]
    return next((one["unit"] for one in inner if isinstance(one, dict) and "unit" in one), "")


def _default(key: Schema) -> str:
    if "default" not in key:
        return ""
    value = key["default"]
    if isinstance(value, dict):
        return ""  # a section's own keys have theirs
    if isinstance(value, float):
        return f"{value:.6g}"
    return code(json.dumps(value, ensure_ascii=False)) if value != "" else ""


def _references(schema: Any) -> Iterator[str]:
    if isinstance(schema, dict):
        if isinstance(reference := schema.get("$ref"), str):
            yield reference.rsplit("/", 1)[1]
        for inner in schema.values():
            yield from _references(inner)
    elif isinstance(schema, list):
        for inner in schema:
            yield from _references(inner)


def _words(name: str) -> str:
    """`CampaignRun` as 'Campaign run'."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).capitalize()


def _cell(text: str) -> str:
    """A description on one line; brackets and stars of formulas stay what they are."""
    return " ".join(text.split()).replace("*", "\\*").replace("[", "\\[").replace("<", "&lt;").replace("$", "\\$")


def _sentence(text: str) -> str:
    """The same with a capital."""
    return _cell(text[:1].upper() + text[1:])


_EFFECT_SECTIONS = {page.__name__ for page in EFFECTS.values()}
_TO_EFFECTS = dict.fromkeys(_EFFECT_SECTIONS, "[effect](effects.md)")
_MECHANISM = "[mechanism](configuration_keys.md#mechanism)"


def _configuration() -> list[str]:
    return SchemaPage("config.schema.json", _TO_EFFECTS).lines()


def _campaign() -> list[str]:
    return SchemaPage("campaign.schema.json", {"Mechanism": _MECHANISM}).lines()


def _verdict() -> list[str]:
    return SchemaPage("verdict.schema.json", {}, ("there", "always")).lines()


# -- tables and effects -----------------------------------------------------------------------------------------------


def _tables() -> list[str]:
    groups = {
        "A scenario": ("simulate/", "surrogate/", "kinematics/", "optimise/", "comparison", "overview"),
        "A campaign": ("measure/", "{stage}/", "locate/", "preflight/", "confirm/", "augment/", "reoptimise/")
        + ("screen/", "decide/", "trend"),
    }
    lines = []
    left = dict(schema.TABLES)
    for title, places in groups.items():
        chosen = {name: one for name, one in left.items() if one.path.startswith(places)}
        left = {name: one for name, one in left.items() if name not in chosen}
        lines += _group(title, chosen)
    return lines + _group("Wherever the command says", left)


def _group(title: str, chosen: dict[str, schema.Table]) -> list[str]:
    lines = [f"## {title}", ""]
    for name, one in sorted(chosen.items()):
        rows = [
            [code(c.name), c.unit, c.kind, "yes" if c.nullable else "", _sentence(c.description)] for c in one.columns
        ]
        place = f" `{one.path}`" if one.path else ""
        lines += [f"### {name}", "", f"{_sentence(one.description)}.{place}", ""]
        lines += table(["column", "unit", "type", "may be empty", "meaning"], rows)
    return lines


def _effects() -> list[str]:
    lines = []
    for name, effect in EFFECTS.items():
        rows = [
            [code(row.name), row.unit, row.bounds, row.default, _cell(row.meaning)] for row in parameters_of(effect)
        ]
        lines += [f"## {name}", "", " ".join(inspect.cleandoc(effect.__doc__).split()).replace("`", "") + "", ""]
        lines += [
            f"Acts at: {effect.SITE}. Law:",
            "",
            "```text",
            effect.LAW,
            "```",
            "",
            f"Reference: {effect.REFERENCE}",
            "",
        ]
        lines += table(["parameter", "unit", "bounds", "default", "meaning"], rows)
        lines += ["```yaml", yaml.safe_dump({"effects": [example(effect)]}, sort_keys=False).rstrip(), "```", ""]
    rows = [
        [code(name), _sentence(fault.law), code(fault.parameter), fault.unit or "the channel's"]
        for name, fault in FAULTS.items()
    ]
    lines += ["## Faults of sensors", "", "A campaign looks for them; a mechanism file cannot list them.", ""]
    return lines + table(["fault", "reading y of the true u", "parameter", "unit"], rows)


# -- gallery ----------------------------------------------------------------------------------------------------------

GALLERY = Path(__file__).parents[1] / "figures" / "gallery"  # scripts/docs-figures fills it


def _gallery() -> list[str]:
    lines = []
    places = {path.parent.relative_to(GALLERY) for path in GALLERY.rglob("*.png")}
    for place in sorted(places, key=lambda place: (len(place.parts), place)):  # scenarios, then campaigns
        campaign = len(place.parts) > 1
        kind, command = (
            ("Campaign", f"make campaign CAMPAIGN=config/{place}.yaml") if campaign else ("Scenario", "make variants")
        )
        lines += [f"## {kind} `{place.name}`", "", f"Made by `{command}`, in `results/{place}/figures/`.", ""]
        lines += ["::::{grid} 1 1 2 2", ":gutter: 3", ""]
        for name, spec in (CAMPAIGN_FIGURES if campaign else FIGURES).items():
            if (GALLERY / place / f"{name}.png").exists():
                picture = f"figures/gallery/{place}/{name}.png"
                lines += [":::{grid-item}", f"[![{spec.title}]({picture})]({picture})", ""]
                lines += [f"**{spec.title}.** {_sentence(spec.caption)}", ":::", ""]
        lines += ["::::", ""]
    return lines


FILLS: dict[str, Callable[[], list[str]]] = {
    "configuration": _configuration,
    "campaign": _campaign,
    "verdict": _verdict,
    "tables": _tables,
    "effects": _effects,
    "gallery": _gallery,
}


def _fill(app: Sphinx, page: str, source: list[str]) -> None:
    source[0] = MARK.sub(lambda found: "\n".join(FILLS[found.group(1)]()), source[0])


def setup(app: Sphinx) -> dict:
    """Fill pages as they are read."""
    app.connect("source-read", _fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
