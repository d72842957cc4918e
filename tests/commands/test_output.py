"""What commands print on a terminal and in a pipe."""

import fcntl
import json
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest
from rich.padding import Padding
from rich.table import Table

from glider.__main__ import main
from glider.campaign.importing.campaign_import import import_campaign
from glider.campaign.logs import POSE_COLUMNS, SERVO_COLUMNS
from glider.campaign.samples import sample_names
from glider.commands.output import output
from tests.helpers.campaigns import campaign_path, first_flights

ROOT = Path(__file__).parents[2]
LONG = "A sentence that a program reads must stay one line of text. " * 5


def on_a_terminal(code, columns=60):
    """What Python code prints on a terminal, without escapes."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        cwd=ROOT,
        env={k: v for k, v in os.environ.items() if k != "COLUMNS"}
        | {"TERM": "xterm", "PYTHONPATH": str(ROOT)},
    )
    os.close(theirs)
    said = b""
    try:
        while part := os.read(ours, 4096):
            said += part
    except OSError:  # It has ended.
        pass
    os.close(ours)
    assert process.wait() == 0, said
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", said.decode())


def print_all():
    table = Table("name", "value")
    table.add_row("a", "short")
    table.add_row("b", LONG.strip())
    with output() as console:
        console.print(LONG, highlight=False)
        console.print(Padding("indented", (0, 0, 0, 2)))
        console.print(table)


@pytest.mark.parametrize("columns", [None, 50])
def test_a_pipe_has_whole_sentences_and_no_blanks_at_the_end(
    columns, capsys, monkeypatch
):
    """Unless COLUMNS has its width."""
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns:
        monkeypatch.setenv("COLUMNS", str(columns))
    print_all()
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line != line.rstrip()] == []
    assert "  indented" in lines
    assert (LONG.strip() in lines) == (columns is None)
    if columns:
        assert max(map(len, lines)) == columns


def test_a_terminal_has_lines_as_wide_as_it_is():
    said = on_a_terminal("from tests.commands.test_output import *; print_all()", 60)
    assert 50 < max(map(len, said.splitlines())) <= 60


WORK = """
import time
from glider.commands.output import working
from glider.progress import Step
with working() as progress:
    for share in (0.0, 0.25, 0.5):
        progress(Step(f"part [{share}]", share))
        time.sleep(0.15)
    progress("the rest, " * 9)
    time.sleep(0.15)
print("done")
"""


def test_a_terminal_shows_the_share_that_is_done():
    said = on_a_terminal(WORK)
    for words in ("25%", "50%", "part [0.25] ...", "the rest, the"):
        assert words in said
    assert all("0:0" in line for line in said.splitlines() if "the rest" in line)
    assert said.rstrip().endswith("done")


def test_a_pipe_has_no_progress():
    done = subprocess.run(
        [sys.executable, "-c", WORK],
        check=True,
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert (done.stdout, done.stderr) == ("done\n", "")


def test_an_import_announces_each_file(tmp_path):
    files = [campaign_path("still_air") / f"{name}.csv" for name in first_flights(4)]
    columns = {name: name for name in (*POSE_COLUMNS, *SERVO_COLUMNS)}
    (tmp_path / "map.yaml").write_text(json.dumps({"columns": columns}))
    steps = []
    import_campaign(
        files, tmp_path / "map.yaml", tmp_path / "throws", progress=steps.append
    )
    assert steps[:4] == [f"reading {file}" for file in files]
    assert [step.share for step in steps[:4]] == [0.0, 0.25, 0.5, 0.75]
    assert steps[4].startswith("cutting the flights out")


def test_samples_as_json(capsys):
    assert main(["samples", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [sample["name"] for sample in listed] == [*sample_names()]
    assert all(sample["flights"] > 0 and sample["holds"] for sample in listed)
