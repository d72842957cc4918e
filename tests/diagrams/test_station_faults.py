"""What goes wrong in flight: neutral within 50 ms, a whole record, a next throw."""

import dataclasses
import errno
import os
from pathlib import Path

import numpy as np
import pytest

from diagrams.station import throw_log
from diagrams.station.bus import COMMAND, COMMAND_FIELDS, POSE, POSE_FIELDS, Bus
from diagrams.station.scenario import Fault, Limits, Simulation
from diagrams.station.throw_log import flight_of, read_throw
from glider.campaign.reader import load_campaign
from glider.physics.model import GliderModel
from tests.helpers.lockstep import Lockstep

SAFE = 0.05
"""Time within which the elevator must be on its way to neutral [s]."""


@pytest.fixture
def make_lab(tmp_path):
    """Makes a station and a glider without effects."""
    GliderModel().save(tmp_path / "nominal.yaml")
    truth = str(tmp_path / "nominal.yaml")

    def make(*faults, limits=None, **simulation):
        sim = Simulation(truth=truth, faults=list(faults), **simulation)
        changes = {} if limits is None else {"limits": limits}
        return Lockstep(tmp_path / "s", sim, **changes)

    return make


def check_stopped(lab, begin, reason):
    """Checks that the throw stops in time, says why, and is recorded to its end."""
    count = len(lab.station.throws)
    assert lab.run(lambda: lab.station.state == "stopped", 0.2), lab.station.state
    stopped = lab.now
    assert reason in lab.station.reason
    assert lab.run(lambda: len(lab.station.throws) > count)
    assert lab.neutral_since(begin, lab.now) - begin <= SAFE
    assert stopped - begin <= SAFE
    assert reason in lab.lines[-1]
    _, topics = read_throw(sorted(lab.folder.glob("throw_*.mcap"))[-1])
    assert reason in next(
        e["reason"] for e in topics["/event"] if e["state"] == "stopped"
    )
    return topics


def check_next_throw(lab):
    """Checks that the next throw perches."""
    lab.glider._settings = dataclasses.replace(lab.glider._settings, faults=[])
    lab.glider._cameras._settings = lab.glider._settings
    [throw] = lab.fly()
    assert throw.perched, lab.lines
    records = sorted(lab.folder.glob("throw_*.mcap"))
    flights = [flight.name for flight in load_campaign(lab.folder).flights]
    assert flights == [f"flight_{k + 1:03d}.csv" for k in range(len(records))]


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("lost", "no usable pose for"),
        ("nan", "a pose that is no number"),
        ("swapped", "a jump of the pitch by 3."),
        ("frozen", "the same pose again"),
    ],
)
def test_poses_that_cannot_be_used_for_100_ms(make_lab, kind, reason):
    lab = make_lab(Fault(kind=kind, at=0.3, duration=0.1))
    begin = lab.run_into_flight(0.3)
    topics = check_stopped(lab, begin, reason)
    release = lab.glider.released if lab.glider.released < lab.now else begin - 0.3
    last = max(pose["time"] for pose in topics["/pose"])
    assert last > release + 0.9, "the record went on to the end of the throw"
    # The flight ends there: rows that are missing cannot show what was commanded.
    [flight] = load_campaign(lab.folder).flights
    assert 0.2 < flight.time[-1] < 0.3
    neutral = [c for c in topics["/command"] if "asked" not in c]
    assert len(neutral) > 20 and abs(neutral[-1]["angle"]) < 1e-6
    check_next_throw(lab)


@pytest.mark.parametrize("kind", ["lost", "nan", "swapped", "frozen"])
def test_two_bad_frames_are_flown_through(make_lab, kind):
    lab = make_lab(Fault(kind=kind, at=0.3, duration=0.016))
    [throw] = lab.fly()
    assert throw.perched, lab.lines


@pytest.mark.parametrize(
    "faults",
    [
        {"duplicated": 0.3},
        {"late": 0.2},
        {"clock_drift": 200e-6},
        {"clock_drift": -200e-6, "jitter": 0.001},
    ],
)
def test_what_the_station_lives_with(make_lab, faults):
    lab = make_lab(**faults)
    assert all(throw.perched for throw in lab.fly(2)), lab.lines


