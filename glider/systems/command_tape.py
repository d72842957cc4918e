"""A tape of elevator-rate commands: as a file to play, and as a Drake source."""

import csv
import math
from pathlib import Path

import numpy as np
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from glider.errors import InputError, expect

_HEAD = "time,elevator_rate_command"
"""First line of a file of commands, in s and rad/s. Each command is held until the next
row; the last row is where the tape ends."""


def tape_text(times: np.ndarray, commands: np.ndarray, end: float) -> str:
    """Returns a tape as the text of a CSV file; after its end the elevator stands.

    Each of the commands (k,) [rad/s] begins at its time (k,) from release [s].
    """
    lines = [_HEAD]
    for time, command in zip(times, commands, strict=True):
        lines.append(f"{time:.6g},{command:.4f}")
    lines.append(f"{end:.6g},0.0000")
    lines.append("")
    return "\n".join(lines)


def load_commands(path: Path | str) -> tuple[np.ndarray, np.ndarray]:
    """Returns times (k,) [s] and commands (k,) [rad/s] of a tape.

    The last row is where the tape ends.

    Raises:
        InputError: the file cannot be read, or is no tape.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8") as file:
            lines = list(csv.reader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}).") from None
    head = ",".join(lines[0]) if lines else ""
    expect(head == _HEAD, f"{path}: line 1", head, _HEAD)
    rows = []
    latest = -math.inf
    for number, line in enumerate(lines[1:], start=2):
        try:
            time, command = map(float, line)
        except ValueError:
            time = command = math.nan
        what = f"{path}: line {number}"
        found = ",".join(line)
        good = math.isfinite(time) and math.isfinite(command)
        expect(good, what, found, "a time and a rate, both finite")
        expect(time > latest, what, found, "a time after that of the line before")
        rows.append((time, command))
        latest = time
    count = len(rows)
    expect(count >= 2, f"{path}: the number of rows", count, "at least 2")
    times, commands = np.array(rows).T
    return times, commands


def command_source(path: Path | str) -> TrajectorySource:
    """Returns a Drake source that plays a file of commands.

    Output ports:
        y0 (1): command, for the servo's input of that name [rad/s].

    Each command is held until the next; after the end the last one, 0, stays.
    """
    times, commands = load_commands(path)
    # A hold ends where it ends: the last value of Drake's is that of the time before.
    breaks = np.append(times, times[-1] + 1.0)
    values = np.append(commands, commands[-1])
    held = PiecewisePolynomial.ZeroOrderHold(breaks, values[None, :])
    source = TrajectorySource(held)
    source.set_name("commands")
    return source
