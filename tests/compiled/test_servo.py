"""The servo's law: its two forms agree, and the elevator never leaves its travel."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider.compiled.actuators import LOOPS, elevator_path
from glider.physics.compose import compose
from glider.physics.effects import COMMAND_DELAY, SERVO_LAG
from glider.physics.servo import (
    STOPPING_TIME,
    Servo,
    held_angle,
    limited_rate,
    rate_bounds,
)

SERVO = Servo(low=-0.4463, high=0.9473, rate=13.0)
SWITCHES = np.array([0.0, 0.02, 0.05, 0.11, 0.2])
COMMANDS = np.array([5.0, -8.0, 3.0, 13.0, 0.0])
ANY_COMMAND = st.floats(-100.0, 100.0)
ANY_ANGLE = st.floats(-3.0, 3.0)


def integrate(switches, commands, query, servo, lag, start):
    """The state-space form, as the plant has it: by Runge-Kutta steps of 20 µs."""
    fine = np.arange(switches[0], query[-1] + 2e-5, 2e-5)
    times = np.unique(np.concatenate([fine, switches, query]))
    held = commands[np.searchsorted(switches, times[:-1], side="right") - 1]
    kinds = (SERVO_LAG,) if lag else ()
    states = np.zeros((len(times), 1 + len(kinds)))
    states[0, 0] = start
    loops = LOOPS.over(kinds)
    loops.actuator_path(times, held, np.array([lag] * len(kinds)), servo, states)
    return np.interp(query, times, states[:, 0])


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=30),
    st.floats(0.004, 0.05),
    st.floats(0.0, 0.06),
    st.sampled_from([0.0, 0.002, STOPPING_TIME, 0.03, 0.2]),
    st.floats(-0.9, -0.05),
    st.floats(0.05, 1.2),
    st.floats(2.0, 15.0),
)
def test_both_forms_agree_to_a_microsecond(commands, hold, delay, lag, low, high, rate):
    servo, commands = Servo(low, high, rate), np.array(commands)
    switches = hold * np.arange(len(commands))
    query = np.linspace(0.0, switches[-1] + 0.1, 200)
    exact = elevator_path(
        switches, commands, query + delay, servo, delay=delay, time_constant=lag
    )
    numeric = integrate(switches, commands, query, servo, lag, 0.0)
    np.testing.assert_allclose(exact, numeric, atol=1e-6 * rate, rtol=0.0)


@pytest.mark.parametrize("kinds", [(), (SERVO_LAG,), (COMMAND_DELAY, SERVO_LAG)])
def test_the_demanded_angle_turns_at_the_servos_rate(kinds):
    """Whatever the states of the actuators are."""
    chain = compose(kinds)
    c = np.array([0.03, 0.02][: len(kinds)])
    size = 7 + sum(len(kind.states) for kind in kinds)
    for state in np.random.default_rng(0).normal(size=(20, size)):
        rates = np.zeros(size)
        rates[3] = chain.actuator_terms(2.5, state, c)
        rates[7:] = chain.actuator_rates(2.5, state, c)
        # It is linear in the states.
        assert chain.demanded_angle(rates, c) == pytest.approx(2.5, abs=1e-9)


@given(
    st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=12),
    st.floats(0.0, 0.05),
    st.floats(0.0, 0.1),
)
def test_the_elevator_stays_in_its_travel_and_keeps_its_rate(u, delay, lag):
    tape = 0.02 * np.arange(len(u)), np.array(u)
    times = np.linspace(0.0, 0.5, 501)
    how = {"delay": delay, "time_constant": lag, "start": 0.1}
    path = elevator_path(*tape, times, SERVO, **how)
    assert path.min() >= SERVO.low - 1e-12
    assert path.max() <= SERVO.high + 1e-12
    fastest = min(np.max(np.abs(u)), SERVO.rate)
    assert np.max(np.abs(np.diff(path))) <= fastest * 0.001 + 1e-12
    backwards = elevator_path(*tape, times[::-1], SERVO, **how)
    np.testing.assert_array_equal(backwards[::-1], path)


def test_without_lag_and_limits_the_path_is_the_integral_of_the_commands():
    times = np.array([0.0, 0.02, 0.035, 0.05, 0.11, 0.2, 0.3])
    expected = [0, 0.1, -0.02, -0.14, 0.04, 1.21, 1.21]
    actual = elevator_path(SWITCHES, COMMANDS, times)
    np.testing.assert_allclose(actual, expected, atol=1e-12)


def test_a_delay_shifts_the_path_and_before_it_nothing_moves():
    times = np.linspace(0.0, 0.3, 31)
    late = elevator_path(SWITCHES, COMMANDS, times + 0.03, delay=0.03, start=0.2)
    on_time = elevator_path(SWITCHES, COMMANDS, times, start=0.2)
    np.testing.assert_allclose(late, on_time, atol=1e-12)
    before = np.array([-1.0, 0.029])
    how = {"delay": 0.03, "time_constant": 0.02, "start": 0.2}
    early = elevator_path(SWITCHES, COMMANDS, before, **how)
    np.testing.assert_array_equal(early, 0.2)


def test_the_servo_slows_down_before_its_stop_and_leaves_it_at_once():
    switches, commands = np.array([0.0, 0.2, 0.3]), np.array([10.0, -10.0, 0.0])
    times = np.array([0.05, 0.085, 0.09, 0.2, 0.25, 0.4])
    path = elevator_path(switches, commands, times, Servo(-0.4, 0.9, 13.0))
    slowed = 0.9 - 0.05 * np.exp(-1.0)
    expected = [0.5, 0.85, slowed, 0.9, 0.4, -0.1]
    np.testing.assert_allclose(path, expected, atol=1e-9)


def test_an_elevator_that_begins_beyond_a_stop_begins_there():
    path = elevator_path(SWITCHES, COMMANDS, np.array([-1.0, 0.0]), SERVO, start=2.0)
    np.testing.assert_array_equal(path, SERVO.high)


@given(ANY_COMMAND, ANY_ANGLE)
def test_the_rate_limit_holds_anywhere(command, angle):
    assert abs(limited_rate(command, angle, SERVO)) <= SERVO.rate


@given(st.floats(-13.0, 13.0), st.floats(SERVO.low + 0.066, SERVO.high - 0.066))
def test_within_the_limits_a_command_passes(command, angle):
    assert limited_rate(command, angle, SERVO) == command


@given(ANY_COMMAND, ANY_COMMAND, ANY_ANGLE)
def test_more_command_is_never_less_rate(one, other, angle):
    rates = [limited_rate(command, angle, SERVO) for command in sorted((one, other))]
    assert rates[0] <= rates[1]


@pytest.mark.parametrize("command", [-20.0, 0.0, 20.0])
def test_an_elevator_beyond_a_stop_returns(command):
    assert limited_rate(command, SERVO.high + 0.01, SERVO) < 0.0
    assert limited_rate(command, SERVO.low - 0.01, SERVO) > 0.0


@given(ANY_COMMAND, st.floats(SERVO.low, SERVO.high), st.floats(0.001, 0.1))
def test_a_command_within_its_bounds_is_followed_while_it_is_held(command, angle, hold):
    """The bounds are the largest: a little more command turns ψ less far."""
    low, high = rate_bounds(angle, SERVO, hold)
    followed = min(max(command, low), high)
    end = held_angle(followed, angle, SERVO, hold)
    assert end == pytest.approx(angle + followed * hold, abs=1e-9)
    if SERVO.rate > high > 1e-3:
        more = 1.1 * high
        assert held_angle(more, angle, SERVO, hold) < angle + more * hold - 1e-9
