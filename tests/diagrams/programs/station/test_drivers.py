"""Drivers: poses of cameras to the bus, and a servo on a pseudo-terminal."""

import contextlib
import math
import os
import pty
import signal
import subprocess
import sys
import time
import tty

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from diagrams.programs.program import run
from diagrams.programs.station.bus import (
    COMMAND,
    COMMAND_FIELDS,
    OPERATOR,
    POSE,
    Bus,
    free_address,
)
from diagrams.programs.station.drivers import servo_board
from diagrams.programs.station.drivers.poses import PosePublisher, Room
from diagrams.programs.station.drivers.servo_board import ServoBoard
from diagrams.programs.station.wire import Wire
from glider.errors import InputError
from glider.physics.parameters import GliderParameters


@pytest.mark.parametrize("shows_elevator", [True, False])
def test_a_throw_comes_to_the_bus_as_it_was_flown(shows_elevator):
    """In axes with y up and the throw along -z; nose of the body along its x."""
    bus, seen = Bus("memq://"), []
    bus.listen(POSE, lambda stamp, values, names: seen.append((stamp, *values)))
    room = Room(up="y", forward="-z", nose="x", wire=[0.4, 1.2, 0.0])
    publisher = PosePublisher(bus, room)
    # Turns: the nose to the throw's direction, then nose down about its left.
    heading = Rotation.from_euler("y", 90, degrees=True)
    left = heading.apply([0.0, 0.0, -1.0])
    flown = []
    for k in range(40):
        x, z = -3.5 + 7.0 * k / 120.0, 0.1 - 0.01 * k
        pitch, elevator = -0.5 + 0.02 * k, 0.3 - 0.01 * k
        body = (Rotation.from_rotvec(pitch * left) * heading).as_quat()
        flap = (Rotation.from_rotvec((pitch + elevator) * left) * heading).as_quat()
        place = (0.4, z + 1.2, -x)
        time = 12.5 + k / 120.0
        publisher.send(k, time, place, body, flap if shows_elevator else None)
        bus.handle()
        flown.append((time, k, x, z, pitch, elevator if shows_elevator else math.nan))
    np.testing.assert_allclose(seen, flown, atol=1e-6)


@given(st.floats(-1.5, 1.5), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_the_mass_center_is_found_from_the_tracked_point(pitch, ahead, above):
    room = Room(up="z", forward="x", tracked_point=[ahead, above])
    # Nose down about +y turns x to -z.
    turn = Rotation.from_rotvec([0.0, pitch, 0.0])
    assert room.pitch_of(turn.as_quat()) == pytest.approx(pitch, abs=1e-9)
    point = turn.apply([ahead, 0.0, above]) + np.array([1.0, 0.5, 2.0])
    assert room.place_of(point, pitch) == pytest.approx((1.0, 2.0), abs=1e-9)


def angles_of(data):
    """Angles [rad] of packets to a servo with the default pulses."""
    packets = np.frombuffer(data[: len(data) // 4 * 4], np.uint8).reshape(-1, 4)
    assert np.all(packets[:, 0] == 0x84) and np.all(packets[:, 1] == 3)
    pulses = (packets[:, 2] + 128.0 * packets[:, 3]) / 4.0
    return (pulses - 1500.0) / 600.0


def test_a_board_gets_the_integral_of_the_rates():
    wire, sent = Wire(GliderParameters().servo, 0.0, 0.05), bytearray()
    board = ServoBoard(wire, sent.extend, channel=3)
    for k in range(100):
        now = 0.005 * k
        if k % 4 == 0:
            board.take(1.0, 2.0, math.nan, now)
        board.update(now)
    expected = np.minimum(2.0 * 0.005 * np.arange(100), 0.9473)
    assert angles_of(bytes(sent)) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(
    ("center", "gain"),
    [(1500.0, math.nan), (math.inf, 600.0), (1500.0, 6000.0), (0.0, 600.0), (900, 0)],
)
def test_pulses_that_no_servo_takes_are_refused(center, gain):
    with pytest.raises(InputError, match="expected 500 to 2500 µs"):
        ServoBoard(Wire(GliderParameters().servo, 0.0, 0.05), bytes, 0, center, gain)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"up": "w"}, "axis 'up' is 'w'; expected x, y, z"),
        ({"up": "z", "forward": "-z"}, "axis 'forward' is '-z'; expected one across z"),
        ({"wire": [0.0, 1.0]}, "place 'wire' is [0.0, 1.0]; expected 3 finite"),
        ({"tracked_point": [0.0, math.nan]}, "expected 2 finite numbers"),
    ],
)
def test_a_room_that_cannot_be_is_refused(fields, message):
    with pytest.raises(InputError) as error:
        Room(**fields)
    assert message in str(error.value)


