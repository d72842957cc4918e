"""The command `doctor`: check this installation.

It runs where the rest does not: only the standard library is imported at the top.
"""

import argparse
import importlib.metadata
import json
import os
import re
import shutil
import sys
import tempfile
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from glider.commands.output import line_width
from glider.commands.parsing import CommandParser

DESCRIPTION = """\
Checks this installation and says how to fix what does not work: Python, libraries and
extras, models, threads, cache, output folder, compiler, Drake and its solvers.

exit code: 0 if everything that is required works, 1 if not.
"""

_PACKAGE = "drake-glider"
_REINSTALL = "install it again: make setup, or pip install . in its source tree"
_LEAST_SPACE = 200e6  # Bytes: compiled kernels take about half of it.
_GROUPS = ("", "import", "lab")  # Extras for developers are not checked.
_SOLVERS = ("Snopt", "Ipopt", "Clarabel")  # Of the planners and the funnels.


class Finding(NamedTuple):
    """The outcome of a check; without advice it works."""

    name: str
    found: str
    advice: str = ""
    required: bool = False

    @property
    def state(self) -> str:
        """In a word: all is well, something optional or something required is not."""
        return ("fails" if self.required else "look") if self.advice else "works"

    def __str__(self) -> str:
        """As lines as wide as the terminal, the advice under what was found."""
        texts = [self.found, f"-> {self.advice}"] if self.advice else [self.found]
        whole: Any = {"break_on_hyphens": False, "break_long_words": False}
        width = max(line_width() - 23, 20)
        lines = [line for text in texts for line in textwrap.wrap(text, width, **whole)]
        return f"{self.state:6}{self.name:15}  " + f"\n{' ' * 23}".join(lines)


def check_python() -> Iterator[Finding]:
    """Checks the version of Python."""
    found = f"{'.'.join(map(str, sys.version_info[:3]))}, {sys.executable}"
    old = "take Python 3.11 or later: make PYTHON=python3.12"
    yield Finding("Python", found, "" if sys.version_info >= (3, 11) else old, True)


def check_libraries() -> Iterator[Finding]:
    """Checks that this package and its requirements are installed, and its extras."""
    here = Path(__file__).parents[1]
    version = version_of(_PACKAGE)
    if version is None:
        advice = "run make setup and use .venv/bin/python, or pip install ."
        yield Finding(_PACKAGE, f"not installed; run from {here}", advice, True)
        return
    yield Finding(_PACKAGE, f"{version}, {here}")
    homes = importlib.metadata.packages_distributions()
    owners = {*homes.get("glider", []), *homes.get("diagrams", [])} - {_PACKAGE}
    for other in sorted(owners):
        advice = f"pip uninstall {other}, then {_REINSTALL}"
        yield Finding(other, f"has modules of the names of {_PACKAGE}", advice, True)
    requirements: dict[str, dict[str, str | None]] = {}
    for line in importlib.metadata.requires(_PACKAGE) or []:
        name, group = parse_requirement(line)
        if group in _GROUPS and name != _PACKAGE:
            requirements.setdefault(group, {})[name] = version_of(name)
    for group, versions in sorted(requirements.items()):
        title, advice = "libraries", _REINSTALL
        if group:
            title = f"extra [{group}]"
            advice = f"pip install '{_PACKAGE}[{group}]', if needed"
        if missing := [name for name, version in versions.items() if version is None]:
            yield Finding(title, f"without {', '.join(missing)}", advice, not group)
        else:
            yield Finding(title, ", ".join(f"{n} {v}" for n, v in versions.items()))


def parse_requirement(line: str) -> tuple[str, str]:
    """Returns the package of a requirement, and its extra or ""."""
    name = re.split(r"[\s<>=!~;\[(]", line.strip(), maxsplit=1)[0]
    extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", line)
    return name, extra[1] if extra else ""


