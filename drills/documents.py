"""Random configurations as text: the shipped ones varied by what the JSON schemas allow, then damaged.

A key that is new in a schema is written here by itself.
"""

import json
import math
from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from drills.plain_quantities import UNITS, Unit, parse_unit, read
from drills.written import Schema, branches, fitting

ROOT = Path(__file__).resolve().parent.parent
MOST_MUTATIONS = 3


class Pairs(list):
    """A mapping: pairs of a key and what is below it, in which a key may come twice."""


Tree = str | list | Pairs
"""A value as it is written, a list, or `Pairs`."""


@cache
def schema(kind: str) -> Schema:
    """The JSON schema of a ``campaign`` or a ``config``."""
    return json.loads((ROOT / f"workflow/schemas/{kind}.schema.json").read_text(encoding="utf-8"))


def tree(node: yaml.Node) -> Tree:
    """What a YAML node is made of."""
    if isinstance(node, yaml.MappingNode):
        return Pairs((key.value, tree(value)) for key, value in node.value)
    if isinstance(node, yaml.SequenceNode):
        return [tree(value) for value in node.value]
    return node.value if node.style is None else json.dumps(node.value, ensure_ascii=False)


def shipped(path: str) -> Tree:
    """A shipped file."""
    return tree(yaml.compose((ROOT / path).read_text(encoding="utf-8")))


def written(content: Tree, indent: str = "") -> str:
    """The text of a tree in block style."""
    if isinstance(content, Pairs):
        return "".join(f"{indent}{key}:{_below(value, indent)}" for key, value in content) or f"{indent}{{}}\n"
    return "".join(f"{indent}-{_below(value, indent)}" for value in content) or f"{indent}[]\n"


def _below(value: Tree, indent: str) -> str:
    if isinstance(value, str):
        return f" {value}\n"
    return "\n" + written(value, indent + "  ") if value else (" {}\n" if isinstance(value, Pairs) else " []\n")


def get(pairs: Tree, key: str) -> Tree | None:
    return next((value for name, value in pairs if name == key), None) if isinstance(pairs, Pairs) else None


def put(pairs: Pairs, key: str, value: Tree) -> None:
    """Set a key, where it stands or at the end."""
    for place, (name, _) in enumerate(pairs):
        if name == key:
            pairs[place] = (key, value)
            return
    pairs.append((key, value))


# ----------------------------------------------------------------------------------------------------------------------
# what the schema allows