@pytest.mark.parametrize("address", ["foo://x", "udpm://here:7667", "239.255.76.67"])
def test_an_address_that_lcm_would_ignore_is_refused(address):
    with pytest.raises(InputError, match=r"the bus is .*expected memq:// or such as"):
        Bus(address)


@contextlib.contextmanager
def driver(name, *arguments):
    """Runs a driver as a process."""
    module = f"diagrams.programs.station.drivers.{name}"
    command = [sys.executable, "-m", module, *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline()  # It is ready.
            yield process
        finally:
            process.terminate()


def test_a_serial_line_without_its_library_names_the_extra(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "serial", None)
    monkeypatch.setattr(sys, "argv", ["servo_board", "--serial", "/dev/ttyACM0"])
    assert run(servo_board.main) == 2
    assert "pip install 'drake-glider[lab]'" in capsys.readouterr().err


def pseudo_terminal():
    """Our end of a serial line, and the name of the other."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    return ours, os.ttyname(theirs)


def read_terminal(ours):
    with contextlib.suppress(BlockingIOError):
        return os.read(ours, 1 << 20)
    return b""


@pytest.mark.slow
@pytest.mark.parametrize(
    "way", ["SIGTERM", pytest.param("SIGINT", marks=pytest.mark.nightly), "kill"]
)
def test_the_servo_is_neutral_when_its_driver_is_ended_or_killed_by_an_operator(way):
    address, (ours, name) = free_address(), pseudo_terminal()
    bus = Bus(address)
    said = []
    bus.listen(OPERATOR, lambda stamp, values, names: said.append(names[0]))

    def command(seconds):
        begin = time.monotonic()
        while (now := time.monotonic()) < begin + seconds:
            bus.say(COMMAND, now, (1.0, 1.0, 0.0, 0.6), COMMAND_FIELDS)
            bus.handle(0.01)

    with driver("servo_board", "--serial", name, "--bus", address, "--channel=3") as it:
        last, patience = 0.0, time.monotonic() + 30.0
        while abs(last - 0.6) > 0.02:  # A busy machine lets commands come too late.
            assert time.monotonic() < patience, last
            command(0.5)
            last = angles_of(read_terminal(ours))[-1]
        if way == "kill":
            bus.say(OPERATOR, 0.0, (2.0,), ("kill",))
            command(0.5)  # Nobody is obeyed.
            assert "killed" in said
        else:
            it.send_signal(getattr(signal, way))
            it.wait(2.0)
            assert it.returncode == 0
        assert angles_of(read_terminal(ours))[-1] == 0.0


@pytest.mark.nightly
def test_a_serial_line_that_takes_nothing_for_a_while_ends_no_driver():
    address, (ours, name) = free_address(), pseudo_terminal()
    bus = Bus(address)
    full = os.open(name, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(full, bytes(1000))
    with driver("servo_board", "--serial", name, "--bus", address, "--channel=3") as it:
        time.sleep(0.5)
        assert it.poll() is None
        while read_terminal(ours):
            pass
        data = read_while(lambda: read_terminal(ours), bus, 0.3, 2.0)
        angles = angles_of(data[len(data) % 4 :])
    assert np.max(angles) > 0.4 and angles[-1] == 0.0
    os.close(full)


def read_while(read, bus, seconds, rate):
    """What a servo gets while a station commands, and half a second after it dies."""
    data, begin = bytearray(), time.monotonic()
    while (now := time.monotonic()) < begin + seconds + 0.5:
        if now < begin + seconds:
            angle = rate * (now - begin)
            bus.say(COMMAND, now, (1.0, 1.0, rate, angle), COMMAND_FIELDS)
        time.sleep(0.01)
        data += read()
    return bytes(data)


@pytest.mark.nightly  # In real time: on a busy machine commands come too late.
def test_the_servo_driver_is_a_process():
    address, (ours, name) = free_address(), pseudo_terminal()
    bus = Bus(address)
    with driver("servo_board", "--serial", name, "--bus", address, "--channel=3"):
        data = read_while(lambda: read_terminal(ours), bus, 0.3, 2.0)
    angles = angles_of(data)
    assert np.max(angles) == pytest.approx(0.64, abs=0.12)  # 0.3 s, and the timeout.
    assert angles[-1] == pytest.approx(0.0, abs=1e-3)
    turned = np.abs(np.diff(angles))
    assert np.max(turned) < 13.0 * 0.03, "it turns back at its rate, and does not jump"
    assert math.isfinite(angles.sum())
