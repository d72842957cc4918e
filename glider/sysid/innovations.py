"""Correlations of the innovations of held-out flights: is what is left white?"""

from collections.abc import Mapping, Sequence

import numpy as np

from glider.sysid.likelihood.model_fit import FitResult, error_flights
from glider.sysid.likelihood.scales import whiten
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.record import Record
from glider.sysid.replay.replayed import logged_elevator
from glider.sysid.result import Innovations

CHANNELS = ("x", "z", "pitch")

_LAGS = 25
"""Largest lag [rows], in flights of three times as many."""

_Z95 = 1.96
"""Standard deviations that 95 % of normal errors are within."""


def correlate(
    task: Task, models: Mapping[str, tuple[FitResult, Sequence[Record]]]
) -> Innovations:
    """Correlates innovations with themselves and with the elevator.

    Args:
        task: that the models were fitted in.
        models: name to the model and the flights as it takes them.
    """
    found: tuple[dict, dict] = {}, {}
    for name, (model, records) in models.items():
        flights = error_flights(task.on(records), model)
        left = [whiten(f, model.scales).innovations[:, :3, 0] for f in flights]
        count = min(_LAGS, min(map(len, left)) // 3) + 1
        elevator = [logged_elevator(record, model.theta) for record in records]
        moves = [(own - own.mean())[:, None] for own in elevator]
        found[0][name] = correlations(left, left, count)
        if all(record.has_servo for record in records):
            found[1][name] = correlations(left, moves, count)
    rows = sum(int(record.seen[:, 0].sum()) for record in records)
    step = float(np.median(np.concatenate([np.diff(r.time) for r in records])))
    return Innovations(
        lag_s=step * np.arange(count),
        band=_Z95 / np.sqrt(rows),
        autocorrelation=found[0],
        with_elevator=found[1],
    )


def correlations(
    late: Sequence[np.ndarray], early: Sequence[np.ndarray], count: int
) -> dict[str, np.ndarray]:
    """Correlations of columns (n, 3) with earlier ones, by channel, at `count` lags."""
    pairs = list(zip(late, early, strict=True))
    size = np.sqrt(sum(np.sum(a**2, axis=0) for a in late))
    size = size * np.sqrt(sum(np.sum(b**2, axis=0) for b in early))
    sums = [
        sum(np.sum(a[k:] * b[: len(b) - k], axis=0) for a, b in pairs)
        for k in range(count)
    ]
    return dict(zip(CHANNELS, (np.array(sums) / size).T, strict=True))
