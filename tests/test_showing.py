"""The options and the page that the examples share."""

import argparse
import io
import json
import urllib.request

import numpy as np
import pytest

from diagrams.playback import Track
from diagrams.showing import add_options, run, show, start_meshcat, write_figures
from glider.errors import InputError

TRACK = Track(
    name="flown",
    times=np.array([0.0, 0.2]),
    poses=np.array([[-3.0, 0.0, 0.0, 0.0], [-2.0, 0.0, 0.0, 0.0]]),
)


def parse(*arguments):
    parser = argparse.ArgumentParser()
    add_options(parser)
    return parser.parse_args(list(map(str, arguments)))


def test_headless_without_a_page_starts_no_server(capsys):
    assert start_meshcat(parse("--headless")) is None
    show(parse("--headless"), [TRACK], "A flight")
    assert capsys.readouterr().out == ""


def test_a_page_is_written_headless(tmp_path, capsys):
    page = tmp_path / "flight.html"
    show(parse("--headless", "--html", page), [TRACK], "A flight")
    assert "<b>A flight</b>" in page.read_text(encoding="utf-8")
    assert str(page) in capsys.readouterr().out


def test_otherwise_meshcat_is_served_until_enter(monkeypatch, capsys):
    class Reader(io.StringIO):
        def readline(self):
            url = capsys.readouterr().out.split()[1]
            with urllib.request.urlopen(url) as page:
                seen.append(page.read())
            return "\n"

    seen = []
    monkeypatch.setattr("sys.stdin", Reader())
    show(parse(), [TRACK], "A flight")
    assert b"meshcat" in seen[0].lower()


def test_figures_are_written_only_when_asked_for(tmp_path):
    write_figures(parse(), {"miss": 0.02})
    path = tmp_path / "figures.json"
    write_figures(parse("--json", path), {"miss": 0.02})
    assert json.loads(path.read_text()) == {"miss": 0.02}


@pytest.mark.parametrize("rate", ["0", "-1", "nan", "fast"])
def test_the_rate_is_a_positive_number(rate, capsys):
    with pytest.raises(SystemExit) as end:
        parse("--rate", rate)
    assert end.value.code == 2
    assert "--rate" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (None, 0, ""),
        (InputError("the flight is not there."), 2, "error: the flight is not there."),
        (PermissionError(13, "Permission denied", "f.json"), 2, "f.json: Permission"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_the_exit_code_tells_whose_fault_it_was(error, code, words, capsys):
    def main():
        if error is not None:
            raise error

    assert run(main) == code
    assert words in capsys.readouterr().err


def test_a_fault_of_ours_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        run(lambda: print(1 / 0))
