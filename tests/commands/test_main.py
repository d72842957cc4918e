"""The command line: what it writes, prints and returns."""

import importlib.metadata
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from glider.__main__ import main
from tests.helpers.campaigns import campaign_path, first_flights
from tests.report.results import make_result


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The main job on a few flights of the sample campaign."""
    out = tmp_path_factory.mktemp("out") / "report"
    flights = ",".join(first_flights(5))
    campaign = str(campaign_path("attached_lift"))
    few = ["--flights", flights, "--effects", "attached_lift,profile_drag"]
    code = main(["close-the-loop", campaign, "--out", str(out), *few])
    return code, out


def test_it_runs_and_writes_everything(done):
    code, out = done
    assert code == 0
    assert (out / "report.html").stat().st_size > 10_000
    report = json.loads((out / "report.json").read_text())
    assert report["verdict"] == "effect_found"
    assert report["effects"][0]["kind"] == "attached_lift"


def test_the_model_loads(done):
    from glider.physics.model import GliderModel

    model = GliderModel.load(done[1] / "model.yaml")
    assert [e.kind.kind for e in model.effects] == ["attached_lift"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "nowhere"),
        (["{campaign}", "--effects", "gremlins"], "gremlins"),
        (["{campaign}", "--held-out", "2"], "held-out"),
        (["{campaign}", "--flights", "flight_1234"], "flight_1234"),
        (["{campaign}", "--seed", "-1"], "seed"),
        (["{campaign}", "--cluster", "nonsense"], "scheduler"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(arguments, words, capsys, tmp_path):
    campaign = str(campaign_path("still_air"))
    filled = [a.format(campaign=campaign) for a in arguments]
    out = tmp_path / "out"
    assert main(["close-the-loop", *filled, "--out", str(out)]) == 2
    message = capsys.readouterr().err.strip()
    assert words in message
    assert message.count("\n") == 0
    assert not out.exists()


def test_a_spoilt_log_names_file_column_and_row(tmp_path, capsys):
    folder = tmp_path / "campaign"
    shutil.copytree(campaign_path("still_air"), folder)
    path = folder / "flight_003.csv"
    lines = path.read_text().splitlines()
    cells = lines[6].split(",")
    lines[6] = ",".join([cells[0], "oops", *cells[2:]])
    path.write_text("\n".join(lines))
    assert main(["close-the-loop", str(folder)]) == 2
    message = capsys.readouterr().err
    for word in ("flight_003.csv", "'x'", "7", "oops"):
        assert word in message


def test_help_teaches(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["close-the-loop", "--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    for word in ("campaign.yaml", "--held-out", "examples", "exit code"):
        assert word in text


# -------------------------------------------------------------------- failing well


def test_a_folder_that_cannot_be_written_is_reported_first(capsys, monkeypatch):
    def never(*arguments, **options):
        raise AssertionError("the work has begun")

    monkeypatch.setattr("glider.sysid.pipeline.close_the_loop", never)
    out = "/proc/report" if Path("/proc").exists() else "/dev/null/report"
    assert main(["close-the-loop", "head_wind", "--out", out]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert out in message


def test_what_was_found_is_printed_even_where_it_cannot_be_kept(
    tmp_path, monkeypatch, capsys
):
    """A full disk costs the report, not the result."""

    def fill_the_disk(folder, files, last):
        raise OSError(28, "No space left on device", str(folder))

    def close(*arguments, **options):
        return make_result(warnings=("only wind was tried and so on",))

    monkeypatch.setattr("glider.sysid.pipeline.close_the_loop", close)
    monkeypatch.setattr("glider.report.folder.replace_files", fill_the_disk)
    out = tmp_path / "out"
    assert main(["close-the-loop", "head_wind", "--out", str(out)]) == 2
    said = capsys.readouterr()
    assert "a steady wind" in said.out
    assert "Report:" not in said.out
    [error] = [line for line in said.err.splitlines() if line.startswith("error")]
    assert error.startswith(f"error: {out}: No space left on device")
    assert "only wind was tried and so on" in " ".join(said.out.split())


@pytest.mark.parametrize("command", ["samples", "--help"])
@pytest.mark.parametrize("lines", [0, 1])
def test_output_that_is_read_no_further_is_no_error(command, lines):
    """As by `| head -1`."""
    process = subprocess.Popen(
        [sys.executable, "-m", "glider", command],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=Path(__file__).parents[2],
        env={**os.environ, "PYTHONUNBUFFERED": "1" if lines else ""},
    )
    for _ in range(lines):
        process.stdout.readline()
    process.stdout.close()
    assert process.stderr.read() == b""
    process.stderr.close()
    assert process.wait() in (0, 1)


def test_an_interrupt_is_one_sentence_and_130(tmp_path):
    """By Ctrl-C while the campaign is read or traced."""
    out = tmp_path / "out"
    arguments = ["close-the-loop", "four_at_once", "--out", str(out)]
    # Python's own answer, until `main` has begun, is a traceback.
    begin = (
        "import sys; from glider.__main__ import main; "
        "print('begins', flush=True); sys.exit(main(sys.argv[1:]))"
    )
    # Who runs the tests in the background has them, and what they start, ignore it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(
        [sys.executable, "-c", begin, *arguments],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    signal.signal(signal.SIGINT, before)
    assert process.stdout.readline() == "begins\n"
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    said, error = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert said == ""
    assert "Traceback" not in error
    assert error.strip().splitlines()[-1].startswith("interrupted: ")


def test_next_throw_proposes_after_a_report(done, tmp_path, capsys):
    out = tmp_path / "next"
    campaign = str(campaign_path("attached_lift"))
    arguments = ["--report", str(done[1]), "--launches", "1", "--out", str(out)]
    assert main(["next-throw", campaign, *arguments]) == 0
    text = capsys.readouterr().out
    assert "attached_lift" in text
    assert "Throw 1: release at" in text
    data = json.loads((out / "next_throw.json").read_text())
    assert data["explanations"][0]["effects"] == ["attached_lift"]
    assert data["seconds"] < 60.0  # Ten, on cores that are not shared.
    assert (out / "commands_1.csv").exists()
    assert (out / "next_throw.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "error: nowhere: does not exist"),
        (["{campaign}"], "close-the-loop, to be run first"),
        (["{campaign}", "--report", "nowhere"], "report.json"),
        (["{campaign}", "--launches", "0"], "--launches"),
        (["{campaign}", "--seed", "-1"], "--seed"),
        (["{campaign}", "--limits", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_bad_input_of_next_throw_is_reported(
    arguments, words, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    campaign = str(campaign_path("still_air"))
    filled = [a.format(campaign=campaign) for a in arguments]
    out = tmp_path / "out"
    assert main(["next-throw", *filled, "--out", str(out)]) == 2
    message = capsys.readouterr().err.strip()
    assert words in message
    assert not out.exists()


# --------------------------------------------------------- commands of `diagrams`


def registered_in_pyproject():
    settings = tomllib.loads(
        (Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8")
    )
    return settings["project"]["entry-points"]["glider.commands"]


def test_the_commands_of_diagrams_are_registered():
    points = importlib.metadata.distribution("drake-glider").entry_points
    installed = points.select(group="glider.commands")
    assert {p.name: p.value for p in installed} == registered_in_pyproject()
    assert set(registered_in_pyproject()) == {"fly", "lab", "make-funnel"}


class Spoilt:
    """An installation whose entry points are others."""

    def __init__(self, points):
        self.entry_points = importlib.metadata.EntryPoints(points)


def point(name, value):
    return importlib.metadata.EntryPoint(name, value, "glider.commands")


@pytest.mark.parametrize(
    "points",
    [
        [],  # Set up before there were any.
        [point("fly", "diagrams.old.fly"), point("lab", "diagrams.old.lab")],
    ],
    ids=["none", "moved"],
)
@pytest.mark.parametrize("arguments", [["fly"], ["lab", "out", "--port=1"]])
def test_an_installation_without_them_says_what_to_do(
    points, arguments, monkeypatch, capsys
):
    monkeypatch.setattr(importlib.metadata, "distribution", lambda name: Spoilt(points))
    assert main(arguments) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith("error: the package diagrams is not installed, or")
    assert line.endswith("(make setup, or pip install .).")
    with pytest.raises(SystemExit):
        main(["--help"])
    shown = " ".join(capsys.readouterr().out.split())
    assert "fly the package diagrams is not installed" in shown
    assert "lab the package diagrams is not installed" in shown


def test_a_tree_that_is_not_installed_still_has_its_own_commands(monkeypatch, capsys):
    def fail(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", fail)
    assert main(["samples"]) == 0
    assert main(["lab", "out"]) == 2
    assert "is not installed" in capsys.readouterr().err
