"""Flow charts of docs/workflow.md as drawings of the page itself: GitHub needs a script for them,
the site none."""

import html
import re

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform

EDGE = re.compile(r"^\s*([\w-]+) --> ([\w-]+)\s*$", re.MULTILINE)

BOX_HEIGHT, ROW, GAP = 30, 66, 22  # px
LETTER = 8.2  # px, a wide one in the font of the boxes


class FlowTransform(SphinxTransform):
    """Replace code blocks in the language `mermaid` by drawings."""

    default_priority = 400

    def apply(self, **kwargs) -> None:
        """Replace all of them on the page."""
        for block in list(self.document.findall(nodes.literal_block)):
            if block.get("language") == "mermaid":
                block.replace_self(nodes.raw("", draw(EDGE.findall(block.astext())), format="html"))


def ranks(edges: list[tuple[str, str]]) -> dict[str, int]:
    """The row of each node: one below the lowest of those that lead to it."""
    found = {name: 0 for edge in edges for name in edge}
    for _ in found:  # the longest way has no more steps than there are nodes
        for source, target in edges:
            found[target] = max(found[target], found[source] + 1)
    return found


def draw(edges: list[tuple[str, str]]) -> str:
    """An SVG of the graph: rows from top to bottom, each node near the middle of those that lead to
    it.

    Parameters
    ----------
    edges : list of (source, target)
        Of a graph without cycles.
    """
    rank = ranks(edges)
    rows = [
        [name for name, row in rank.items() if row == number]
        for number in range(max(rank.values()) + 1)
    ]
    wide = {name: LETTER * len(name) + 18 for name in rank}
    whole = max(sum(wide[name] for name in row) + GAP * (len(row) - 1) for row in rows) + 2
    centre: dict[str, float] = {}
    for row in rows:
        above = {
            name: [centre[source] for source, target in edges if target == name] for name in row
        }
        row.sort(key=lambda name: sum(above[name]) / len(above[name]) if above[name] else 0.0)
        left = (whole - sum(wide[name] for name in row) - GAP * (len(row) - 1)) / 2
        for name in row:
            centre[name] = left + wide[name] / 2
            left += wide[name] + GAP
    parts = []
    for source, target in edges:
        x0, y0 = centre[source], rank[source] * ROW + BOX_HEIGHT + 1
        x1, y1 = centre[target], rank[target] * ROW - 3
        bend = (y1 - y0) / 2
        parts.append(
            f'<path d="M{x0:.0f},{y0} C{x0:.0f},{y0 + bend:.0f} {x1:.0f},{y1 - bend:.0f}'
            f' {x1:.0f},{y1}"/>'
        )
    for name, x in centre.items():
        y = rank[name] * ROW + 1
        parts.append(
            f'<rect x="{x - wide[name] / 2:.0f}" y="{y}" width="{wide[name]:.0f}"'
            f' height="{BOX_HEIGHT}" rx="5"/><text x="{x:.0f}"'
            f' y="{y + 20}">{html.escape(name)}</text>'
        )
    return (
        f'<div class="flow"><svg viewBox="0 0 {whole:.0f} {(len(rows) - 1) * ROW + BOX_HEIGHT + 3}"'
        f' width="{whole:.0f}" role="img" aria-label="flow chart of the stages"><defs><marker'
        ' id="arrow" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7"'
        f' orient="auto"><path d="M0,0 L8,4 L0,8 z"/></marker></defs>{"".join(parts)}</svg></div>'
    )


def setup(app: Sphinx) -> dict:
    """Draw as pages are read."""
    app.add_transform(FlowTransform)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
