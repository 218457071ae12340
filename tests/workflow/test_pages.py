"""The pages name what is there: files that they link to, modules and functions of the package."""

import re
from importlib import import_module
from pkgutil import resolve_name

import pytest

from benchmarks.project import ROOT

PAGES = [
    *(
        ROOT / name
        for name in ("README.md", "config/README.md", "CONTRIBUTING.md", "SECURITY.md", "CODE_OF_CONDUCT.md")
    ),
    *sorted(page for page in ROOT.glob("docs/**/*.md") if "_build" not in page.parts),
]
each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


@each_page
def test_every_link_leads_to_a_file_and_to_a_heading_of_it(page):
    for path, heading in re.findall(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?\)", page.read_text(encoding="utf-8")):
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), path
        if heading:
            heads = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            assert heading in [re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads], heading


@each_page
def test_every_name_of_the_package_can_be_imported(page):
    text = page.read_text(encoding="utf-8")
    if page.stem == "changelog":
        text = re.sub(r"(?m)^ *\| `[^|]*\|", "", text)  # names as they were, in a table's first column
    for name in re.findall(r"`(jointgap(?:\.\w+)+)", text):
        resolve_name(name)
    for module, names in re.findall(r"^from (jointgap[\w.]*) import ([\w, ]+)$", text, re.MULTILINE):
        for name in names.split(", "):
            assert hasattr(import_module(module), name), (module, name)


def test_every_path_that_the_map_of_the_code_names_is_there():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for path in re.findall(r"`([\w.]+/[\w./-]*)`", text):
        if not path.startswith(("results/", "docs/_build/")):
            assert (ROOT / path).exists() or (ROOT / "src/jointgap" / path).exists(), path
