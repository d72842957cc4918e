"""The doctor reports what works and what to do, and works where the rest does not."""

import ast
import importlib.metadata
import json
import subprocess
import sys
from pathlib import Path

import pytest

from glider.__main__ import main
from glider.commands import doctor
from glider.commands.doctor import Finding

ROOT = Path(__file__).parents[2]


def test_a_healthy_installation(capsys, monkeypatch):
    """All checks of the machine on which the tests run."""
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    for name in ("Python", "libraries", "models", "threads", "compiler", "Drake"):
        assert any(line.startswith(f"works {name} ") for line in lines), name
    extras = ("extra [import]", "extra [lab]")
    for name in ("cache", "output", "SNOPT", "IPOPT", "CLARABEL", *extras):
        assert any(line[6:].startswith(name) for line in lines), name
    assert lines[-1].startswith("Everything")


def test_findings_as_json(monkeypatch, capsys):
    def check():
        yield Finding("f", "g", "h", required=True)

    monkeypatch.setattr(doctor, "CHECKS", {"abc": check})
    assert main(["doctor", "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["summary"].startswith("1 of 1 fail")
    [found] = said["checks"]
    assert found["state"] == "fails"
    assert [found[key] for key in ("name", "found", "advice")] == ["f", "g", "h"]


def test_a_missing_library_fails_and_a_missing_extra_needs_a_look(monkeypatch):
    lines = ["numpy", "gremlin>=2; python_version>'3'", 'elf[x]; extra == "import"']
    monkeypatch.setattr(importlib.metadata, "requires", lambda name: lines)
    found = {f.name: f for f in doctor.check_libraries()}
    assert found["libraries"].state == "fails"
    assert "gremlin" in found["libraries"].found
    assert found["extra [import]"].state == "look"
    assert "pip install 'drake-glider[import]'" in found["extra [import]"].advice


EXTRAS = {"serial", "ezc3d"}
"""Modules that may be imported by name although an extra installs them: in a `try`, and
after `need`, by which readers of logs import theirs."""


def test_what_is_imported_is_a_requirement():
    """A command that runs here runs after `pip install .`, which takes no extra."""
    base, distributions = set(), importlib.metadata.packages_distributions()
    collect_requirements("drake-glider", base)
    for path in [*ROOT.glob("glider/**/*.py"), *ROOT.glob("diagrams/**/*.py")]:
        for module in modules_imported(path):
            package = module.split(".")[0]
            if package in sys.stdlib_module_names | {"glider", "diagrams", *EXTRAS}:
                continue
            homes = {name.lower() for name in distributions[package]}
            assert homes & base, f"{path.relative_to(ROOT)} imports {module}"


def collect_requirements(package, found):
    """Adds what a package without extras requires, and what that requires."""
    for line in importlib.metadata.requires(package) or []:
        name, extra = doctor.parse_requirement(line)
        if not extra and name.lower() not in found and doctor.version_of(name):
            found.add(name.lower())
            collect_requirements(name, found)


def modules_imported(path):
    """Yields the modules that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


def test_another_package_of_the_same_modules_fails(monkeypatch):
    """PyPI has a `diagrams` and a `glider`; pip overwrites one with another."""
    homes = {"diagrams": ["diagrams", "drake-glider"], "glider": ["drake-glider"]}
    monkeypatch.setattr(importlib.metadata, "packages_distributions", lambda: homes)
    found = {f.name: f for f in doctor.check_libraries()}
    assert found["diagrams"].state == "fails"
    assert "pip uninstall diagrams" in found["diagrams"].advice
    assert found["drake-glider"].state == "works"


def test_an_old_python_fails(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 9, 1))
    [finding] = doctor.check_python()
    assert finding.state == "fails"


def test_an_uninstalled_package_fails(monkeypatch):
    def not_there(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", not_there)
    [finding] = doctor.check_libraries()
    assert finding.state == "fails"


def test_code_that_is_not_compiled_needs_a_look(monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    [finding] = doctor.check_threads()
    assert finding.state == "look"


def test_a_cache_that_does_not_last_needs_a_look(monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr("glider.paths.cache_folder", lambda: tmp_path)
    cache, _ = doctor.check_folders()
    assert cache.name == "cache" and cache.state == "look"


def test_what_fails_is_the_exit_code_and_advice_stands_under_it(monkeypatch, capsys):
    def check():
        yield Finding("a", "b")
        yield Finding("c", "d", "e")
        yield Finding("f", "g", "h " * 50, required=True)

    def broken():
        raise ImportError("no such\nsymbol")
        yield

    def no_terminal(_):
        raise OSError

    monkeypatch.setattr(doctor, "CHECKS", {"abc": check, "lib": broken})
    monkeypatch.setattr("os.get_terminal_size", no_terminal)
    monkeypatch.delenv("COLUMNS", raising=False)
    assert main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert "fails lib              no such symbol" in out
    assert "2 of 4 fail" in out
    assert f"-> {'h ' * 49}h\n" in out  # In a pipe, advice is one line.
    monkeypatch.setenv("COLUMNS", "60")
    assert main(["doctor"]) == 1
    assert max(map(len, capsys.readouterr().out.splitlines())) == 60
    assert "-> e" in out


NOTHING = """
import sys

class Nothing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("numpy", "pydrake", "numba", "yaml", "rich"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Nothing())
from glider.__main__ import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["doctor"], 1, "fails Drake"),
        (["close-the-loop", "head_wind"], 2, "is not installed for"),
        (["samples"], 2, "use the Python of the environment"),
        (["--help"], 0, "doctor"),
    ],
)
def test_a_python_without_the_libraries_is_reported(arguments, code, words):
    """As where the environment is not activated: a sentence, no traceback."""
    done = subprocess.run(
        [sys.executable, "-c", NOTHING, *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stderr
    assert words in done.stdout + done.stderr
    assert "Traceback" not in done.stderr
