"""What the README shows in Python is there, and does what the README says."""

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

BLOCKS = re.findall(
    r"^```python\n(.*?)^```$",
    (ROOT / "README.md").read_text(encoding="utf-8"),
    re.DOTALL | re.MULTILINE,
)


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_what_is_imported_is_there(block):
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.ImportFrom):
            module = importlib.import_module(node.module)
            for alias in node.names:
                assert hasattr(module, alias.name), f"{node.module} has {alias.name}"


@pytest.mark.slow
def test_load_plan_fly(monkeypatch, capsys):
    """In ten lines, and with the numbers that its comments name."""
    [block] = [block for block in BLOCKS if "GliderModel.load(" in block]
    lines = [line for line in block.splitlines() if line]
    assert len(lines) <= 10
    monkeypatch.chdir(ROOT)
    names = {}
    exec(compile(block, "README.md", "exec"), names)
    planned, flights = names["planned"], names["flights"]
    assert [effect.kind.kind for effect in names["plant"].model.effects] == ["wind"]
    assert f"# cost {planned.cost:.2f}, {planned.duration:.4f} s, " in block
    assert f" {len(planned.times)} knots\n" in block
    assert flights.perched.shape == (100,)
    assert flights.perched.all()
    assert capsys.readouterr().out == "100 of 100 perch\n"
    assert "# 100 of 100\n" in block
