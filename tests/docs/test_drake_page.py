"""Each block of Python on the page for users of Drake is a script that runs."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "drake.md").read_text(encoding="utf-8")
SCRIPTS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)

SAYS = {
    "close_the_loop(campaign)": "effect_found",
    "ExtractGradient(": "'mass'",
    "class ConstantGains": "10 of 10 launches perch",
    "class FixedGains": "10 of 10 launches perch",
    "perching_program(model": "10 of 10 launches perch",
    "symbolic.EvalTimeDerivatives": "sqrt",
    "my_glider.yaml": "Plan(",
}
"""Maps what a script contains to what it prints, among other things."""


def run(script: str, folder: Path) -> str:
    """Runs a script as a reader does, who has copied it into a folder."""
    (folder / "script.py").write_text(script, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "script.py"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.docs
@pytest.mark.parametrize("script", SCRIPTS, ids=range(len(SCRIPTS)))
def test_a_script_of_the_page_runs_and_says_what_it_should(script, tmp_path):
    [expected] = [words for part, words in SAYS.items() if part in script]
    assert expected in run(script, tmp_path)


def test_all_scripts_are_known():
    assert len(SCRIPTS) == len(SAYS)


@pytest.mark.docs
def test_a_broken_script_is_noticed(tmp_path):
    [script] = [script for script in SCRIPTS if "my_glider.yaml" in script]
    with pytest.raises(AssertionError, match="pitch_inertia"):
        run(script.replace("pitch_inertia", "pitch_inertias"), tmp_path)
