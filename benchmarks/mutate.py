"""Do the tests notice a wrong program? Plants single faults and runs the tests.

A fault swaps an operator or a comparison, drops a sign, or changes a number, in a copy
of the tree. The tests that import the module are run first, then those of its package,
until one fails. A fault that none notices survives: a test is missing, or the fault
changes nothing. The draw is by the seed, so a run can be repeated on other code.

    python -m benchmarks.mutate [--packages glider/physics ...] [--count 20] [--seed 0]
        [--limit 300] [--json FILE.jsonl]
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
LEFT_OUT = (".git", ".venv*", "out", "__pycache__", ".*_cache", "docs")

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
    """Tests that import a module, and then the tests of its package."""
    name = path.removesuffix(".py").replace("/", ".")
    near = [
        str(test.relative_to(ROOT))
        for test in sorted((ROOT / "tests").rglob("test_*.py"))
        if f"{name} import" in test.read_text()
    ]
    folder = folder_of(path)
    return [*near, *([folder] if folder else [])]


def plant(fault: Fault, tree: Path, limit: float) -> str:
    """Runs tests with a fault until one fails: "noticed", "survived" or "too slow"."""
    module = tree / fault.path
    right = module.read_bytes()
    wrong = right[: fault.begin] + fault.after.encode() + right[fault.end :]
    module.write_bytes(wrong)
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
    try:
        code = subprocess.run(
            [*command, *tests_of(fault.path)],
            cwd=tree,
            env={**os.environ, "PYTHONPATH": str(tree)},
            capture_output=True,
            timeout=limit,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        return "too slow"
    finally:
        module.write_bytes(right)
    return "noticed" if code else "survived"


def main() -> None:
    """Prints a line for each fault, and how many survived."""
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
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(*LEFT_OUT))
        for fault in draw(args.packages, args.count, args.seed):
            begin = time.perf_counter()
            outcome = plant(fault, tree, args.limit)
            seconds = time.perf_counter() - begin
            counts[outcome] = counts.get(outcome, 0) + 1
            where = f"{fault.path}:{fault.line}"
            words = f"{fault.before} -> {fault.after}"
            print(f"{outcome:9s} {seconds:5.0f} s  {where}  {words}", flush=True)
            if args.json:
                line = {"seed": args.seed, "outcome": outcome, **fault._asdict()}
                with args.json.open("a") as file:
                    file.write(json.dumps(line) + "\n")
    print(f"{counts}, seed {args.seed}")


if __name__ == "__main__":
    main()
