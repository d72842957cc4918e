"""Tests that need not run with each of the two Drakes."""

import shutil
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]

FOLDERS = (
    *("campaign", "commands", "compiled", "docs", "experiments"),
    *("files", "helpers", "report", "sysid"),
)
"""Of tests in which Drake has no part, reading, tracing, reports, commands; and of the
docs, which are the same with any. The main job with either Drake is closing the loop's
example."""

FILES = (
    "benchmarks/test_bench_forms.py",
    "benchmarks/test_bench_peers.py",
    "benchmarks/test_mutate.py",
    "benchmarks/test_power.py",
    "control/test_predictor.py",
    "diagrams/programs/test_browser.py",
    "diagrams/programs/lab/test_lab.py",
    "diagrams/programs/lab/test_import.py",
    "diagrams/programs/lab/test_page.py",
    "diagrams/programs/lab/test_takes.py",
    "diagrams/programs/station/test_drivers.py",
    "diagrams/programs/station/test_faults.py",
    "examples/article/test_basis_model.py",
    "examples/article/test_course.py",
    "examples/article/test_learning_loop.py",
    "physics/test_held_commands.py",
    "planning/test_problem.py",
    "simulation/test_refly.py",
    "test_changed.py",
    "test_contributing.py",
    "test_floors.py",
    "test_front_door.py",
    "test_shape.py",
    "test_vocabulary.py",
    "verification/test_check.py",
    "verification/test_check_funnel.py",
    "physics/test_confidence.py",
    "verification/test_defect.py",
    "verification/test_exact_time.py",
    "verification/test_falsify.py",
    "verification/test_feedback.py",
    "verification/test_flight_proof.py",
    "verification/test_forged.py",
    "verification/test_gliders.py",
    "verification/test_goal.py",
    "verification/test_held.py",
    "verification/test_held_gliders.py",
    "verification/test_interval.py",
    "verification/test_interval_gliders.py",
    "verification/test_latency.py",
    "verification/test_latency_gliders.py",
    "verification/test_pushes.py",
    "verification/test_remainder.py",
    "verification/test_remainder_proof.py",
    "verification/test_sizes.py",
    "verification/test_taylor_models.py",
)
"""The same: of a browser, of sources, of regressions, and of proofs that no solver has
a part in. And what uses Drake only as other files do that run with both: the station's
faults and drivers its bus as test_station.py does, funnels the solvers as
test_funnel.py and test_sos.py."""

IS_LEFT_OUT = sys.version_info >= (3, 12) and shutil.which("python3.11") is not None
"""Whether this interpreter leaves them to another, of Python 3.11."""

WITHOUT_DRAKE = pytest.mark.skipif(
    IS_LEFT_OUT, reason="Drake has no part in it: it is tested with Python 3.11"
)
"""Mark of such tests."""


def is_without_drake(path: Path) -> bool:
    """Whether tests of a file, or of a whole folder, have nothing to do with Drake."""
    inside = path.relative_to(TESTS)
    return inside.as_posix() in FILES or not {*inside.parts[:1]}.isdisjoint(FOLDERS)
