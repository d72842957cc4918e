"""Tests that need not run with each of the two Drakes."""

import shutil
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]

FOLDERS = (
    *("campaign", "commands", "comparison", "compiled", "docs", "experiments"),
    *("files", "helpers", "report", "sysid"),
)
"""Of tests in which Drake has no part, reading, tracing, reports, commands; and of the
docs, which are the same with any. The main job with either Drake is closing the loop's
example."""

FILES = (
    "benchmarks/test_power.py",
    "diagrams/test_browser.py",
    "examples/article/test_basis_dynamics.py",
    "examples/test_figures.py",
    "examples/article/test_searches.py",
    "examples/test_next_throw.py",
    "test_changed.py",
    "test_contributing.py",
    "test_floors.py",
    "test_front_door.py",
    "verification/test_check_funnel.py",
    "verification/test_confidence.py",
    "verification/test_defect.py",
    "verification/test_exact_time.py",
    "verification/test_flight_proof.py",
    "verification/test_forged.py",
    "verification/test_interval.py",
    "verification/test_interval_gliders.py",
    "verification/test_remainder_proof.py",
    "verification/test_taylor_models.py",
)
"""The same: of a browser, of sources, of regressions, and of proofs that no solver has
a part in."""

WITHOUT_DRAKE = pytest.mark.skipif(
    sys.version_info >= (3, 12) and shutil.which("python3.11") is not None,
    reason="Drake has no part in it: it is tested with Python 3.11",
)
"""Mark of such tests: where there are both interpreters, one of them runs these."""


def is_without_drake(path: Path) -> bool:
    """Whether a file's tests have nothing to do with Drake."""
    inside = path.relative_to(TESTS)
    return inside.parts[0] in FOLDERS or inside.as_posix() in FILES