class Writer:
    """Writes values that a schema allows."""

    def __init__(self, random: np.random.Generator, root: Schema):
        self.random, self.root = random, root

    def chance(self, share: float) -> bool:
        return self.random.random() < share

    def one_of(self, choices: list):
        return choices[int(self.random.integers(len(choices)))]

    def vary(self, content: Tree, options: list[Schema], more: float) -> Tree:
        """`content` with numbers a little changed and in other notations, and some keys more that `options` allow."""
        if isinstance(content, Pairs):
            texts = {key: value for key, value in content if isinstance(value, str)}
            chosen = fitting(options, texts | dict.fromkeys([key for key, _ in content], ""), self.root) or {}
            known = chosen.get("properties", {})
            varied = Pairs()
            for key, value in content:
                entry = known.get(key, chosen.get("additionalProperties"))
                below = branches(entry, self.root) if isinstance(entry, dict) else []
                if key in known and key not in chosen.get("required", ()) and self.chance(0.02):
                    continue
                varied.append((key, self.vary(value, below, more)))
            present = [key for key, _ in content]
            for key in known:
                if key not in present and self.chance(more):
                    varied.append((key, self.fresh(branches(known[key], self.root))))
            return varied
        if isinstance(content, list):
            items = [option["items"] for option in options if isinstance(option.get("items"), dict)]
            prefix = next((option["prefixItems"] for option in options if "prefixItems" in option), [])
            entries = [prefix[place] if place < len(prefix) else next(iter(items), {}) for place in range(len(content))]
            return [
                self.vary(value, branches(entry, self.root), more)
                for value, entry in zip(content, entries, strict=True)
            ]
        unit = next((option["unit"] for option in options if "unit" in option), None)
        if unit is None or self.chance(0.4):
            return content
        value = read(content, unit).value
        return content if value is None else self.quantity(value * (1.0 + 0.01 * self.random.normal()), unit)

    def fresh(self, options: list[Schema], depth: int = 0) -> Tree:
        """A value of one of the `options`."""
        option = self.one_of(options)
        if "unit" in option:
            return self.quantity(self.size(option), option["unit"])
        if "const" in option:
            return json.dumps(option["const"])
        if "enum" in option:
            return json.dumps(self.one_of(option["enum"]))
        kind = option.get("type")
        kind = self.one_of(kind) if isinstance(kind, list) else kind
        if kind == "object" or "properties" in option:
            return self.mapping(option, depth)
        if kind == "array":
            entries = option.get("prefixItems") or [option.get("items", {})] * int(self.random.integers(1, 4))
            return [self.fresh(branches(entry, self.root), depth + 1) for entry in entries]
        if kind == "integer":
            usual = option.get("default")
            usual = usual if isinstance(usual, int) else int(self.one_of([1, 2, 5, 100]))
            return str(max(usual + int(self.random.integers(-1, 2)), option.get("minimum", 0)))
        if kind == "number":
            return self.number(self.size(option))
        return {"boolean": self.one_of(["true", "false"]), "null": "null"}.get(kind, self.word(option))

    def mapping(self, option: Schema, depth: int) -> Pairs:
        known, content = option.get("properties", {}), Pairs()
        for key, entry in known.items():
            if key in option.get("required", ()) or (depth < 4 and self.chance(0.2)):
                content.append((key, self.fresh(branches(entry, self.root), depth + 1)))
        if isinstance(option.get("additionalProperties"), dict) and not known:
            names = option.get("propertyNames", {}).get("enum") or ["one", "two", "three"]
            below = branches(option["additionalProperties"], self.root)
            for name in self.random.permutation(names)[: int(self.random.integers(1, 3))]:
                content.append((str(name), self.fresh(below, depth + 1)))
        return content

    def size(self, option: Schema) -> float:
        """A size that is likely to be possible: near an example or a default, else of any order of magnitude."""
        usual = option.get("default")
        if option.get("examples"):
            usual = option["examples"][0]
        if isinstance(usual, int | float) and not isinstance(usual, bool) and self.chance(0.9):
            return float(usual) * (1.0 + 0.1 * self.random.normal())
        size = 10.0 ** self.random.uniform(-6.0, 3.0)
        return min(size, option.get("maximum", math.inf), option.get("exclusiveMaximum", math.inf))

    def word(self, option: Schema) -> str:
        usual = option.get("default") or (option.get("examples") or [""])[0]
        return (
            json.dumps(usual) if isinstance(usual, str) and usual else self.one_of(["steel", "a word", "'3'", "über"])
        )

    def number(self, value: float) -> str:
        """A number in one of the notations that YAML and people have for it."""
        digits = self.one_of([f"{value!r}", f"{value:.9e}", f"{value:.12g}", f"{value:.8f}"])
        if float(digits) == 0.0:
            digits = repr(value)
        return self.one_of([digits, digits, digits, f"+{digits}" if value > 0 else digits, json.dumps(digits)])

    def quantity(self, value: float, unit: str) -> str:
        """`value` in SI, plain or in a unit of the same dimension."""
        if self.chance(0.3):
            return self.number(value)
        goal = parse_unit(unit) if unit != "1" else Unit(1.0, (0.0,) * 4)
        own = [unit] if unit != "1" else ["%", ""]
        own += [name for name, each in UNITS.items() if each.powers == goal.powers and unit != "1"]
        name = self.one_of(own)
        factor = parse_unit(name).factor if name else 1.0
        digits = self.one_of([f"{value / factor:.15g}", f"{value / factor!r}", f"{value / factor:.9e}"])
        space = self.one_of([" ", " ", " ", "", "  "]) if name[:1] not in ("e", "E") else " "
        text = f"{digits}{space}{name}".rstrip()
        return self.one_of([text, text, text, json.dumps(text, ensure_ascii=False), f"'{text}'"])


# ----------------------------------------------------------------------------------------------------------------------
# damage

TRAPS = [
    "yes", "no", "on", "off", "y", "n", "~", "null", "Null", "true", "True", "''", '""', "010", "0o10", "0x10", "0b11",
    "1_000", "1:30", "12:30:45", ".5", "5.", "1e3", "1.e+3", "1e-3", ".inf", "-.inf", ".nan", "nan", "inf", "infinity",
    "2026-03-01", "2026-03-01 12:00:00", "=", "<<", "!!str 7", "!!float 7", "!!int 7", '!!float "7"', "!!binary aGk=",
    "!!python/object/apply:os.system ['echo hi']", "!!python/name:os.system", "!!set {a}", "!!omap [a: 1]", "!mine 7",
    "!!timestamp 2026-03-01", "*nowhere", "&a [*a]", "&a {b: *a}", "%", "@", "`", "? a", "- 7", "| 7", "> 7", "1_0 mm",
    "0_1", "08", "09", "-0", "+0", "1e", "e1", "--7", "+-7 mm", "-+7", "7-", ".", "-", "+", ",", "1,5", "1.000,5",
]  # fmt: skip
"""What YAML 1.1 reads as something else than people, and what neither can read."""

