"""A campaign keeps where its servo columns come from, and how well they are timed."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from glider.campaign.checks.servo import calc_correlation, measure_elevators
from glider.campaign.importing.campaign_import import import_campaign, read_flights
from glider.campaign.importing.servo_logs import align_commands, make_servo
from glider.campaign.importing.track import ServoLogs, Stream, Track
from glider.campaign.logs import ServoLog
from glider.campaign.motion_capture import MotionCapture
from glider.campaign.reader import load_campaign
from glider.campaign.writer import save_campaign
from glider.compiled.actuators import elevator_path
from glider.errors import InputError
from glider.physics.held_commands import command_steps
from glider.sysid.pipeline import close_the_loop
from glider.sysid.replay.log_space import SERVO_LOG
from glider.sysid.replay.record import measure_noise, prepare
from glider.sysid.replay.vehicle import make_vehicle
from tests.campaign.importing import foreign
from tests.helpers.known_truth import task_of
from tests.helpers.tasks import fly, typical

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
    return foreign.write_table(path, ",".join(columns), *columns.values())


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
    fitted = {"elevator_scale"}  # As an unknown of the log.
    for log, missing in (
        (ServoLog(), set()),
        (ServoLog(command="reconstructed"), {"servo_lag", "command_delay"}),
        (ServoLog(angle="reconstructed", command="converted"), fitted),
    ):
        vehicle = make_vehicle(dataclasses.replace(campaign, servo=log))
        assert {*make_vehicle(campaign).kinds} - {*vehicle.kinds} == missing
        assert all(kind in "".join(vehicle.notes) for kind in missing - fitted)


def test_an_offset_that_was_found_has_a_standard_error(tmp_path, campaign):
    files, path = write(tmp_path, campaign, "two clocks")
    log = read_flights(files, path).campaign.servo
    assert 0.002 < log.clock_std < 0.01
    [note] = {n for r in read_flights(files, path).recordings for n in r.notes}
    found = float(note.partition(" is ")[2].partition(" ")[0])
    assert abs(found - AHEAD) < 3.0 * log.clock_std


def test_an_offset_is_found_whichever_way_the_flights_go(tmp_path):
    """Motive's x points backward there; the angle of attack is along the throw."""
    capture = MotionCapture(rate=200.0, position=1e-3, pitch=5e-3)
    flown = fly(typical("wind"), flights=4, seed=7, capture=capture)
    files, path = foreign.write_motive(tmp_path, flown), tmp_path / "MAP.yaml"
    path.write_text(foreign.MAP_MOTIVE + foreign.VEHICLE)
    imported = read_flights(files, path)
    [note] = {n for r in imported.recordings for n in r.notes if n[:5] == "clock"}
    found = float(note.partition(" is ")[2].partition(" ")[0])
    assert abs(found - foreign.AHEAD) < 3.0 * imported.campaign.servo.clock_std


@pytest.mark.nightly
def test_a_clock_that_turns_the_elevator_round_is_refused(tmp_path, campaign):
    files, path = write(tmp_path, campaign, "two clocks", 0.25)
    with pytest.raises(InputError, match="'clock: find'"):
        read_flights(files, path)


@pytest.mark.parametrize("off", [-0.03, 0.03])
def test_a_clock_that_is_off_is_warned_of(tmp_path, campaign, off):
    files, path = write(tmp_path, campaign, "two clocks", AHEAD + off)
    imported = read_flights(files, path)
    assert f"'clock' is {AHEAD + off:g}" in imported.campaign.notes[0]
    assert imported.campaign.servo.clock_std == pytest.approx(0.03, abs=0.01)


@pytest.mark.parametrize(
    ("off", "least", "most"), [(0.0, 0.0029, 0.005), (-0.01, 0.0045, 0.01)]
)
def test_a_given_clock_is_known_as_well_as_it_was_read(
    tmp_path, campaign, off, least, most
):
    """To its digits and a step of the logs: not to 3 ms where it is 10 ms wrong."""
    files, path = write(tmp_path, campaign, "two clocks", round(AHEAD + off, 3))
    imported = read_flights(files, path)
    assert imported.campaign.notes == ()
    assert least < imported.campaign.servo.clock_std < most


