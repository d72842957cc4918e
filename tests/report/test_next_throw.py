"""What is written of proposed throws."""

import dataclasses
import json

import numpy as np
import pytest

from glider.errors import InputError
from glider.experiments.known_funnel import known_funnel
from glider.paths import models_path
from glider.report.next_throw import (
    draw_proposal,
    sentences,
    throw_words,
    to_json,
    write_proposal,
)
from glider.systems.command_tape import load_commands
from glider.verification.proof.check import check_funnel
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


def test_a_funnel_is_reported_recorded_and_drawn():
    without = late_proposal()
    assert to_json(without)["funnel"] is None
    assert to_json(without)["throws"][0]["funnel_level"] is None
    assert "funnel" not in throw_words(without, 1)
    known = known_funnel(models_path("funnels", "drawn_hook.npz"))
    proposal = dataclasses.replace(
        without,
        place=dataclasses.replace(without.place, funnel=known),
        levels=(0.8312, 0.4),
    )
    data = to_json(proposal)
    assert data["funnel"] == {
        "file": known.file,
        "sha256": known.funnel.sha256,
        "certificate_checked": False,
        "proof_by": f"glider check-funnel {known.file} --prove",
        "relied_on": known.relied_on,
    }
    assert data["funnel"]["relied_on"]["remainder"] == "unchecked"
    assert [t["funnel_level"] for t in data["throws"]] == [0.8312, 0.4]
    durations = [t.duration for t in proposal.throws]
    assert [t["feedback_from_s"] for t in data["throws"]] == durations
    said, inlet, unchecked = (
        s for s in sentences(proposal) if "nel" in s or "inlet" in s
    )
    assert "±0.173 m" in inlet and "of one glider" in inlet
    assert {said, unchecked} <= set(data["says"])
    assert f"inside the funnel of {known.file} by" in said
    assert "up to level 0.84 of 1" in said
    assert throw_words(proposal, 2).endswith(
        f"; up to level 0.40 of the funnel, its feedback from {durations[1]:.2f} s"
    )
    assert draw_proposal(proposal) != draw_proposal(without)


def test_what_was_checked_of_a_funnel_is_reported():
    known = known_funnel(models_path("funnels", "drawn_hook.npz"))
    given = known_funnel(known.funnel)
    verdict = check_funnel(known.funnel, every=100, seed=3)
    checked = dataclasses.replace(known, verdict=verdict)

    def told(funnel):
        place = dataclasses.replace(late_proposal().place, funnel=funnel)
        proposal = dataclasses.replace(late_proposal(), place=place, levels=(0.8, 0.4))
        return [s for s in sentences(proposal) if "funnel" in s], to_json(proposal)

    (_, said), data = told(checked)
    assert "was checked, exactly at 3 of its 201 times" in said
    assert "searched by ascent, up to 0.6" in said
    assert f"not proven here: `glider check-funnel {known.file} --p" in said
    assert data["funnel"]["certificate_checked"] is True
    relied = data["funnel"]["relied_on"]
    assert (relied["exact_at_times"], relied["remainder"]) == (3, "sampled")
    assert (relied["seed"], relied["every_flight_proven"]) == (3, False)
    assert relied["inlet"]["half_widths"]["z"] == pytest.approx(0.173, abs=1e-3)
    assert relied["set_of_gliders"] is None
    of_set = known_funnel(models_path("funnels", "head_wind_95.npz"))
    assert of_set.relied_on["set_of_gliders"].startswith("95 % ellipsoid of wind.x")
    (inside, said), data = told(given)
    assert "inside the given funnel by" in inside
    assert "sets were not checked" in said
    assert data["funnel"]["file"] is None


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
    proposal = weighed(
        0.55,
        0.43,
        chance_now=0.55,
        chance_then=0.97,
        chance_same_kind=0.6,
        equivalent=40,
    )
    first, second = (e.name for e in proposal.explanations)
    said = sentences(proposal)
    assert said[0] == (
        f"The flights leave 2 explanations: {first} (0.55), {second} (0.43); the "
        "probability of another is 0.02."
    )
    assert said[1] == (
        f"With 2 such throws {first} and {second} separate with probability 0.97; "
        "today 0.55. As many throws of the present kind reach 0.60; 40 of them would "
        "achieve the same."
    )


def test_what_throws_cannot_show_is_reported():
    proposal = weighed(0.55, 0.43, chance_now=0.55, chance_then=0.56)
    assert (
        "No throw within the limits distinguishes them much" in sentences(proposal)[1]
    )
    never = dataclasses.replace(proposal, chance_then=0.9, equivalent=None)
    assert "more than 1000 of them" in sentences(never)[1]


def test_what_is_barely_probable_is_not_named_but_counted():
    proposal = weighed(0.975, 0.005, chance_now=0.975)
    said = sentences(proposal)
    assert said[0].startswith("The flights leave one explanation, ")
    assert said[0].endswith("(0.97); the probability of another is 0.03.")
    assert not any("With" in sentence for sentence in said)