HUGE = [
    "1e300", "-1e300", "1e-300", "1e400", "-1e400", "1e-400", "9" * 400, "0." + "0" * 400 + "1", "9" * 5000,
    "1e999999999", "1e300 mm", "9" * 400 + " mm", "1" + "0" * 20, "-1", "0", "-0.0", "1e-9", "1e9", "4.9e-324 m",
    "1e12", "100000000",
]  # fmt: skip

UNIT_TRAPS = [
    "{n} kg", "{n} m", "{n} mm", "{n} s", "{n} rad", "{n} deg", "{n} Hz", "{n} 1/s", "{n} rpm", "{n} degC", "{n} dB",
    "{n} Mm", "{n} mmm", "{n} m m", "{n} mm^2", "{n} m^0.5", "{n} m/s", "{n}mm", "{n} MM", "{n} Meter", "{n} mm mm",
    "mm {n}", "{n} *2 mm", "{n} * 2 mm", "{n} + 1 mm", "2 {n} mm", "{n} 2 mm", "{n}/2 mm", "{n}/2", "{n} mm/2",
    "({n}) mm", "{n} (mm)", "[{n} mm]", "{n} +- 1 mm", "{n} ± 1 mm", "{n}(1) mm", "{n} mm,", "{n} mm.", "{n};mm",
    "{n} mm # c", "{n} mm ...", "{n} mm -", "{n}^2 mm", "{n}**2 mm", "{n} e mm", "{n} pi mm", "{n} %", "{n} percent",
    "{n} ppm", "{n} count", "{n} dimensionless", "{n} radian", "1 {n} mm", "1 000 mm", "1'000 mm", "1 000.5 mm",
    "{n} mm or 3 mm", "{n} sqrt(mm)", "{n} abs(mm)", "nan mm", "inf mm", "-inf m", "0x7 mm", "0b1 mm", "1_000 mm",
    "1e3 mm", "1.e3mm", "1e+3 mm", "1e 3 mm", "1 e3 mm", "1e3e3 mm", "1.2.3 mm", "..5 mm", "{n} m*", "{n} m/",
    "{n} *m", "{n} /m", "{n} m//s", "{n} m^", "{n} m^^2", "{n} m^m", "{n} m^99999999", "{n}**99999999 mm",
    "9**9**9**9 mm", "{n} mm if 1 else 2", "lambda: 0", "{n} []", "{n} __class__", "{n} mm\\n", "\"{n} mm\\0\"",
    "\"{n}\\tmm\"", "\"{n}\\nmm\"", "{n} 'mm'",
]  # fmt: skip
"""Texts of numbers with units, {n} a number: wrong dimensions, arithmetic, marks for thousands, tolerances."""