def version_of(package: str) -> str | None:
    """Returns the installed version of a package; None if it is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def check_models() -> Iterator[Finding]:
    """Checks that the models and the sample campaigns are there."""
    from glider.paths import models_path

    try:
        models_path("campaigns", "samples.yaml")
        yield Finding("models", str(models_path()))
    except FileNotFoundError as error:
        yield Finding("models", str(error), _REINSTALL, True)


def check_threads() -> Iterator[Finding]:
    """Checks how many processors may be used, and that code is compiled for them."""
    count = os.cpu_count()
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else count
    advice = ""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        advice = "unset NUMBA_DISABLE_JIT: Python alone is a hundred times slower"
    yield Finding("threads", f"{usable} of {count} processors may be used", advice)


def check_folders() -> Iterator[Finding]:
    """Checks the folders of compiled code and of reports."""
    from glider.errors import InputError
    from glider.files.writing import check_writable
    from glider.paths import cache_folder

    try:
        folder = cache_folder()
        check_writable(folder)
    except (InputError, OSError) as error:
        advice = "set XDG_CACHE_HOME to a folder that you may write"
        yield Finding("cache", str(error), advice, True)
    else:
        size = sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())
        free = shutil.disk_usage(folder).free
        found = f"{folder}, {size / 1e6:.0f} MB, {free / 1e9:.1f} GB free"
        advice = ""
        if free < _LEAST_SPACE:
            advice = f"free some space, or rm -r {folder}: it is compiled again"
        elif folder.is_relative_to(tempfile.gettempdir()):
            advice = "set XDG_CACHE_HOME to a folder that lasts"
        yield Finding("cache", found, advice)
    output = Path("out").absolute()
    try:
        check_writable(output)
        yield Finding("output", f"reports go to {output}")
    except InputError as error:
        yield Finding("output", str(error), "give --out DIR, or change the folder")


def check_compiler() -> Iterator[Finding]:
    """Compiles a function with numba."""
    import numba

    double = numba.njit(lambda x: 2.0 * x)
    advice = "" if double(1.5) == 3.0 else "pip install --force-reinstall numba"
    yield Finding("compiler", f"numba {numba.__version__}", advice, True)


def check_drake() -> Iterator[Finding]:
    """Imports Drake and solves a small problem with each solver."""
    from pydrake import solvers

    yield Finding("Drake", str(version_of("drake")))
    for name in _SOLVERS:
        program = solvers.MathematicalProgram()
        x = program.NewContinuousVariables(1)
        program.AddBoundingBoxConstraint(1.0, 2.0, x)
        program.AddLinearCost(x[0])
        found = getattr(solvers, f"{name}Solver")().Solve(program, None, None)
        good = abs(float(found.GetSolution(x)[0]) - 1.0) < 1e-3
        advice = "" if good else "pip install --force-reinstall drake"
        words = "solves" if good else "does not solve a linear program"
        yield Finding(name.upper(), words, advice, True)


CHECKS = {
    "Python": check_python,
    "libraries": check_libraries,
    "models": check_models,
    "threads": check_threads,
    "folders": check_folders,
    "compiler": check_compiler,
    "Drake": check_drake,
}
"""What is checked to how, the quick ones first."""


def add_arguments(parser: CommandParser) -> None:
    """Adds its arguments to a parser."""
    parser.add_json("JSON instead of sentences")


def run(args: argparse.Namespace) -> int:
    """Runs it; returns the exit code."""
    findings = []
    for finding in _check_all():
        findings.append(finding)
        if not args.json:
            print(finding, flush=True)
    states = [finding.state for finding in findings]
    if failing := states.count("fails"):
        summary = f"{failing} of {len(states)} fail: see the advice after the arrows."
    elif looking := states.count("look"):
        summary = f"Everything required works; {looking} of {len(states)} need a look."
    else:
        summary = "Everything works."
    if args.json:
        checks = [{**f._asdict(), "state": f.state} for f in findings]
        print(json.dumps({"summary": summary, "checks": checks}, indent=2))
    else:
        print(f"\n{summary}")
    return 1 if failing else 0


def _check_all() -> Iterator[Finding]:
    """Runs all checks; one that cannot even run fails."""
    for name, check in CHECKS.items():
        try:
            yield from check()
        except Exception as error:  # Whatever is wrong with a library.
            text = " ".join(str(error).split()) or type(error).__name__
            yield Finding(name, text[:200], _REINSTALL, True)
