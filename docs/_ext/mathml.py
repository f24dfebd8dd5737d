"""Render formulas to MathML when the pages are built, with latex2mathml."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number

logger = logging.getLogger(__name__)


# A bracket at a table grows with it only if it is said to open or to close something.
_OPENING = re.compile(r"<mo>((?:&#x000(?:5B|28);)|[\[(])</mo>(?=<mtable>)")
_CLOSING = re.compile(r"(?<=</mtable>)<mo>((?:&#x000(?:5D|29);)|[\])])</mo>")


def to_mathml(latex: str, display: str, node: nodes.Node) -> str:
    """MathML of a formula; what latex2mathml does not know is reported as a warning."""
    try:
        markup = convert(latex.strip(), display=display)
    except Exception as error:
        logger.warning("formula cannot be rendered: %s (%r)", latex, error, location=node)
        return ""
    if unknown := re.findall(r"\\[A-Za-z{}]+", re.sub(r"&#x0*5C;", r"\\", markup)):
        logger.warning("unknown commands in a formula: %s", ", ".join(unknown), location=node)
    markup = _OPENING.sub(r'<mo form="prefix" stretchy="true" fence="true">\1</mo>', markup)
    return _CLOSING.sub(r'<mo form="postfix" stretchy="true" fence="true">\1</mo>', markup)


def visit_inline(self: Any, node: nodes.math) -> None:
    """Write an inline formula."""
    self.body.append(to_mathml(node.astext(), "inline", node))
    raise nodes.SkipNode


def visit_block(self: Any, node: nodes.math_block) -> None:
    """Write a displayed formula with its number."""
    # MyST wraps a labelled formula in a container that has the label's id already.
    ids = [i for i in node["ids"] if i not in node.parent.get("ids", [])]
    anchor = f' id="{ids[0]}"' if ids else ""
    self.body.append(f'<div class="math notranslate"{anchor}>')
    self.body.append(to_mathml(node.astext(), "block", node))
    if node["number"]:
        number = get_node_equation_number(self, node)
        self.body.append(f'<span class="eqno">({number})')
        self.add_permalink_ref(node, "Link to this equation")
        self.body.append("</span>")
    self.body.append("</div>")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer ``mathml``."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
