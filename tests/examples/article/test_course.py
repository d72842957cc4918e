"""What all lessons share: a help, files refused before the work, and plain imports."""

import ast
import importlib
import inspect
import re
import sys
from pathlib import Path

import pytest

import course
from diagrams.programs.program import run
from glider.paths import models_path

FOLDER = Path(course.__file__).parent
README = (FOLDER / "README.md").read_text(encoding="utf-8")
LESSONS = re.findall(r"^\| \d+ \| `(\w+)\.py`", README, re.MULTILINE)
"""Names in the order of the README."""

ALLOWED = {"numpy", "scipy", "matplotlib", "pydrake", "glider", "diagrams"}


@pytest.fixture(params=LESSONS)
def lesson(request):
    return importlib.import_module(request.param)


def test_the_readme_lists_every_lesson_in_order():
    files = {path.stem for path in FOLDER.glob("*.py")} - {"course"}
    assert set(LESSONS) == files
    for number, name in enumerate(LESSONS, start=1):
        words = importlib.import_module(name).__doc__
        assert words.startswith(f"Lesson {number}: ")


def test_the_help_is_the_docstring_with_its_command(lesson, capsys):
    with pytest.raises(SystemExit) as end:
        lesson.main(["--help"])
    assert end.value.code == 0
    output = capsys.readouterr().out
    assert inspect.cleandoc(lesson.__doc__) in output
    assert f"python examples/article/{lesson.__name__}.py --figure" in output
    assert "The article's section" in output or "the article's section" in output


@pytest.mark.parametrize(
    ("file", "words"),
    [("absent/a.png", "in a folder that exists"), ("a.txt", "the format is '.txt'")],
)
def test_a_picture_that_cannot_be_is_refused_before_the_work(
    lesson, file, words, tmp_path, capsys
):
    given = ["--figure", str(tmp_path / file)]
    assert run(lambda: lesson.main(given)) == 2
    said = capsys.readouterr()
    assert words in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""


def test_a_lesson_needs_nothing_but_what_a_reader_has(lesson):
    """Numpy, scipy, matplotlib, Drake, the library and other lessons."""
    text = Path(lesson.__file__).read_text(encoding="utf-8")
    imported = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported |= {f"{node.module}.{alias.name}" for alias in node.names}
    roots = {name.partition(".")[0] for name in imported}
    assert roots <= ALLOWED | {"course", *LESSONS} | sys.stdlib_module_names
    assert [name for name in imported if "._" in name or ".compiled" in name] == []


def test_numbers_are_printed_beside_each_other_and_none_is_left_out(capsys):
    article = {"a level": "2.3045", "a flight": "figure"}
    assert course.compare(article, "2.30", "figure") == {
        "a level": "2.30",
        "a flight": "figure",
    }
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["article", "ours"]
    assert lines[1].split("  ")[0] == "a level"
    assert lines[1].split() == ["a", "level", "2.3045", "2.30"]
    with pytest.raises(ValueError, match="shorter"):
        course.compare(article, "2.30")


def test_what_the_lessons_load_ships():
    for name in ("heavy", "heavy_ekf"):
        assert models_path("vehicles", f"{name}.yaml").exists()
