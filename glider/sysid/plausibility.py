"""Checks that a model does not attribute too much to chance.

Process noise and per-flight constants absorb whatever a model lacks: the likelihood
stays honest, but where they explain most of the error the effects mean nothing. That
happens where a log is inconsistent in a way that no check of its rows detects, as with
the commands of another flight or a clock that runs slow.
"""

import numpy as np

from glider.campaign.checks.motion import robust_std
from glider.sysid.likelihood.model_fit import FitResult
from glider.sysid.likelihood.scales import CEILING
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Record
from glider.sysid.replay.signals import logged_elevator

BOUNDED = {
    "air": "gusts of {:.2g} m/s",
    "wind": "flight-to-flight winds of {:.2g} m/s",
    "trim": "flight-to-flight trims of {:.2g} rad",
    "pitch_zero": "flight-to-flight pitch offsets of {:.2g} rad",
}
"""Scales whose ceilings no flight of a known glider reaches, and their words."""

NEAR_CEILING = 0.97
"""Share of its ceiling above which a scale is at it."""

MOMENT_SHARE = 0.2
"""Unmodelled pitch acceleration over the RMS pitch acceleration above which the model
does not explain it. Measured: at most 0.04 in campaigns with the right answer, 0.2 to 1
where elevator and pose are of different flights or clocks."""

GAIN_ERROR = 0.03
"""Share by which the elevator may move more or less than commanded. Measured,
with lag and delay fitted: 0.003 at most in 60 campaigns, servos of other forms than the
library's among them; 0.04 and 0.05 where one clock is 5 % slow."""

GAIN_Z = 4.0
"""... and standard errors over flights above which that is significant."""

WINDOW = 0.1
"""Time over which an elevator's travel is measured [s]."""


def find_doubt(task: Task, model: FitResult) -> str | None:
    """Finds the reason why a model cannot be trusted: one clause, or None."""
    if not task.vehicle.knows_forces:
        return None
    found = [*_at_ceilings(model)]
    turning = [r.acceleration[r.seen[:, 2], 2] for r in task.records]
    usual = float(np.sqrt(np.mean(np.concatenate(turning) ** 2)))
    if model.scales.moment > MOMENT_SHARE * usual:
        found.append(
            f"unmodelled pitch accelerations of {model.scales.moment:.2g} rad/s² "
            f"(measured ones are {usual:.2g})"
        )
    if found:
        return f"the model needs {' and '.join(found)}"
    gain, error = elevator_gain(task, model)
    if abs(gain - 1.0) > max(GAIN_ERROR, GAIN_Z * error):
        return (
            f"the elevator moves {gain:.3f} times as far as commanded (± {error:.1g}), "
            "as with a wrong clock or unit"
        )
    return None


def _at_ceilings(model: FitResult) -> list[str]:
    """Returns words for the scales that are as large as they may be."""
    return [
        words.format(getattr(model.scales, name))
        for name, words in BOUNDED.items()
        if getattr(model.scales, name) > NEAR_CEILING * getattr(CEILING, name)
    ]


def elevator_gain(task: Task, model: FitResult) -> tuple[float, float]:
    """Ratio of measured to modelled elevator travel, and its standard error.

    The median over flights of regressions of travel on travel; 1 and infinity where
    there is no servo.
    """
    gains = [
        gain
        for record in task.records
        if record.has_servo and (gain := _gain_of(record, model)) is not None
    ]
    if len(gains) < 3:
        return 1.0, np.inf
    middle = float(np.median(gains))
    spread = float(robust_std(np.array(gains) - middle))
    return middle, 1.2533 * spread / np.sqrt(len(gains))


def _gain_of(record: Record, model: FitResult) -> float | None:
    """Returns a flight's gain; None where its elevator barely moves."""
    rows = np.flatnonzero(record.seen[:, 3])
    time, measured = record.time[rows], record.elevator[rows]
    modeled = logged_elevator(record, model.theta)[rows]
    ends = np.searchsorted(time, time + WINDOW)
    first = np.flatnonzero(ends < len(time))
    if len(first) == 0:
        return None
    travel = measured[ends[first]] - measured[first]
    ordered = modeled[ends[first]] - modeled[first]
    known = float(ordered @ ordered)
    return float(ordered @ travel) / known if known > LEAST_TRAVEL else None


LEAST_TRAVEL = 0.1
"""Sum of squared travels above which a flight determines a gain [rad²]."""
