"""Limits of the throws that a session proposes."""

from diagrams.programs.lab.folder import limits_of
from diagrams.programs.station.scenario import Limits, Scenario
from diagrams.programs.station.throw_log import ThrowLog
from glider.files.schema import yaml_text


def write_record(folder, number, limits):
    facts = {"scenario": yaml_text(Scenario(limits=limits))}
    ThrowLog(folder / f"throw_{number:03d}.mcap", facts).close()


def test_a_proposed_throw_keeps_inside_the_room(tmp_path):
    assert limits_of(tmp_path) is None
    write_record(tmp_path, 1, Limits())
    write_record(tmp_path, 2, Limits(x=[-5.0, 2.0], z=[-1.0, 2.5]))
    room = limits_of(tmp_path)
    assert (list(room.x), list(room.z)) == ([-5.0, 2.0], [-1.0, 2.5])
    assert not room.launch_speed and not room.pitch  # As flown.
