"""The elevator's replayed path solves the servo's equation, as logs show it."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glider.physics.actuator_replay import command_steps, elevator_path, hides_command

SWITCHES = np.array([0.0, 0.02, 0.05, 0.11, 0.2])
COMMANDS = np.array([5.0, -8.0, 3.0, 13.0, 0.0])


def integrate(switches, commands, times, delay, tau, start=0.0):
    """Runge-Kutta on τ ṙ = u(t - T) - r, φ̇ = r, with steps that end at switches."""
    grid = np.union1d(
        np.concatenate([times, switches + delay]), np.linspace(0, 0.4, 4001)
    )
    angle, rate, path = start, 0.0, {}
    for a, b in itertools.pairwise(grid):
        path[a] = angle
        middle = 0.5 * (a + b)
        given_ = np.flatnonzero(switches + delay <= middle)
        u = commands[given_[-1]] if len(given_) else 0.0

        def f(y, u=u):
            return np.array([y[1], (u - y[1]) / tau])

        y, h = np.array([angle, rate]), b - a
        k1 = f(y)
        k2 = f(y + 0.5 * h * k1)
        k3 = f(y + 0.5 * h * k2)
        k4 = f(y + h * k3)
        angle, rate = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    path[grid[-1]] = angle
    return np.array([path[t] for t in times])


@pytest.mark.parametrize("delay", [0.0, 0.013])
@pytest.mark.parametrize("tau", [0.01, 0.05])
def test_the_path_solves_the_servos_equation(delay, tau):
    times = np.linspace(0, 0.35, 36)
    exact = elevator_path(SWITCHES, COMMANDS, times, delay, tau, start=0.1)
    numeric = integrate(SWITCHES, COMMANDS, times, delay, tau, start=0.1)
    np.testing.assert_allclose(exact, numeric, atol=1e-9)


def test_without_a_lag_the_path_is_the_integral_of_the_commands():
    times = np.array([0.0, 0.02, 0.035, 0.05, 0.11, 0.2, 0.3])
    expected = [0, 0.1, -0.02, -0.14, 0.04, 1.21, 1.21]
    actual = elevator_path(SWITCHES, COMMANDS, times)
    np.testing.assert_allclose(actual, expected, atol=1e-7)


def test_a_delay_shifts_the_path_and_before_it_nothing_moves():
    times = np.linspace(0.0, 0.3, 31)
    late = elevator_path(SWITCHES, COMMANDS, times + 0.03, delay=0.03, start=0.2)
    np.testing.assert_allclose(
        late, elevator_path(SWITCHES, COMMANDS, times, start=0.2), atol=1e-12
    )
    early = elevator_path(SWITCHES, COMMANDS, np.array([-1.0, 0.029]), 0.03, 0.02, 0.2)
    np.testing.assert_array_equal(early, 0.2)


def test_the_elevator_stops_at_its_travel_and_leaves_it_at_once():
    switches, commands = np.array([0.0, 0.2, 0.3]), np.array([10.0, -10.0, 0.0])
    times = np.array([0.05, 0.1, 0.15, 0.2, 0.25, 0.4])
    path = elevator_path(switches, commands, times, limits=(-0.4, 0.9))
    np.testing.assert_allclose(path, [0.5, 0.9, 0.9, 0.9, 0.4, -0.1], atol=1e-7)


@given(
    st.lists(st.floats(-13, 13), min_size=1, max_size=12),
    st.floats(0, 0.05),
    st.floats(0, 0.1),
)
def test_it_stays_in_its_travel_and_is_no_faster_than_its_commands(u, delay, tau):
    switches = 0.02 * np.arange(len(u))
    times = np.linspace(0, 0.5, 501)
    path = elevator_path(switches, np.array(u), times, delay, tau, 0.1, (-0.45, 0.95))
    assert path.min() >= -0.45
    assert path.max() <= 0.95
    fastest = np.max(np.abs(u))
    assert np.max(np.abs(np.diff(path))) <= fastest * 0.001 + 1e-7
    np.testing.assert_allclose(
        elevator_path(
            switches, np.array(u), times[::-1], delay, tau, 0.1, (-0.45, 0.95)
        ),
        path[::-1],
    )


# ------------------------------------------------------------------- the log


def logged(time, switches, commands):
    """Returns the column of a log: the command in force at each row."""
    return commands[np.searchsorted(switches, time + 1e-12, side="right") - 1]


@pytest.mark.parametrize("phase", [0.0, 0.003, 0.0131])
@pytest.mark.parametrize("start", [0.0, 17.3])
@pytest.mark.parametrize("rate", [50.0, 40.0])
@pytest.mark.parametrize("regular", [True, False], ids=["regular", "irregular"])
def test_the_clock_of_the_commands_is_found(phase, start, rate, regular):
    rng = np.random.default_rng(2)
    time = np.arange(0, 1.0, 1 / 120)
    if not regular:
        time = time + rng.uniform(-0.003, 0.003, len(time))
        time = np.sort(np.delete(time, rng.integers(0, len(time), 8)))
        time = time - time[0]
    clock = np.concatenate([[-1.0], np.arange(phase, 1.0, 1 / rate)])
    commands = rng.uniform(-10, 10, len(clock))
    column = logged(time, clock, commands)
    switches, steps = command_steps(start + time, column, rate)
    assert switches[0] == start + time[0]
    assert steps[0] == column[0]
    shown = np.isin(commands, steps[1:])
    np.testing.assert_array_equal(commands[shown], steps[1:])
    # A clock that started with the log is met; another to a fifth of a row, and
    # to a row where each of its ticks falls into the same third of 120 Hz.
    tolerance = 1e-9 if phase == 0.0 else 0.2 / 120 if rate == 50.0 else 1.3 / 120
    np.testing.assert_allclose(switches[1:], start + clock[shown], atol=tolerance)


@pytest.mark.parametrize("rate", [100.0, 120.0, 200.0, 250.0])
def test_a_log_that_begins_at_any_row_has_the_same_commands(rate):
    """A tick at a row is not that of the row after it, where the log begins there."""
    time, begins = np.arange(0.0, 0.9, 1.0 / rate), np.arange(0.0, 0.9, 0.02)
    commands = np.random.default_rng(0).normal(size=len(begins))
    column = logged(time, begins, commands)
    for first in range(25):
        switches, _ = command_steps(time[first:] - time[first], column[first:], 50.0)
        true = begins[begins > time[first] + 1e-9]
        np.testing.assert_allclose(switches[1:] + time[first], true, atol=1e-9)


def test_a_gap_hides_a_command_where_two_ticks_are_in_it():
    time = np.delete(np.arange(60) / 120.0, [8, 9, 21, 22, 40])
    begins = np.arange(0.0, 0.6, 0.02)
    command = logged(time, begins, np.random.default_rng(0).normal(size=len(begins)))
    hidden = hides_command(time, command, 50.0)
    # That of 60 to 80 ms; at 175 and 183 ms two commands are shown by other rows too.
    assert [*np.flatnonzero(hidden)] == [7]
    assert not hides_command(time, command, np.inf).any()
    assert not hides_command(time, 0.0 * command, 50.0).any()


def test_without_a_clock_a_command_begins_half_a_row_before_it_shows():
    time = np.array([0.0, 0.1, 0.2, 0.3])
    switches, commands = command_steps(time, np.array([1.0, 1.0, 2.0, 3.0]), None)
    np.testing.assert_allclose(switches, [0.0, 0.15, 0.25])
    np.testing.assert_array_equal(commands, [1.0, 2.0, 3.0])


def test_a_log_with_the_commands_own_times_needs_no_clock():
    time, since = np.array([0.0, 0.1, 0.2, 0.3]), np.array([-1.0, -1.0, 0.17, 0.21])
    column = np.array([1.0, 1.0, 2.0, 3.0])
    switches, _ = command_steps(time, column, 10.0, since)
    np.testing.assert_allclose(switches, [0.0, 0.17, 0.21])
    # One that began before the row that does not show it yet did not.
    switches, _ = command_steps(time, column, 10.0, np.array([0.0, 0.0, 0.05, 0.21]))
    np.testing.assert_allclose(switches, [0.0, 0.1, 0.21])


def test_a_command_that_never_changes_is_one_step():
    switches, commands = command_steps(np.arange(5.0), np.full(5, 2.0), 50.0)
    np.testing.assert_array_equal(switches, [0.0])
    np.testing.assert_array_equal(commands, [2.0])


def test_a_servo_that_slows_down_between_the_ticks_hides_no_clock():
    """A fifth of the changes are of no tick: those begin half a row before."""
    rng = np.random.default_rng(3)
    time = np.arange(0, 1.0, 1 / 120)
    clock = np.arange(0.0, 1.0, 0.02)
    slowed = np.array([0.1171, 0.2503, 0.3839, 0.4337, 0.5171, 0.6003, 0.7003, 0.8337])
    begins = np.sort(np.concatenate([clock, slowed]))
    commands = rng.uniform(-10, 10, len(begins))
    switches, steps = command_steps(time, logged(time, begins, commands), 50.0)
    shown = begins[np.isin(commands, steps)]
    apart = np.abs(switches - shown)
    of_clock = np.isin(shown, clock)
    assert np.mean(apart[of_clock] < 1e-9) > 0.9
    assert np.all(apart[~of_clock] < 1 / 120)


def test_a_servo_that_slows_down_before_its_stop_is_replayed_without_bias():
    """No matter when it does: its rate is sampled by the rows, not set by the clock.

    The ticks that fall on its changes would move the elevator by milliradians at the
    stop, which a search for effects takes for a lag.
    """
    time, tau = np.arange(0, 1.0, 1 / 120), 0.005
    errors = []
    for stop in 0.54 + np.arange(0.0, 0.02, 0.001):
        ticks = np.arange(0.0, 1.0, 0.02)
        held = 2.0 + 0.1 * np.sin(40.0 * ticks)
        rate = held[np.searchsorted(ticks, time + 1e-9, side="right") - 1]
        until = held[np.searchsorted(ticks, stop + 1e-9, side="right") - 1]
        slowing = until * np.exp(-(time - stop) / tau)
        column = np.where(time > stop, np.round(slowing, 2), rate)
        grid = np.append(ticks[ticks < stop], stop)
        true = np.sum(held[: len(grid) - 1] * np.diff(grid)) + until * tau
        switches, steps = command_steps(time, column, 50.0)
        np.testing.assert_array_equal(switches[1:20], ticks[1:20])
        errors.append(elevator_path(switches, steps, time[-1:])[0] - true)
    assert abs(np.mean(errors)) < 5e-4


def test_commands_that_change_in_every_row_begin_there():
    time = np.arange(0.0, 0.5, 0.01)
    column = np.sin(20.0 * time)
    switches, _ = command_steps(time, column, None)
    np.testing.assert_allclose(switches, time, atol=1e-9)
