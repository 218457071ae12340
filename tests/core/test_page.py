"""Pages in Markdown and HTML: equal content, escaped text."""

import base64
import re
from html.parser import HTMLParser
from io import BytesIO

import pytest
from markdown_it import MarkdownIt
from PIL import Image

from jointgap.core.page import (
    Bullets,
    Cell,
    FigureBlock,
    Heading,
    Link,
    Page,
    Paragraph,
    TableBlock,
    to_html,
    to_markdown,
)

PAGE = Page(
    "A < B",
    (
        Paragraph("The force is -a*v*|v|.", strong=True),
        Heading("Where"),
        Bullets(("one <b>", "see `a*b|c`")),
        TableBlock(
            ("what", "value"), (("x | y\nz", "1.5"), ("`p|q`", Cell("missed", "bad"))), "lr"
        ),
        FigureBlock("gaps", "Gap before & after", "One is noise."),
    ),
)


def holds(text, *parts):
    assert [part for part in parts if part not in text] == []


def test_markdown_and_html_have_every_block_escaped_outside_code():
    assert (
        to_markdown(PAGE, "pictures") == "# A < B\n\n"
        "**The force is -a\\*v\\*\\|v\\|.**\n\n"
        "## Where\n\n"
        "- one \\<b>\n- see `a*b|c`\n\n"
        "| what | value |\n| --- | ---: |\n| x \\| y z | 1.5 |\n| `p\\|q` | missed |\n\n"
        "![Gap before & after](pictures/gaps.png)\n\n"
        "*Figure 1. Gap before & after. One is noise.*\n"
    )
    holds(
        to_html(PAGE),
        "<title>A &lt; B</title>",
        "<p class=answer>The force is -a*v*|v|.</p>",
        "<td class='n'>1.5</td>",
    )
    holds(
        to_html(PAGE),
        "<li>one &lt;b&gt;</li><li>see <code>a*b|c</code></li>",
        "<td class='v bad'>missed</td>",
    )
    unit = Page("5.93 N (90 % interval 5.89 to 5.98) → 3 mm", ())  # stays with its number
    holds(to_html(unit), "<h1>5.93\xa0N (90\xa0% interval 5.89 to 5.98) → 3\xa0mm</h1>")


HOSTILE = [
    "<script>alert(1)</script>",
    "`<img src=x onerror=alert(1)>``",
    "a `` b `<img src=x onerror=alert(1)>``` c`",
    "[x](javascript:alert(1))",
    "[x]: javascript:alert(1)",
    "&lt;b&gt; & <!-- no -->",
    "a | b || c",
    "one\n\n# two\n\n<script>alert(1)</script>",
    *("# no heading", "> no quotation", "- no list", "1. no list", "***", "a\n===", "\\"),
    *("_a_ __b__ ~~c~~ *d* **e**", "{{ 7 * 7 }} {% raw %}"),
]


class _Seen(HTMLParser):
    """Text and elements of a page, as a browser reads them."""

    def __init__(self, text: str):
        super().__init__()
        self.elements: list[str] = []
        self.texts: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append(" ".join([tag, *(name for name, _ in attrs)]))

    def handle_data(self, data):
        self.texts.append(data)


def _words(text: str) -> str:
    return " ".join(text.split())


def shown(text: str, form: str) -> _Seen:
    """A page of this text, as a browser shows it."""
    render = MarkdownIt("commonmark", {"html": True}).enable(["table", "strikethrough"]).render
    table = TableBlock((text, "b"), ((text, "c"),))
    page = Page(text, (Heading(text), Paragraph(text), Bullets((text,)), table))
    if form == "html":
        return _Seen(to_html(page).partition("</style>")[2])
    return _Seen(render(to_markdown(page)))


@pytest.mark.parametrize("form", ("markdown", "html"))
@pytest.mark.parametrize("text", HOSTILE)
def test_text_of_a_user_is_never_markup(text, form):
    seen, harmless = shown(text, form), shown("words", form)
    assert [element for element in seen.elements if element != "code"] == harmless.elements
    if "code" not in seen.elements:
        expected = "".join(harmless.texts).replace("words", _words(text))
        assert _words("".join(seen.texts)) == _words(expected)


def test_html_embeds_the_figures_that_exist(tmp_path):
    assert "<img" not in to_html(PAGE, tmp_path)
    Image.new("RGB", (2, 1), "red").save(tmp_path / "gaps.png")
    page = to_html(PAGE, tmp_path)
    taken_in = page.partition("src='data:image/png;base64,")[2].partition("'")[0]
    with Image.open(BytesIO(base64.b64decode(taken_in))) as image:
        assert image.convert("RGB").getpixel((1, 0)) == (255, 0, 0)
    caption = "<b>Figure 1. Gap before &amp; after.</b> One is noise.</figcaption>"
    holds(page, "<img alt='Gap before &amp; after'", caption)


def test_a_page_fits_a_phone_and_has_contents_with_links():
    page = to_html(PAGE)
    holds(
        page,
        "<html lang='en'>",
        "<meta name='viewport' content='width=device-width, initial-scale=1'>",
    )
    assert page.count("<div class='box'") == page.count("<table>") == 1 and "<nav" not in page
    page = to_html(
        Page("A", tuple(Heading(text) for text in ("One", "Two & a half", "One", "<b>")))
    )
    places = re.findall(r"<h2 id='([^']*)'", page)
    assert places == ["one", "two-a-half", "one-2", "b"] == re.findall(r"href='#([^']*)'", page)


def test_figures_and_tables_are_numbered_and_links_are_relative():
    table = TableBlock(("a",), (("1",),), caption="First things.")
    text = to_markdown(
        Page("A", (table, FigureBlock("x", "X"), table, FigureBlock("y", "Y", moving=True)))
    )
    holds(
        text,
        "Table 1. First",
        "Figure 1. X.",
        "Table 2. First",
        "![Y](figures/y.gif)",
        "Figure 2. Y.",
    )
    bullets = Bullets(
        (Link("the run", "my run/summary.html", "is `new`"), Link("it", "#a", ": `b`"))
    )
    page = Page("A", (bullets, TableBlock(("where",), ((Link("a]b", "javascript:alert(1)"),),))))
    run = "<li><a href='./my%20run/summary.html'>the run</a> is <code>new</code></li>"
    holds(
        to_html(page),
        run,
        "<li><a href='#a'>it</a>: <code>b</code></li>",
        "<a href='./javascript%3Aalert%281%29'>a]b</a>",
    )
    holds(
        to_markdown(page),
        "- [the run](./my%20run/summary.html) is `new`",
        r"[a\]b](./javascript%3Aalert%281%29)",
    )
