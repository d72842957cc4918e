"""Limits of the throws that a session proposes."""

import shutil

import pytest

from diagrams.programs.lab.folder import LIMITS, limits_of
from diagrams.programs.lab.session import LabSession
from diagrams.programs.lab.state import Trace
from diagrams.programs.station.scenario import Limits, Scenario
from diagrams.programs.station.throw_log import ThrowLog
from glider.campaign.samples import campaign_folder
from glider.errors import InputError
from glider.files.schema import yaml_text


def write_record(folder, number, limits):
    facts = {"scenario": yaml_text(Scenario(limits=limits))}
    ThrowLog(folder / f"throw_{number:03d}.mcap", facts).close()


def test_a_throw_keeps_inside_the_room_or_what_the_file_says(tmp_path):
    assert limits_of(tmp_path) is None
    write_record(tmp_path, 1, Limits())
    write_record(tmp_path, 2, Limits(x=[-5.0, 2.0], z=[-1.0, 2.5]))
    room = limits_of(tmp_path)
    assert (room.x, room.z) == ([-5.0, 2.0], [-1.0, 2.5])
    assert not room.launch_speed and not room.pitch  # As flown.
    (tmp_path / LIMITS).write_text("z: [-0.5, 3.0]\nspeed: 8.0\n")
    given = limits_of(tmp_path)
    assert (given.z, given.speed, given.x) == ([-0.5, 3.0], 8.0, [])
    (tmp_path / LIMITS).write_text("z: [3.0, -0.5]\n")
    with pytest.raises(InputError, match="'z'"):
        limits_of(tmp_path)


def test_other_limits_ask_for_another_throw(tmp_path):
    source = campaign_folder("head_wind")
    for name in ("campaign.yaml", *(f"flight_{k:03d}.csv" for k in range(3))):
        shutil.copy(source / name, tmp_path)
    session = LabSession(tmp_path)
    try:
        session.update()
        trace = session._next_job()
        session._take(Trace(flights=trace.flights, sha256=trace.sha256))
        first = session._next_job()
        assert first.proposes
        session._take(first.refused("No throw keeps within the limits."))
        assert session._next_job() is None
        (tmp_path / LIMITS).write_text("speed: fast\n")
        job = session._next_job()
        assert job.proposes and job.sha256 == first.sha256
        session._take(job.refused("Other reasons."))
        assert session._next_job() is None
        (tmp_path / LIMITS).unlink()
        assert session._next_job() == first
    finally:
        session.close()
