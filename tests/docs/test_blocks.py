"""Blocks of Python in the docs begin with all that they use."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
BLOCKS = {
    f"{path.name}:{number}": block
    for path in sorted((ROOT / "docs").glob("*.md"))
    for number, block in enumerate(BLOCK.findall(path.read_text(encoding="utf-8")))
}


@pytest.mark.parametrize("block", BLOCKS.values(), ids=BLOCKS.keys())
def test_a_block_names_nothing_that_it_does_not_define(block):
    command = [
        sys.executable,
        "-m",
        "ruff",
        "check",
        "--isolated",
        "--select=F821",
        "-",
    ]
    found = subprocess.run(
        command, input=block, capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stdout
