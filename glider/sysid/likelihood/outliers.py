"""Flights that no model explains together with the others.

With everything acting at once, the remaining mean squared error is about the same for
all flights of one glider, whatever its model lacks, and many times as large for a
flight of other axes, units or clocks (docs/theory/tracing.md has measurements). It is
found in closed form from the flights' Gram matrices by iteratively reweighted least
squares (Huber, Robust Statistics, 1981).
"""

import numpy as np

from glider.campaign.checks.motion import robust_std
from glider.sysid.constants import (
    COARSE_NOISE,
    LEAST_DEVIATION,
    LEAST_SPREAD,
    PER_OUTLIER,
    Z,
)
from glider.sysid.likelihood import model_fit
from glider.sysid.likelihood.candidates import gather_in_parts
from glider.sysid.likelihood.filtering import PER_FLIGHT, flight_values
from glider.sysid.likelihood.information import solve
from glider.sysid.likelihood.scales import Scales
from glider.sysid.likelihood.task import FitResult, Task, start_of
from glider.sysid.replay.record import Noise

_COARSE = "position", "pitch", "elevator", "air", "moment", "servo", "rest"
COARSE_SCALES = Scales(
    **{name: COARSE_NOISE * getattr(Scales, name) for name in _COARSE}
)
"""Noise under which flights are compared."""
_ROUNDS = 12  # Of reweighting.
_LEAST_SQUARE = 1e-6  # Mean square that is rounding, as of logs without noise.


def find_outlying(task: Task, noise: Noise) -> dict[str, float]:
    """Finds flights whose remaining error no model explains with that of the others.

    Logarithms of mean squares are compared, since an error common to all flights scales
    the squares.

    Returns:
        names of the outliers, and their mean square over the median.
    """
    if len(task.records) < PER_OUTLIER:
        return {}
    squares = _mean_squares(task, noise)
    ratios = squares / np.median(squares)
    is_out = _deviations(np.log(squares), LEAST_DEVIATION) > Z
    if PER_OUTLIER * np.sum(is_out) > len(squares):
        return {}
    places = np.flatnonzero(is_out).tolist()
    return {task.records[i].name: float(ratios[i]) for i in places}


def _mean_squares(task: Task, noise: Noise) -> np.ndarray:
    """Returns the mean square of each flight's remaining error (flights,).

    That is the error with all effects acting at once, whitened by `COARSE_SCALES`.
    """
    model = start_of(task, noise)
    # Each flight's information on the m coefficients, (m + 1, m + 1).
    candidates, grams = gather_in_parts(task, model, COARSE_SCALES)
    counts = np.array([np.sum(record.seen) for record in task.records])
    prior = model_fit.prior_of(task, model, candidates.slots)

    weights = np.ones(len(grams))
    for _ in range(_ROUNDS):
        total = prior.added_to(np.tensordot(weights, grams, 1))
        change = solve(total)
        left = np.append(-change, 1.0)
        squares = np.einsum("i,fij,j->f", left, grams, left) / counts
        squares = np.maximum(squares, _LEAST_SQUARE)
        # The larger its error, the less a flight counts (Huber's weights).
        ratios = squares / np.median(squares)
        weights = 1.0 / np.maximum(ratios, 1.0)

    return squares


def _deviations(values: np.ndarray, least: float) -> np.ndarray:
    """Returns by how many standard deviations values (n,) differ from their median.

    The standard deviation counts as `least` if it is smaller. That of few values is
    uncertain, and counts as a larger one.
    """
    apart = values - np.median(values)
    std = max(float(robust_std(apart)), least)
    return apart / (std * (1.0 + 4.0 / len(values)))


def find_extreme(task: Task, model: FitResult) -> dict[str, str]:
    """Returns names of flights of extreme wind, trim or pitch offset, and the reasons.

    A flight's constants may absorb that it has another unit or glider; the variation
    then grows to include it and hides the effects of all others.
    """
    if not task.vehicle.knows_forces:
        return {}
    flights = model_fit.error_flights(task, model)
    columns = iter(flight_values(flights, model.scales).T)
    found: dict[str, str] = {}
    for kind in PER_FLIGHT:
        for coefficient in task.space.kinds[kind].coefficients:
            values = next(columns)
            apart = _deviations(values, LEAST_SPREAD * coefficient.scale)
            for i in np.flatnonzero(np.abs(apart) > Z).tolist():
                value = f"{values[i]:.2g} {coefficient.unit}"
                reason = f"no other flight needs {kind} as of {value}"
                found.setdefault(task.records[i].name, reason)

    are_too_many = PER_OUTLIER * len(found) > len(task.records)
    return {} if are_too_many else found
