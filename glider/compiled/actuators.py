"""An elevator behind actuators that are known by their formulas alone."""

import numpy as np

from glider.compiled.kernel import Family
from glider.compiled.runge_kutta import advance, put
from glider.physics.chain import actuator_rates, actuator_terms, demanded_angle
from glider.physics.compose import initial_extra
from glider.physics.effects import SERVO_LAG, Replay
from glider.physics.parameter_space import space_of
from glider.physics.servo import (
    NO_LIMITS,
    Servo,
    held_rate,
    lagged_rate,
    limited_rate,
    turned_angle,
)

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


def held_path(begins, commands, query, servo, lag, start, path):
    """Turns an elevator along held commands, exactly.

    Args:
        begins: (k,) when each command begins to act [s], increasing.
        commands: (k,) [rad/s].
        query: (m,) times, in any order [s].
        servo: its limits.
        lag: time constant of the elevator behind the servo [s]; 0 for none.
        start: the elevator's angle before the first command [rad], within the travel.
        path: (m,) the elevator's angles [rad], written.
    """
    count = commands.shape[0]
    angles = np.empty(count)
    rates = np.empty(count)
    steady = np.empty(count)
    lagged = np.zeros(count)
    angle = start
    behind = 0.0
    for k in range(count):
        angles[k] = angle
        lagged[k] = behind
        rates[k], steady[k] = held_rate(commands[k], angle, servo)
        if k + 1 < count:
            span = begins[k + 1] - begins[k]
            angle = turned_angle(angle, rates[k], steady[k], span)
            if lag > 0.0:
                behind = lagged_rate(behind, rates[k], steady[k], span, lag)
    for j in range(query.shape[0]):
        k = np.searchsorted(begins, query[j], side="right") - 1
        path[j] = start
        if k >= 0:
            since = query[j] - begins[k]
            path[j] = turned_angle(angles[k], rates[k], steady[k], since)
            if lag > 0.0:
                rate = lagged_rate(lagged[k], rates[k], steady[k], since, lag)
                path[j] -= lag * rate


def uneven_path(begins, commands, query, servo, form, time, load, start, path):
    """Turns an elevator along held commands behind a servo that is not even.

    Exact but for loads and limits, which it keeps for a step of at most 1 ms.

    Args:
        begins: (k,) when each command begins to act [s], increasing.
        commands: (k,) [rad/s].
        query: (m,) times, increasing [s].
        servo: its limits.
        form: lags of turning up and down [s], what a load adds to both [s], the share
            that it takes from the rate limit, the play [rad], and the largest rate at
            which the elevator comes after the servo [rad/s].
        time: (n,) of the loads [s], increasing.
        load: (n,) in the unit that the form counts them in.
        start: the elevator's angle before the first command [rad], within the travel.
        path: (m,) the elevator's angles [rad], written.
    """
    up, down, lag_by_load, rate_by_load, play, slew = form
    now = begins[0]
    angle = start
    behind = start
    shown = start
    k = 0
    i = 0
    for j in range(query.shape[0]):
        while now < query[j]:
            until = min(now + 0.001, query[j])
            if k + 1 < begins.shape[0]:
                until = min(until, begins[k + 1])
            while i + 1 < time.shape[0] and time[i + 1] <= now:
                i += 1
            most = servo.rate * max(1.0 - rate_by_load * load[i], 0.0)
            rate = limited_rate(min(max(commands[k], -most), most), angle, servo)
            lag = (up if angle > behind else down) + lag_by_load * load[i]
            step = until - now
            steady = rate * lag
            gap = angle - behind
            angle += rate * step
            if lag > 1e-9:
                gap = gap + rate * step - steady - (gap - steady) * np.exp(-step / lag)
            else:
                gap += rate * step
            behind += min(max(gap, -slew * step), slew * step)
            shown = min(max(shown, behind - 0.5 * play), behind + 0.5 * play)
            now = until
            if k + 1 < begins.shape[0] and now >= begins[k + 1]:
                k += 1
        path[j] = shown


LOOPS = Family(
    (slope_of_actuators, actuator_path, held_path, uneven_path),
    (actuator_path, held_path, uneven_path),
)

_SHORTEST = 1e-9
"""Time constant below which a lag is none [s]."""


def elevator_path(
    switch_times: np.ndarray,
    commands: np.ndarray,
    query: np.ndarray,
    servo: Servo = NO_LIMITS,
    *,
    delay: float = 0.0,
    time_constant: float = 0.0,
    start: float = 0.0,
) -> np.ndarray:
    """Returns the elevator's angle φ at some times, exactly [rad].

    The servo rests before the first command. A lag τ turns ψ' into the elevator's
    rate, τ r' = ψ' - r, so that φ = ψ - τ r.

    Args:
        switch_times: (k,) when each command begins [s], increasing.
        commands: (k,) elevator rates, each held until the next [rad/s].
        query: times in any order and shape [s].
        servo: its limits.
        delay: T, between a command and its action [s].
        time_constant: τ [s]; 0 for none.
        start: angle before the first command [rad]; clipped into the travel.
    """
    begins = np.ascontiguousarray(switch_times + delay, dtype=float)
    commands = np.ascontiguousarray(commands, dtype=float)
    times = np.ravel(np.asarray(query, dtype=float))
    start = float(min(max(start, servo.low), servo.high))
    lag = float(time_constant) if time_constant > _SHORTEST else 0.0
    path = np.empty(len(times))
    LOOPS.over(()).held_path(begins, commands, times, servo, lag, start, path)
    return path.reshape(np.shape(query))


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
    rest = initial_extra(space_of(kinds), None, 0.0, c)
    states = np.empty((len(times), 1 + len(rest)))
    states[0] = [start, *rest]
    LOOPS.over(kinds).actuator_path(times, held, c, servo, states)
    return np.interp(query, times, states[:, 0])
