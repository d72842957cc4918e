"""What is used first costs little, and a fault in the input is reported at once.

That is, before pydrake, numba, SciPy and matplotlib are imported, of which each takes
a good part of a second. Modules are counted, not time: each case runs in a fork of one
process, which has imported nothing.
"""

import ast
import dataclasses
import importlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import diagrams
import diagrams.programs
import glider
from glider.lazy import public_names
from glider.paths import models_path
from glider.physics.parameters import GliderParameters
from glider.planning.plan import Plan
from glider.planning.problem import PerchingProblem
from glider.simulation.flown_flights import Perches
from tests.helpers.campaigns import campaign_path

ROOT = Path(__file__).parents[1]

PACKAGES = [glider, diagrams, diagrams.programs]
"""With public names."""

HEAVY = ("matplotlib", "numba", "pydrake", "scipy")
FOR_NUMBA = {"numba", "scipy"}
"""numba imports SciPy's root."""

FIRST = {
    "GliderModel",
    "GliderPlant",
    "PerchingProblem",
    "close_the_loop",
    "fly",
    "plan",
}

SERVER = """
import contextlib, io, json, os, sys, traceback

def run(code, arguments):
    sys.argv[1:] = arguments
    try:
        exec(compile(code, "case", "exec"), {"__name__": "__main__"})
    except SystemExit as stop:
        return stop.code
    except BaseException:
        traceback.print_exc()
        return 1
    return 0

for line in sys.stdin:
    code, arguments = json.loads(line)
    reader, writer = os.pipe()
    if os.fork() == 0:
        out, error = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
            returned = run(code, arguments)
        answer = {
            "code": returned,
            "out": out.getvalue(),
            "error": error.getvalue(),
            "modules": sorted(sys.modules),
        }
        with open(writer, "w") as file:
            json.dump(answer, file)
        os._exit(0)
    os.close(writer)
    with open(reader) as file:
        print(file.read(), flush=True)
    os.wait()
"""