def test_a_fifth_of_the_frames_lost(make_lab):
    lab = make_lab(lost=0.2, duplicated=0.0, late=0.0)
    perched = 0
    for _ in range(6):
        [throw] = lab.fly()
        perched += throw.perched
        assert throw.perched or "no usable pose for 4" in throw.reason, lab.lines
        record = sorted(lab.folder.glob("throw_*.mcap"))[-1]
        _, topics = read_throw(record)
        stamps = [p["stamp"] for p in topics["/pose"] if p["free"]]
        # Every frame that came is there: gaps of some periods, none of them long.
        assert np.max(np.diff(sorted(stamps))) < 0.1
    assert perched >= 4, lab.lines


def test_the_glider_vanishes_and_comes_back(make_lab):
    lab = make_lab()
    begin = lab.run_into_flight(0.3)
    lab.glider_bus.is_in = False
    topics = check_stopped(lab, begin, "no usable pose for")
    assert max(pose["time"] for pose in topics["/pose"]) > begin - 0.02
    lab.start_glider()
    check_next_throw(lab)


def test_the_station_dies_and_is_started_again(make_lab):
    lab = make_lab()
    begin = lab.run_into_flight(0.4)
    lab.station_bus.is_in = False
    lab.run(lambda: False, SAFE)
    wire = lab.glider._wire
    assert wire.angle == wire.neutral or wire.rate * wire.angle < 0.0
    record = sorted(lab.folder.glob("throw_*.mcap"))[-1]
    _, topics = read_throw(record)
    # Frames take 6 ms and come each 8 ms.
    assert max(pose["time"] for pose in topics["/pose"]) > begin - 0.016
    assert not list(lab.folder.glob("flight_*.csv"))
    lab.start_station()
    assert [flight.name for flight in load_campaign(lab.folder).flights] == [
        "flight_001.csv"
    ]
    check_next_throw(lab)


def test_a_record_that_is_cut_off_anywhere_is_read_up_to_there(make_lab, tmp_path):
    lab = make_lab()
    lab.fly()
    whole = (lab.folder / "throw_001.mcap").read_bytes()
    poses = len(read_throw(lab.folder / "throw_001.mcap")[1]["/pose"])
    found = []
    for size in np.random.default_rng(0).integers(8, len(whole), 60):
        part = tmp_path / "throw_002.mcap"
        part.write_bytes(whole[:size])
        found.append((size, len(read_throw(part)[1]["/pose"])))
        flight_of(part)
    found.sort()
    assert np.all(np.diff([count for _, count in found]) >= 0)
    assert found[-1][1] > 0.8 * poses


class Disk:
    """A disk with so much room left; removing the reserve gives its room back."""

    def __init__(self, monkeypatch, room):
        self.room = room
        write, write_bytes, unlink = os.write, Path.write_bytes, Path.unlink

        def use(size):
            if size > self.room:
                raise OSError(errno.ENOSPC, "No space left on device")
            self.room -= size

        def take(file, data):
            use(len(data))
            return write(file, data)

        def take_all(path, data):
            use(len(data))
            return write_bytes(path, data)

        def free(path, missing_ok=False):
            if path.exists() and path.suffix == ".reserve":
                self.room += path.stat().st_size
            unlink(path, missing_ok=missing_ok)

        monkeypatch.setattr(throw_log.os, "write", take)
        monkeypatch.setattr(Path, "write_bytes", take_all)
        monkeypatch.setattr(Path, "unlink", free)


def test_without_room_for_a_record_there_is_no_throw(make_lab, monkeypatch):
    lab = make_lab()
    disk = Disk(monkeypatch, 1000)
    assert not lab.run(lambda: lab.station.state == "ready", 3.0)
    assert "No space left on device" in lab.station.reason
    assert not list(lab.folder.glob("throw_*"))
    disk.room = 10**8
    check_next_throw(lab)


