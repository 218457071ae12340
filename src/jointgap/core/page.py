"""A page of results, as HTML and as Markdown."""

import re
from base64 import b64encode
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote

from markupsafe import Markup, escape

from jointgap import __version__
from jointgap.core.files import write_text
from jointgap.core.words import format_day

if TYPE_CHECKING:
    from jinja2 import Template


def data_address(path: Path) -> str:
    """The image in a file as a data URL."""
    return f"data:image/{path.suffix[1:]};base64,{b64encode(path.read_bytes()).decode()}"


_UNBROKEN = (
    24  # [characters] shorter cells stay on one line: tables scroll instead of squeezing words
)
_CONTENTS_FROM, _PARTS_UP_TO = 4, 30
"""Number of sections above which a page has a table of contents, and its largest number of
entries."""


@dataclass(frozen=True)
class Heading:
    """Heading of a section (`level` 2) or subsection (3)."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Paragraph:
    """Text with code between backticks, as in lists and tables; a strong one is the main result of
    the page."""

    text: str
    strong: bool = False


class Link(NamedTuple):
    """A link to another file, or to an anchor of the page (``#...``), in a list or a table cell.

    `target` is a path relative to the page; `then` is text after the link.
    """

    text: str
    target: str
    then: str = ""

    @property
    def gap(self) -> str:
        """Space between the link and its following text."""
        return " " if self.then and self.then.strip()[:1] not in ",;:.)" else ""

    @property
    def address(self) -> str:
        """The target as a URL of a path, whatever characters it contains."""
        if self.target.startswith("#"):
            return f"#{quote(self.target[1:])}"
        path = quote(self.target, safe="/#")
        return path if path.startswith((".", "/")) else f"./{path}"


@dataclass(frozen=True)
class Bullets:
    """A list of points."""

    points: tuple[str | Link, ...]


class Cell(NamedTuple):
    """A table cell with a tone (good, bad, open or ``''``), which colours it in HTML."""

    text: str
    tone: str = ""


@dataclass(frozen=True)
class TableBlock:
    """A table: head, rows, and the alignment of each column, ``l`` or ``r`` (numbers).

    A table with a `caption` is numbered.
    """

    heads: tuple[str, ...]
    rows: tuple[tuple[str | Cell | Link, ...], ...]
    align: str = ""
    caption: str = ""

    @classmethod
    def of(
        cls, rows: Iterable[Mapping[str, "str | Cell | Link"]], align: str = "", caption: str = ""
    ) -> "TableBlock":
        """A table from at least one row of cells by column head."""
        rows = list(rows)
        return cls(tuple(rows[0]), tuple(tuple(row.values()) for row in rows), align, caption)

    @property
    def rules(self) -> list[str]:
        """Alignment row in Markdown."""
        return ["---:" if side == "r" else "---" for side in self.align.ljust(len(self.heads), "l")]

    @property
    def lines(self) -> list[list[tuple[str | Link, str]]]:
        """Rows of (text, CSS class)."""
        return [
            [_styled(cell, rule) for cell, rule in zip(row, self.rules, strict=True)]
            for row in self.rows
        ]


def _styled(cell: str | Cell | Link, rule: str) -> tuple[str | Link, str]:
    """Text and CSS class of a cell in a column with alignment `rule`."""
    if isinstance(cell, Cell):
        return (cell.text, f"v {cell.tone}") if cell.tone else _styled(cell.text, rule)
    if rule.endswith(":"):
        return cell, "n"
    text = cell.text if isinstance(cell, Link) else cell
    return cell, "s" if len(text) <= _UNBROKEN else "w"


@dataclass(frozen=True)
class FigureBlock:
    """A saved figure by the stem of its files, relative to the folder of figures, with title and
    caption.

    HTML omits missing figures. A `moving` one is a GIF, a still one PNG and SVG; `small` ones are
    placed side by side.
    """

    stem: str
    title: str
    caption: str = ""
    moving: bool = False
    small: bool = False

    @property
    def image(self) -> str:
        """The file for HTML, relative to the folder of figures."""
        return f"{self.stem}.{'gif' if self.moving else 'png'}"


Block = Heading | Paragraph | Bullets | TableBlock | FigureBlock


@dataclass(frozen=True)
class Page:
    """A title and blocks."""

    title: str  # Main result, or subject
    blocks: tuple[Block, ...]
    subject: str = ""  # Shown above the title, where that is the main result
    footer: str = ""  # Version and date
    width: str = "75rem"  # Largest width in HTML [CSS length]

    @property
    def name(self) -> str:
        """Title of the window, and first line in Markdown."""
        return f"{self.subject}: {self.title}" if self.subject else self.title


class _Shown(NamedTuple):
    """A block with its number among its kind and its anchor (headings only)."""

    block: Block
    number: int = 0
    place: str = ""
    image: str = ""

    @property
    def kind(self) -> str:
        """The class of the block."""
        return type(self.block).__name__


def written_today() -> str:
    """A footer with version and date."""
    return f"Written by jointgap {__version__} on {format_day(date.today())}."


def write_page(stem: Path, page: Page, figures: str = ".") -> str:
    """Write a page to ``stem.html`` and ``stem.md``, with `figures` in that folder next to it;
    returns the Markdown."""
    text = to_markdown(page, figures)
    write_text(stem.with_name(f"{stem.name}.html"), to_html(page, stem.parent / figures))
    write_text(stem.with_name(f"{stem.name}.md"), text)
    return text


def to_markdown(page: Page, figures: str = "figures") -> str:
    """The page as Markdown; `figures` is the folder of the figures' files, relative to the page."""
    shown = tuple(_numbered(page.blocks))
    return _template("page.md.j2").render(page=page, shown=shown, figures=figures)


def to_html(page: Page, figures: Path | str = "figures") -> str:
    """The page as one HTML file, with embedded images from the folder `figures`."""
    blocks = [
        block
        for block in page.blocks
        if not isinstance(block, FigureBlock) or Path(figures, block.image).exists()
    ]
    shown = tuple(_numbered(blocks, Path(figures)))
    ahead = next((n for n, item in enumerate(shown) if isinstance(item.block, Heading)), len(shown))
    sections = [item for item in shown if isinstance(item.block, Heading)]
    if len(sections) > _PARTS_UP_TO:
        sections = [item for item in sections if item.block.level == 2]
    return _template("page.html.j2").render(
        page=page,
        first=shown[:ahead],
        rest=shown[ahead:],
        contents=sections if len(sections) >= _CONTENTS_FROM else [],
    )


def _numbered(blocks: Iterable[Block], folder: Path | None = None) -> Iterator[_Shown]:
    """The blocks with numbers of figures and captioned tables, anchors of headings, and images in
    the `folder` of figures."""
    counts: Counter[type] = Counter()
    places: set[str] = set()
    for block in blocks:
        place = image = ""
        if isinstance(block, Heading):
            name = place = place_of(block.text)
            while place in places:
                place = f"{name}-{len(places)}"
            places.add(place)
        elif isinstance(block, FigureBlock) or getattr(block, "caption", ""):
            counts[type(block)] += 1
        if isinstance(block, FigureBlock) and folder:
            image = data_address(folder / block.image)
        yield _Shown(block, counts[type(block)], place, image)


def place_of(heading: str) -> str:
    """Anchor of the first section with this `heading`: ``where-it-shows``."""
    return "-".join(re.findall(r"\w+", heading.lower())) or "section"


_CODE = re.compile(r"((?<!`)`[^`]+`(?!`))")
"""Code between backticks; two or three in a row have another meaning in Markdown."""

_SIGNS = re.compile(
    r"[\\*|`~]"
    r"|<(?=[A-Za-z/!?])|&(?=#?\w+;)"  # tags, links and entities
    r"|\](?=[(\[:])"  # the middle of a link
    r"|(?<![^\W_])_|_(?![^\W_])"  # literal within a word
)
_BEGINNING = re.compile(r"^(#+|[-+>=]+)(?=\s|$)|^(>)|^(\d{1,9})(?=[.)](?:\s|$))")
"""Beginnings of headings, lists and quotations."""


def markdown_text(text: str) -> str:
    """`text` as a paragraph with Markdown's special characters escaped, except backticks around
    code."""
    return _BEGINNING.sub(
        lambda match: f"{match[0]}\\" if match[3] else f"\\{match[0]}", _markdown_words(text)
    )


def _markdown_words(text: str) -> str:
    parts = _CODE.split(" ".join(text.split()))
    return "".join(part if n % 2 else _SIGNS.sub(r"\\\g<0>", part) for n, part in enumerate(parts))


def _markdown_cell(text: str) -> str:
    """The same for a table cell: a bar in code is escaped too, and a cell begins no list."""
    return re.sub(r"(?<!\\)\|", r"\|", _markdown_words(text))


def _markdown_point(point: str | Link, of_cell: bool = False) -> str:
    """A list item or, with `of_cell`, a table cell."""
    escaped = _markdown_cell if of_cell else markdown_text
    if not isinstance(point, Link):
        return escaped(point)
    words = re.sub(r"(?<!\\)([\[\]])", r"\\\1", _markdown_cell(point.text))
    return f"[{words}]({point.address}){point.gap}{_markdown_cell(point.then)}"


def _html_point(point: str | Link) -> Markup:
    """A list item or a table cell."""
    if not isinstance(point, Link):
        return _with_code(point)
    return Markup(
        f"<a href='{escape(point.address)}'>{_with_code(point.text)}</a>"
        f"{point.gap}{_with_code(point.then.strip())}"
    )


def _with_code(text: str) -> Markup:
    """`text` as HTML, with code between backticks."""
    return Markup(_CODE.sub(lambda match: f"<code>{match[0][1:-1]}</code>", str(escape(text))))


_NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=(?!to\b)[^\W\d]{1,3}\b|%)")


@cache
def _template(name: str) -> "Template":
    from jinja2 import Environment, PackageLoader, StrictUndefined  # slow to load

    templates = Environment(
        loader=PackageLoader("jointgap.core"),
        autoescape=lambda name: name is not None and name.endswith(".html.j2"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    templates.filters |= {
        "markdown": markdown_text,
        "markdown_cell": lambda cell: _markdown_point(cell, of_cell=True),
        "markdown_point": _markdown_point,
        "html_point": _html_point,
        "with_code": _with_code,
        "unbroken": lambda text: _NUMBER_AND_UNIT.sub("\N{NO-BREAK SPACE}", text),
    }
    return templates.get_template(name)
