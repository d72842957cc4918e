"""The options and the page that the examples share."""

import io
import re
import urllib.request

import numpy as np
import pytest

from diagrams.playback import Track
from diagrams.programs.program import (
    add_launches,
    check_files,
    make_parser,
    read_options,
    run,
    show,
    silent,
    start_meshcat,
    working,
)
from glider.errors import InputError
from glider.paths import models_path
from glider.physics.model import GliderModel
from glider.planning.constraints import Violation
from glider.planning.dircol import PlanningError

TRACK = Track(
    name="flown",
    times=np.array([0.0, 0.2]),
    poses=np.array([[-3.0, 0.0, 0.0, 0.0], [-2.0, 0.0, 0.0, 0.0]]),
)


def parse(*arguments):
    parser = make_parser("What is shown.")
    add_launches(parser, 20, least=3)
    return read_options(parser, list(map(str, arguments)), figure="paths")


def test_headless_without_a_page_starts_no_server(capsys):
    assert start_meshcat(parse("--headless")) is None
    show(parse("--headless"), [TRACK], "A flight")
    assert capsys.readouterr().out == ""


def test_a_page_is_written_headless(tmp_path, capsys):
    page = tmp_path / "flight.html"
    show(parse("--headless", "--html", page), [TRACK], "A flight")
    assert "<b>A flight</b>" in page.read_text(encoding="utf-8")
    assert str(page) in capsys.readouterr().out


def test_otherwise_a_page_is_there_until_enter(monkeypatch, capsys, caplog):
    class Reader(io.StringIO):
        def readline(self):
            address = capsys.readouterr().out.split()[1]
            with urllib.request.urlopen(address) as page:
                seen.append((address, page.read()))
            return "\n"

    seen = []
    monkeypatch.setattr("sys.stdin", Reader())
    show(parse(), [TRACK], "A flight")
    [(address, page)] = seen
    assert b"<b>A flight</b>" in page
    with pytest.raises(OSError):
        urllib.request.urlopen(address)
    assert "http://" not in caplog.text  # Drake would name a page without legend.


@pytest.mark.parametrize(("has_wire", "wire"), [(True, (0.0, 0.0)), (False, None)])
def test_a_wire_is_shown_where_flights_go_to_one(tmp_path, monkeypatch, has_wire, wire):
    stages = []
    monkeypatch.setattr(
        "diagrams.programs.program.play", lambda *_, stage, **__: stages.append(stage)
    )
    args = parse("--headless", "--html", tmp_path / "flight.html")
    show(args, [TRACK], "A flight", has_wire=has_wire)
    assert [stage.wire for stage in stages] == [wire]


def test_an_example_without_a_picture_has_no_option_for_one():
    with pytest.raises(InputError, match="unrecognized arguments: --figure"):
        read_options(make_parser(""), ["--figure", "paths.png"])


def test_options_are_refused_where_their_file_cannot_be_written(tmp_path):
    for option in ("--html", "--figure"):
        with pytest.raises(InputError, match="in a folder that exists"):
            parse(option, tmp_path / "absent" / "a.png")


def test_progress_is_shown_on_stderr(capsys):
    with working("plan") as progress:
        progress("fly")
        silent("fly")
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("rate", ["0", "-1", "nan", "fast"])
def test_the_rate_is_a_positive_number(rate):
    with pytest.raises(InputError, match=f"--rate: {rate} is not a number of at least"):
        parse("--rate", rate)


@pytest.mark.parametrize(
    ("option", "number", "least"),
    [
        *[("--launches", number, 3) for number in ("0", "-1", "2", "2.5", "many")],
        *[("--seed", number, 0) for number in ("-1", "1e3", "")],
    ],
)
def test_launches_and_seed_are_whole_numbers(option, number, least):
    words = f"{option}: {number} is not an integer of at least {least}"
    with pytest.raises(InputError, match=re.escape(words)):
        parse(option, number)
    least_ones = parse("--launches", "3", "--seed", "0")
    assert (least_ones.launches, least_ones.seed) == (3, 0)


FILES = ("a.json", "a.html", "a.yaml")


def test_files_that_can_be_written_are_let_through(tmp_path):
    (tmp_path / "a.json").touch()  # To be written over.
    check_files(*(tmp_path / name for name in FILES), tmp_path / "more.png")
    check_files(None, figure=tmp_path / "A.SVG")
    check_files(None, None)


@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize(
    ("folder", "words"),
    [("absent", "in a folder that exists"), ("folder", "is a folder")],
)
def test_a_file_that_cannot_be_written_is_refused(tmp_path, place, folder, words):
    for name in (*FILES, "more.png"):
        (tmp_path / "folder" / name).mkdir(parents=True)
    files = [tmp_path / name for name in (*FILES, "more.png")]
    files[place] = tmp_path / folder / files[place].name
    with pytest.raises(InputError, match=words):
        check_files(*files[:3], figure=files[3])


@pytest.mark.parametrize("name", ["f.txt", "f", "f.html"])
def test_a_figure_is_in_a_format_that_matplotlib_writes(tmp_path, name):
    with pytest.raises(InputError, match=rf"{name}: the format is .*png"):
        check_files(figure=tmp_path / name)


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (None, 0, ""),
        (InputError("the flight is not there."), 2, "error: the flight is not there."),
        (PermissionError(13, "Permission denied", "f.json"), 2, "f.json: Permission"),
        (FileNotFoundError("no 'a' among the models."), 2, "error: no 'a' among"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_the_exit_code_tells_whose_fault_it_was(error, code, words, capsys):
    def main():
        if error is not None:
            raise error

    assert run(main) == code
    assert words in capsys.readouterr().err


def test_a_problem_without_a_plan_is_one_sentence(capsys):
    def fail():
        violation = Violation("position at the wire", 0.25, "m")
        raise PlanningError("InfeasibleConstraints (13)", [violation])

    assert run(fail) == 2
    assert (
        "violates 'position at the wire' the most, by 0.25 m."
        in capsys.readouterr().err
    )


def test_a_fault_of_ours_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        run(lambda: print(1 / 0))


def test_every_shipped_truth_is_a_model_with_one_effect_or_a_free_function():
    names = [path.stem for path in models_path("truths").glob("*.yaml")]
    assert len(names) >= 6
    for name in names:
        truth = GliderModel.load(name)
        assert len(truth.effects) + len(truth.free_functions) == 1


def test_an_unknown_truth_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match=r"^tail_wind: .*head_wind"):
        GliderModel.load("tail_wind")