def test_a_disk_that_is_full_in_flight_has_room_for_this_throw(make_lab, monkeypatch):
    lab = make_lab()
    disk = Disk(monkeypatch, 10**7)
    lab.run_into_flight(0.3)
    disk.room = 0
    assert lab.run(lambda: len(lab.station.throws) == 1)
    assert lab.station.throws[0].perched
    _, topics = read_throw(lab.folder / "throw_001.mcap")
    assert topics["/event"][-1]["state"] == "result"


def test_a_disk_that_takes_nothing_more_stops_the_throw(make_lab, monkeypatch):
    lab = make_lab()
    disk = Disk(monkeypatch, 10**7)
    begin = lab.run_into_flight(0.3)
    disk.room = -(10**8)
    count = len(lab.commands)
    assert lab.run(lambda: lab.station.state == "stopped", SAFE)
    assert lab.run(lambda: len(lab.station.throws) == 1)
    assert lab.neutral_since(begin, lab.now) - begin <= SAFE
    assert len(lab.commands) > count and "No space left" in lab.lines[-1]
    _, topics = read_throw(lab.folder / "throw_001.mcap")
    assert max(pose["time"] for pose in topics["/pose"]) > begin - 0.016
    disk.room = 10**8
    check_next_throw(lab)


def test_a_second_operator(make_lab):
    lab = make_lab()
    begin = lab.run_into_flight(0.3)
    angle, sender = lab.glider._wire.angle, lab.glider._wire._sender
    Bus(lab.lcm).say(COMMAND, lab.now, (7.0, 1.0, 13.0, 0.9), COMMAND_FIELDS)
    check_stopped(lab, begin, "another operator")
    assert lab.glider._wire._sender == sender and angle > 0.0
    check_next_throw(lab)


def test_the_kill_key_stops_until_it_is_armed_again(make_lab):
    lab = make_lab()
    begin = lab.run_into_flight(0.3)
    lab.station.on_operator(0.0, (), ("kill",))
    check_stopped(lab, begin, "the operator stopped it")
    assert not lab.run(lambda: lab.station.state == "ready", 2.0)
    lab.station.on_operator(0.0, (), ("arm",))
    check_next_throw(lab)


@pytest.mark.parametrize(
    ("delay", "answer", "reason"),
    [(0.03, 0.0, "two commands in a row were late"), (0.0, np.nan, "gave no number")],
)
def test_a_controller_that_fails(make_lab, monkeypatch, delay, answer, reason):
    lab = make_lab()
    begin = lab.run_into_flight(0.3)
    controller = lab.guidance.controller

    def command(time, state):
        lab.now += delay
        return answer

    with monkeypatch.context() as patch:
        patch.setattr(type(controller), "command", lambda self, t, x: command(t, x))
        # Late commands are seen when they are: the second one, a period later.
        check_stopped(lab, begin + 2.0 * delay, reason)
    check_next_throw(lab)


def test_a_filter_that_loses_the_glider(make_lab):
    lab = make_lab(limits=Limits(distance=1e-5))
    assert lab.run(lambda: len(lab.station.throws) == 1)
    assert "the filter has lost the glider" in lab.lines[-1]
    assert lab.station.throws[0].stopped < 0.2


def test_nonsense_on_the_bus_is_no_fault(make_lab):
    lab = make_lab()
    lab.run_into_flight(0.3)
    rng = np.random.default_rng(0)
    for size in (0, 1, 8, 20, 100, 4000):
        for channel in (POSE, COMMAND, "GLIDER_STATUS", "GLIDER_OPERATOR"):
            lab.lcm.Publish(channel, rng.bytes(size))
    bus = Bus(lab.lcm)
    bus.say(POSE, 1e12, (1.0, 2.0), ("x", "z"))
    bus.say(POSE, -1e12, (1.0, 1e300, -1e300, np.inf, np.nan), POSE_FIELDS)
    assert lab.run(lambda: len(lab.station.throws) == 1)
    assert lab.station.throws[0].perched, lab.lines
    assert lab.station_bus.refused == 18
