"""When the held commands of a log began."""

import numpy as np
import pytest

from glider.physics.held_commands import command_steps


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


def test_commands_that_change_in_every_row_begin_there():
    time = np.arange(0.0, 0.5, 0.01)
    column = np.sin(20.0 * time)
    switches, _ = command_steps(time, column, None)
    np.testing.assert_allclose(switches, time, atol=1e-9)
