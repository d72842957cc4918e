"""The order of files where several processes share them."""

from pathlib import Path

TESTS = Path(__file__).parents[1]

LONGEST = (
    "sysid/test_lifelike.py",
    "estimation/test_estimation.py",
    "docs/test_site.py",
    "sysid/test_pipeline.py",
    "report/test_page_in_browser.py",
    "sysid/test_planted.py",
    "diagrams/test_browser.py",
    "sysid/replay/test_vehicle.py",
    "examples/test_perching_funnel.py",
    "helpers/test_lifelike.py",
    "sysid/replay/test_own_effects.py",
    "commands/test_main.py",
    "verification/test_interval_gliders.py",
    "examples/test_learn_residual.py",
    "examples/test_perch_corrected.py",
    "examples/test_filter_parameters.py",
    "control/test_control.py",
    "planning/test_sampling.py",
    "campaign/checks/test_broken_logs.py",
    "campaign/importing/test_import.py",
)
"""Files of a quarter of a minute and more, longest first: one that came last would
keep one process busy and the others idle. But the second compiles another loop than the
first, so that none is compiled twice."""


def place_of(path: Path) -> int:
    """Returns where a file of tests stands among the longest; the others come last."""
    name = path.relative_to(TESTS).as_posix()
    return LONGEST.index(name) if name in LONGEST else len(LONGEST)
