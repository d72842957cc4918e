"""A proposed throw, flown by the station from its file of commands."""

import dataclasses
import json
import warnings

import numpy as np
import pytest

from diagrams.programs.lab.folder import Watched
from diagrams.programs.station.proposed import load_launch, tape_plan
from diagrams.programs.station.scenario import Simulation
from diagrams.programs.station.throw_log import read_throw
from glider import effects
from glider.campaign.reader import load_campaign
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.systems.command_tape import tape_text
from tests.helpers.lockstep import Lockstep

THROW = {
    "commands": "commands_1.csv",
    "x_m": -3.4,
    "height_m": 0.3,
    "speed_m_s": 6.0,
    "climb_rad": 0.1,
    "pitch_rad": -0.1,
}


@pytest.fixture
def commands(tmp_path):
    """File of a throw that begins to turn the elevator at once."""
    file = tmp_path / "commands_1.csv"
    rates = np.repeat([6.0, -4.0, 0.0, 5.0, -3.0], 6)
    file.write_text(tape_text(0.02 * np.arange(30), rates, 0.6))
    text = json.dumps({"campaign": "known", "throws": [THROW]})
    (tmp_path / "next_throw.json").write_text(text)
    return file


def make_lab(tmp_path, commands):
    GliderModel().save(tmp_path / "nominal.yaml")
    truth = Simulation(truth=str(tmp_path / "nominal.yaml"))
    return Lockstep(tmp_path / "s", truth, commands=str(commands))


def test_the_elevator_turns_as_the_file_says_from_the_proposed_launch(
    tmp_path, commands
):
    lab = make_lab(tmp_path, commands)
    lab.run_into_flight(0.3)
    released, launch = lab.glider.released, lab.glider._launch
    assert np.hypot(*launch[4:6]) == pytest.approx(6.0, abs=0.4)
    assert launch[[0, 1, 2]] == pytest.approx([-3.4, 0.3, -0.1], abs=0.15)
    lab.run(lambda: len(lab.station.throws) == 1)
    assert lab.station.throws[0].reason == "", lab.lines
    topics = read_throw(lab.folder / "throw_001.mcap")[1]
    seen = [p for p in topics["/pose"] if p["free"] and not p["fault"]]
    since = np.array([p["time"] for p in seen]) - released
    begins, rates = 0.12 * np.arange(6), [6.0, -4.0, 0.0, 5.0, -3.0]
    angles = np.append(0.0, np.cumsum(0.12 * np.array(rates)))
    inside = (since > 0.08) & (since < 0.58)  # What was missed is made good by then.
    wanted = np.interp(since, begins, angles)
    away = (np.array([p["elevator"] for p in seen]) - wanted)[inside]
    # A hundredth of a second of time, by which the release is not known, is 0.06 rad.
    assert np.sqrt(np.mean(away**2)) < 0.06
    [flight] = load_campaign(lab.folder).flights
    [throw] = Watched(lab.folder).throws(())
    assert throw.name == flight.name and throw.planned == "proposed"


def test_a_kill_stops_a_proposed_throw_too(tmp_path, commands):
    lab = make_lab(tmp_path, commands)
    begin = lab.run_into_flight(0.2)
    lab.station.operate("kill")
    assert lab.run(lambda: len(lab.station.throws) == 1)
    assert lab.neutral_since(begin, lab.now) - begin <= 0.05


def test_commands_without_a_launch_are_refused(tmp_path, commands):
    other = commands.with_name("commands_2.csv")
    with pytest.raises(InputError, match=r"commands_2.csv: does not exist; expected"):
        load_launch(other)
    other.write_text(commands.read_text())
    with pytest.raises(InputError, match="expected commands of a throw in"):
        load_launch(other)
    for text in ("[]", "{}", '{"throws": [{}]}'):
        (tmp_path / "next_throw.json").write_text(text)
        with pytest.raises(InputError):
            load_launch(commands)
    (tmp_path / "next_throw.json").unlink()
    with pytest.raises(InputError, match="not the throws of glider next-throw"):
        load_launch(commands)


def test_a_throw_beyond_what_its_model_was_traced_on_warns(commands):
    slow = GliderModel(
        effects=(effects.PROFILE_DRAG(cd0=0.05),), flown={"V": (2.0, 5.0)}
    )
    launch = load_launch(commands)
    with pytest.warns(UserWarning, match=r"The throw leaves .* V from .* 2 to 5\)"):
        tape_plan(slow, launch, commands)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fast = dataclasses.replace(slow, flown={"V": (2.0, 8.0)})
        tape_plan(fast, launch, commands)
