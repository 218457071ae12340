"""A page says the same in Markdown and in HTML, and no text of it is taken for markup."""

import base64
from html.parser import HTMLParser

import pytest
from markdown_it import MarkdownIt

from jointgap.report.page import (
    Bullets,
    Cell,
    FigureBlock,
    Heading,
    Page,
    Paragraph,
    TableBlock,
    to_html,
    to_markdown,
)
from jointgap.report.plain_words import in_words

PAGE = Page(
    "A < B",
    (
        Paragraph("The force is -a*v*|v|.", strong=True),
        Heading("Where"),
        Bullets(("one <b>", "see `a*b|c`")),
        TableBlock(("what", "value"), (("x | y\nz", "1.5"), ("`p|q`", Cell("missed", "bad"))), "lr"),
        FigureBlock("gaps", "Gap before & after"),
    ),
)


def test_markdown_has_every_block_with_its_signs_escaped_outside_code():
    assert to_markdown(PAGE, "pictures") == (
        "# A < B\n\n"
        "**The force is -a\\*v\\*\\|v\\|.**\n\n"
        "## Where\n\n"
        "- one \\<b>\n- see `a*b|c`\n\n"
        "| what | value |\n| --- | ---: |\n| x \\| y z | 1.5 |\n| `p\\|q` | missed |\n\n"
        "![Gap before & after](pictures/gaps.svg)\n"
    )


def test_html_escapes_text_marks_code_and_colours_what_is_news():
    page = to_html(PAGE)
    for part in (
        "<title>A &lt; B</title>",
        "<p class=answer>The force is -a*v*|v|.</p>",
        "<li>one &lt;b&gt;</li><li>see <code>a*b|c</code></li>",
        "<td class='n'>1.5</td>",
        "<td class='v bad'>missed</td>",
    ):
        assert part in page, part


HOSTILE = [
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "`<img src=x onerror=alert(1)>``",
    "a `` b `<img src=x onerror=alert(1)>``` c`",
    "[x](javascript:alert(1))",
    "[x]: javascript:alert(1)",
    "<javascript:alert(1)>",
    "&lt;b&gt; & <!-- no -->",
    "a | b || c",
    "one\n\n# two\n\n<script>alert(1)</script>",
    "# no heading",
    "> no quotation",
    "- no list",
    "1. no list",
    "***",
    "===",
    "a\n===",
    "_a_ __b__ ~~c~~ *d* **e**",
    "\\",
    "{{ 7 * 7 }} {% raw %}",
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


@pytest.mark.parametrize("text", HOSTILE)
@pytest.mark.parametrize("form", ["markdown", "html"])
def test_what_a_user_wrote_is_shown_as_text_and_is_never_markup(text, form):
    def shown(given: str) -> _Seen:
        page = Page(
            given, (Heading(given), Paragraph(given), Bullets((given,)), TableBlock((given, "b"), ((given, "c"),)))
        )
        if form == "html":
            return _Seen(to_html(page).partition("</style>")[2])
        return _Seen(
            MarkdownIt("commonmark", {"html": True}).enable(["table", "strikethrough"]).render(to_markdown(page))
        )

    seen, harmless = shown(text), shown("words")
    assert [one for one in seen.elements if one != "code"] == harmless.elements
    if "code" not in seen.elements:
        assert _words("".join(seen.texts)) == _words("".join(harmless.texts).replace("words", _words(text)))


def test_html_takes_in_the_figures_that_were_drawn_and_leaves_out_the_others(tmp_path):
    assert "<img" not in to_html(PAGE, tmp_path)
    (tmp_path / "gaps.png").write_bytes(b"a picture")
    image = base64.b64encode(b"a picture").decode()
    assert f"<img alt='Gap before &amp; after' src='data:image/png;base64,{image}'>" in to_html(PAGE, tmp_path)


def test_names_of_joints_channels_and_effects_read_as_words():
    assert in_words("crank_pin") == "crank pin"
    assert in_words("sensor_bias:crank_torque") == "sensor bias: crank torque"
