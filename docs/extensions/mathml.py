"""Formulas as MathML, which browsers draw by themselves: no script from elsewhere, and text that
can be searched."""

import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

BARE = re.compile(
    r"\\[td]?frac(?!\s*\{)"
)  # \frac12, which tex2mathml takes for the fraction of 12 and what follows

log = logging.getLogger(__name__)


def _mathml(node: nodes.Element, as_block: bool = False) -> str:
    formula = node.astext()
    if BARE.search(formula):
        log.warning(
            "write fractions with braces, \\frac{1}{2}: %s", formula, location=node, type="mathml"
        )
    return tex2mathml(formula, as_block=as_block)


def _inline(writer, node: nodes.math) -> None:
    writer.body.append(_mathml(node))
    raise nodes.SkipNode


def _block(writer, node: nodes.math_block) -> None:
    writer.body.append(f'<div class="formula">{_mathml(node, as_block=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict:
    """Offer the renderer `mathml`, and choose it."""
    app.add_html_math_renderer(
        "mathml", inline_renderers=(_inline, None), block_renderers=(_block, None)
    )
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
