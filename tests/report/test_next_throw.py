"""What is written of proposed throws."""

import json

import numpy as np
import pytest

from glider.errors import InputError
from glider.report.next_throw import to_json, write_proposal
from glider.systems.command_tape import load_commands
from tests.helpers.late import late_proposal


def test_the_folder_holds_commands_picture_and_numbers(tmp_path):
    proposal = late_proposal()
    folder = tmp_path / "next"
    folder.mkdir()
    (folder / "commands_7.csv").write_text("of an earlier proposal")
    (folder / "notes.txt").write_text("kept")
    write_proposal(proposal, folder)
    names = sorted(p.name for p in folder.iterdir())
    assert names == [
        "commands_1.csv",
        "commands_2.csv",
        "next_throw.json",
        "next_throw.png",
        "notes.txt",
    ]
    for k, throw in enumerate(proposal.throws, start=1):
        times, commands = load_commands(folder / f"commands_{k}.csv")
        assert np.allclose(times[:-1], throw.times)
        assert np.array_equal(commands[:-1], throw.commands)
    data = json.loads((folder / "next_throw.json").read_text())
    assert data == to_json(proposal)
    assert data["chance"]["then"] > data["chance"]["now"]
    assert [t["commands"] for t in data["throws"]] == names[:2]


def test_a_file_in_the_way_is_told(tmp_path):
    (tmp_path / "next").write_text("")
    with pytest.raises(InputError, match="is a file"):
        write_proposal(late_proposal(), tmp_path / "next")
