"""A package imports only from lower floors; CONTRIBUTING.md has their order."""

import ast
import functools
import graphlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.helpers.floors import FLOORS

ROOT = Path(__file__).parents[1]

"""Packages and lone modules from the ground up; of those that fit a module, the
longest holds. Modules of one package may import one another, but not in a circle."""

ROOMS = {
    *FLOORS,
    "glider.physics.effects",
    "glider.campaign.checks",
    "glider.campaign.importing",
    "glider.campaign.importing.readers",
} - {"glider"}
"""What may hold modules: none lies loose in glider/ but those that FLOORS names."""

OURS = {"glider", "diagrams", "examples", "tests", "benchmarks"}

Sources = dict[str, tuple[Path, str]]
"""Module name to its file and text."""


def read_sources(root: Path) -> Sources:
    """Reads the modules of the library, the diagrams and the examples."""
    sources = {}
    for folder in ("glider", "diagrams", "examples"):
        for path in sorted((root / folder).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            sources[name] = (path, path.read_text(encoding="utf-8"))
    return sources


def floor_of(module: str) -> str:
    """Returns the longest package of FLOORS that a module lies in."""
    return max((f for f in FLOORS if is_within(module, f)), key=len)


def is_within(module: str, package: str) -> bool:
    return module == package or module.startswith(package + ".")


parsed = functools.cache(ast.parse)


def imports_of(module: str, sources: Sources) -> Iterator[str]:
    """Yields our modules that a module imports, at its top or in a function."""
    path, text = sources[module]
    package = module.split(".")
    if path.name != "__init__.py":
        package = package[:-1]
    for node in ast.walk(parsed(text)):
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            start = ".".join([*base, node.module] if node.module else base)
            # Of "from a import b": a.b where that is a module, a otherwise.
            deeper = [f"{start}.{alias.name}" for alias in node.names]
            found = [name if name in sources else start for name in deeper]
        else:
            continue
        yield from (name for name in found if name.split(".")[0] in OURS)


def find_faults(sources: Sources) -> list[str]:
    """Returns a sentence for each package without a place and each wrong import."""
    faults = []
    for module, (path, _) in sorted(sources.items()):
        package = module if path.name == "__init__.py" else module.rpartition(".")[0]
        if module not in FLOORS and package not in ROOMS:
            faults.append(f"{module} is on no floor: it needs a package of FLOORS")
            continue
        here = floor_of(module)
        for target in sorted(set(imports_of(module, sources)) - {module}):
            there = floor_of(target)
            alone = here == "examples"
            if FLOORS.index(there) > FLOORS.index(here) or (alone and there == here):
                faults.append(f"{module} ({here}) imports {target} ({there})")
    return faults


def find_circle(sources: Sources) -> list[str]:
    """Returns modules that import one another in a circle, or an empty list."""
    graph = {m: set(imports_of(m, sources)) - {m} for m in sources}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return []


def test_packages_import_only_from_lower_floors():
    sources = read_sources(ROOT)
    assert "glider.physics.state" in sources
    assert find_faults(sources) == []


def test_no_modules_import_one_another_in_a_circle():
    assert find_circle(read_sources(ROOT)) == []


def test_the_library_imports_no_diagram():
    sources = read_sources(ROOT)
    guilty = [
        module
        for module in sources
        if is_within(module, "glider")
        for target in imports_of(module, sources)
        if is_within(target, "diagrams")
    ]
    assert guilty == []


def systems_elsewhere(sources: Sources) -> list[str]:
    """Returns modules of the library beside glider.systems that import Drake's."""
    found = []
    for module, (_, text) in sources.items():
        names = set()
        for node in ast.walk(parsed(text)):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names.add(node.module)
        uses = any(is_within(name, "pydrake.systems") for name in names)
        ours = is_within(module, "glider") and not is_within(module, "glider.systems")
        if uses and ours:
            found.append(module)
    return found


def test_drake_systems_are_in_one_place():
    assert systems_elsewhere(read_sources(ROOT)) == []


def test_a_drake_system_elsewhere_is_caught(tmp_path):
    text = "def f():\n    from pydrake.systems.framework import LeafSystem\n"
    sources = make_tree(tmp_path, glider_control_own=text, glider_systems_own=text)
    assert systems_elsewhere(sources) == ["glider.control.own"]


def make_tree(root, **files):
    """Writes modules (a_b stands for a/b.py) with their packages, and reads them."""
    for name, text in {"glider_physics_state": "import math\n", **files}.items():
        path = root.joinpath(*name.split("_")).with_suffix(".py")
        path.parent.mkdir(parents=True, exist_ok=True)
        for folder in path.relative_to(root).parents:
            if str(folder) != "." and not (root / folder / "__init__.py").exists():
                (root / folder / "__init__.py").touch()
        path.write_text(text)
    return read_sources(root)


@pytest.mark.parametrize(
    "text",
    [
        "import glider.report\n",
        "import glider.report as r\n",
        "from glider.report import write\n",
        "from glider import report\n",
        "from .. import report\n",
        "from ..report import write\n",
        "def f():\n    from glider import report\n",
    ],
)
def test_an_upward_import_is_caught(tmp_path, text):
    sources = make_tree(tmp_path, glider_physics_state=text, glider_report_page="")
    faults = find_faults(sources)
    assert (
        "glider.physics.state (glider.physics) imports glider.report (glider.report)"
    ) in faults


def test_downward_and_sideways_imports_are_allowed(tmp_path):
    text = "from glider.physics import state\nfrom glider.report.a import X\n"
    sources = make_tree(tmp_path, glider_report_page=text, glider_report_a="")
    assert find_faults(sources) == []
    assert find_circle(sources) == []


def test_a_circle_is_caught(tmp_path):
    sources = make_tree(
        tmp_path,
        glider_planning_plan="from glider.planning import guess\n",
        glider_planning_guess="def f():\n    import glider.planning.plan\n",
    )
    assert find_faults(sources) == []
    assert set(find_circle(sources)) == {
        "glider.planning.plan",
        "glider.planning.guess",
    }


def test_a_package_without_a_place_is_caught(tmp_path):
    faults = find_faults(make_tree(tmp_path, glider_novelty_a="import math\n"))
    assert faults[0].startswith("glider.novelty is on no floor")


def test_a_loose_module_is_caught(tmp_path):
    """Only the front door, errors, paths and the command line stand outside rooms."""
    [fault] = find_faults(make_tree(tmp_path, glider_novelty="import math\n"))
    assert fault.startswith("glider.novelty is on no floor")


def test_examples_stand_alone_and_tests_are_not_imported(tmp_path):
    sources = make_tree(
        tmp_path,
        examples_perch="from examples import fly\nfrom tests import campaigns\n",
        examples_fly="from diagrams import loop\n",
        diagrams_loop="from glider.physics.state import X\n",
    )
    assert find_faults(sources) == [
        "examples.perch (examples) imports examples.fly (examples)",
        "examples.perch (examples) imports tests (tests)",
    ]
