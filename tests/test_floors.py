"""A module imports only from lower floors (the table of floors in design.md)."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

FLOORS: dict[float, list[str]] = {
    7: ["glider.__main__", "examples", "tests"],
    6: ["glider.report"],
    5.1: ["glider.learning"],
    5: ["diagrams", "glider.sysid.pipeline"],
    # From a fit to a verdict: weigh it, search with it, judge the search.
    4.6: ["glider.sysid.outcome"],
    4.5: ["glider.sysid.verdict"],
    4.4: ["glider.sysid.rough", "glider.sysid.tracing"],
    4.3: [
        "glider.low_reynolds",
        "glider.sysid.explanation",
        "glider.sysid.flight_weights",
    ],
    4.2: [
        "glider.sysid.coefficients",
        "glider.sysid.refly",
        "glider.sysid.search",
        "glider.sysid.unexplained",
    ],
    4.1: [
        "glider.planning.multistart",
        "glider.sysid.field_fit",
        "glider.sysid.forecast",
        "glider.sysid.signs",
        "glider.sysid.whiteness",
    ],
    4: [
        "glider.control",
        "glider.cruise",
        "glider.planning.dircol",
        "glider.sysid.rollout_fit",
        "glider.verification",
    ],
    3.2: [
        "glider.execution",
        "glider.monte_carlo",
        "glider.mppi_controller",
        "glider.planning.transcription",
        "glider.sysid.basis_logs",
    ],
    3.1: [
        "glider.estimation",
        "glider.guided",
        "glider.observer",
        "glider.planning.audit",
        "glider.planning.guess",
        "glider.planning.ilqr",
        "glider.sysid.residual",
        "glider.sysid.shooting",
        "glider.sysid.simulate",
        "glider.sysid.vehicle",
    ],
    3: [
        "glider.linearization",
        "glider.planning.sampling",
        "glider.plant",
        "glider.riccati",
        "glider.sensing",
        "glider.servo",
    ],
    # Flying a log again: theta, records, signals, states, errors.
    2.8: ["glider.sysid.information"],
    2.7: ["glider.sysid.linearization"],
    2.6: ["glider.sysid.nodes"],
    2.5: ["glider.sysid.signals"],
    2.4: ["glider.sysid.basis_study", "glider.sysid.record", "glider.sysid.warm_up"],
    2.3: ["glider.sysid.basis_exercise", "glider.sysid.layout"],
    # The waist, in three steps: the text of the physics, its loops over time and
    # its composition with effects, and what compiles them.
    2.2: ["glider.kernel", "glider.sysid.own_effects"],
    2.1: ["glider.dynamics", "glider.loops"],
    2: ["glider.chain"],
    1.4: ["glider.sysid.basis_choice"],
    1.3: ["glider.sysid.basis_refinement", "glider.sysid.result"],
    1.2: [
        "glider.model_file",
        "glider.sysid.basis_model",
        "glider.sysid.basis_recipe",
        "glider.sysid.noise",
    ],
    # A step above the aerodynamics and the plan that they share.
    1.1: [
        "glider.effects",
        "glider.servo_limits",
        "glider.sysid.basis_features",
        "glider.tracking",
    ],
    1: [
        "glider.actuator",
        "glider.aerodynamics",
        "glider.geometry",
        "glider.planning.plan",
        "glider.plots",
        "glider.sysid.regression",
        "glider.sysid.smoothing",
        "glider.trigonometry",
    ],
    # From a folder to flights: the text of a file, a flight, a campaign.
    0.4: ["glider.sysid.campaign_reader"],
    0.3: ["glider.sysid.campaign_writer", "glider.sysid.flight_reader"],
    0.2: [
        "glider.planning.problem",
        "glider.sysid.csv_table",
        "glider.sysid.flight_log",
    ],
    0.1: ["glider.miss", "glider.parameters"],
    0: ["glider.errors", "glider.paths", "glider.state"],
}
"""Floor to dotted prefixes; of those that fit a module, the longest holds. A
fraction is a step within a floor. A new module that none fits needs a place."""

ONE_HOUSE = [
    "diagrams",
    "glider.effects",
    "glider.estimation",
    "glider.loops",
    "glider.plots",
    "glider.report",
    "glider.verification",
]
"""Packages whose own modules may import one another."""

OURS = {"glider", "diagrams", "examples", "tests"}

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


def floor_of(module: str) -> float | None:
    """Returns the floor of the longest prefix that fits, None if none does."""
    fits = [
        (len(prefix), floor)
        for floor, prefixes in FLOORS.items()
        for prefix in prefixes
        if is_within(module, prefix)
    ]
    return max(fits)[1] if fits else None


def is_within(module: str, package: str) -> bool:
    return module == package or module.startswith(package + ".")


def imports_of(module: str, sources: Sources) -> Iterator[str]:
    """Yields our modules that a module imports, at its top or in a function."""
    path, text = sources[module]
    package = module.split(".")
    if path.name != "__init__.py":
        package = package[:-1]
    for node in ast.walk(ast.parse(text, filename=str(path))):
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


def with_packages(target: str, importer: str) -> Iterator[str]:
    """Yields a module and the packages that Python imports on the way to it."""
    parts = target.split(".")
    for end in range(1, len(parts) + 1):
        package = ".".join(parts[:end])
        if end == len(parts) or not is_within(importer, package):
            yield package


def is_allowed(importer: str, target: str) -> bool:
    here, there = floor_of(importer), floor_of(target)
    if here is None or there is None:
        return False
    if any(is_within(importer, p) and is_within(target, p) for p in ONE_HOUSE):
        return True
    return there < here


def find_faults(sources: Sources) -> list[str]:
    """Returns a sentence for each module without a place and each wrong import."""
    imports = {module: set(imports_of(module, sources)) for module in sources}
    # An __init__ that imports nothing of ours does no harm on any floor.
    bare = {
        module
        for module, (path, _) in sources.items()
        if path.name == "__init__.py" and not imports[module]
    }
    faults = []
    for module in sorted(sources.keys() - bare):
        if floor_of(module) is None:
            faults.append(f"{module} is on no floor: give it a place in FLOORS")
            continue
        targets = {t for name in imports[module] for t in with_packages(name, module)}
        faults += [
            f"{module} (floor {floor_of(module):g}) imports {target} "
            f"(floor {floor_of(target)})"
            for target in sorted(targets - bare - {module})
            if not is_allowed(module, target)
        ]
    return faults


def test_modules_import_only_from_lower_floors():
    sources = read_sources(ROOT)
    assert "glider.state" in sources
    assert find_faults(sources) == []


def test_the_library_imports_no_diagram():
    sources = read_sources(ROOT)
    guilty = [
        module
        for module in sources
        if is_within(module, "glider") and module != "glider.__main__"
        for target in imports_of(module, sources)
        if is_within(target, "diagrams")
    ]
    assert guilty == []


def make_tree(root, **files):
    """Writes modules (a_b stands for a/b.py) with their packages, and reads them."""
    for name, text in {"glider_state": "import math\n", **files}.items():
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
        "from . import report\n",
        "from .report import write\n",
        "def f():\n    from glider import report\n",
        "import glider.report.figures as figures\n",
    ],
)
def test_an_upward_import_is_caught(tmp_path, text):
    sources = make_tree(tmp_path, glider_state=text, glider_report="")
    faults = find_faults(sources)
    assert "glider.state (floor 0) imports glider.report (floor 6)" in faults


def test_a_downward_import_is_allowed(tmp_path):
    text = "from glider import state\nfrom glider.state import X\nimport numpy\n"
    assert find_faults(make_tree(tmp_path, glider_report=text)) == []


def test_a_sideways_import_is_caught_except_in_one_house(tmp_path):
    sources = make_tree(
        tmp_path,
        glider_plant="from glider import servo\n",
        glider_servo="",
        glider_effects_air="from glider.effects import sensor\n",
        glider_effects_sensor="",
    )
    [fault] = find_faults(sources)
    assert fault == "glider.plant (floor 3) imports glider.servo (floor 3)"


def test_a_module_without_a_place_is_caught(tmp_path):
    [fault] = find_faults(make_tree(tmp_path, glider_novelty="import math\n"))
    assert fault.startswith("glider.novelty is on no floor")


def test_the_longest_prefix_holds():
    assert floor_of("glider.sysid.rollout_fit") == 4
    assert floor_of("glider.plant") == 3
    assert floor_of("glider.sysid.residuals") is None
    assert floor_of("glider.states") is None


def test_a_package_that_imports_high_is_not_a_way_around(tmp_path):
    """Python runs glider/planning/__init__.py before glider.planning.problem."""
    sources = make_tree(
        tmp_path,
        glider_plant="import glider.planning.problem\n",
        glider_planning_problem="",
        glider_planning_dircol="",
    )
    assert find_faults(sources) == []
    init = tmp_path / "glider" / "planning" / "__init__.py"
    init.write_text("from glider.planning import dircol\n")
    faults = find_faults(read_sources(tmp_path))
    assert "glider.plant (floor 3) imports glider.planning (floor None)" in faults


def test_examples_stand_alone_and_tests_are_not_imported(tmp_path):
    sources = make_tree(
        tmp_path,
        examples_perch="from examples import fly\nfrom tests import campaigns\n",
        examples_fly="from diagrams import loop\n",
        diagrams_loop="from glider.state import X\n",
    )
    assert find_faults(sources) == [
        "examples.perch (floor 7) imports examples.fly (floor 7)",
        "examples.perch (floor 7) imports tests (floor 7)",
    ]
