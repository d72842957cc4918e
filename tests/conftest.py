"""Settings of every test."""

import os
from pathlib import Path

# For NumPy, when it is imported, here and in what tests start: two processes with two
# threads of linear algebra each wait for one another, small matrices ten times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import matplotlib
import pytest

from glider.physics.model import GliderModel
from glider.planning.dircol import plan
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from tests.helpers.floors import floor_of
from tests.helpers.legs import IS_LEFT_OUT, TESTS, WITHOUT_DRAKE, is_without_drake

matplotlib.use("Agg")  # Tests open no window.

# The same examples on every machine, and no time limit on one of them: the first
# call of a kernel compiles it.
hypothesis.settings.register_profile("glider", deadline=None, derandomize=True)
hypothesis.settings.load_profile("glider")


@pytest.fixture(scope="session")
def article_plan() -> Plan:
    """The article's problem, solved cold for the nominal model."""
    return plan(GliderModel(), PerchingProblem())


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Imports nothing of a leg that leaves it out, unless it is asked for by name."""
    is_whole = all(Path(name).resolve() == TESTS for name in config.args)
    left_out = is_whole and IS_LEFT_OUT and is_without_drake(collection_path)
    return True if left_out else None


def pytest_report_header() -> str | None:
    """Says that this is not all."""
    return f"not run: {WITHOUT_DRAKE.kwargs['reason']}" if IS_LEFT_OUT else None


def pytest_collection_modifyitems(
    config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Runs the tests of lower packages first: a cause fails before what it causes.

    In a package those that run commands come after the others. Slow tests come last; in
    several processes, their files come first. What Drake has no part in runs with one
    of the two.
    """
    of_commands = {
        path
        for path in {item.path for item in items}
        if "glider.__main__" in path.read_text(encoding="utf-8")
    }
    items.sort(key=lambda item: (floor_of(item.path), item.path in of_commands))
    for item in items:
        if is_without_drake(item.path):
            item.add_marker(WITHOUT_DRAKE)
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    if hasattr(config, "workerinput"):  # A worker that is idle steals from the end.
        items.sort(key=lambda item: item.path not in slow)
    else:
        items.sort(key=lambda item: item.get_closest_marker("slow") is not None)
