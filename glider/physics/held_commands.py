"""When the held commands of a log began: rows show them later, a clock may give them.

`glider.physics.servo` turns the elevator along them.
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
    than by chance.

    Args:
        time: (n,) of the log's rows [s].
        command: (n,) in force at the rows [rad/s].
        command_rate: of the clock [Hz]; infinite where commands switched at the rows.
            None where it is unknown: then it is the integer that fits best, within
            2 Hz of the rate of changes, some of which do not show.
        since: (n,) when the command of each row was given, if the log has it [s].

    Returns:
        switch times (k,) [s], the first at the log's start, and commands [rad/s].
    """
    rows = np.flatnonzero(np.diff(command)) + 1
    commands = np.concatenate([command[:1], command[rows]])
    if command_rate == np.inf:
        return time[np.concatenate([[0], rows])], commands
    after = time[rows]
    before = time[rows - 1]
    if since is not None:
        switches = np.clip(since[rows], before, after)
        return np.append(time[:1], switches), commands
    switches = 0.5 * (before + after)
    clock = _find_clock(time, rows, command_rate)
    if clock is not None:
        phase, period = clock
        ticks = phase + period * _ticks(after, phase, period)
        is_tick = ticks > before + _SAME
        switches = np.where(is_tick, ticks, switches)
    return np.concatenate([time[:1], switches]), commands


def _ticks(
    times: np.ndarray, phase: float | np.ndarray, period: float | np.ndarray
) -> np.ndarray:
    """Returns the number of the last tick of a clock at some times."""
    return np.floor((times - phase + _SLACK * period) / period)


def _find_clock(
    time: np.ndarray, rows: np.ndarray, command_rate: float | None
) -> tuple[float, float] | None:
    """Finds phase and period [s] of the clock that made commands switch before rows."""
    after = time[rows]
    before = time[rows - 1]
    rates: list[float] = []
    if command_rate is not None and len(rows):
        rates = [command_rate]
    if command_rate is None and len(rows) > 10:
        usual = round((len(rows) - 1) / np.ptp(after))
        rates = [usual + k for k in (0, 1, -1, 2, -2) if usual + k > 0]
    if not rates:
        return None
    # The phases that are tried: from the log's start, and a tick at each change.
    tried = 1 + len(rows)
    periods = np.repeat(1.0 / np.array(rates), tried)[:, None]
    latest = [np.sort(after % (1.0 / rate))[::-1] for rate in rates]
    phases = np.insert(latest, 0, time[0], axis=1)
    phases = phases.reshape(-1, 1)
    ticks = phases + periods * _ticks(after, phases, periods)
    # A tick at a row shows there.
    shares = np.mean(ticks > before + _SAME, axis=1)
    best = int(np.argmax(shares))
    share = shares[best]
    spread = np.sqrt(share * (1.0 - share) / len(rows))
    own = best - best % tried  # The same rate, from the log's start.
    similar = share - max(_SIMILAR, 2.0 * spread)
    if shares[own] >= similar:
        best = own
    period = float(periods[best, 0])
    step = float(np.median(after - before))
    by_chance = step / period
    least = min(0.5 * (1.0 + by_chance), 1.0 - _SIMILAR)
    if shares[best] <= least:
        return None
    return float(phases[best, 0]), period
