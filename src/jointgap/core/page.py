"""A page of results, as HTML and as Markdown."""

import re
from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import ClassVar, NamedTuple
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from jointgap import __version__
from jointgap.core.files import write_text
from jointgap.core.words import day_in_words


def data_address(path: Path) -> str:
    """The image in a file as an address that holds it."""
    return f"data:image/{path.suffix[1:]};base64,{b64encode(path.read_bytes()).decode()}"


_UNBROKEN = 24  # [characters] a cell up to this length stays on one line: a table scrolls sooner than it squeezes words
_CONTENTS_FROM, _PARTS_UP_TO = 4, 30
"""Sections from which on a page has a table of contents, and how many it may list with parts of sections among them."""


@dataclass(frozen=True)
class Heading:
    """Heading of a section (`level` 2) or of a part of one (3)."""

    kind: ClassVar = "heading"
    text: str
    level: int = 2


@dataclass(frozen=True)
class Paragraph:
    """Sentences; what stands between backticks is code, here and in lists and tables. A strong one is the page's
    answer.
    """

    kind: ClassVar = "paragraph"
    text: str
    strong: bool = False


class Link(NamedTuple):
    """A way to another file, or to a place on the page (``#...``), as a point of a list or a cell of a table.

    `target` is a path relative to the page, as it is on the disk; `then` follows the words of the link.
    """

    text: str
    target: str
    then: str = ""

    @property
    def gap(self) -> str:
        """What stands between the link and what follows it."""
        return " " if self.then and self.then.strip()[:1] not in ",;:.)" else ""

    @property
    def address(self) -> str:
        """The target as an address: whatever a path holds is a path, and no address of another kind."""
        if self.target.startswith("#"):
            return f"#{quote(self.target[1:])}"
        path = quote(self.target, safe="/#")
        return path if path.startswith((".", "/")) else f"./{path}"


@dataclass(frozen=True)
class Bullets:
    """A list of points."""

    kind: ClassVar = "bullets"
    points: tuple[str | Link, ...]


class Cell(NamedTuple):
    """A cell of a table that is good, bad or open news: its tone, ``''`` for none, colours it in HTML."""

    text: str
    tone: str = ""


@dataclass(frozen=True)
class TableBlock:
    """A table: texts of its head and of its rows, and for each column ``l`` or ``r`` (numbers stand to the right).

    One with a `caption` has a number on its page.
    """

    kind: ClassVar = "table"
    heads: tuple[str, ...]
    rows: tuple[tuple[str | Cell | Link, ...], ...]
    align: str = ""
    caption: str = ""

    @classmethod
    def of(cls, rows: Iterable[Mapping[str, "str | Cell | Link"]], align: str = "", caption: str = "") -> "TableBlock":
        """A table of rows that have their cells by the head of the column; at least one row."""
        rows = list(rows)
        return cls(tuple(rows[0]), tuple(tuple(row.values()) for row in rows), align, caption)

    @property
    def rules(self) -> list[str]:
        """The line below the head, in Markdown's signs."""
        return ["---:" if side == "r" else "---" for side in self.align.ljust(len(self.heads), "l")]

    @property
    def lines(self) -> list[list[tuple[str | Link, str]]]:
        """Rows of (text, CSS class)."""
        return [[_styled(cell, rule) for cell, rule in zip(row, self.rules, strict=True)] for row in self.rows]


def _styled(cell: str | Cell | Link, rule: str) -> tuple[str | Link, str]:
    """A cell of a column with that `rule`: its text, and its CSS class."""
    if isinstance(cell, Cell):
        return (cell.text, f"v {cell.tone}") if cell.tone else _styled(cell.text, rule)
    if rule.endswith(":"):
        return cell, "n"
    text = cell.text if isinstance(cell, Link) else cell
    return cell, "s" if len(text) <= _UNBROKEN else "w"


@dataclass(frozen=True)
class FigureBlock:
    """A saved figure by the stem of its files, relative to the folder of figures, with its title and what it shows.

    HTML leaves it out where it was not drawn. A `moving` one is a GIF, a still one PNG and SVG; `small` ones stand
    beside each other where there is room.
    """

    kind: ClassVar = "figure"
    stem: str
    title: str
    caption: str = ""
    moving: bool = False
    small: bool = False

    @property
    def image(self) -> str:
        """The file that HTML takes in, relative to the folder of figures."""
        return f"{self.stem}.{'gif' if self.moving else 'png'}"


Block = Heading | Paragraph | Bullets | TableBlock | FigureBlock


