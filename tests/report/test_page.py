"""A page says the same in Markdown and in HTML, and no text of it is taken for markup."""

import base64

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


def test_html_takes_in_the_figures_that_were_drawn_and_leaves_out_the_others(tmp_path):
    assert "<img" not in to_html(PAGE, tmp_path)
    (tmp_path / "gaps.png").write_bytes(b"a picture")
    image = base64.b64encode(b"a picture").decode()
    assert f"<img alt='Gap before &amp; after' src='data:image/png;base64,{image}'>" in to_html(PAGE, tmp_path)


def test_names_of_joints_channels_and_effects_read_as_words():
    assert in_words("crank_pin") == "crank pin"
    assert in_words("sensor_bias:crank_torque") == "sensor bias: crank torque"
