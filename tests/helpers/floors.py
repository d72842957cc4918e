"""The order of packages: each imports only from those before it."""

from pathlib import Path

TESTS = Path(__file__).parents[1]

FLOORS = [
    "glider.lazy",
    "glider.errors",
    "glider.paths",
    "glider.progress",
    "glider.files",
    "glider.physics",
    "glider.compiled",
    "glider.campaign",
    "glider.systems.template",
    "glider.systems.plant",
    "glider.sysid.constants",
    "glider.sysid.result",
    "glider.sysid.replay",
    "glider.sysid.likelihood",
    "glider.sysid.search",
    "glider.sysid.fit",
    "glider.sysid",
    "glider.planning",
    "glider.control",
    "glider.estimation",
    "glider.simulation",
    "glider.verification.dynamics",
    "glider.verification.sos",
    "glider.verification.funnel",
    "glider.verification.proof",
    "glider.verification.trials",
    "glider.verification",
    "glider.systems",
    "glider.experiments",
    "glider.report.plots",
    "glider.report",
    "glider.comparison",
    "glider.funnels",
    "glider.throws",
    "glider",
    "glider.commands",
    "glider.__main__",
    "diagrams",
    "diagrams.programs.page",
    "diagrams.programs.program",
    "diagrams.programs.station",
    "diagrams.programs.station.drivers",
    "diagrams.programs.lab",
    "diagrams.programs",
    "examples",
    "examples.article",
    "tests",
    "benchmarks",
]


def floor_of(test: Path) -> int:
    """Returns the floor of the package that a test is of, the last without one."""
    parts = test.relative_to(TESTS).parent.parts
    for count in range(len(parts), 0, -1):
        name = ".".join(parts[:count])
        for package in (f"glider.{name}", name):
            if package in FLOORS:
                return FLOORS.index(package)
    return len(FLOORS)
