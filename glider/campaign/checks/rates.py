"""Do rows and commands come at the rates that the campaign has?

A clock that runs 5 % slow makes gravity and every force 10 % less: other effects
explain that well. Only the rates of rows (the cameras') and commands show it: one of
them off is a warning, both off by the same share are the clock.
"""

import math
from collections.abc import Sequence

import numpy as np

from glider.campaign.logs import Campaign

SCALE = "Scale:"
"""How warnings begin that make findings doubtful."""

_OFF = 0.02
"""Share by which a rate may be off: times are rounded, commands show a row later."""
_MORE = 1.1  # Times as often as they come, at most, as stamps jitter.
_FEWEST = 30  # Intervals that a rate is taken from, at least.
_MOST_TICKS = 3  # Ticks in an interval: beyond, a rate that is off has lost count.


def check_rates(campaign: Campaign) -> tuple[str, ...]:
    """Warns where rows do not come at the campaign's pose_rate.

    Refuses commands that are off by the same share: the clock of the log is wrong.
    """
    claimed = campaign.pose_rate
    if claimed is None:
        return ()
    rows = _calc_pace([flight.time for flight in campaign.flights], claimed)
    if abs(rows - 1.0) < _OFF:
        return ()
    words = (
        f"rows come at {claimed / rows:.4g} Hz where field 'pose_rate' "
        f"says {claimed:.4g}"
    )
    rate = campaign.command_rate
    if rate is not None and campaign.elevator == "servo":
        changes = []
        for flight in campaign.flights:
            is_new = np.diff(np.asarray(flight.command)) != 0.0
            changes.append(flight.time[1:][is_new])
        commands = _calc_pace(changes, rate)
        if abs(commands - rows) < _OFF:
            campaign.refuse(
                f"{words}, and commands at {rate / commands:.4g} Hz "
                f"where field 'command_rate' says {rate:.4g}; expected column 'time' "
                f"in seconds (it runs {rows:.3g} times too fast), or the true rates."
            )
    return (f"The {words}: is the clock of 'time' right?",)


def check_commands(campaign: Campaign) -> None:
    """Refuses commands that change more often than they come: no servo got them."""
    rate = campaign.switch_rate
    if rate is None or campaign.elevator != "servo":
        return
    changes = []
    for flight in campaign.flights:
        count = np.count_nonzero(np.diff(np.asarray(flight.command)))
        duration = flight.time[-1] - flight.time[0]
        changes.append((count - 1) / max(duration, 1.0 / rate))
    usual = np.median(changes)
    if usual > _MORE * rate:
        campaign.refuse(
            f"column 'elevator_rate_command' changes {usual:.3g} "
            f"times a second; expected {rate:.4g} at most, as field 'command_rate' "
            "says (log what the servo gets, not what a controller asks in between)."
        )


def _calc_pace(clocks: Sequence[np.ndarray], rate: float) -> float:
    """How much longer ticks last than at a rate; 1 where few are seen.

    Args:
        clocks: times (n,) of each flight, a whole number of ticks apart [s].
        rate: [Hz].
    """
    steps = np.concatenate([np.diff(clock) for clock in clocks]) * rate
    ticks = np.round(steps)
    is_counted = (ticks >= 1) & (ticks <= _MOST_TICKS)
    if np.sum(is_counted) < max(_FEWEST, 0.8 * len(steps)):
        return 1.0
    total = np.sum(steps[is_counted])
    return total / np.sum(ticks[is_counted])


def claim_scale(
    campaign: Campaign,
    ratio: float,
    least: float,
    parts: tuple[float, float],
    words: str,
) -> tuple[str, ...]:
    """Warns of a ratio that is certainly off by one part, and refuses a larger one.

    Args:
        campaign: named in the refusal.
        ratio: of what flights show to what is claimed.
        least: logarithm of the ratio below which it may be chance.
        parts: by which it may be off without a warning, and without a refusal.
        words: sentence on it, without its end.
    """
    off = abs(ratio - 1.0)
    warned, refused = parts
    if abs(math.log(ratio)) < least or off < warned:
        return ()
    if off > refused:
        campaign.refuse(f"{words}.")
    return (f"{SCALE} {words}.",)
