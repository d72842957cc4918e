"""The shape of the code: sizes and names that keep it a library two people can own."""

import ast
import collections
from pathlib import Path

ROOT = Path(__file__).parents[1]
LONGEST_FUNCTION = 80
KERNELS = ROOT / "glider" / "compiled"
"""Loops that numba compiles are one function each, however long."""


def modules_of(*folders):
    return [
        path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))
    ]


def long_functions(path):
    """Functions of more lines than LONGEST_FUNCTION."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    lengths = {
        node.name: node.end_lineno - node.lineno + 1
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    return [
        f"{path.relative_to(ROOT)}: {name}, {lines} lines"
        for name, lines in lengths.items()
        if lines > LONGEST_FUNCTION
    ]


def test_functions_are_short():
    paths = [p for p in modules_of("glider", "diagrams") if KERNELS not in p.parents]
    assert [fault for path in paths for fault in long_functions(path)] == []


def test_no_name_stands_for_three_modules():
    homes = collections.defaultdict(set)
    for path in modules_of("glider", "diagrams"):
        if path.stem not in ("__init__", "__main__"):
            homes[path.stem].add(path.relative_to(ROOT).parts[:2])
    assert {name: where for name, where in homes.items() if len(where) > 2} == {}


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= 200