def test_a_clock_of_one_digit_is_known_to_50_ms(tmp_path, campaign):
    files, path = write(tmp_path, campaign, "two clocks", 0.3)
    imported = read_flights(files, path)
    assert imported.campaign.servo.clock_std == pytest.approx(0.05, abs=0.01)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("logs", "clock"), [*((logs, None) for logs in MAPS), ("two clocks", 0.33)]
)
def test_no_delay_is_named_that_the_import_made(tmp_path, campaign, logs, clock):
    files, path = write(tmp_path, campaign, logs, clock)
    result = close_the_loop(read_flights(files, path).campaign, effects=TIMING)
    named = [e.kind for e in result.effects if e.kind != "unexplained"]
    assert named == ["attached_lift"]
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


TIME = np.arange(0.0, 1.0, 1.0 / 120.0)


def logged(campaign, time=TIME, **servo):
    """The servo's columns of a flight with logs on another clock; poses do not move."""
    streams = {
        name: None if log is None else Stream(log[0], np.array(log[1])[:, None], "s")
        for name, log in servo.items()
    }
    track = Track(
        path=Path("log.csv"),
        time=time,
        position=np.zeros((len(time), 3)),
        rotation=foreign.planar_rotation(np.zeros(len(time))),
        spatial=False,
        clock="poses",
        servo=ServoLogs(**streams),
    )
    return make_servo(track, campaign, "MAP.yaml")


def moved(servo):
    """Path (n,) of an elevator that follows its commands [rad]."""
    rate = campaign_rate(servo)
    return elevator_path(*command_steps(TIME, servo.command, rate), TIME)


def campaign_rate(servo):
    return np.inf if servo.log.command == "converted" else 50.0


@pytest.mark.parametrize("late", [-3e-7, 0.0, 3e-7])
def test_rows_of_two_files_that_differ_by_rounding_are_the_same(campaign, late):
    rates = np.sign(np.sin(40.0 * TIME))
    table = TIME + late
    servo = logged(
        campaign, elevator=(table, np.zeros(len(TIME))), rate_command=(table, rates)
    )
    assert servo.log == ServoLog()
    assert servo.command == pytest.approx(rates)


@pytest.mark.parametrize("measured", [True, False])
def test_small_steps_of_commanded_angles_keep_their_size(campaign, measured):
    """Not 0.83 of it, as where each rate begins half a row early or at a tick."""
    given = np.arange(0.0, 1.01, 0.02)
    asked = np.where((given > 0.25) & (given < 0.5), 0.05, 0.0)
    angles, elevator = (given, asked), (given, asked) if measured else None
    servo = logged(campaign, elevator=elevator, angle_command=angles)
    path = moved(servo)
    assert path[TIME > 0.6] == pytest.approx(0.0, abs=1e-9)
    middle = (TIME > 0.3) & (TIME < 0.47)
    assert path[middle] == pytest.approx(0.05, abs=1e-9)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("rate", [50.0, 60.0, 73.0, 100.0, 200.0])
def test_commands_of_another_log_move_as_far(campaign, rate, known):
    """Held from row to row, commands would add up to another angle, 40 mrad off.

    So they would on a clock of 49 Hz for 50, where its rate is not given.
    """
    if not known:
        campaign = dataclasses.replace(campaign, command_rate=None)
    rng = np.random.default_rng(int(rate))
    ticks = np.arange(-0.193, 1.0, 0.02)
    rates = np.where(ticks < 0.0, 0.0, rng.normal(0.0, 4.0, len(ticks)))
    rows = np.arange(-0.2 + rng.uniform(0.0, 1.0 / rate), 1.1, 1.0 / rate)
    held = rates[np.maximum(np.searchsorted(ticks, rows, "right") - 1, 0)]
    angle = elevator_path(ticks, rates, rows)
    servo = logged(campaign, elevator=(rows, angle), rate_command=(rows, held))
    assert servo.log.command_std == pytest.approx(1.0 / rate / np.sqrt(12.0), rel=0.01)
    path = moved(servo)
    late = np.arange(-0.5 / rate - 1e-3, 0.5 / rate + 2e-3, 1e-3)
    off = [np.std(path - elevator_path(ticks, rates, TIME - d)) for d in late]
    assert min(off) < 5e-3


