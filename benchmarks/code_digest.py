"""Digest of the code that a function runs, by which a change of it is noticed.

It covers what the function names in its own module, and every module of this project
that is imported from there on, at the top of a module or inside of a function, without
comments, docstrings and imports for type checkers. Of a package whose names are loaded
lazily (`glider.lazy`) it covers the modules of those names that are imported.
"""

import ast
import functools
import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path

from glider.lazy import public_names

ROOT = Path(__file__).parents[1]
FOLDERS = (ROOT, ROOT / "examples" / "article")
"""Where modules of this project are imported from."""


def digest_of(function: Callable[..., object]) -> str:
    """Computes the digest of the code that a function of a module runs."""
    texts, waiting = {"": ""}, []
    for node in _own_statements(function):
        texts[""] += _text(node)
        waiting += _imported(node)
    while waiting:
        name = waiting.pop()
        if name not in texts:
            texts[name], imported = _module(name)
            waiting += imported
    whole = "\n".join(f"{name} {text}" for name, text in sorted(texts.items()) if text)
    return hashlib.sha256(whole.encode()).hexdigest()[:16]


@functools.cache
def _module(name: str) -> tuple[str, tuple[str, ...]]:
    """The text of a module and what it imports; nothing of one that is not ours."""
    tree = _tree(name)
    return ("", ()) if tree is None else (_text(tree), tuple(_imported(tree)))


def _own_statements(function: Callable[..., object]) -> Iterator[ast.stmt]:
    """Yields a function and the top statements of its module that define what it names.

    They are in the order of the module.
    """
    tree = _tree(function.__module__)
    assert tree is not None, f"{function.__module__} is no module of this project"
    named, count = {function.__name__}, 0
    while len(named) > count:
        count = len(named)
        used = [node for node in tree.body if _defined(node) & named]
        named |= {
            name.id
            for node in used
            for name in ast.walk(node)
            if isinstance(name, ast.Name)
        }
    for node in used:
        if isinstance(node, ast.Import | ast.ImportFrom):
            node.names = [a for a in node.names if _bound(a) in named]
        yield node


def _defined(node: ast.stmt) -> set[str]:
    """Names that a statement at the top of a module defines."""
    if isinstance(node, ast.Import | ast.ImportFrom):
        return {_bound(alias) for alias in node.names}
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return {node.name}
    return {
        name.id
        for name in ast.walk(node)
        if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store)
    }


def _bound(alias: ast.alias) -> str:
    """The name that an import binds."""
    return (alias.asname or alias.name).split(".")[0]


def _imported(tree: ast.AST) -> Iterator[str]:
    """Yields the modules that code imports, with the packages around them."""
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [_home(node.module or "", alias.name) for alias in node.names]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            # Of importlib.import_module.
            names = [node.value] if "." in node.value else []
        for name in names:
            parts = name.split(".")
            yield from (".".join(parts[: k + 1]) for k in range(len(parts)))


def _home(module: str, name: str) -> str:
    """The module that `from module import name` loads."""
    if _file(f"{module}.{name}") is not None:
        return f"{module}.{name}"
    file = _file(module)
    if file is not None and _is_lazy(file):
        return public_names(str(file))[name][0]
    return module


@functools.cache
def _file(module: str) -> Path | None:
    """The file of a module of this project; None for any other."""
    if not all(part.isidentifier() for part in module.split(".")):
        return None
    for folder in FOLDERS:
        place = folder.joinpath(*module.split("."))
        for file in (place.with_suffix(".py"), place / "__init__.py"):
            if file.is_file():
                return file
    return None


@functools.cache
def _is_lazy(file: Path) -> bool:
    is_package = file.name == "__init__.py"
    return is_package and "attach(__name__, " in file.read_text(encoding="utf-8")


def _tree(module: str) -> ast.Module | None:
    """The syntax tree of what a module runs; None where it is not ours, or lazy."""
    file = _file(module)
    if file is None or _is_lazy(file):
        return None
    return _Bare().visit(ast.parse(file.read_text(encoding="utf-8")))


class _Bare(ast.NodeTransformer):
    """Leaves out what does not run: docstrings, and imports for type checkers."""

    def visit_Expr(self, node):
        is_text = isinstance(node.value, ast.Constant)
        return None if is_text and isinstance(node.value.value, str) else node

    def visit_If(self, node):
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return [self.visit(other) for other in node.orelse]
        return self.generic_visit(node)


def _text(value: object) -> str:
    """Writes a syntax tree as text, the same in each version of Python."""
    if isinstance(value, ast.AST):
        fields = (
            f"{name}={_text(field)}"
            for name, field in ast.iter_fields(value)
            if field is not None and field != []  # Newer versions have more of these.
        )
        return f"{type(value).__name__}({' '.join(fields)})"
    if isinstance(value, list):
        return f"[{' '.join(map(_text, value))}]"
    return repr(value)
