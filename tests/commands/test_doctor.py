"""The doctor reports what works and what to do, and works where the rest does not."""

import ast
import contextlib
import importlib.metadata
import re
import subprocess
import sys
from pathlib import Path

import pytest

from glider.__main__ import main
from glider.commands import doctor

ROOT = Path(__file__).parents[2]


def test_a_healthy_installation(capsys):
    """All checks of the machine on which the tests run."""
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in ("versions", "cache", "compiler", "solver"):
        assert any(line.startswith(f"works  {name} ") for line in lines), name
    assert lines[-1] == "Everything works."


def test_a_missing_library_fails(monkeypatch, capsys):
    def not_there(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", not_there)
    assert main(["doctor"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("fails  versions")
    assert "drake-glider" in lines[0]
    assert lines[-1].startswith("1 of 4 fail; install it again")


EXTRAS = {"serial", "ezc3d", "dask"}
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
        needed, _, condition = line.partition(";")
        name = re.match(r"[\w.-]+", needed)[0]
        if "extra ==" in condition or name.lower() in found:
            continue
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            importlib.metadata.version(name)
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
    with pytest.raises(ImportError, match="pip uninstall diagrams"):
        doctor.versions()


def test_a_cache_that_cannot_be_written_fails(monkeypatch, tmp_path, capsys):
    file = tmp_path / "file"
    file.write_text("in the way")
    monkeypatch.setattr("glider.paths.cache_folder", lambda: file)
    assert main(["doctor"]) == 1
    assert f"fails  cache     {file}: is a file" in capsys.readouterr().out


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
        (["doctor"], 1, "fails  solver"),
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