def test_a_measured_elevator_of_a_slower_log_keeps_its_travel(campaign):
    """Chords between samples at 50 Hz would lose 3 % of it."""
    rows = np.arange(-0.2, 1.2, 0.02)
    angle = 0.3 * np.sin(2.0 * np.pi * 5.0 * rows)
    servo = logged(campaign, elevator=(rows, angle))
    expected = 0.3 * np.sin(2.0 * np.pi * 5.0 * TIME)
    travel = servo.elevator @ expected / (expected @ expected)
    assert travel == pytest.approx(1.0, abs=5e-3)


@pytest.mark.parametrize(("delay", "lag"), [(0.0, 0.0), (0.025, 0.0), (0.01, 0.02)])
@pytest.mark.parametrize("late", [0.0, 0.007])
def test_an_elevator_turns_its_corners_between_rows(campaign, delay, lag, late):
    """At 50 Hz, in step with its commands or not: rounded ones are 10 mrad off."""
    rng = np.random.default_rng(4)
    ticks = np.arange(-0.2, 1.2, 0.02)
    tape = ticks, rng.normal(0.0, 4.0, len(ticks))
    rows = ticks + late
    angle = elevator_path(*tape, rows, delay=delay, time_constant=lag)
    servo = logged(
        dataclasses.replace(campaign, elevator_limits=None),
        elevator=(rows, angle),
        rate_command=(rows, tape[1]),
    )
    expected = elevator_path(*tape, TIME, delay=delay, time_constant=lag)
    assert np.std(servo.elevator - expected) < 3e-3


def test_angles_that_are_logged_at_changes_only_are_held_between(campaign):
    """Not approached slowly, and held after the last one."""
    rows, asked = np.array([-0.3, 0.1, 0.3, 0.5, 0.7]), [0.0, 0.2, 0.0, 0.2, 0.1]
    servo = logged(campaign, angle_command=(rows, asked))
    angle = servo.elevator
    assert angle[(TIME > 0.13) & (TIME < 0.24)] == pytest.approx(0.2, abs=1e-6)
    assert angle[(TIME > 0.33) & (TIME < 0.44)] == pytest.approx(0.0, abs=1e-6)
    assert angle[TIME > 0.75] == pytest.approx(0.1, abs=1e-6)


def test_angles_beyond_a_stop_are_those_of_the_stop(campaign):
    """The servo stands there; on its way back it counts from there."""
    rows = np.array([-0.3, 0.1, 0.5, 1.2])
    servo = logged(campaign, angle_command=(rows, [0.0, 1.2, 0.5, 0.5]))
    high = campaign.elevator_limits[1]
    assert servo.elevator[(TIME > 0.3) & (TIME < 0.4)] == pytest.approx(high)
    assert servo.elevator[TIME > 0.7] == pytest.approx(0.5, abs=1e-6)
    assert moved(servo)[TIME > 0.7] == pytest.approx(0.5, abs=0.01)


def test_a_command_long_before_a_flight_is_held_in_it(campaign):
    """Of a log of changes, none of which is near the flight."""
    rows = np.array([-3.0, -2.9, 3.0])
    rates, angle = np.array([2.0, 0.0, 0.0]), np.array([0.0, 0.2, 0.2])
    for late in (0.0, 1e-4):
        log = (rows + late, angle)
        servo = logged(campaign, elevator=log, rate_command=(rows, rates))
        assert servo.elevator == pytest.approx(0.2, abs=1e-6)
        assert servo.command == pytest.approx(0.0, abs=1e-6)


