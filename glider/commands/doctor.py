"""The command `doctor`: check this installation.

It runs where the rest does not: only the standard library is imported at the top.
"""

import argparse
import importlib.metadata
import sys
from collections.abc import Callable

from glider.commands.parsing import CommandParser

DESCRIPTION = """\
Checks this installation: versions, the folder of compiled code, the compiler and a
solver of Drake.

exit code: 0 if all of it works, 1 if not.
"""

_PACKAGES = ("drake-glider", "drake", "numpy", "scipy", "numba", "matplotlib")
_REINSTALL = "install it again: make setup, or pip install . in its source tree"


def add_arguments(parser: CommandParser) -> None:
    """Adds no argument."""


def run(args: argparse.Namespace) -> int:
    """Runs the checks; returns the exit code."""
    checks = {
        "versions": versions,
        "cache": _cache,
        "compiler": _compiler,
        "solver": _solver,
    }
    failed = [name for name in checks if not _print_outcome(name, checks[name])]
    if failed:
        print(f"\n{len(failed)} of {len(checks)} fail; {_REINSTALL}.")
        return 1
    print("\nEverything works.")
    return 0


def _print_outcome(name: str, check: Callable[[], str]) -> bool:
    """Runs a check and prints what it found; returns whether it passed."""
    state = "works"
    try:
        found = check()
    except Exception as error:  # Whatever is wrong with a library.
        state = "fails"
        found = " ".join(str(error).split())[:200] or type(error).__name__
    print(f"{state}  {name:8}  {found}", flush=True)
    return state == "works"


def versions() -> str:
    """Returns the versions of Python, this package and its main libraries."""
    found = [f"Python {sys.version.split()[0]}"]
    for name in _PACKAGES:
        found.append(f"{name} {importlib.metadata.version(name)}")
    modules = importlib.metadata.packages_distributions()
    owners = {*modules.get("glider", ()), *modules.get("diagrams", ())}
    others = owners - {_PACKAGES[0]}
    if others:
        names = ", ".join(sorted(others))
        raise ImportError(f"modules are from another package: pip uninstall {names}")
    return ", ".join(found)


def _cache() -> str:
    """Checks that compiled code can be kept."""
    from glider.files.writing import check_writable
    from glider.paths import cache_folder

    folder = cache_folder()
    check_writable(folder)
    return str(folder)


def _compiler() -> str:
    """Compiles a function."""
    import numba

    numba.njit(lambda x: 2.0 * x)(1.5)
    return "compiles a function"


def _solver() -> str:
    """Solves a small problem with the solvers of plans and of funnels."""
    from pydrake.solvers import ClarabelSolver, MathematicalProgram, SnoptSolver

    program = MathematicalProgram()
    x = program.NewContinuousVariables(1)
    program.AddBoundingBoxConstraint(1.0, 2.0, x)
    program.AddLinearCost(x[0])
    for solver in (SnoptSolver(), ClarabelSolver()):
        if not solver.Solve(program, None, None).is_success():
            name = solver.solver_id().name()
            raise RuntimeError(f"{name} does not solve a linear program")
    return "SNOPT and Clarabel solve a linear program"
