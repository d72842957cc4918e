"""Flights that no model explains together with the others.

Everything that may be wrong, shrunken curves, the launch, the air and the flight's own
constants act at once; what a flight's error then costs, over its number of
measurements, is a mean square that is about the same for all flights of one glider,
whatever the glider lacks. A flight whose axes, units, clock or elevator are not those
of the others, that was hit or is of another glider, costs many times as much. All is in
closed form from the flights' Gram matrices, under weights by which a flight that
costs much counts little (iteratively reweighted least squares; Huber, Robust
Statistics, 1981).

Measured: in 15 campaigns that are good the worst flight costs 2.2 times the middle one,
at 4.3 deviations; one of turned axes 200 to 1000 times (60 to 110 deviations), with
commands 50 ms late 150, with an elevator zero of 0.2 rad 28, of a glider half as heavy
again 42, with positions 5 % too large 3.
"""

import numpy as np

from glider.sysid.likelihood.candidates import gather
from glider.sysid.likelihood.information import solve
from glider.sysid.likelihood.model_fit import (
    FitResult,
    error_flights,
    prior_of,
    start_of,
    with_prior,
)
from glider.sysid.likelihood.scales import PER_FLIGHT, Scales, flight_values
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.smoothing import Noise

COARSE_SCALES = Scales(
    position=0.01, pitch=0.02, elevator=0.05, air=0.3, moment=5.0, servo=0.02
)
"""Scales under which flights are compared: what any one model lacks costs little."""

Z_OUTLYING = 5.0
"""Deviations of the logarithm of a flight's mean square from the middle one from which
on it stands out, of many flights."""

LEAST_DEVIATION = 0.15
"""Least deviation of these logarithms: with `Z_OUTLYING`, twice the middle one."""

MOST = 0.3
"""Share of the flights that may stand out: more are no exceptions."""

FEWEST = 5
"""Flights below which none can stand out."""

_ROUNDS = 12
_HEAVY = 2.0
"""Mean square over the middle one from which on a flight counts less."""


def find_outlying(task: Task, noise: Noise) -> dict[str, float]:
    """Returns the flights that stand out, and their mean square over the middle one.

    Args:
        task: on all flights.
        noise: of the sensors.
    """
    if len(task.records) < FEWEST:
        return {}
    squares = mean_squares(task, noise)
    outlying = stand_out(squares)
    ratio = squares / np.median(squares)
    return {
        record.name: float(ratio[i])
        for i, record in enumerate(task.records)
        if outlying[i]
    }


def mean_squares(task: Task, noise: Noise) -> np.ndarray:
    """Returns what each flight's error costs over its measurements (flights,)."""
    model = start_of(task, noise, with_curves=task.vehicle.knows_forces)
    candidates = gather(task, model)
    grams = candidates.grams(COARSE_SCALES)
    counts = np.array([np.sum(record.seen) for record in task.records])
    slots = [d.slot for d in candidates.directions]
    own, mean, precision = prior_of(task, model, slots)
    weights = np.ones(len(grams))
    for _ in range(_ROUNDS):
        total = with_prior(np.tensordot(weights, grams, 1), own, mean, precision)
        left = np.append(-solve(total), 1.0)
        squares = np.einsum("i,fij,j->f", left, grams, left) / counts
        squares = np.maximum(squares, _LEAST_SQUARE)
        weights = 1.0 / np.maximum(squares / (_HEAVY * np.median(squares)), 1.0)
    return squares


_LEAST_SQUARE = 1e-6
"""Mean square below which flights are equally good: errors of a thousandth of
`COARSE_SCALES`. Of logs without noise the rest is rounding, of any size and sign."""


def stand_out(squares: np.ndarray) -> np.ndarray:
    """Returns which mean squares (flights,) are out of line with the others.

    Logarithms are compared, for what all flights lack makes them larger by factors.
    Of few flights the deviation is hardly known, and more of them are asked for. Where
    more than `MOST` are out of line none is.
    """
    logs = np.log(squares)
    apart = logs - np.median(logs)
    deviation = max(1.4826 * float(np.median(np.abs(apart))), LEAST_DEVIATION)
    outlying = apart > Z_OUTLYING * (1.0 + 4.0 / len(logs)) * deviation
    return outlying & (np.mean(outlying) <= MOST)


Z_EXTREME = 10.0
"""Deviations of a flight's own wind, trim or zero of the pitch from the middle one from
which on it is no spread over flights: of Gaussian ones 1e-20 of flights are so far."""

LEAST_EXTREME = 0.3
"""... and how far off it is at least, in the coefficient's scale."""


def find_extreme(task: Task, model: FitResult) -> dict[str, str]:
    """Returns flights that need a wind, trim or pitch zero far from all others', why.

    What one flight has of its own may take up that its positions are in another length
    or that it is of another glider; the spread over flights then grows to hold it, and
    the effects of all the others drown.

    Args:
        task: the flights, of a glider whose mass and areas are told; others have none.
        model: fitted to (most of) them.
    """
    if not task.vehicle.knows_forces or len(task.records) < FEWEST:
        return {}
    flights = error_flights(task, model)
    own = flight_values(flights, model.scales)
    found: dict[str, str] = {}
    for kind, places in PER_FLIGHT.items():
        for name, place in places.items():
            slot = task.layout.index[kind, name]
            units = {c.name: c.unit for c in task.layout.kinds[kind].coefficients}
            apart = np.abs(own[:, place] - np.median(own[:, place]))
            deviation = 1.4826 * float(np.median(apart))
            least = max(Z_EXTREME * deviation, LEAST_EXTREME * task.layout.scale[slot])
            for i in np.flatnonzero(apart > least).tolist():
                found.setdefault(
                    task.records[i].name,
                    f"no other flight needs {kind} as of {own[i, place]:.2g} "
                    f"{units[name]}",
                )
    return found if len(found) <= MOST * len(task.records) else {}
