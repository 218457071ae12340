"""What users wrote stands in the HTML report as text: Snakemake takes its first page as reStructuredText and HTML."""

from html.parser import HTMLParser
from types import SimpleNamespace

import pytest
from docutils.core import publish_parts
from jinja2 import Environment

from benchmarks.project import ROOT

HOSTILE = [
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "`x <javascript:alert(1)>`_ and `y`__ and z_",
    "javascript:alert(1) https://example.org",
    "a\n\n.. raw:: html\n\n    <script>alert(1)</script>",
    ".. raw:: html",
    ":raw-html:`<b>` |a| [1]_ *b* **c** ``d`` `e`",
    "{{ 7 * 7 }} {% for %} \\ \\* --- ...",
    "- no list",
]


class _Seen(HTMLParser):
    """Text and elements of a page, as a browser reads them."""

    def __init__(self, text: str):
        super().__init__()
        self.elements: list[str] = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append(" ".join([tag, *(name for name, _ in attrs)]))

    def handle_data(self, data):
        self.text += data


def first_page(description: str) -> _Seen:
    """The first page of the report of a scenario with that description, made as Snakemake makes it."""
    template = (ROOT / "workflow/report/workflow.rst").read_text(encoding="utf-8")
    config = {"scenarios": {"mine": {"description": description}}}
    text = Environment().from_string(template).render(snakemake=SimpleNamespace(config=config))
    return _Seen(publish_parts(text, writer="html")["html_body"])


@pytest.mark.parametrize("description", HOSTILE)
def test_a_description_is_shown_as_it_was_written_and_is_never_markup(description):
    seen, harmless = first_page(description), first_page("in a word")
    assert seen.elements == harmless.elements
    assert seen.text == harmless.text.replace("in a word", " ".join(description.split()))
