"""Do the tests notice a wrong program? Plants single faults and runs the tests.

A fault swaps an operator or a comparison, drops a sign, or changes a number, in a copy
of the tree. The tests that import the module are run first, then those of its package,
until one fails. A fault that none notices survives: a test is missing, or the fault
changes nothing. The draw is by the seed, so a run can be repeated on other code.

Before that, all these tests run once in the copy without a fault: one that fails there
would notice every fault. The list of survivors goes to standard output, and how each
fault came out to standard error.

    python -m benchmarks.mutate [--packages glider/physics ...] [--count 20] [--seed 0]
        [--limit 300] [--json FILE.jsonl] > survivors.txt
"""

import argparse
import ast
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.changed import ROOT, folder_of

PACKAGES = ("glider/physics", "glider/campaign", "glider/sysid")
LEFT_OUT = (".git", ".venv*", "out", "__pycache__", ".*_cache")
"""Not copied; the docs are, because quick tests read them."""

OUTCOMES = {0: "survived", 1: "noticed"}
"""By pytest's exit code. With any other, no test failed: pytest found none, or could
not run."""

SWAPPED: dict[type[ast.AST], Any] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.And: ast.Or,
    ast.Or: ast.And,
}


class Fault(NamedTuple):
    """A change of one expression of a module."""

    path: str  #: Of the module, from the root.
    line: int
    before: str  #: The expression.
    after: str  #: The one in its place.
    begin: int  #: Byte of the module where it begins.
    end: int  #: Byte after it.


def faults_of(path: str) -> Iterator[Fault]:
    """Yields all faults that can be planted in a module."""
    text = (ROOT / path).read_bytes()
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node in ast.walk(ast.parse(text)):
        changed = change(node)
        if changed is None or not isinstance(node, ast.expr):
            continue
        assert node.end_lineno is not None and node.end_col_offset is not None
        begin = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        before = text[begin:end].decode()
        yield Fault(path, node.lineno, before, f"({changed})", begin, end)


def change(node: ast.AST) -> str | None:
    """Returns the source of an expression with a fault; None where there is none."""
    if isinstance(node, ast.Constant):
        value: Any = node.value
        if type(value) is int:
            return repr(value + 1)
        return repr(1.5 * value or 1.0) if type(value) is float else None
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        return ast.unparse(node.operand)
    if isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in SWAPPED:
        other = type(node)(**{**vars(node), "op": SWAPPED[type(node.op)]()})
        return ast.unparse(other)
    if isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPPED:
        swapped = [SWAPPED[type(node.ops[0])](), *node.ops[1:]]
        return ast.unparse(ast.Compare(node.left, swapped, node.comparators))
    return None


def draw(packages: list[str], count: int, seed: int) -> list[Fault]:
    """Draws faults from the modules of packages, each as likely."""
    found: list[Fault] = []
    for package in packages:
        for module in sorted((ROOT / package).rglob("*.py")):
            found += faults_of(str(module.relative_to(ROOT)))
    rng = np.random.default_rng(seed)
    rows = rng.choice(len(found), min(count, len(found)), replace=False)
    return [found[row] for row in rows]


def tests_of(path: str) -> list[str]:
    """Tests that import a module, and then the others of its package.

    By file: given a folder too, pytest would order the files by their names.
    """
    name = path.removesuffix(".py").replace("/", ".")
    tests = sorted((ROOT / "tests").rglob("test_*.py"))
    near = [test for test in tests if f"{name} import" in test.read_text()]
    folder = ROOT / (folder_of(path) or "tests")
    others = [test for test in tests if folder in test.parents]
    return [str(test.relative_to(ROOT)) for test in dict.fromkeys([*near, *others])]


def copy_tree(folder: Path) -> Path:
    """Copies the tree into a folder, and returns the root of the copy."""
    ignore = shutil.ignore_patterns(*LEFT_OUT)
    return Path(shutil.copytree(ROOT, folder / "tree", ignore=ignore))


def run_tests(
    tests: list[str], tree: Path, limit: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Runs tests in a copy of the tree until one fails, or raises at the limit [s].

    A test module that cannot be imported is a test that fails.
    """
    options = ("-q", "-x", "-p", "no:cacheprovider", "--continue-on-collection-errors")
    return subprocess.run(
        [sys.executable, "-m", "pytest", *options, *tests],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree)},
        capture_output=True,
        text=True,
        timeout=limit,
        check=False,
    )


def check_tests(faults: list[Fault], tree: Path) -> None:
    """Runs the tests of all faults without any, and ends the program if one fails."""
    paths = dict.fromkeys(fault.path for fault in faults)
    tests = dict.fromkeys(test for path in paths for test in tests_of(path))
    done = run_tests(list(tests), tree)
    if done.returncode:
        lines = (done.stdout + done.stderr).splitlines()
        failed = [x for x in lines if x.startswith(("FAILED", "ERROR"))] or lines[-1:]
        sys.exit(
            "No fault was planted, because the tests fail without one: "
            f"{' '.join(failed)} (pytest's exit code {done.returncode})."
        )


def plant(fault: Fault, tree: Path, limit: float) -> str:
    """Runs tests with a fault, and returns one of OUTCOMES, "too slow" or "not run"."""
    module = tree / fault.path
    right = module.read_bytes()
    wrong = right[: fault.begin] + fault.after.encode() + right[fault.end :]
    module.write_bytes(wrong)
    try:
        code = run_tests(tests_of(fault.path), tree, limit).returncode
    except subprocess.TimeoutExpired:
        return "too slow"
    finally:
        module.write_bytes(right)
    return OUTCOMES.get(code, "not run")


def main() -> None:
    """Plants the faults, and prints those that survived."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--packages", nargs="+", default=list(PACKAGES))
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limit", type=float, default=300.0, help="of a fault [s]")
    parser.add_argument("--json", type=Path, help="a line for each fault is added")
    args = parser.parse_args()
    counts: dict[str, int] = {}
    faults = draw(args.packages, args.count, args.seed)
    with tempfile.TemporaryDirectory() as folder:
        tree = copy_tree(Path(folder))
        check_tests(faults, tree)
        packages = " ".join(args.packages)
        print(f"Survivors of {len(faults)} faults in {packages}, seed {args.seed}:")
        for fault in faults:
            begin = time.perf_counter()
            outcome = plant(fault, tree, args.limit)
            seconds = time.perf_counter() - begin
            counts[outcome] = counts.get(outcome, 0) + 1
            words = " ".join(f"{fault.before} -> {fault.after}".split())
            found = f"{fault.path}:{fault.line}  {words}"
            print(f"{outcome:9s} {seconds:5.0f} s  {found}", file=sys.stderr)
            if outcome == "survived":
                print(found, flush=True)
            if args.json:
                line = {"seed": args.seed, "outcome": outcome, **fault._asdict()}
                with args.json.open("a") as file:
                    file.write(json.dumps(line) + "\n")
    print(f"{counts}, seed {args.seed}", file=sys.stderr)


if __name__ == "__main__":
    main()