@dataclass(frozen=True)
class Page:
    """A title and what stands below it."""

    title: str  # The page's answer, or what it is about
    blocks: tuple[Block, ...]
    subject: str = ""  # What the page is about, where the title is the answer; stands above it
    footer: str = ""  # Of what and by what the page was written
    width: str = "75rem"  # The most that HTML takes of the screen [CSS length]

    @property
    def name(self) -> str:
        """Of the window, and the first line in Markdown."""
        return f"{self.subject}: {self.title}" if self.subject else self.title


class _Shown(NamedTuple):
    """A block with its number among its kind and the name of its place (headings alone)."""

    block: Block
    number: int = 0
    place: str = ""
    image: str = ""


def written_today() -> str:
    """For a footer: by which version a page was written, and when."""
    return f"Written by jointgap {__version__} on {day_in_words(date.today())}."


def write_page(stem: Path, page: Page, figures: str = ".") -> str:
    """Write a page as ``stem.html`` and ``stem.md``, with `figures` in that folder beside it; the text in Markdown."""
    text = to_markdown(page, figures)
    write_text(stem.with_name(f"{stem.name}.html"), to_html(page, stem.parent / figures))
    write_text(stem.with_name(f"{stem.name}.md"), text)
    return text


def to_markdown(page: Page, figures: str = "figures") -> str:
    """The page as Markdown; `figures` is the folder of the figures' files, relative to the page."""
    shown = tuple(_numbered(page.blocks))
    return _TEMPLATES.get_template("page.md.j2").render(page=page, shown=shown, figures=figures)


def to_html(page: Page, figures: Path | str = "figures") -> str:
    """The page as one HTML file; `figures` is the folder of the figures' image files, which it takes in."""
    there = [
        block for block in page.blocks if not isinstance(block, FigureBlock) or Path(figures, block.image).exists()
    ]
    shown = tuple(
        one._replace(image=data_address(Path(figures, one.block.image))) if isinstance(one.block, FigureBlock) else one
        for one in _numbered(there)
    )
    ahead = next((n for n, one in enumerate(shown) if isinstance(one.block, Heading)), len(shown))
    sections = [one for one in shown if isinstance(one.block, Heading)]
    if len(sections) > _PARTS_UP_TO:
        sections = [one for one in sections if one.block.level == 2]
    return _TEMPLATES.get_template("page.html.j2").render(
        page=page,
        first=shown[:ahead],
        rest=shown[ahead:],
        contents=sections if len(sections) >= _CONTENTS_FROM else [],
    )


def _numbered(blocks) -> Iterator[_Shown]:
    """The blocks with numbers of figures and of tables with captions, and names of the places of headings."""
    figures = tables = 0
    places: set[str] = set()
    for block in blocks:
        if isinstance(block, FigureBlock):
            figures += 1
            yield _Shown(block, figures)
        elif isinstance(block, TableBlock) and block.caption:
            tables += 1
            yield _Shown(block, tables)
        elif isinstance(block, Heading):
            name = place = place_of(block.text)
            while place in places:
                place = f"{name}-{len(places)}"
            places.add(place)
            yield _Shown(block, place=place)
        else:
            yield _Shown(block)


def place_of(heading: str) -> str:
    """The name of the place on a page of the first section with this `heading`: ``where-it-shows``."""
    return "-".join(re.findall(r"\w+", heading.lower())) or "section"


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


def _markdown_point(point: str | Link, of_cell: bool = False) -> str:
    """A point of a list or, with `of_cell`, a cell of a table."""
    escaped = _markdown_cell if of_cell else markdown_text
    if not isinstance(point, Link):
        return escaped(point)
    words = re.sub(r"(?<!\\)([\[\]])", r"\\\1", _markdown_cell(point.text))
    return f"[{words}]({point.address}){point.gap}{_markdown_cell(point.then)}"


def _html_point(point: str | Link) -> Markup:
    """A point of a list or a cell of a table."""
    if not isinstance(point, Link):
        return _with_code(point)
    return Markup(
        f"<a href='{escape(point.address)}'>{_with_code(point.text)}</a>{point.gap}{_with_code(point.then.strip())}"
    )


def _with_code(text: str) -> Markup:
    """`text` as HTML, with what stands between backticks as code."""
    return Markup(_CODE.sub(lambda found: f"<code>{found[0][1:-1]}</code>", str(escape(text))))


_NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=(?!to\b)[^\W\d]{1,3}\b|%)")

_TEMPLATES = Environment(
    loader=PackageLoader("jointgap.core"),
    autoescape=lambda name: name is not None and name.endswith(".html.j2"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_TEMPLATES.filters |= {
    "markdown": markdown_text,
    "markdown_cell": lambda cell: _markdown_point(cell, of_cell=True),
    "markdown_point": _markdown_point,
    "html_point": _html_point,
    "with_code": _with_code,
    "unbroken": lambda text: _NUMBER_AND_UNIT.sub("\N{NO-BREAK SPACE}", text),
}
