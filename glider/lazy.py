"""Public names of a package, each imported when it is first asked for."""

import ast
import importlib
import importlib.util
import warnings
from collections.abc import Callable
from pathlib import Path


def attach(
    package: str, file: str
) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """Makes the `__getattr__`, `__dir__` and `__all__` of a package.

    The names are those that its source imports under `if TYPE_CHECKING`, where mypy
    and editors see them: `import a.b as b` for a module, else `from a import b`.

    Args:
        package: its `__name__`.
        file: its `__file__`.
    """
    names = public_names(file)

    def get(name: str) -> object:
        if name not in names:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home, attribute = names[name]
        module = importlib.import_module(home)
        value = getattr(module, attribute) if attribute else module
        setattr(importlib.import_module(package), name, value)  # Asked for once.
        return value

    return get, lambda: sorted(names), list(names)


def public_names(file: str) -> dict[str, tuple[str, str | None]]:
    """Maps each name to its module, and to its name there or None for the module."""
    with open(file, encoding="utf-8") as source:
        tree = ast.parse(source.read())
    names: dict[str, tuple[str, str | None]] = {}
    for block in tree.body:
        for node in block.body if isinstance(block, ast.If) else ():
            if isinstance(node, ast.Import):
                names |= {a.asname or a.name: (a.name, None) for a in node.names}
            elif isinstance(node, ast.ImportFrom):
                names |= {a.name: (node.module or "", a.name) for a in node.names}
    return names


def warn_if_foreign(package: str, module: str) -> None:
    """Warns where a package of ours is another distribution's of the same name.

    Args:
        package: its name.
        module: that ours has.
    """
    found = importlib.util.find_spec(package)
    places = found.submodule_search_locations if found else None
    if places and not any((Path(place) / f"{module}.py").exists() for place in places):
        warnings.warn(
            f"The package '{package}' in {places[0]} is not that of drake-glider: "
            f"pip uninstall {package}, then install drake-glider again.",
            stacklevel=3,
        )
