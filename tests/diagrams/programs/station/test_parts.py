"""Parts of the station alone: the wire's limits, the cameras' clock, release."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagrams.programs.station.bus import OPERATOR, Bus
from diagrams.programs.station.clocks import _WINDOW, AHEAD, CameraClock
from diagrams.programs.station.operators import ARM, KILL, Kills, Operator
from diagrams.programs.station.scenario import Release, Scenario, Sensors
from diagrams.programs.station.throw_log import _flight_of
from diagrams.programs.station.tracker import CommandTape, ReleaseDetector, mean_rates
from diagrams.programs.station.wire import Wire
from glider.compiled.actuators import elevator_path
from glider.physics.parameters import GliderParameters

SERVO = GliderParameters().servo

anything = st.floats(allow_nan=True, allow_infinity=True)
steps = st.lists(st.tuples(st.floats(0.0, 0.2), anything, st.booleans()), max_size=30)


@given(steps)
def test_whatever_is_commanded_the_elevator_stays_within_its_limits(commands):
    wire, now = Wire(SERVO, 0.0, 0.05), 10.0
    angle = wire.advance(now)
    for span, rate, is_command in commands:
        now += span
        if is_command:
            wire.command(rate, now)
        turned = wire.advance(now) - angle
        angle = wire.angle
        assert SERVO.low <= angle <= SERVO.high
        assert abs(wire.rate) <= SERVO.rate
        assert abs(turned) <= SERVO.rate * span + 1e-9
    # Silence: neutral after the timeout and the way there.
    wire.advance(now + 0.05)
    assert wire.advance(now + 0.05 + SERVO.high / SERVO.rate + 1e-6) == 0.0


@given(st.lists(st.floats(1e-3, 0.3), max_size=6))
def test_a_silent_wire_does_not_depend_on_when_it_is_asked(spans):
    once, often = Wire(SERVO, 0.1, 0.05), Wire(SERVO, 0.1, 0.05)
    for wire in (once, often):
        wire.advance(0.0)
        wire.command(9.0, 0.0)
    for until in np.cumsum(spans):
        often.advance(until)
    end = float(np.sum(spans))
    assert often.advance(end) == pytest.approx(once.advance(end), abs=1e-9)


def test_a_wire_stops_at_neutral_though_commands_are_lost():
    wire = Wire(SERVO, 0.0, 0.05)
    wire.advance(0.0)
    wire.command(10.0, 0.0)
    assert wire.advance(0.02) == pytest.approx(0.2)
    assert wire.to_neutral(0.02) == pytest.approx(-10.0)
    angles = [wire.advance(0.02 + 0.001 * k) for k in range(100)]
    assert min(angles) == angles[-1] == 0.0


def test_a_wire_obeys_one_sender_until_it_is_silent():
    wire = Wire(SERVO, 0.0, 0.05)
    assert wire.obey(1.0, 5.0, 0.0)
    assert not wire.obey(2.0, -5.0, 0.02)
    assert wire.rate == 5.0
    assert wire.obey(2.0, -5.0, 1.1) and wire.rate == -5.0


def test_an_arm_reaches_a_servo_that_missed_the_first():
    """For a second: longer, and it would end the kill of one that dies after it."""
    bus, now, servo = Bus("memq://"), [0.0], Kills()
    operator = Operator(bus, lambda: now[0])
    operator.say(KILL)
    servo.hear((operator.id,), (KILL,), 0.0)
    now[0] = 0.05
    operator.say(ARM)
    bus.handle()  # And the servo was deaf.
    heard = []
    bus.listen(OPERATOR, lambda when, values, names: heard.append(when))
    bus.listen(OPERATOR, lambda when, *said: servo.hear(said[0], said[1], when))
    for now[0] in np.arange(0.1, 3.0, 0.05):
        operator.repeat()
        bus.handle()
    assert not servo
    assert len(heard) in (4, 5)
    assert heard[-1] < 1.05


@pytest.mark.parametrize("lost", [range(0), range(7, 9), range(5, 7)])
def test_lost_commands_leave_no_elevator_deflected(lost):
    """Neutral is an angle: rates alone would keep what was lost for good."""
    station, servo = Wire(SERVO, 0.0, 0.05), Wire(SERVO, 0.0, 0.05)
    for k in range(40):
        now = 0.02 * k
        rate = station.command(5.0, now) if k < 6 else station.to_neutral(now)
        if k not in lost:
            assert servo.obey(1.0, rate, now, station.angle)
        if k == 6 and k not in lost:
            assert servo.angle == pytest.approx(station.angle, abs=0.01)
    assert station.advance(0.8) == pytest.approx(0.0, abs=1e-9)
    assert servo.advance(0.8) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("drift", [-200e-6, 0.0, 200e-6])
def test_the_cameras_clock_is_found_within_half_a_millisecond(drift):
    rng, clock, latency = np.random.default_rng(0), CameraClock(0.006), 0.006
    errors = []
    for k in range(1200):
        exposed = k / 120.0
        received = exposed + latency + rng.exponential(0.0005)
        stamp = exposed * (1.0 + drift) - 1234.5
        errors.append(clock.to_ours(stamp, received) - exposed)
        clock.learn(stamp, received)
    assert np.max(np.abs(errors[120:])) < 5e-4


def test_a_clock_that_starts_again_is_followed():
    clock = CameraClock(0.0)
    clock.learn(1000.0, 10.0)
    assert clock.to_ours(0.0, 11.0) == -990.0
    assert clock.to_ours(1.5, 10.0 + _WINDOW + 0.5) == 10.0 + _WINDOW + 0.5


def test_a_frame_stamped_ahead_does_not_move_the_clock():
    """Nor does one that came first of all, for longer than the window."""
    clock = CameraClock(0.006)
    clock.learn(100.5, 200.006)  # Half a second ahead.
    errors = []
    for k in range(600):
        exposed = 200.0 + k / 120.0
        received = exposed + 0.006
        stamp = exposed - 100.0 + (0.4 if k == 480 else 0.0)
        when = clock.to_ours(stamp, received)
        if clock.calc_lead(when, received) < AHEAD:
            clock.learn(stamp, received)
        errors.append(when - exposed)
    after = np.delete(errors, 480)[math.ceil(120 * _WINDOW) + 2 :]
    assert np.max(np.abs(after)) < 1e-9


def test_a_delay_in_flight_does_not_move_the_clock():
    clock = CameraClock(0.006)
    for k in range(240):
        delay = 0.006 + (0.03 if k > 120 else 0.0)
        when = clock.to_ours(k / 120.0, k / 120.0 + delay)
        clock.learn(k / 120.0, k / 120.0 + delay)
        assert when == pytest.approx(k / 120.0, abs=1e-9)


def test_the_tape_integrates_what_was_commanded():
    tape = CommandTape()
    tape.rest_at(0.9)
    for time, angle, rate in ((0.0, 0.9, 1.0), (0.02, 0.92, -2.0), (0.04, 0.88, 0.0)):
        tape.add(time, angle, rate)
    times = np.array([-0.1, 0.01, 0.03, 0.05, 0.06])
    rates = mean_rates(tape.rows, times, SERVO)
    assert rates == pytest.approx([0.01 / 0.11, -0.5, -1.0, 0.0])
    tape.add(0.06, 0.88, 13.0)  # It comes to its stop.
    turn = SERVO.high - 0.88
    [rate] = mean_rates(tape.rows, np.array([0.06, 0.16]), SERVO)
    assert rate == pytest.approx(10.0 * turn)


def test_the_tape_has_what_the_servo_did_in_a_silence():
    """It turned to neutral: the next command begins there."""
    tape = CommandTape()
    tape.rest_at(0.0)
    tape.add(0.0, 0.0, -5.0)
    tape.add(0.2, 0.0, 1.0)
    times = np.array([0.1, 0.2, 0.2, 0.3])
    rates = mean_rates(tape.rows, times, SERVO)
    assert rates[0] == pytest.approx(-10.0 * SERVO.low, rel=0.01)
    assert rates[1:] == pytest.approx([0.0, 1.0])


def thrown(push, seconds=0.5, rate=120.0, lost=(), speed=7.0):
    """Poses (k, 5) of a throw released at time 0, pushed by so many m/s²."""
    time = np.arange(-seconds, 0.3, 1.0 / rate)
    begin = -speed / push
    pushed = np.clip(time, begin, 0.0) - begin
    x = -3.5 + 0.5 * push * (pushed**2 - begin**2) + speed * np.clip(time, 0.0, None)
    x -= 2.0 * np.clip(time, 0.0, None) ** 2
    z = 0.1 - 0.5 * 3.0 * np.clip(time, 0.0, None) ** 2
    noise = np.random.default_rng(0).normal(size=(len(time), 2)) * 4e-4
    rows = np.column_stack([time, x, z, 0.0 * x, 0.0 * x])
    rows[:, 1:3] += noise
    return np.delete(rows, lost, axis=0)


@pytest.mark.parametrize("push", [20.0, 40.0, 70.0])
@pytest.mark.parametrize("lost", [(), (58, 61, 63)])
def test_release_is_seen_in_time(push, lost):
    detector = ReleaseDetector(Release(), np.array([-3.5, 0.1]))
    found = [r[0] for r in thrown(push, lost=lost) if detector.add(r[0], r[1:])]
    assert 0.0 <= found[0] < 0.042 + 0.003 * len(lost), found[0]


@pytest.mark.parametrize(
    ("push", "speed", "place"),
    [(40.0, 3.0, -3.5), (40.0, 7.0, -7.5)],
    ids=["too slow", "far from the launch"],
)
def test_what_is_no_release(push, speed, place):
    detector = ReleaseDetector(Release(), np.array([-3.5, 0.1]))
    rows = thrown(push, speed=speed)
    rows[:, 1] += place + 3.5
    assert not any(detector.add(r[0], r[1:]) for r in rows)
    assert math.isfinite(detector._motion()[0])


def test_an_elevator_that_is_not_measured_is_that_of_the_servo():
    """The last command goes on behind the stop."""
    acts = 0.02 * np.arange(1, 7)
    rates = np.full(6, 13.0)
    time = np.arange(0.0, 0.3, 1.0 / 120.0)
    angles = elevator_path(acts, rates, acts, SERVO)
    pose = {
        "free": True,
        "fault": "",
        "x": 0.0,
        "z": 0.0,
        "pitch": 0.0,
        "elevator": 0.0,
    }
    commands = zip(acts.tolist(), rates.tolist(), angles.tolist(), strict=True)
    topics = {
        "/pose": [pose | {"stamp": t, "time": t} for t in time.tolist()],
        "/command": [{"acts": t, "rate": u, "angle": a} for t, u, a in commands],
    }
    scenario = Scenario(sensors=Sensors(elevator=False))
    flight = _flight_of(Path("throw_001.mcap"), topics, scenario, SERVO)
    expected = elevator_path(acts, rates, time, SERVO)
    assert flight.elevator == pytest.approx(expected, abs=1e-9)
    assert np.max(flight.elevator) <= SERVO.high
