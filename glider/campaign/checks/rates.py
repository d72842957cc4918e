"""Do rows and commands come at the rates that the campaign is said to have?

A clock that runs 5 % slow makes gravity 10 % less and every force with it: other
effects explain that well. Only the clocks that wrote the log tell: its rows come at the
rate of the cameras, its commands at that of the flight computer.
"""

from collections.abc import Iterable

import numpy as np

from glider.campaign.logs import Campaign, Flight
from glider.errors import InputError

_OFF = 0.02
"""Share by which a rate may differ from what was told: times are rounded to
milliseconds, and a command shows in the first row after it."""

_FEWEST = 30
"""Intervals that a rate is taken from, at least."""

_MOST_TICKS = 3
"""Ticks in an interval, at most: beyond, a rate that is off has lost count."""


def check_rates(campaign: Campaign) -> tuple[str, ...]:
    """Returns a warning where the rows do not come at the campaign's pose_rate.

    Raises:
        InputError: the commands do not come at their rate either, by the same share:
            it is the clock of the log that is wrong.
    """
    rows = _pace((f.time for f in campaign.flights), campaign.pose_rate)
    if rows is None or abs(rows - 1.0) < _OFF:
        return ()
    words = (
        f"rows come at {campaign.pose_rate / rows:.4g} Hz where field 'pose_rate' "
        f"says {campaign.pose_rate:.4g}"
    )
    rate = campaign.command_rate
    if rate is not None and campaign.elevator == "servo":
        commands = _pace(map(_switches, campaign.flights), rate)
        if commands is not None and abs(commands - rows) < _OFF:
            raise InputError(
                f"{campaign.path}: {words}, and commands at {rate / commands:.4g} Hz "
                f"where field 'command_rate' says {rate:.4g}; column 'time' in seconds "
                f"is needed (it runs {rows:.3g} times too fast), or both rates as they "
                "are."
            )
    return (f"The {words}: is the clock of 'time' right?",)


def _switches(flight: Flight) -> np.ndarray:
    """Returns the times of the rows with a new command [s]."""
    assert flight.command is not None
    return flight.time[1:][np.diff(flight.command) != 0.0]


def _pace(clocks: Iterable[np.ndarray], rate: float) -> float | None:
    """Returns how much longer ticks last than at a rate, or None where few are seen.

    Args:
        clocks: times of ticks in each flight, of which some may be missing [s].
        rate: that they are said to have [Hz].
    """
    steps = np.concatenate([*map(np.diff, clocks), np.empty(0)]) * rate
    ticks = np.round(steps)
    counted = (ticks >= 1) & (ticks <= _MOST_TICKS)
    if np.sum(counted) < max(_FEWEST, 0.8 * len(steps)):
        return None
    return float(np.sum(steps[counted]) / np.sum(ticks[counted]))