COMMAND = """
import sys
from glider.__main__ import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def run():
    """Runs Python code in a fork of one process, in the root of the source tree.

    The answer has the exit code, what was printed on "out" and "error", and the modules
    that were loaded at the end.
    """
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )

    def ask(code, *arguments):
        print(json.dumps([code, [str(a) for a in arguments]]), file=server.stdin)
        server.stdin.flush()
        return json.loads(server.stdout.readline())

    with server:
        yield ask
        server.stdin.close()


def loaded(answer):
    """Returns which of HEAVY a case had loaded at its end."""
    return {name for name in HEAVY if name in answer["modules"]}


# ---------------------------------------------------------------- import glider


@pytest.mark.parametrize("package", ["glider", "diagrams"])
def test_an_import_imports_nothing_else(run, package):
    done = run(f"import {package}")
    assert done["code"] == 0, done["error"]
    ours = {m for m in done["modules"] if m.startswith(("glider", "diagrams"))}
    assert ours == {package, "glider", "glider.lazy"}
    assert not {"numpy", *HEAVY} & set(done["modules"])


@pytest.mark.parametrize(
    ("name", "needs"),
    [
        ("close_the_loop", set()),
        ("PerchingProblem", set()),
        ("effects", set()),
        ("Campaign", set()),
        ("GliderModel", FOR_NUMBA),
    ],
)
def test_a_name_loads_no_more_than_it_needs(run, name, needs):
    done = run(f"from glider import {name}")
    assert done["code"] == 0, done["error"]
    assert loaded(done) <= needs


def test_a_package_of_the_same_name_is_said_at_import(tmp_path):
    """PyPI's `diagrams` draws architectures of clouds."""
    other = tmp_path / "diagrams"
    other.mkdir()
    (other / "__init__.py").write_text("", encoding="utf-8")
    path = os.pathsep.join([str(tmp_path), str(Path(glider.__file__).parents[1])])
    done = subprocess.run(
        [sys.executable, "-c", "import glider"],
        env=os.environ | {"PYTHONPATH": path},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "pip uninstall diagrams" in done.stderr
    assert str(other) in done.stderr


def test_what_people_use_first_is_there():
    assert set(glider.__all__) >= FIRST
    assert set(dir(glider)) >= FIRST


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_is_that_of_its_module(package):
    """And mypy and editors see the same names, of which there is one list."""
    names = public_names(package.__file__)
    assert dir(package) == sorted(names)
    for name, (home, attribute) in names.items():
        module, value = importlib.import_module(home), getattr(package, name)
        assert value is (getattr(module, attribute) if attribute else module)
        assert attribute is None or value.__module__ == home, name


def test_the_names_are_about_forty():
    names = [name for package in PACKAGES for name in package.__all__]
    assert len(names) <= 42
    for page in ("README.md", "CHANGELOG.md"):
        assert f" {len(names)} names, importable" in (ROOT / page).read_text("utf-8")
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("package", PACKAGES)
def test_each_name_is_documented(package):
    page = (ROOT / "docs" / "api" / "first.md").read_text(encoding="utf-8")
    assert [n for n in package.__all__ if f"`{n}`" not in page] == []


PUBLIC = [
    *sorted((ROOT / "examples").glob("*.py")),
    *sorted((ROOT / "docs" / "tutorials").glob("*.py")),
]


@pytest.mark.parametrize("path", PUBLIC, ids=lambda path: path.name)
def test_examples_and_tutorials_import_public_names_alone(path):
    public = {package.__name__: set(package.__all__) for package in PACKAGES}
    used = 0
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                assert alias.name.split(".")[0] not in public, alias.name
        elif isinstance(node, ast.ImportFrom):
            home = node.module or ""
            if home.split(".")[0] not in public:
                continue
            assert home in public, f"line {node.lineno}: {home}"
            unknown = {alias.name for alias in node.names} - public[home]
            assert not unknown, f"line {node.lineno}: {unknown}"
            used += 1
    assert used


def test_another_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'glider' has no attribute 'gremlin'"):
        _ = glider.gremlin


@pytest.mark.slow
def test_what_a_notebook_shows_of_a_name_is_one_line(article_plan):
    model = glider.GliderModel()
    policy = glider.tracking_policy(model, article_plan)
    flights = glider.fly(model, policy, article_plan.states[:1], keep_paths=True)
    campaign = glider.load_campaign("still_air")
    funnel = glider.funnels.load_funnel(models_path("funnels", "drawn.npz"))
    assert repr(article_plan) == "Plan(cost=194.046, duration=0.8795 s, 41 knots)"
    assert repr(policy) == f"TrackingPolicy({article_plan})"
    assert repr(flights) == "Flights(1 of 1 perch)"
    assert repr(Perches([])) == "Perches(0 of 0 flights perch)"
    assert repr(campaign) == f"Campaign('still_air', {len(campaign.flights)} flights)"
    rows = campaign.flights[0].time.size
    assert repr(campaign.flights[0]) == f"Flight('flight_000.csv', {rows} rows)"
    assert repr(glider.effects.WIND) == "WIND"
    assert repr(glider.effects.WIND(x=-0.6)) == "WIND(x=-0.6, z=0.0)"
    assert repr(funnel).startswith("Funnel(0.")
    assert repr(funnel).endswith(" times)")


def test_help_describes_the_fields():
    for kind in (PerchingProblem, Plan, GliderParameters):
        for field in dataclasses.fields(kind):
            assert f"    {field.name}: " in kind.__doc__, field.name


def test_types_are_there_for_those_who_install_it():
    for package in (glider, diagrams):
        assert Path(package.__file__).with_name("py.typed").is_file()


# ------------------------------------------------------------- the command line


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["--version"], ["close-the-loop", "--help"], ["check-funnel", "-h"]],
    ids=" ".join,
)
def test_help_loads_nothing_heavy(run, arguments):
    done = run(COMMAND, *arguments)
    assert done["code"] == 0, done["error"]
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
        ("close-the-loop {campaign} --flights flight_001", "at least 3", set()),
        ("close-the-loop {campaign} --out {file}", "--out", set()),
        ("close-the-loop {campaign} --effects wnid", "effect 'wnid'", set()),
        ("close-the-loop {campaign} --effects ,", "at least one", set()),
        ("check-funnel {absent}", "absent: cannot be read: No such file", set()),
        ("check-funnel {file}", "is not a funnel", set()),
        ("check-funnel {short}", "is not a funnel", set()),
        ("check-funnel {spoilt}", "is a damaged funnel: Bad CRC-32", set()),
        ("check-funnel {garbled}", "is a damaged funnel: Error -3", set()),
        ("check-funnel {file} --every 0", "--every", set()),
        ("close-the-loop {campaign} --out {file}/out", "is a file", set()),
        ("samples gremlins", "there is no sample 'gremlins'", set()),
    ],
)
def test_a_fault_in_the_input_is_reported_at_once(run, places, line, words, needs):
    """In one sentence and with exit code 2, before what it does not need is loaded."""
    done = run(COMMAND, *(word.format(**places) for word in line.split()))
    assert done["code"] == 2, done["error"]
    [message] = done["error"].strip().splitlines()
    assert message.startswith("error: ")
    assert words in message
    assert loaded(done) <= needs
