"""A page, written once and shown twice: as Markdown, and as one HTML file that needs nothing beside it.

A page is a title and a row of blocks. What a block looks like stands in ``templates/``, a template for each of the two
forms.
"""

import base64
import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape


@dataclass(frozen=True)
class Heading:
    """Heading of a section."""

    kind: ClassVar = "heading"
    text: str


@dataclass(frozen=True)
class Paragraph:
    """Sentences; what stands between backticks is code, here and in lists and tables. A strong one is the page's
    answer.
    """

    kind: ClassVar = "paragraph"
    text: str
    strong: bool = False


@dataclass(frozen=True)
class Bullets:
    """A list of points."""

    kind: ClassVar = "bullets"
    points: tuple[str, ...]


class Cell(NamedTuple):
    """A cell of a table that is good, bad or open news: its tone, ``''`` for none, colours it in HTML."""

    text: str
    tone: str = ""


@dataclass(frozen=True)
class TableBlock:
    """A table: texts of its head and of its rows, and for each column ``l`` or ``r`` (numbers stand to the right)."""

    kind: ClassVar = "table"
    heads: tuple[str, ...]
    rows: tuple[tuple[str | Cell, ...], ...]
    align: str = ""

    @property
    def rules(self) -> list[str]:
        """The line below the head, in Markdown's signs."""
        return ["---:" if side == "r" else "---" for side in self.align.ljust(len(self.heads), "l")]

    @property
    def lines(self) -> list[list[tuple[str, str]]]:
        """Rows of (text, CSS class)."""
        sides = ["n" if rule.endswith(":") else "" for rule in self.rules]
        cells = [[cell if isinstance(cell, Cell) else Cell(cell) for cell in row] for row in self.rows]
        return [
            [(c.text, f"v {c.tone}" if c.tone else side) for c, side in zip(row, sides, strict=True)] for row in cells
        ]


@dataclass(frozen=True)
class FigureBlock:
    """A saved figure by the stem of its files. HTML leaves it out where it was not drawn."""

    kind: ClassVar = "figure"
    stem: str
    title: str


Block = Heading | Paragraph | Bullets | TableBlock | FigureBlock


@dataclass(frozen=True)
class Page:
    """A title and what stands below it; `width` [CSS length] is the most that HTML takes of the screen."""

    title: str
    blocks: tuple[Block, ...]
    width: str = "75rem"


def to_markdown(page: Page, figures: str = "figures") -> str:
    """The page as Markdown; `figures` is the folder of the figures' SVG files, relative to the page."""
    return _TEMPLATES.get_template("page.md.j2").render(page=page, figures=figures)


def to_html(page: Page, figures: Path | str = "figures") -> str:
    """The page as one HTML file; `figures` is the folder of the figures' PNG files, which it takes in."""
    images = {
        block.stem: base64.b64encode(path.read_bytes()).decode()
        for block in page.blocks
        if isinstance(block, FigureBlock) and (path := Path(figures, f"{block.stem}.png")).exists()
    }
    return _TEMPLATES.get_template("page.html.j2").render(page=page, images=images)


_CODE = re.compile(r"((?<!`)`[^`]+`(?!`))")
"""What stands between backticks; two or three in a row mean something else in Markdown."""

_SIGNS = re.compile(
    r"[\\*|`~]"
    r"|<(?=[A-Za-z/!?])|&(?=#?\w+;)"  # tags, links and entities
    r"|\](?=[(\[:])"  # the middle of a link
    r"|(?<![^\W_])_|_(?![^\W_])"  # within a word it is a letter
)
_BEGINNING = re.compile(r"^(#+|[-+>=]+)(?=\s|$)|^(>)|^(\d{1,9})(?=[.)](?:\s|$))")
"""What makes a paragraph a heading, a list or a quotation."""


def markdown_text(text: str) -> str:
    """`text` as a paragraph in which the signs of Markdown mean themselves, apart from the backticks around code."""
    return _BEGINNING.sub(lambda found: f"{found[0]}\\" if found[3] else f"\\{found[0]}", _markdown_words(text))


def _markdown_words(text: str) -> str:
    parts = _CODE.split(" ".join(text.split()))
    return "".join(part if n % 2 else _SIGNS.sub(r"\\\g<0>", part) for n, part in enumerate(parts))


def _markdown_cell(text: str) -> str:
    """The same for a cell of a table: a bar in code is no border of a cell either, and no cell begins a list."""
    return re.sub(r"(?<!\\)\|", r"\|", _markdown_words(text))


def _with_code(text: str) -> Markup:
    """`text` as HTML, with what stands between backticks as code."""
    return Markup(_CODE.sub(lambda found: f"<code>{found[0][1:-1]}</code>", str(escape(text))))


_TEMPLATES = Environment(
    loader=PackageLoader("jointgap.report"),
    autoescape=lambda name: name is not None and name.endswith(".html.j2"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_TEMPLATES.filters |= {"markdown": markdown_text, "markdown_cell": _markdown_cell, "with_code": _with_code}
