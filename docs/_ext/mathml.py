"""Formulas as MathML, which browsers draw themselves: no script, no image, no network.

The converter is that of docutils. A formula it cannot read is a warning, which ends a build with ``-W``.
"""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)


def mathml(node: nodes.Element, block: bool) -> str:
    """The formula of a node; its LaTeX as code if it cannot be converted."""
    text = node.astext().strip()
    try:
        return tex2mathml(text, as_block=block)
    except MathError as error:
        logger.warning("formula cannot be converted: %s: %s", error, text, location=node)
        return f"<code>{nodes.unescape(text)}</code>"


def visit_inline(self: Any, node: nodes.math) -> None:
    self.body.append(mathml(node, block=False))
    raise nodes.SkipNode


def visit_block(self: Any, node: nodes.math_block) -> None:
    self.body.append(f'<div class="math-block">{mathml(node, block=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
