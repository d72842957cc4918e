"""A campaign keeps where its servo columns come from, and how well they are timed."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from glider.campaign.importing.campaign_import import import_campaign, read_flights
from glider.campaign.importing.selection import ServoLogs, Stream
from glider.campaign.importing.servo_logs import make_servo
from glider.campaign.importing.track import Track
from glider.campaign.logs import ServoLog
from glider.campaign.reader import load_campaign
from glider.campaign.writer import save_campaign
from glider.errors import InputError
from glider.physics.actuator_replay import command_steps, elevator_path
from glider.sysid.pipeline import close_the_loop
from glider.sysid.replay.record import prepare
from glider.sysid.replay.smoothing import measure_noise
from glider.sysid.replay.vehicle import make_vehicle
from tests.campaign.importing import foreign

AHEAD = 0.35  # Of the servo's clock [s].
VEHICLE = """\
vehicle: {mass: 0.08, pitch_inertia: 0.0015, wing_area: 0.0885, elevator_area: 0.0147,
          wing_offset: 0.0, hinge_offset: 0.27, elevator_offset: 0.022, gravity: 9.81,
          air_density: 1.204, elevator_rate_limit: 13.0,
          elevator_limits: [-0.4463, 0.9473]}
"""
POSES = "columns: {time: [time, t], x: x, z: z, pitch: pitch, "
MAPS = {
    "measured": POSES + "elevator: elevator}\n",
    "commanded": POSES + "elevator_angle_command: elevator}\n",
    "two clocks": 'join: ["*_poses.csv", "*_servo.csv"]\ncommand_rate: 50\n'
    + POSES
    + "elevator: elevator, elevator_rate_command: rate}\n",
}
TIMING = ("attached_lift", "servo_lag", "command_delay", "pose_latency")


@pytest.fixture(scope="module")
def campaign():
    return foreign.flights("attached_lift", 8)


def write(folder, campaign, logs, clock=None):
    """Files of poses and servo, the latter at 50 Hz where it has its own clock."""
    files = []
    for k, flight in enumerate(campaign.flights):
        columns = dict(zip(("x", "z", "pitch"), flight.pose.T, strict=True))
        columns = {"time": flight.time, **columns}
        if logs == "two clocks":
            time = np.arange(flight.time[0] - 1.0, flight.time[-1] + 1.0, 0.02)
            angle = np.interp(time, flight.time, flight.elevator)
            tape = flight.time, flight.command, campaign.command_rate
            begins, rates = command_steps(*tape)
            row = np.searchsorted(begins, time + 1e-6, side="right") - 1
            rate = np.where(time > flight.time[-1], 0.0, rates[np.maximum(row, 0)])
            servo = {"t": time + AHEAD, "elevator": angle, "rate": rate}
            files.append(save(folder / f"{k}_servo.csv", servo))
        else:
            columns["elevator"] = flight.elevator
        files.append(save(folder / f"{k}_poses.csv", columns))
    path = folder / "MAP.yaml"
    given = "" if clock is None else f"clock: {clock}\n"
    path.write_text(MAPS[logs] + given + VEHICLE)
    return files, path


def save(path, columns):
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, "%.9g", ",", header=",".join(columns), comments="")
    return path


@pytest.mark.parametrize(
    ("logs", "expected"),
    [
        ("measured", ServoLog(command="reconstructed")),
        (
            "commanded",
            ServoLog(
                angle="reconstructed",
                command="converted",
                clock_std=1.0 / 120.0 / np.sqrt(12.0),
            ),
        ),
    ],
)
def test_a_campaign_keeps_what_was_logged_of_the_servo(
    tmp_path, campaign, logs, expected
):
    imported = import_campaign(*write(tmp_path, campaign, logs), tmp_path / "out")
    again = load_campaign(tmp_path / "out")
    save_campaign(tmp_path / "again", again)
    for known in (imported.campaign, again, load_campaign(tmp_path / "again")):
        assert known.servo.angle == expected.angle
        assert known.servo.command == expected.command
        assert known.servo.clock_std == pytest.approx(expected.clock_std, rel=1e-3)
    assert "servo:" not in saved(tmp_path / "plain", campaign)
    flight, log = again.flights[0], again.servo
    tape = flight.time, flight.command, again.switch_rate
    path = elevator_path(*command_steps(*tape), flight.time)
    left = flight.elevator - path
    assert np.std(left) < 0.01  # Half a row too early: 0.02.
    [record, *_] = prepare(again.flights, again, measure_noise(again))
    assert record.seen[:, 3].any() == (log.angle == "measured")


def saved(folder, campaign):
    save_campaign(folder, campaign)
    return (folder / "campaign.yaml").read_text()


@pytest.mark.parametrize(
    "field", ["angle: guessed", "command: 3", "clock_std: -1.0", "delay: 0.1"]
)
def test_a_servo_that_cannot_be_is_refused(tmp_path, campaign, field):
    text = saved(tmp_path, campaign)
    (tmp_path / "campaign.yaml").write_text(f"{text}servo: {{{field}}}\n")
    with pytest.raises(InputError, match="servo"):
        load_campaign(tmp_path)


def test_effects_that_the_logs_cannot_support_are_not_tried(campaign):
    for log, missing in (
        (ServoLog(), set()),
        (ServoLog(command="reconstructed"), {"servo_lag", "command_delay"}),
        (ServoLog(angle="reconstructed", command="converted"), set()),
    ):
        vehicle = make_vehicle(dataclasses.replace(campaign, servo=log))
        assert {*make_vehicle(campaign).kinds} - {*vehicle.kinds} == missing
        assert all(kind in "".join(vehicle.notes) for kind in missing)


def test_an_offset_that_was_found_has_a_standard_error(tmp_path, campaign):
    files, path = write(tmp_path, campaign, "two clocks")
    log = read_flights(files, path).campaign.servo
    assert 0.002 < log.clock_std < 0.01
    [note] = {n for r in read_flights(files, path).recordings for n in r.notes}
    found = float(note.partition(" is ")[2].partition(" ")[0])
    assert abs(found - AHEAD) < 3.0 * log.clock_std


@pytest.mark.nightly
def test_a_clock_that_turns_the_elevator_round_is_refused(tmp_path, campaign):
    files, path = write(tmp_path, campaign, "two clocks", 0.25)
    with pytest.raises(InputError, match="'clock: find'"):
        read_flights(files, path)


@pytest.mark.parametrize("off", [-0.03, 0.03])
def test_a_clock_that_is_off_is_warned_of(tmp_path, campaign, off):
    files, path = write(tmp_path, campaign, "two clocks", AHEAD + off)
    imported = read_flights(files, path)
    assert f"'clock' is {AHEAD + off:g}" in imported.undecided[0]
    assert imported.campaign.servo.clock_std == pytest.approx(0.03, abs=0.01)


def test_a_clock_that_is_right_is_known_to_half_its_last_digit(tmp_path, campaign):
    files, path = write(tmp_path, campaign, "two clocks", AHEAD)
    imported = read_flights(files, path)
    assert imported.undecided == ()
    assert imported.campaign.servo.clock_std == pytest.approx(0.01 / np.sqrt(12.0))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("logs", "clock"), [*((logs, None) for logs in MAPS), ("two clocks", 0.33)]
)
def test_no_delay_is_named_that_the_import_made(tmp_path, campaign, logs, clock):
    files, path = write(tmp_path, campaign, logs, clock)
    result = close_the_loop(read_flights(files, path).campaign, effects=TIMING)
    assert [e.kind for e in result.effects] == ["attached_lift"]
    assert result.effects[0].coefficients["slope"].value == pytest.approx(3.0, rel=0.03)
    assert "servo_log" not in {e.kind.kind for e in result.model.effects}


@pytest.mark.nightly
def test_poses_logged_before_they_happen_are_a_clock_not_an_effect(campaign):
    def late(flight, seconds):
        return dataclasses.replace(
            flight,
            elevator=np.interp(flight.time - seconds, flight.time, flight.elevator),
            command=np.interp(flight.time - seconds, flight.time, flight.command),
        )

    flights = tuple(late(flight, 0.02) for flight in campaign.flights)
    shifted = dataclasses.replace(campaign, flights=flights, command_rate=None)
    result = close_the_loop(shifted, effects=TIMING)
    assert "pose_latency" not in {e.kind for e in result.effects}
    assert result.verdict == "not_trusted"
    ahead = float(result.reason.partition("logged ")[2].partition(" ms")[0])
    assert "clock" in result.reason
    assert ahead == pytest.approx(20.0, abs=2.0)  # [ms]; commands come at rows.


@pytest.mark.parametrize("measured", [True, False])
def test_small_steps_of_commanded_angles_keep_their_size(campaign, measured):
    """Not 0.83 of it, as where each rate begins half a row early or at a tick."""
    time = np.arange(0.0, 4.0, 1.0 / 120.0)
    given = np.arange(0.0, 4.0, 0.02)
    asked = np.where((given > 1.0) & (given < 2.0), 0.05, 0.0)
    angles = Stream(given, asked[:, None], "servo")
    elevator = Stream(time, np.interp(time, given, asked)[:, None], "poses")
    track = Track(
        path=Path("log.csv"),
        time=time,
        position=np.zeros((len(time), 3)),
        rotation=None,
        pitch=np.zeros(len(time)),
        along_throw=False,
        clock="poses",
        servo=ServoLogs(elevator if measured else None, angle_command=angles),
    )
    servo = make_servo(track, campaign, "MAP.yaml")
    known = dataclasses.replace(campaign, command_rate=50.0, servo=servo.log)
    tape = command_steps(time, servo.command, known.switch_rate)
    path = elevator_path(*tape, time)
    assert path[time > 2.5] == pytest.approx(0.0, abs=1e-9)
    assert path[(time > 1.2) & (time < 1.8)] == pytest.approx(0.05, abs=1e-9)


@pytest.mark.parametrize("logs", ["commanded", "two clocks"])
def test_a_wrong_servo_log_is_no_effect(tmp_path, campaign, logs):
    """Half the travel of an elevator nobody measured, and a clock 20 ms off."""
    off = AHEAD - 0.02 if logs == "two clocks" else None
    files, path = write(tmp_path, campaign, logs, off)
    if logs == "commanded":
        path.write_text(
            path.read_text() + "units: {elevator_angle_command: {gain: 0.5}}\n"
        )
    result = close_the_loop(read_flights(files, path).campaign)
    assert result.verdict == "not_trusted"
    assert {e.kind for e in result.effects} == {"attached_lift"}
    words = (
        "turns 2.0. times as far" if logs == "commanded" else "check|is 'clock' right"
    )
    assert re.search(words, result.reason)


def test_a_clock_that_is_far_off_is_refused(tmp_path, campaign):
    files, path = write(tmp_path, campaign, "two clocks", AHEAD - 0.3)
    with pytest.raises(InputError, match="expected that, or 'find'"):
        read_flights(files, path)
