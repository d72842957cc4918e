"""What README.md shows runs, and does what it says, where it alone is installed.

`make readme` runs its commands and its Python in the order of the page, in a fresh
environment with the wheel and the base requirements, from an empty folder. `make demo`,
the first of them, sets it up.
"""

import ast
import importlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from glider.physics.parameters import PARAMETER_NAMES, GliderParameters

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")

BLOCKS = re.findall(r"^```python\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE)
_OUTSIDE = re.sub(r"^```.*?^```$", "", TEXT, flags=re.DOTALL | re.MULTILINE)
COMMANDS = [
    re.split(r"\s+# ", line.strip())[0]
    for line in re.findall(r"^    (?=\S)(.*)$", _OUTSIDE, re.MULTILINE)
]
"""Of all indented lines outside of blocks, without their comments."""

OF_CI = ("make test", "make lint docs tables proofs benchmark")
"""What .ci/run runs itself, and what takes hours."""

FASTER = {
    "python examples/perch_corrected.py": "--launches 3",
    "python examples/perching_funnel.py": "--samples 80",
}
"""Options that make an example shorter: by default it flies hundreds of launches."""

LONGEST = ("glider close-the-loop four_at_once", "python examples/perching_funnel.py")
"""Run by make nightly: the sample campaign of `make demo` goes the same way, and
tests/examples/test_scripts.py checks funnels at few times."""

SERVERS = ("glider lab",)
"""Commands that serve a page until Ctrl-C."""


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_what_is_imported_is_there(block):
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.ImportFrom):
            module = importlib.import_module(node.module)
            for alias in node.names:
                assert hasattr(module, alias.name), f"{node.module} has {alias.name}"


def test_make_and_ci_know_the_targets():
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for command in COMMANDS:
        if command.startswith("make "):
            assert set(command.split()[1:]) <= set(targets), command
    assert set(OF_CI) <= set(COMMANDS)


# ------------------------------------------------------ in a fresh environment


class Place:
    """A folder to work in, and an environment with base requirements alone."""

    def __init__(self, folder: Path):
        self.folder, self.bin = folder / "work", folder / "venv" / "bin"
        self.folder.mkdir()
        own = {"PATH": f"{self.bin}:{os.environ['PATH']}"}
        # Nothing of the environment of the tests must reach it.
        hidden = ("PYTHONPATH", "VIRTUAL_ENV", "PYTHONHOME", "MAKEFLAGS", "MAKELEVEL")
        self.environment = {k: v for k, v in os.environ.items() if k not in hidden}
        self.environment |= own

    def start(self, command: str, folder: Path | None = None) -> subprocess.Popen:
        """Starts a command as a shell does, without a terminal."""
        return subprocess.Popen(
            ["bash", "-c", f"exec {command}"],
            cwd=folder or self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def run(self, command: str, folder: Path | None = None) -> str:
        """Runs a command, which must succeed; returns what it prints."""
        with self.start(command, folder) as process:
            words, _ = process.communicate(timeout=600)
        assert process.returncode == 0, f"{command}\n{words}"
        return words


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """The environment as `make demo` sets it up, then with the wheel.

    In the folder are what a reader has: takes of cameras, the examples and the models
    of a clone, and a report of last week.
    """
    place = Place(tmp_path_factory.mktemp("readme"))
    python = shlex.quote(sys.executable)
    demo = f"make demo VENV={place.bin.parent} PYTHON={python}"
    place.run(demo, ROOT)
    wheels = place.folder.parent / "wheels"
    place.run("python -m pip install -qq build")
    # The wheel is built from the sdist, so that both are tried.
    place.run(f"python -m build --outdir {wheels} {shlex.quote(str(ROOT))}")
    again = "python -m pip install -qq --no-deps --force-reinstall"
    place.run(f"{again} {wheels}/*.whl")
    place.run("glider samples attached_lift --out sample")
    takes = place.folder / "takes"
    takes.mkdir()
    for path in sorted((place.folder / "sample").glob("flight_*.csv"))[:8]:
        path.rename(takes / path.name.replace("flight", "take"))
    shutil.rmtree(place.folder / "sample")
    shutil.copytree(ROOT / "examples", place.folder / "examples")
    (place.folder / "models").symlink_to(ROOT / "models")
    shutil.copytree(ROOT / "out" / "demo", place.folder / "out" / "last_week")
    return place


INSTALLED = """
import pathlib, sys
import diagrams, glider
from glider.paths import models_path

for package in (glider, diagrams):
    folder = pathlib.Path(package.__file__).resolve().parent
    assert "site-packages" in folder.parts, folder
    assert (folder / "py.typed").is_file()
models, ours = models_path(), pathlib.Path(sys.argv[1], "models")
shipped = {p.relative_to(models) for p in models.rglob("*") if p.is_file()}
assert shipped == {p.relative_to(ours) for p in ours.rglob("*") if p.is_file()}
"""


@pytest.mark.readme
def test_the_wheel_has_the_packages_and_the_models_of_the_tree(place):
    place.run(f"python -c {shlex.quote(INSTALLED)} {shlex.quote(str(ROOT))}")


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(
            command,
            marks=[
                pytest.mark.nightly
                if command.startswith(LONGEST)
                else pytest.mark.readme
            ],
        )
        for command in COMMANDS
        if command not in OF_CI
    ],
)
def test_a_command_runs(place, command):
    if command == "make demo":
        report = json.loads((place.folder / "out/last_week/report.json").read_text())
        assert report["verdict"] == "effect_found"
    elif command.startswith(SERVERS):
        check_page(place, command)
    else:
        if "--out throws" in command:
            fill_in_vehicle(place.folder / "MAP.yaml")
        options = [more for name, more in FASTER.items() if command.startswith(name)]
        assert place.run(" ".join([command, *options])).strip()


def fill_in_vehicle(path):
    """Writes what a reader knows of the glider into a MAP that --guess proposed."""
    text = path.read_text(encoding="utf-8")
    assert text.rpartition("\nvehicle:")[2].count("\n  ") == 1  # At the end.
    known = GliderParameters()
    lines = (f"  {name}: {getattr(known, name)}\n" for name in PARAMETER_NAMES)
    path.write_text(text + "".join(lines), encoding="utf-8")


def check_page(place, command):
    """Starts a server, loads the page that it names and ends it as Ctrl-C does."""
    with place.start(command) as process:
        words = ""
        while (address := re.search(r"http://\S+", words)) is None:
            line = process.stdout.readline()
            assert line, words
            words += line
        with urllib.request.urlopen(address[0], timeout=60) as page:
            assert page.status == 200 and b"</html>" in page.read()
        process.send_signal(signal.SIGINT)
        words += process.communicate(timeout=60)[0]
        assert process.returncode == 0, words


@pytest.mark.readme
def test_a_diagram_is_built_flown_and_traced(place):
    """From any folder, and it prints what its comment says."""
    [block] = [block for block in BLOCKS if "DiagramBuilder()" in block]
    said = place.run(f"python -c {shlex.quote(block)}").splitlines()[-1]
    [expected] = re.findall(r"  # (effect_found .*)$", block, re.MULTILINE)
    number = re.compile(r"-?\d+\.\d+")
    assert number.sub("#", said) == number.sub("#", expected)
    found, told = ([float(n) for n in number.findall(x)] for x in (said, expected))
    assert found == pytest.approx(told, abs=1e-3)
