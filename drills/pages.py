"""What of a page is alive: elements and attributes that a browser acts upon, and the letters that it shows."""

from html.parser import HTMLParser
from typing import NamedTuple

from drills.harness import Complaint

_ACTIVE = {"script", "iframe", "object", "embed", "form", "link", "meta", "base", "style", "svg", "math", "template"}
_LINKS = ("href", "src", "action", "formaction", "xlink:href", "data", "srcdoc")


class Part(NamedTuple):
    """An element, with those of its attributes by which something can be run or fetched."""

    tag: str
    attributes: tuple[tuple[str, str], ...]


class _Parts(HTMLParser):
    def __init__(self):
        super().__init__(convert_charrefs=True)
        self.found: list[Part] = []
        self.shown: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        acting = tuple((name, value or "") for name, value in attrs if name.startswith("on") or name in _LINKS)
        self.found.append(Part(tag, acting))

    def handle_data(self, data: str) -> None:
        self.shown.append(data)


def parts(html: str) -> tuple[list[Part], str]:
    """The elements of a page, and its text."""
    parser = _Parts()
    parser.feed(html)
    parser.close()
    return parser.found, "".join(parser.shown)


def live(html: str, harmless: str, canary: str = "") -> Complaint | None:
    """What is alive in a page `html` that is not in the same page made with a `harmless` name.

    Parameters
    ----------
    html, harmless : str
    canary : str
        Text of a file that no page may take in.
    """
    (found, text), (usual, _) = parts(html), parts(harmless)
    known = set(usual)
    for part in found:
        if part in known or part.tag == "code":
            continue
        if part.tag in _ACTIVE or any(name.startswith("on") for name, _ in part.attributes):
            return Complaint(f"a live element {part.tag} comes of a name", f"{part}")
        if any("script:" in value.lower() or value.lower().startswith("data:text") for _, value in part.attributes):
            return Complaint("a link that runs a script comes of a name", f"{part}")
        if part.tag not in {one.tag for one in usual} or part.attributes:
            return Complaint("markup comes of a name", f"{part}")
    if canary and canary in text:
        return Complaint("a page takes in a file that a name asks for", canary)
    return None
