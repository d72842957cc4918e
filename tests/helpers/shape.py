"""The size of the library's packages: syntax nodes, modules and public names.

    python -m tests.helpers.shape [--write]

prints each package's size beside its budget in tests/shape.yaml; with --write the
sizes of now become the budgets. `tests/test_shape.py` holds the packages to them.

A syntax node is a node of Python's syntax tree: unlike a line, it does not become fewer
where text is compressed. A public name is a function, class or constant at the top of a
module whose name does not begin with an underscore.
"""

import argparse
import ast
import dataclasses
import functools
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
FILE = ROOT / "tests" / "shape.yaml"
LIBRARY = ("glider", "diagrams")


@dataclasses.dataclass(frozen=True)
class Shape:
    """Size of a package, or its budget."""

    nodes: int
    modules: int
    names: int

    def __add__(self, other: "Shape") -> "Shape":
        """Returns the size of both together."""
        return Shape(
            self.nodes + other.nodes,
            self.modules + other.modules,
            self.names + other.names,
        )


def shape_of(text: str) -> Shape:
    """Returns the size of a module with this text."""
    tree = ast.parse(text)
    nodes = sum(1 for _ in ast.walk(tree))
    public = {name for name in top_level_names(tree) if not name.startswith("_")}
    return Shape(nodes, 1, len(public))


def top_level_names(tree: ast.Module) -> set[str]:
    """Returns the names that a module defines, without those that it imports."""
    names = set()
    for statement in tree.body:
        if isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
            names.add(statement.name)
        targets = []
        if isinstance(statement, ast.Assign):
            targets = statement.targets
        elif isinstance(statement, ast.AnnAssign):
            targets = [statement.target]
        for target in targets:
            for node in ast.walk(target):
                if isinstance(node, ast.Name):
                    names.add(node.id)
    return names


@functools.cache
def measure(root: Path = ROOT) -> dict[str, Shape]:
    """Returns the size of each package of the library, by its name."""
    found: dict[str, Shape] = {}
    for library in LIBRARY:
        for path in sorted((root / library).rglob("*.py")):
            package = package_of(path.relative_to(root))
            shape = shape_of(path.read_text(encoding="utf-8"))
            found[package] = found.get(package, Shape(0, 0, 0)) + shape
    return found


def package_of(path: Path) -> str:
    """Returns the package that a module is counted for: the second level at most."""
    return ".".join(path.parent.parts[:2])


def read_budgets() -> tuple[Shape, dict[str, Shape]]:
    """Returns the budget of the whole library and those of its packages."""
    data = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    packages = {name: Shape(**sizes) for name, sizes in data["packages"].items()}
    return Shape(**data["total"]), packages


def main() -> None:
    """Prints sizes and budgets, or makes the sizes the budgets."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--write", action="store_true", help="sizes become budgets")
    args = parser.parse_args()
    sizes = measure()
    total = sum(sizes.values(), Shape(0, 0, 0))
    if args.write:
        packages = {name: dataclasses.asdict(size) for name, size in sizes.items()}
        data = {"total": dataclasses.asdict(total), "packages": packages}
        head = "# Budgets of tests/test_shape.py; see tests/helpers/shape.py.\n"
        FILE.write_text(head + yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    whole, budgets = read_budgets()
    print(f"{'package':24}{'nodes':>9}{'budget':>9}{'modules':>9}{'names':>7}")
    for name, size in {"total": total, **sizes}.items():
        budget = {"total": whole, **budgets}.get(name)
        nodes = "none" if budget is None else budget.nodes
        print(f"{name:24}{size.nodes:9}{nodes:>9}{size.modules:9}{size.names:7}")


if __name__ == "__main__":
    main()
