"""Flights that no model explains together with the others.

All effects, shrunken curves, the launch, moving air and per-flight constants act at
once; the remaining mean squared error of a flight is about the same for all flights of
one glider, whatever its model lacks. It is many times as large for a flight whose axes,
units, clock or elevator are not those of the others, that was hit or is of another
glider. All is in closed form from the flights' Gram matrices, with low weights for
flights of large errors (iteratively reweighted least squares; Huber, Robust Statistics,
1981).

Measured: in 15 good campaigns the worst flight has 2.2 times the median mean square,
at 4.3 deviations; one of turned axes 200 to 1000 times (60 to 110 deviations), with
commands 50 ms late 150, with an elevator zero of 0.2 rad 28, of a glider half as heavy
again 42, with positions 5 % too large 3.
"""

import numpy as np

from glider.campaign.checks.motion import robust_std
from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.candidates import gather
from glider.sysid.likelihood.information import solve
from glider.sysid.likelihood.scales import PER_FLIGHT, Scales, flight_values
from glider.sysid.likelihood.task import Task
from glider.sysid.replay.smoothing import Noise

COARSE_SCALES = Scales(
    position=0.01, pitch=0.02, elevator=0.05, air=0.3, moment=5.0, servo=0.02
)
"""Scales under which flights are compared: errors of any one model count little."""

Z_OUTLYING = 5.0
"""Deviations of the logarithm of a flight's mean square from the median above which it
is an outlier, among many flights."""

LEAST_DEVIATION = 0.15
"""Least deviation of these logarithms: with `Z_OUTLYING`, twice the median."""

MOST = 0.3
"""Share of the flights that may be outliers: more are no exceptions."""

FEWEST = 5
"""Flights below which none can be an outlier."""

_ROUNDS = 12
_HEAVY = 2.0
"""Mean square over the median above which a flight counts less."""


_LEAST_SQUARE = 1e-6
"""Mean square below which flights are equally good: errors of a thousandth of
`COARSE_SCALES`. Of logs without noise the rest is rounding, of any size and sign."""


def find_outlying(task: Task, noise: Noise) -> dict[str, float]:
    """Returns the outliers and their mean square over the median."""
    if len(task.records) < FEWEST:
        return {}
    squares = mean_squares(task, noise)
    ratios = (squares / np.median(squares)).tolist()
    flights = zip(task.records, ratios, stand_out(squares), strict=True)
    return {record.name: ratio for record, ratio, outlying in flights if outlying}


def mean_squares(task: Task, noise: Noise) -> np.ndarray:
    """Returns the mean square of each flight's remaining error (flights,)."""
    model = model_fit.start_of(task, noise, with_curves=task.vehicle.knows_forces)
    candidates = gather(task, model)
    grams = candidates.grams(COARSE_SCALES)
    counts = np.array([np.sum(record.seen) for record in task.records])
    prior = model_fit.prior_of(task, model, candidates.slots)
    weights = np.ones(len(grams))
    for _ in range(_ROUNDS):
        total = prior.added_to(np.tensordot(weights, grams, 1))
        left = np.append(-solve(total), 1.0)
        squares = np.einsum("i,fij,j->f", left, grams, left) / counts
        squares = np.maximum(squares, _LEAST_SQUARE)
        weights = 1.0 / np.maximum(squares / (_HEAVY * np.median(squares)), 1.0)
    return squares


def stand_out(squares: np.ndarray) -> np.ndarray:
    """Finds the mean squares (flights,) that are out of line with the others.

    Logarithms are compared, since an error common to all flights scales the squares.
    With few flights the deviation is uncertain, and a larger one is required. If more
    than `MOST` are out of line, none is an outlier.
    """
    logs = np.log(squares)
    apart = logs - np.median(logs)
    deviation = max(float(robust_std(apart)), LEAST_DEVIATION)
    outlying = apart > Z_OUTLYING * (1.0 + 4.0 / len(logs)) * deviation
    return outlying & (np.mean(outlying) <= MOST)


Z_EXTREME = 10.0
"""Deviations of a flight's wind, trim or pitch offset from the median above which it is
no flight-to-flight variation: of Gaussian ones 1e-20 of flights are so far."""

LEAST_EXTREME = 0.3
"""... and least deviation, in the coefficient's scale."""


def find_extreme(task: Task, model: model_fit.FitResult) -> dict[str, str]:
    """Returns flights of extreme wind, trim or pitch offset, and the reasons.

    The constants of one flight may absorb that its positions have another unit or that
    it is of another glider; the flight-to-flight variation then grows to include it and
    hides the effects of all others.
    """
    if not task.vehicle.knows_forces or len(task.records) < FEWEST:
        return {}
    flights = model_fit.error_flights(task, model)
    own = flight_values(flights, model.scales)
    found: dict[str, str] = {}
    for kind, places in PER_FLIGHT.items():
        for name, place in places.items():
            slot = task.layout.index[kind, name]
            units = {c.name: c.unit for c in task.layout.kinds[kind].coefficients}
            apart = np.abs(own[:, place] - np.median(own[:, place]))
            deviation = float(robust_std(apart))
            least = max(Z_EXTREME * deviation, LEAST_EXTREME * task.layout.scale[slot])
            for i in np.flatnonzero(apart > least).tolist():
                found.setdefault(
                    task.records[i].name,
                    f"no other flight needs {kind} as of {own[i, place]:.2g} "
                    f"{units[name]}",
                )
    return found if len(found) <= MOST * len(task.records) else {}
