"""A page of headings, sentences, tables and figures, as Markdown and as HTML."""

import base64
import html as escape
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from jointgap.figures.campaign_catalogue import CATALOGUE
from jointgap.paper.comparison_page import STYLE


@dataclass(frozen=True)
class Heading:
    """Of a section."""

    text: str


@dataclass(frozen=True)
class Text:
    """A paragraph; the strong one is the answer."""

    text: str
    strong: bool = False


@dataclass(frozen=True)
class Listing:
    """Points of a list."""

    points: tuple[str, ...]


@dataclass(frozen=True)
class Rows:
    """A table."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Picture:
    """A figure of `jointgap.figures.campaign_catalogue` by name; left out where it was not drawn."""

    name: str


Block = Heading | Text | Listing | Rows | Picture

_STYLE = STYLE + "img { max-width: 100%; } .answer { font-size: 1.25rem; } body { max-width: 60rem; }"


def markdown(title: str, blocks: Iterable[Block], figures: str) -> str:
    """The page as Markdown; `figures` is the folder of the SVG files, relative to the page."""
    lines = [f"# {title}"]
    for block in blocks:
        match block:
            case Heading(text):
                lines.append(f"## {text}")
            case Text(text, strong):
                lines.append(f"**{_plain(text)}**" if strong else _plain(text))
            case Listing(points):
                lines.append("\n".join(f"- {_plain(point)}" for point in points))
            case Rows(heads, rows):
                cells = [heads, ["---"] * len(heads), *rows]
                lines.append("\n".join(f"| {' | '.join(_plain(cell) for cell in row)} |" for row in cells))
            case Picture(name):
                lines.append(f"![{CATALOGUE[name].title}]({figures}/{name}.svg)")
    return "\n\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """Text in which stars and bars, as formulas have them, mean themselves."""
    return text.replace("*", r"\*").replace("|", r"\|")


def html(title: str, blocks: Iterable[Block], figures: Path | str) -> str:
    """The page as one self-contained file; `figures` is the folder of the PNG files, which it takes in."""
    parts = [
        f"<!doctype html><html lang='en'><head><meta charset='utf-8'><title>{escape.escape(title)}</title>",
        f"<style>{_STYLE}</style></head><body><h1>{escape.escape(title)}</h1>",
    ]
    for block in blocks:
        match block:
            case Heading(text):
                parts.append(f"<h2>{escape.escape(text)}</h2>")
            case Text(text, strong):
                parts.append(f"<p{' class=answer' if strong else ''}>{_marked(text)}</p>")
            case Listing(points):
                parts.append(f"<ul>{''.join(f'<li>{_marked(point)}</li>' for point in points)}</ul>")
            case Rows(heads, rows):
                head = "".join(f"<th>{escape.escape(cell)}</th>" for cell in heads)
                body = "".join(f"<tr>{''.join(f'<td>{escape.escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
                parts.append(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")
            case Picture(name):
                parts.append(_image(Path(figures) / f"{name}.png", CATALOGUE[name].title))
    return "\n".join([*parts, "</body></html>"]) + "\n"


def _marked(text: str) -> str:
    """Text as HTML, with what stands between backticks as code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape.escape(text))


def _image(path: Path, title: str) -> str:
    if not path.exists():
        return ""
    content = base64.b64encode(path.read_bytes()).decode()
    return f"<p><img alt='{escape.escape(title)}' src='data:image/png;base64,{content}'></p>"
