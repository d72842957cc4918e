"""What is written of proposed throws."""

import dataclasses
import io
import json

import numpy as np
import pytest
from matplotlib.image import imread

from glider.errors import InputError
from glider.report.next_throw import draw_proposal, sentences, to_json, write_proposal
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
    one = dataclasses.replace(proposal, paths=[p[:1] for p in proposal.paths])
    full, less = (imread(io.BytesIO(draw_proposal(p))) for p in (proposal, one))
    assert len(less) == pytest.approx(2 / 3 * len(full))  # Of one explanation.


def test_a_file_in_the_way_is_reported(tmp_path):
    (tmp_path / "next").write_text("")
    with pytest.raises(InputError, match="is a file"):
        write_proposal(late_proposal(), tmp_path / "next")


def weighed(*probabilities, **changes):
    """The late servo's proposal with other probabilities."""
    proposal = late_proposal()
    explanations = tuple(
        dataclasses.replace(e, probability=p)
        for e, p in zip(proposal.explanations, probabilities, strict=False)
    )
    return dataclasses.replace(proposal, explanations=explanations, **changes)


def test_two_rivals_are_named_with_their_chances():
    proposal = weighed(0.55, 0.43, chance_now=0.55, chance_then=0.97)
    first, second = (e.name for e in proposal.explanations)
    said = sentences(proposal)
    assert said[0] == (
        f"The flights leave 2 explanations: {first} (0.55), {second} (0.43); the "
        "probability of another is 0.02."
    )
    assert said[1] == (
        f"With 2 such throws {first} and {second} separate with probability 0.97; "
        "today 0.55."
    )


def test_what_throws_cannot_show_is_reported():
    proposal = weighed(0.55, 0.43, chance_now=0.55, chance_then=0.56)
    assert (
        "No throw within the limits distinguishes them much" in sentences(proposal)[1]
    )


def test_what_is_barely_probable_is_not_named_but_counted():
    proposal = weighed(0.975, 0.005, chance_now=0.975)
    said = sentences(proposal)
    assert said[0].startswith("The flights leave one explanation, ")
    assert said[0].endswith("(0.97); the probability of another is 0.03.")
    assert not any("With" in sentence for sentence in said)


def test_throws_beyond_what_was_flown_are_named():
    alpha = "alpha from -0.1 to 0.9 rad (flown: -0.1 to 0.5)"
    proposal = dataclasses.replace(late_proposal(), beyond=("", alpha))
    [said] = [own for own in sentences(proposal) if "traced on" in own]
    assert said.startswith(f"Throw 2 ({alpha}) leaves what the model was traced on")
    assert [own["beyond_flown"] for own in to_json(proposal)["throws"]] == ["", alpha]
    both = dataclasses.replace(proposal, beyond=(alpha, alpha))
    assert f"Throw 1 ({alpha}) and throw 2 ({alpha}) leave" in " ".join(sentences(both))
    assert not any("traced on" in own for own in sentences(late_proposal()))
