"""Sphinx extension: docstrings as they are written here, plain text with backticks.

In reST, bars, asterisks and underscores are markup: here they are absolute values,
products and names. An indented block is a formula or code, as in Markdown, where it is
no part of a section.
"""

import re

from sphinx.application import Sphinx

_CODE = re.compile(r"(``[^`]+``|`[^`]+`)")
_MARKUP = re.compile(r"[|*]|(?<=\w)_(?!\w)")
_SECTION = re.compile(
    r"(Args|Attributes|Examples?|Input ports|Notes?|Output ports|Raises|References|"
    r"Returns|Yields|Warns|Source):"
)


def to_rest(lines: list[str]) -> list[str]:
    """Returns the lines of a docstring as reST that says the same."""
    told: list[str] = []
    in_section = in_block = False
    for line in lines:
        is_indented = line.startswith("    ")
        if line and not is_indented:
            in_section = in_block = False
            if _SECTION.fullmatch(line.strip()):
                in_section = True
        if is_indented and not in_section:
            if not in_block:
                told += ["", "::", ""]
                in_block = True
            told.append(line)
            continue
        if line and told and told[-1].startswith("    ") and not in_section:
            told.append("")
        told.append(escaped(line))
    return told


def escaped(line: str) -> str:
    """Returns a line in which bars, asterisks and underscores mean themselves."""
    parts = _CODE.split(line)
    return "".join(
        part if k % 2 else _MARKUP.sub(lambda m: "\\" + m.group(), part)
        for k, part in enumerate(parts)
    )


def process(app, what, name, obj, options, lines: list[str]) -> None:
    """Rewrites a docstring in place, before napoleon reads its sections."""
    lines[:] = to_rest(lines)


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the rewriting to a Sphinx build."""
    app.connect("autodoc-process-docstring", process, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
