"""Commands that the docs show exist, with the options that they are shown with."""

import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from glider.__main__ import make_parser

ROOT = Path(__file__).parents[2]

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "tutorials").glob("*.py")),
    *sorted((ROOT / "examples").rglob("*.py")),
    *sorted((ROOT / "glider" / "commands").glob("*.py")),
]

IN_BLOCK = re.compile(r"^#? +(?:\.venv/bin/)?((?:glider|make|python) [^\n]*)$", re.M)
IN_TEXT = re.compile(r"`((?:glider|make|python) [^`]*)`")


def shown(program):
    """Pairs of a page and the arguments of a command of `program` on it."""
    found = set()
    for page in PAGES:
        text = re.sub(r" *\\{1,2}\n#? *", " ", page.read_text("utf-8"))
        for match in IN_BLOCK.findall(text) + IN_TEXT.findall(text):
            line = re.sub(r"\n#?|\s#.*$|\|.*$|[][]", " ", match)  # Optional is as good.
            if "= " in line or line.endswith("."):
                continue  # Code and prose.
            first, *words = shlex.split(line)
            if first == program:
                found.add((page.relative_to(ROOT).as_posix(), tuple(words)))
    return sorted(found)


def identify(case):
    return f"{case[0]}: {' '.join(case[1])}"


@pytest.mark.parametrize("case", shown("glider"), ids=identify)
def test_a_shown_command_is_parsed(case, capsys):
    words = [{"N": "3"}.get(word, word) for word in case[1]]
    is_name_alone = len(words) == 1
    try:
        make_parser().parse_args([*words, "--help"] if is_name_alone else words)
    except SystemExit as stop:
        assert stop.code == 0, capsys.readouterr().err


@pytest.mark.parametrize("case", shown("make"), ids=identify)
def test_a_shown_target_is_in_the_makefile(case):
    targets = {word for word in case[1] if "=" not in word}
    rules = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text("utf-8"), re.M)
    assert targets
    assert targets <= set(rules)


@pytest.mark.parametrize("case", shown("python"), ids=identify)
def test_a_shown_program_has_its_options(case):
    first, *words = case[1]
    if first == "-m":
        spec = importlib.util.find_spec(words[0])
        assert spec is not None
        path = Path(spec.origin)
    else:
        path = ROOT / first
    shared = ("diagrams/programs/program.py", "glider/commands/parsing.py")
    code = "".join(p.read_text("utf-8") for p in (path, *(ROOT / s for s in shared)))
    for option in re.findall(r"(?<= )--[a-z-]+", " ".join(["", *words])):
        assert f'"{option}"' in code


def test_the_console_script_and_the_module_are_one_command():
    """As an environment has them; the docs show the script."""
    script = Path(sys.executable).with_name("glider")
    said = [
        subprocess.run([*command, "--help"], capture_output=True, text=True, check=True)
        for command in ([script], [sys.executable, "-m", "glider"])
    ]
    assert said[0].stdout == said[1].stdout
    assert said[0].stdout.startswith("usage: glider ")
    assert not [page for page in PAGES if "python -m glider " in page.read_text()]
