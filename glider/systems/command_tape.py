"""A tape of elevator-rate commands: as a file to play, and as a Drake source."""

import csv
import math
from pathlib import Path

import numpy as np
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from glider.errors import InputError, expect

COLUMNS = ("time", "elevator_rate_command")
"""Columns of a file of commands, in s and rad/s. Each command is held until the next
row; the last row is where the tape ends."""


def tape_text(times: np.ndarray, commands: np.ndarray, end: float) -> str:
    """Returns a tape as the text of a CSV file; after its end the elevator stands.

    Each of the commands (k,) [rad/s] begins at its time (k,) from release [s].
    """
    rows = zip([*times, end], [*commands, 0.0], strict=True)
    lines = [f"{time:.6g},{command:.4f}" for time, command in rows]
    return "\n".join([",".join(COLUMNS), *lines, ""])


def load_commands(path: Path | str) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) [s] and commands (k,) [rad/s] of a tape; the last is where it ends."""
    try:
        with Path(path).open(newline="", encoding="utf-8") as file:
            lines = list(csv.reader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}).") from None
    head, needed = ",".join(lines[0]) if lines else "", ",".join(COLUMNS)
    expect(head == needed, f"{path}: line 1", head, needed)
    rows: list[tuple[float, float]] = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            time, command = map(float, line)
        except ValueError:
            time = command = math.nan
        what = f"{path}: line {number}"
        good = math.isfinite(time) and math.isfinite(command)
        expect(good, what, ",".join(line), "a time and a rate, both finite")
        rises = not rows or time > rows[-1][0]
        expect(rises, what, ",".join(line), "a time after that of the line before")
        rows.append((time, command))
    expect(len(rows) >= 2, f"{path}: the number of rows", len(rows), "at least 2")
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
    held = PiecewisePolynomial.ZeroOrderHold(
        np.append(times, times[-1] + 1.0), np.append(commands, commands[-1])[None, :]
    )
    source = TrajectorySource(held)
    source.set_name("commands")
    return source