TYPOGRAPHIC = [
    "\N{MINUS SIGN}{n}", "\N{MINUS SIGN}{n} mm", "\N{EN DASH}{n} mm", "\N{EM DASH}{n}", "\N{HYPHEN}{n} mm",
    "\N{NON-BREAKING HYPHEN}{n}", "\N{SMALL HYPHEN-MINUS}{n} mm", "\N{FULLWIDTH HYPHEN-MINUS}{n} mm",
    "\N{SUPERSCRIPT MINUS}{n}", "\N{SOFT HYPHEN}{n} mm", "{n}\N{NO-BREAK SPACE}mm", "{n}\N{THIN SPACE}mm",
    "{n}\N{NARROW NO-BREAK SPACE}mm", "{n}\N{ZERO WIDTH SPACE} mm", "\N{ZERO WIDTH NO-BREAK SPACE}{n} mm",
    "1\N{NO-BREAK SPACE}500 mm", "1\N{NARROW NO-BREAK SPACE}500", "1\N{THIN SPACE}500 mm",
    "1\N{RIGHT SINGLE QUOTATION MARK}500 mm", "1\N{DOT ABOVE}5 mm", "1\N{MIDDLE DOT}5 mm",
    "1\N{ARABIC DECIMAL SEPARATOR}5 mm", "{n} \N{MICRO SIGN}m", "{n} \N{GREEK SMALL LETTER MU}m",
    "{n} mm\N{SUPERSCRIPT TWO}", "{n}\N{SUPERSCRIPT TWO} mm", "{n}\N{SUPERSCRIPT TWO}",
    "\N{VULGAR FRACTION ONE HALF} mm", "1\N{VULGAR FRACTION ONE HALF} mm", "{n} \N{MULTIPLICATION SIGN} 10 mm",
    "{n}\N{MULTIPLICATION SIGN}10^3 mm", "{n} N\N{MIDDLE DOT}m", "{n} N\N{DOT OPERATOR}m",
    "{n} kg\N{MIDDLE DOT}m\N{SUPERSCRIPT TWO}", "{n}\N{DEGREE SIGN}", "{n} \N{DEGREE SIGN}C", "{n} \N{PRIME}",
    "{n}\N{PER MILLE SIGN}", "\N{FULLWIDTH DIGIT SEVEN} mm", "\N{ARABIC-INDIC DIGIT THREE} mm",
    "\N{ARABIC-INDIC DIGIT THREE}", "\N{DEVANAGARI DIGIT FIVE} m", "\N{RIGHT-TO-LEFT OVERRIDE}{n} mm",
    "{n} m\N{COMBINING LONG STROKE OVERLAY}m", "{n} \N{CYRILLIC SMALL LETTER ES}m", "{n} \N{SQUARE MM}",
    "{n} \N{GREEK SMALL LETTER OMEGA}", "\N{INFINITY}", "\N{INFINITY} m", "{n} \N{EN DASH} 9 mm",
    "{n}\N{HORIZONTAL ELLIPSIS}9 mm", "\N{ALMOST EQUAL TO}{n} mm", "<{n} mm", "\N{LESS-THAN OR EQUAL TO}{n} mm",
    "~{n} mm",
]  # fmt: skip


def _paths(content: Tree, path: tuple = ()) -> list[tuple]:
    """Every place in a tree: keys by their index, so that one that comes twice is told apart."""
    if isinstance(content, str):
        return [path]
    children = [value for _, value in content] if isinstance(content, Pairs) else content
    return [path] * bool(path) + [p for place, value in enumerate(children) for p in _paths(value, (*path, place))]


def _at(content: Tree, path: tuple) -> Tree:
    for place in path:
        content = content[place][1] if isinstance(content, Pairs) else content[place]
    return content


def _set(content: Tree, path: tuple, value: Tree) -> None:
    parent = _at(content, path[:-1])
    parent[path[-1]] = (parent[path[-1]][0], value) if isinstance(parent, Pairs) else value


def _replaced(choices: list[str]) -> Callable:
    def mutate(writer: Writer, content: Pairs) -> None:
        leaves = [path for path in _paths(content) if isinstance(_at(content, path), str)]
        path = writer.one_of(leaves)
        old = _at(content, path).strip("'\"").split()
        number = (
            old[0] if old and old[0].replace(".", "").replace("-", "").isdigit() else writer.one_of(["7", "0.5", "120"])
        )
        text = writer.one_of(choices).replace("{n}", number)
        if writer.chance(0.25) and "\\" not in text and not text.startswith(("!", "&", "*", '"', "'")):
            text = json.dumps(text, ensure_ascii=False)
        _set(content, path, text)

    return mutate


def _duplicated(writer: Writer, content: Pairs) -> None:
    """A key comes twice, with another value the second time."""
    parents = [content, *(each for path in _paths(content) if isinstance(each := _at(content, path), Pairs) and each)]
    parent = writer.one_of(parents)
    key, value = writer.one_of(list(parent))
    other = writer.one_of(["7 mm", "0.5", "{}", "ideal", "3"]) if writer.chance(0.5) else deepcopy(value)
    parent.insert(int(writer.random.integers(len(parent) + 1)), (key, other))


def _lost(writer: Writer, content: Pairs) -> None:
    path = writer.one_of(_paths(content))
    del _at(content, path[:-1])[path[-1]]


