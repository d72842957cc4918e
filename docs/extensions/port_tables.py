"""Sphinx extension: pages of Drake systems, with their ports as tables.

Docstrings list ports as they list arguments, for `help`. Here such a section becomes a
table of name, size and meaning, and what Drake adds to each class is left out.
"""

import re

from sphinx.application import Sphinx

_SECTION = re.compile(r"(Input|Output) ports:")
_PORT = re.compile(r"    (\w+) \(([^)]*)\): (.*)")
_OF_DRAKE = re.compile(r"To(ScalarType|AutoDiffXd|Symbolic)|Do[A-Z]|.*𝓣")
"""Methods of Drake that a class overrides, and what a scalar conversion adds."""


def with_tables(lines: list[str]) -> list[str]:
    """Returns the lines of a docstring with its ports in tables of reST."""
    found: list[str] = []
    is_table = False
    for line in lines:
        if _SECTION.fullmatch(line):
            is_table = True
            found += head_of(line.removesuffix(":"))
            continue
        if line and not line.startswith("    "):
            is_table = False
        if not is_table:
            found.append(line)
        elif port := _PORT.fullmatch(line):
            name, size, meaning = port.groups()
            found += [f"   * - ``{name}``", f"     - {size}", f"     - {meaning}"]
        else:
            found.append(f"       {line.strip()}" if line else "")
    return found


def head_of(title: str) -> list[str]:
    """Returns the first lines of a table of ports."""
    return [
        f".. list-table:: {title}",
        "   :header-rows: 1",
        "   :widths: 22 13 65",
        "   :class: ports",
        "",
        "   * - name",
        "     - size",
        "     - meaning",
    ]


def process(app, what, name, obj, options, lines: list[str]) -> None:
    """Rewrites the ports of a docstring in place, before napoleon reads it."""
    lines[:] = with_tables(lines)


def skip(app, what, name: str, obj, is_skipped: bool, options) -> bool | None:
    """Leaves out what Drake adds to a class; None leaves the choice to others."""
    return True if _OF_DRAKE.match(name) else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the tables to a Sphinx build."""
    # After plain_docstrings, whose marks a table must not have, and before napoleon.
    app.connect("autodoc-process-docstring", process, priority=450)
    app.connect("autodoc-skip-member", skip)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
