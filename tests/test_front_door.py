"""What is used first costs little, and a fault in the input is told at once.

That is, before pydrake, numba, SciPy and matplotlib are imported, of which each takes
a good part of a second. Modules are counted, in a process of their own, not time.
"""

import ast
import importlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import glider
from glider.paths import models_path
from tests.helpers.campaigns import campaign_path

ROOT = Path(__file__).parents[1]

HEAVY = ("matplotlib", "numba", "pydrake", "scipy")
FOR_NUMBA = {"numba", "scipy"}
"""numba imports SciPy's root."""

FIRST = {
    "EffectKind",
    "GliderModel",
    "GliderPlant",
    "PerchingProblem",
    "close_the_loop",
    "fly",
    "load_model",
    "plan",
}

LOADED = f"print(json.dumps([m for m in {HEAVY} if m in sys.modules]))"

COMMAND = f"""
import json, sys
from glider.__main__ import main
try:
    code = main(sys.argv[1:])
except SystemExit as stop:
    code = stop.code
{LOADED}
sys.exit(code)
"""


def run(code, *arguments):
    """Runs Python code in a process of its own, in the root of the source tree."""
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


def loaded(done):
    """Returns which of HEAVY a process had loaded at its end."""
    return set(json.loads(done.stdout.splitlines()[-1]))


# ---------------------------------------------------------------- import glider


def test_import_glider_imports_nothing_else():
    done = run(
        "import sys; import glider; "
        "print([m for m in sys.modules if m == 'numpy' or m.startswith('glider.')])"
        f"\nimport json; {LOADED}"
    )
    assert done.stdout.splitlines()[0] == "[]", done.stderr
    assert loaded(done) == set()


@pytest.mark.parametrize(
    ("name", "needs"),
    [
        ("close_the_loop", set()),
        ("PerchingProblem", set()),
        ("EffectKind", set()),
        ("GliderModel", FOR_NUMBA),
        ("load_model", FOR_NUMBA),
    ],
)
def test_a_name_loads_no_more_than_it_needs(name, needs):
    done = run(f"import json, sys; from glider import {name}; {LOADED}")
    assert done.returncode == 0, done.stderr
    assert loaded(done) <= needs


def test_what_people_use_first_is_there():
    assert set(glider.__all__) >= FIRST
    assert set(dir(glider)) >= FIRST


@pytest.mark.parametrize("name", glider.__all__)
def test_a_name_is_that_of_its_module(name):
    module = importlib.import_module(glider._HOMES[name])
    assert getattr(glider, name) is getattr(module, name)


def test_mypy_and_editors_see_the_same_names():
    tree = ast.parse(Path(glider.__file__).read_text(encoding="utf-8"))
    [block] = [node for node in tree.body if isinstance(node, ast.If)]
    seen = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == glider._HOMES


def test_another_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'glider' has no attribute 'gremlin'"):
        _ = glider.gremlin


# ------------------------------------------------------------- the command line


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["--version"], ["close-the-loop", "--help"], ["check-funnel", "-h"]],
    ids=" ".join,
)
def test_help_loads_nothing_heavy(arguments):
    done = run(COMMAND, *arguments)
    assert done.returncode == 0, done.stderr
    assert loaded(done) == set()


def spoil(folder):
    path = folder / "flight_003.csv"
    lines = path.read_text().splitlines()
    cells = lines[6].split(",")
    lines[6] = ",".join([cells[0], "oops", *cells[2:]])
    path.write_text("\n".join(lines))


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """Names of campaigns and files for the arguments below."""
    folder = tmp_path_factory.mktemp("input")
    shutil.copytree(campaign_path("still_air"), folder / "bad_row")
    spoil(folder / "bad_row")
    (folder / "file").write_text("no")
    funnel = models_path("funnels", "drawn.npz").read_bytes()
    (folder / "short.npz").write_bytes(funnel[: len(funnel) // 2])
    middle = len(funnel) // 2
    spoilt = funnel[:middle] + bytes(64) + funnel[middle + 64 :]
    (folder / "spoilt.npz").write_bytes(spoilt)
    # The compressed data of the first array: after its header, name and extra field.
    start = 30 + sum(int.from_bytes(funnel[i : i + 2], "little") for i in (26, 28))
    garbled = funnel[:start] + b"\xff" * 8 + funnel[start + 8 :]
    (folder / "garbled.npz").write_bytes(garbled)
    return {
        "campaign": campaign_path("still_air"),
        "bad_row": folder / "bad_row",
        "file": folder / "file",
        "folder": folder,
        "short": folder / "short.npz",
        "spoilt": folder / "spoilt.npz",
        "garbled": folder / "garbled.npz",
        "absent": folder / "absent",
    }


@pytest.mark.parametrize(
    ("line", "words", "needs"),
    [
        ("close-the-loop {absent}", "does not exist", set()),
        ("close-the-loop {file}", "is not a folder", set()),
        ("close-the-loop {folder}", "no campaign.yaml", set()),
        ("close-the-loop {bad_row}", "flight_003.csv: column 'x', row 7", set()),
        ("close-the-loop {campaign} --flights flight_1234", "flight_1234", set()),
        ("close-the-loop {campaign} --flights flight_001", "at least 3", set()),
        ("close-the-loop {campaign} --grade A", "index.csv", set()),
        ("close-the-loop {campaign} --held-out 2", "held-out", set()),
        ("close-the-loop {campaign} --seed -1", "--seed", set()),
        ("close-the-loop {campaign} --out {file}", "--out", set()),
        ("close-the-loop {campaign} --effects wnid", "effect 'wnid'", set()),
        ("close-the-loop {campaign} --effects ,", "at least one", set()),
        ("check-funnel {absent}", "absent: cannot be read: No such file", set()),
        ("check-funnel {folder}", "is not a funnel", set()),
        ("check-funnel {file}", "is not a funnel", set()),
        ("check-funnel {short}", "is not a funnel", set()),
        ("check-funnel {spoilt}", "is a damaged funnel: Bad CRC-32", set()),
        ("check-funnel {garbled}", "is a damaged funnel: Error -3", set()),
        ("check-funnel {file} --every 0", "--every", set()),
        ("check-funnel {campaign}", "is not a funnel", set()),
        ("close-the-loop {campaign} --out {file}/out", "is a file", set()),
        ("samples gremlins", "there is no sample 'gremlins'", set()),
    ],
)
def test_a_fault_in_the_input_is_told_at_once(places, line, words, needs):
    """In one sentence and with exit code 2, before what it does not need is loaded."""
    done = run(COMMAND, *(word.format(**places) for word in line.split()))
    assert done.returncode == 2, done.stderr
    [message] = done.stderr.strip().splitlines()
    assert message.startswith("error: ")
    assert words in message
    assert loaded(done) <= needs