def test_commands_that_are_logged_too_seldom_are_refused(campaign):
    rows = np.arange(-0.2, 1.2, 0.05)
    rates, angle = np.sin(9.0 * rows), np.cos(9.0 * rows)
    with pytest.raises(InputError, match="logged at 20 Hz, and field 'command_rate'"):
        logged(campaign, elevator=(rows, angle), rate_command=(rows, rates))
    assert logged(campaign, elevator=(rows, angle)).log.command == "reconstructed"


@pytest.mark.parametrize("rate", [30.0, 40.0])
def test_commands_in_the_rows_of_slow_poses_are_refused_too(campaign, rate):
    rows = np.arange(0.0, 1.0, 1.0 / rate)
    servo = {"elevator": (rows, 0.0 * rows), "rate_command": (rows, np.sin(9.0 * rows))}
    with pytest.raises(InputError, match=f"logged at {rate:g} Hz, and field"):
        logged(campaign, rows, **servo)
    slow = dataclasses.replace(campaign, command_rate=rate)
    assert logged(slow, rows, **servo).log.command == "logged"


def test_commands_are_aligned_in_all_flights(campaign):
    """Each file is up to a step of its log off: not each its own delay."""
    rng, flights = np.random.default_rng(0), []
    late = rng.uniform(-0.005, 0.005, len(campaign.flights))
    for flight, seconds in zip(campaign.flights, late, strict=True):
        tape = command_steps(flight.time, flight.command, campaign.command_rate)
        path = elevator_path(*tape, flight.time - seconds)
        rate = np.append(np.diff(path) / np.diff(flight.time), 0.0)
        flights.append(dataclasses.replace(flight, command=rate))
    log = ServoLog(command="converted", command_std=0.003)
    known = dataclasses.replace(campaign, flights=tuple(flights), servo=log)
    assert scatter_of_delays(known) > 0.006
    assert scatter_of_delays(align_commands(known)) < 0.003


def scatter_of_delays(campaign):
    tried = np.arange(-0.02, 0.03, 0.0005)
    elevators = measure_elevators(campaign, {})
    delays = [calc_correlation([elevator], tried)[1] for elevator in elevators]
    return np.ptp(delays)


def test_clocks_differ_as_far_as_they_are_uncertain(campaign):
    """Beyond, a delay is an effect, which no clock may explain away."""
    log = ServoLog(clock_std=0.002, command_std=0.003)
    uncertain = dataclasses.replace(campaign, servo=log)
    task, _ = task_of(uncertain)
    poses, commands, *_ = task.space.slots_of(SERVO_LOG.kind)
    lower, upper = task.bounds([poses, commands, 0])
    assert upper[:2] == pytest.approx([0.00392, 0.00588], rel=1e-3)  # In 95 %.
    assert lower[:2] == pytest.approx([-0.00392, -0.00588], rel=1e-3)
    assert upper[2] == task.space.upper[0]


@pytest.mark.nightly
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
    # What else is listed imitates the clock, and is not trusted.
    assert "attached_lift" in {e.kind for e in result.effects}
    words = (
        "turns 2.0. times as far" if logs == "commanded" else "check|is 'clock' right"
    )
    assert re.search(words, result.reason)


@pytest.mark.nightly
def test_a_factor_of_elevator_and_commands_is_stated(campaign):
    """They agree: no check of the log shows it, and other effects would imitate it."""
    flights = tuple(
        dataclasses.replace(f, elevator=0.6 * f.elevator, command=0.6 * f.command)
        for f in campaign.flights
    )
    scaled = dataclasses.replace(campaign, flights=flights, elevator_limits=None)
    tried = "attached_lift", "mass", "induced_drag", "elevator_area", "elevator_scale"
    result = close_the_loop(scaled, effects=tried)
    assert result.verdict == "not_trusted"
    assert {e.kind for e in result.effects} == {"attached_lift", "elevator_scale"}
    assert re.search("turns 1.6[5-8] times as far as its log says", result.reason)


def test_a_clock_that_is_far_off_is_refused(tmp_path, campaign):
    three = dataclasses.replace(campaign, flights=campaign.flights[:3])
    files, path = write(tmp_path, three, "two clocks", AHEAD - 0.3)
    with pytest.raises(InputError, match="expected that, or 'find'"):
        read_flights(files, path)