def _renamed(writer: Writer, content: Pairs) -> None:
    """A key becomes unknown, or no text at all."""
    parent = writer.one_of(
        [content, *(e for path in _paths(content) if isinstance(e := _at(content, path), Pairs) and e)]
    )
    place = int(writer.random.integers(len(parent)))
    key, value = parent[place]
    names = [
        key[:-1] or "x", key + "s", key.upper(), key.replace("_", "-"), "1", "null", "true", "[a]", "{a: b}", "1.5",
        '""', "? [a, b]\n", "2026-03-01", "<<", json.dumps(key + "\u202e", ensure_ascii=True),
        json.dumps(key + "\x1b[31m"), key + " ", f"'{key}'",
    ]  # fmt: skip
    parent[place] = (writer.one_of(names), value)


def _moved(writer: Writer, content: Pairs) -> None:
    """A value of another type: what stands elsewhere in the file."""
    paths = _paths(content)
    path, other = writer.one_of(paths), writer.one_of(paths)
    if other[: len(path)] != path and path[: len(other)] != other:
        _set(content, path, deepcopy(_at(content, other)))  # shared, it could be put into itself next


def _nested(writer: Writer, content: Pairs) -> None:
    """Brackets in brackets, aliases of aliases, or one text without an end."""
    depth = int(writer.one_of([50, 400, 3000, 30000]))
    laughs = "[" + ", ".join(f"&l{n} [{', '.join([f'*l{n - 1}' if n else 'ha'] * 9)}]" for n in range(12)) + "]"
    shapes = [
        "[" * depth + "]" * depth,
        "{a: " * depth + "1" + "}" * depth,
        "[" * depth,
        laughs,
        "7" * 30 * depth,
        "a" * 30 * depth,
    ]
    _set(content, writer.one_of(_paths(content)), writer.one_of(shapes))


def _merged(writer: Writer, content: Pairs) -> None:
    parents = [content, *(e for path in _paths(content) if isinstance(e := _at(content, path), Pairs) and e)]
    writer.one_of(parents).insert(
        0, ("<<", writer.one_of(["{length: 7 mm}", "[{mass: 3 kg}, {mass: 4 kg}]", "7", "{}"]))
    )


_OF_TREES = [
    (_replaced(TRAPS), 4),
    (_replaced(HUGE), 2),
    (_replaced(UNIT_TRAPS), 5),
    (_replaced(TYPOGRAPHIC), 4),
    (_replaced(["[1, 2]", "{a: 1}", "[]", "{}", "steel", "3", "0.5", "[7 mm]", "{value: 7, unit: mm}", "7, mm"]), 2),
    (_duplicated, 2),
    (_lost, 1),
    (_renamed, 1),
    (_moved, 1),
    (_nested, 0.3),
    (_merged, 0.3),
]

_BYTES = [
    lambda content, at: b"\xef\xbb\xbf" + content,
    lambda content, at: content.replace(b"\n", b"\r\n"),
    lambda content, at: content.replace(b"\n", b"\r"),
    lambda content, at: content[:at],
    lambda content, at: content[:at] + b"\x00" + content[at:],
    lambda content, at: content[:at] + b"\xff" + content[at:],
    lambda content, at: content[:at] + b"\t" + content[at:],
    lambda content, at: content[:at] + b"\xc2\x85" + content[at:],
    lambda content, at: content[:at] + b"\xe2\x80\xa8" + content[at:],
    lambda content, at: content[:at] + b"\x1b[31m" + content[at:],
    lambda content, at: content[:at] + content[at + 1 :],
    lambda content, at: content[:at] + b"\n---\n" + content[at:],
    lambda content, at: content + b"\n---\nname: other\n",
    lambda content, at: content.decode().encode("utf-16"),
    lambda content, at: content.decode().encode("utf-32"),
    lambda content, at: b"",
    lambda content, at: b"# nothing\n",
    lambda content, at: b"- " + content,
    lambda content, at: b"%YAML 1.2\n---\n" + content,
    lambda content, at: b"%YAML 9.9\n---\n" + content,
    lambda content, at: b"%TAG ! tag:evil,2000:\n---\n" + content,
]


def damaged(writer: Writer, content: Pairs) -> bytes:
    """The text of a tree, damaged in one to `MOST_MUTATIONS` places, now and then in its bytes too."""
    weights = np.array([weight for _, weight in _OF_TREES])
    for _ in range(int(writer.random.integers(1, MOST_MUTATIONS + 1))):
        place = int(writer.random.choice(len(_OF_TREES), p=weights / weights.sum()))
        if content and _paths(content):
            _OF_TREES[place][0](writer, content)
    encoded = written(content).encode("utf-8", "surrogatepass")
    if writer.chance(0.1):
        encoded = writer.one_of(_BYTES)(encoded, int(writer.random.integers(len(encoded) + 1)))
    return encoded
