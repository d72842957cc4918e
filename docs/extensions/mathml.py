"""Sphinx extension: formulas as MathML, which browsers draw without a script.

Sphinx's own way fetches MathJax from elsewhere, which a lab's computer may not reach.
"""

from docutils.nodes import SkipNode, math, math_block
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator


def visit_inline(translator: HTML5Translator, node: math) -> None:
    """Writes a formula in a line of text."""
    translator.body.append(convert(node.astext()))
    raise SkipNode


def visit_block(translator: HTML5Translator, node: math_block) -> None:
    """Writes a formula of its own line, which scrolls where it is too wide."""
    formula = convert(node.astext(), display="block")
    translator.body.append(f'<div class="formula">{formula}</div>\n')
    raise SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the renderer to a Sphinx build."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
