"""What is written of a rehearsal."""

import dataclasses
import json

import matplotlib
import numpy as np
from rich.console import Console

from glider.experiments.rehearsal import Rehearsal, Rehearsed
from glider.physics.effects import MASS
from glider.report import rehearsal as report
from glider.report.rehearsal import print_rehearsal, to_json, write_rehearsal
from tests.report.results import make_result

RESULT = make_result()
[CHANGE] = MASS.coefficients
SEEN = Rehearsed(
    kind="mass",
    coefficient=CHANGE,
    size=0.1,
    power=0.75,
    instead={"airspeed_dependence": 0.2},
    curve=np.array([(0.05, 0.2), (0.1, 0.75), (0.2, 1.0)]),
    visible=0.15,
)
HIDDEN = dataclasses.replace(SEEN, visible=np.inf, instead={})
REHEARSAL = Rehearsal(
    campaign="throws",
    flights=12,
    known=("wind",),
    effects=(SEEN, HIDDEN),
    false_alarms=0.015,
    seed=3,
    seconds=50.0,
)


def printed(rehearsal):
    console = Console(width=100)
    with console.capture() as said:
        print_rehearsal(rehearsal, console)
    return said.get()


def test_a_table_has_power_and_the_smallest_size():
    text = printed(REHEARSAL)
    assert "12 flights of throws, whose model has wind." in text
    first, second = [line for line in text.splitlines() if line.startswith("mass ")][:2]
    assert first.split() == ["mass", "0.100", "75%", "0.150"]
    assert second.endswith("no size")
    assert "mass is reported as airspeed_dependence (20%)." in text
    assert "Without a further effect, 1.5% name one." in text


def test_what_is_hardly_ever_named_instead_is_not_told():
    rare = dataclasses.replace(SEEN, instead={"inertia": 0.004, "wind": 0.01})
    text = printed(dataclasses.replace(REHEARSAL, effects=(rare,)))
    assert "mass is reported as wind (1%)." in text
    only = dataclasses.replace(SEEN, instead={"inertia": 0.004})
    text = printed(dataclasses.replace(REHEARSAL, effects=(only,)))
    assert "is reported as" not in text


def test_what_was_flown_has_the_names_beside_those_of_the_model():
    one = dataclasses.replace(SEEN, flown=RESULT)
    flown = dataclasses.replace(REHEARSAL, effects=(one,), flown=RESULT)
    assert "flown and traced once: effect_found." in printed(flown)
    assert to_json(flown)["flown"] == {"verdict": "effect_found", "named": []}
    unknown = dataclasses.replace(flown, known=())
    assert "flown and traced once: effect_found: wind." in printed(unknown)
    [found] = to_json(unknown)["effects"]
    assert found["flown"] == {"verdict": "effect_found", "named": ["wind"]}


def test_the_folder_has_a_picture_and_numbers(tmp_path):
    write_rehearsal(REHEARSAL, tmp_path)
    data = json.loads((tmp_path / "rehearsal.json").read_text())
    assert data == to_json(REHEARSAL)
    assert data["flown"] is None
    assert data["effects"][1]["visible"] is None
    assert data["seed"] == 3
    assert (tmp_path / "rehearsal.png").read_bytes().startswith(b"\x89PNG")
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        drawn = report.draw_rehearsal(REHEARSAL, "svg").decode()
    for words in ("0.05", "0.2", "planted size", "power of 95%"):
        assert f">{words}<" in drawn
