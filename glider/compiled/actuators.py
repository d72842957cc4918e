"""An elevator behind actuators that are known by their formulas alone."""

import numpy as np

from glider.compiled.kernel import Family
from glider.compiled.runge_kutta import advance, put
from glider.physics.chain import actuator_rates, actuator_terms, demanded_angle
from glider.physics.compose import initial_extra
from glider.physics.effects import SERVO_LAG, Replay
from glider.physics.servo import NO_LIMITS, Servo, elevator_path, limited_rate

STEP = 0.00025
"""Longest step of an actuator [s]."""


def slope_of_actuators(t, node, y, data, rate):
    """Writes the rates of the elevator's angle and of the actuators' own states."""
    command, servo, c, x = data
    x[3] = y[0]
    for i in range(1, y.shape[0]):
        x[6 + i] = y[i]
    demanded = limited_rate(command, demanded_angle(x, c), servo)
    rates = (actuator_terms(demanded, x, c), *actuator_rates(demanded, x, c))
    for i in range(len(rates)):
        rate[i] = rates[i]


def actuator_path(times, commands, c, servo, states):
    """Turns an elevator through servo and actuators along held commands.

    Args:
        times: (K + 1,) [s].
        commands: (K,) held over each interval [rad/s].
        c: coefficients of the actuators.
        servo: its limits.
        states: (K + 1, 1 + m) the elevator's angle and the actuators' own states;
            the first row is given, the others are written.
    """
    size = states.shape[1]
    x = np.zeros(6 + size)
    y = states[0].copy()
    work = np.empty((3, size))
    for k in range(times.shape[0] - 1):
        step = times[k + 1] - times[k]
        data = (commands[k], servo, c, x)
        advance(slope_of_actuators, times[k], y, step, 4, data, work)
        put(y, states[k + 1])


LOOPS = Family((slope_of_actuators, actuator_path), (actuator_path,))


def replayed_path(
    replay: Replay,
    switch_times: np.ndarray,
    commands: np.ndarray,
    query: np.ndarray,
    servo: Servo = NO_LIMITS,
    *,
    start: float = 0.0,
) -> np.ndarray:
    """Returns the angle of an elevator behind servo and actuators at some times [rad].

    Exact for delay and lag; with further actuators, by fine Runge-Kutta steps.

    Args:
        replay: delay, lag and actuators, at rest before the first command.
        switch_times: (k,) when each command begins [s], increasing.
        commands: (k,) elevator rates, each held until the next [rad/s].
        query: (m,) times [s].
        servo: its limits.
        start: angle before the first command [rad]; clipped into the travel.
    """
    actuators = replay.actuators
    delay = replay.delay
    lag = replay.time_constant
    start = min(max(start, servo.low), servo.high)
    if not actuators:
        return elevator_path(
            switch_times,
            commands,
            query,
            servo,
            delay=delay,
            time_constant=lag,
            start=start,
        )
    if lag > 0.0:
        actuators = ((SERVO_LAG, (lag,)), *actuators)
    kinds = tuple(kind for kind, _ in actuators)
    begins = switch_times + delay
    c = np.array([value for _, values in actuators for value in values])
    first = begins[0]
    last = max(query.max(), begins[-1]) + STEP
    even = np.linspace(first, last, int((last - first) / STEP) + 2)
    times = np.union1d(even, begins)
    held = commands[np.searchsorted(begins, times[:-1], side="right") - 1]
    rest = initial_extra(kinds, None, 0.0, c)
    states = np.empty((len(times), 1 + len(rest)))
    states[0] = [start, *rest]
    LOOPS.over(kinds).actuator_path(times, held, c, servo, states)
    return np.interp(query, times, states[:, 0])
