"""The elevator's path under a tape of rate commands, solved exactly.

This replays a log through the actuator of `glider.physics.effects.signals`: a pure
delay T and a first-order lag τ between held commands and the elevator's rate,
    τ ṙ(t) = u(t - T) - r(t),   φ̇ = r,
whose solution between two commands is a straight line and an exponential. The
servo rests before the first command, and the elevator stops at its travel.
"""

import numpy as np

_SIMILAR = 0.05  # Share of changes by which two phases of a clock fit similarly.
_SAME = 1e-6  # Resolution of a log's times [s].
_SLACK = 1e-3  # Share of a period by which a row may be earlier than its tick.


def latest_command(begins: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Returns the index of the command that is held at each time (m,) [s].

    A command that begins at a time is held there, whatever the rounding; the index is
    -1 before the first of the increasing times `begins` (k,) [s].
    """
    return np.searchsorted(begins, times + 1e-9, side="right") - 1


def elevator_path(
    switch_times: np.ndarray,
    commands: np.ndarray,
    query: np.ndarray,
    delay: float = 0.0,
    time_constant: float = 0.0,
    start: float = 0.0,
    limits: tuple[float, float] | None = None,
) -> np.ndarray:
    """Returns the elevator's angle at the query times [rad].

    Args:
        switch_times: (k,) when each command begins [s], increasing.
        commands: (k,) elevator rates, each held until the next [rad/s].
        query: (m,) times, increasing or not [s].
        delay: T [s].
        time_constant: τ [s]; 0 for none.
        start: angle before the first command [rad].
        limits: travel of the elevator [rad], or None.
    """
    begin = switch_times + delay
    tau = max(time_constant, 1e-9)
    low, high = limits if limits is not None else (-np.inf, np.inf)
    spans, held = np.diff(begin), commands.tolist()
    steps = zip(held, spans.tolist(), np.exp(-spans / tau).tolist(), strict=False)
    found, angle, rate = [(start, 0.0)], start, 0.0
    for command, span, decay in steps:  # All but the last, which has no end.
        excess = rate - command
        angle += command * span + excess * tau * (1.0 - decay)
        angle = min(max(angle, low), high)
        rate = command + excess * decay
        found.append((angle, rate))
    angles, rates = np.array(found).T
    index = np.searchsorted(begin, query, side="right") - 1
    before = index < 0
    index = np.maximum(index, 0)
    span = np.maximum(query - begin[index], 0.0)
    excess = rates[index] - commands[index]
    path = angles[index] + commands[index] * span
    path = path + excess * tau * (1.0 - np.exp(-span / tau))
    return np.where(before, start, np.clip(path, low, high))


def command_steps(
    time: np.ndarray,
    command: np.ndarray,
    command_rate: float | None,
    since: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns when the commands of a log switched, and to what.

    A log shows a new command in the first row after it was given: without more
    knowledge, half a row before on the average. Where the commands come from a
    clock, its phase is the one that fits most of the rows that changed, or that of a
    clock that started with the log if it fits about as many; it must fit many more
    than by chance. Not all: a servo that slows down before its stops changes commands
    between the ticks too. Where the clock's rate is unknown, it is the integer in Hz
    that fits best, within 2 Hz of the rate of changes, some of which do not show; it is
    infinite where the commands switched at the rows, made of the angles there.
    `since` (n,) is when the command of each row was given, if the log has it [s].
    Returns switch times (k,) [s], the first at the log's start, and commands [rad/s].
    """
    rows = np.flatnonzero(np.diff(command)) + 1
    commands = np.concatenate([command[:1], command[rows]])
    if command_rate == np.inf:
        return time[np.concatenate([[0], rows])], commands
    after, before = time[rows], time[rows - 1]
    if since is not None:
        return np.append(time[:1], np.clip(since[rows], before, after)), commands
    switches = 0.5 * (before + after)
    if (clock := _find_clock(time, rows, command_rate)) is not None:
        phase, period = clock
        ticks = phase + period * _ticks(after, phase, period)
        is_tick = ticks > before + _SAME
        is_tick &= ~_on_ramps(before, after, 0.999 * period)
        switches = np.where(is_tick, ticks, switches)
    return np.concatenate([time[:1], switches]), commands


def hides_command(
    time: np.ndarray, command: np.ndarray, command_rate: float | None
) -> np.ndarray:
    """Returns which steps between a log's rows hide a whole command of a clock, (n-1,).

    The arguments are those of `command_steps`. None does where no clock is found.
    """
    rows = np.flatnonzero(np.diff(command)) + 1
    clock = None if command_rate == np.inf else _find_clock(time, rows, command_rate)
    if clock is None:
        return np.zeros(len(time) - 1, dtype=bool)
    return np.diff(_ticks(time, *clock)) > 1.0


def _ticks(
    times: np.ndarray, phase: float | np.ndarray, period: float | np.ndarray
) -> np.ndarray:
    """Returns the number of the last tick of a clock at some times."""
    return np.floor((times - phase + _SLACK * period) / period)


def _find_clock(
    time: np.ndarray, rows: np.ndarray, command_rate: float | None
) -> tuple[float, float] | None:
    """Finds phase and period [s] of the clock that made commands switch before rows."""
    after, before = time[rows], time[rows - 1]
    rates = [] if command_rate is None or not len(rows) else [command_rate]
    if command_rate is None and len(rows) > 10:
        usual = round((len(rows) - 1) / np.ptp(after))
        rates = [usual + k for k in (0, 1, -1, 2, -2) if usual + k > 0]
    if not rates:
        return None
    periods = np.repeat(1.0 / np.array(rates), 1 + len(rows))[:, None]
    latest = [np.sort(after % (1.0 / rate))[::-1] for rate in rates]
    phases = np.insert(latest, 0, time[0], axis=1).reshape(-1, 1)
    ticks = phases + periods * _ticks(after, phases, periods)
    # A tick at a row shows there.
    shares = np.mean(ticks > before + _SAME, axis=1)
    best = int(np.argmax(shares))
    spread = np.sqrt(shares[best] * (1.0 - shares[best]) / len(rows))
    own = best - best % (1 + len(rows))  # The same rate, from the log's start.
    if shares[own] >= shares[best] - max(_SIMILAR, 2.0 * spread):
        best = own
    period = float(periods[best, 0])
    by_chance = float(np.median(after - before)) / period
    if shares[best] <= min(0.5 * (1.0 + by_chance), 1.0 - _SIMILAR):
        return None
    return float(phases[best, 0]), period


def _on_ramps(before: np.ndarray, after: np.ndarray, period: float) -> np.ndarray:
    """Returns which changes are samples of a rate that changes all the time, (k,).

    Three changes or more that follow each other sooner than a clock's period [s] are no
    commands of the clock: so does a servo that slows down before a stop. `before` and
    `after` (k,) are the times of the rows beside each change [s].
    """
    soon = np.pad(after[1:] - before[:-1] < period, 1)
    runs = soon[1:-1] & (soon[:-2] | soon[2:])
    return np.append(runs, False) | np.append(False, runs)
