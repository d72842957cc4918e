"""The fit of the scales of noise to flights, by sequential quadratic programming."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import LinearConstraint, minimize

from glider.compiled.parallel import in_parallel
from glider.sysid.constants import FEW_FLIGHTS
from glider.sysid.likelihood.filtering import score, whiten
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.likelihood.scales import CEILING, FLOOR, NAMES, Scales

_STEP_OF_LOG = 1e-3  # Step of a scale's logarithm for slopes.
_LARGEST_STEP = 1.0  # Of a logarithm in a round.
_STEPS = 2  # Of a round.
_LEAST_FISHER = 0.1  # Information on a logarithm that there always is.

# Prior of the logarithms. Flights in nearly still air do not determine the gusts' time:
# its range is two standard deviations either way. The others have none.
_USUAL = Scales().logs
_PRECISION = np.where(
    np.array(NAMES) == "air_time", (0.25 * (CEILING.logs - FLOOR.logs)) ** -2.0, 0.0
)


def typical_flights(flights: Sequence[Any]) -> Sequence[Any]:
    """About FEW_FLIGHTS of many, evenly picked."""
    return flights[:: max(1, len(flights) // FEW_FLIGHTS)]


def lifted(scales: Scales) -> Scales:
    """Returns scales at least halfway to their usual ones, in logarithms.

    A fit that begins with little noise keeps to the errors of the model before it.
    """
    least = np.where(_PRECISION == 0.0, 0.5 * (FLOOR.logs + _USUAL), -np.inf)
    return Scales.from_logs(np.maximum(scales.logs, least))


class _FittedScales(NamedTuple):
    """Scales of the greatest likelihood."""

    scales: Scales
    cost: float  #: Negative log-likelihood there [nats].


def fit_scales(
    flights: Sequence[LinearFlight],
    scales: Scales,
    free: Sequence[str] = NAMES,
    rounds: int = 20,
    tolerance: float = 0.05,
) -> _FittedScales:
    """Maximises the likelihood of the scales.

    Those in `free` are fitted to flights with one column, their error, until a round
    gains less than `tolerance` [nats]. The slopes are exact; each round steps in
    coordinates in which the information of a few flights is one where it begins.
    """
    index = [NAMES.index(name) for name in free]
    logs = np.clip(scales.logs, FLOOR.logs, CEILING.logs)
    value = np.inf
    for _ in range(rounds if flights and free else 0):
        before, value, logs = _step(flights, logs, index, tolerance)
        if not before - value >= tolerance:  # Or it diverges.
            break
    return _FittedScales(Scales.from_logs(logs), value)


def _step(
    flights: Sequence[LinearFlight],
    logs: np.ndarray,
    index: Sequence[int],
    tolerance: float,
) -> tuple[float, float, np.ndarray]:
    """Returns the cost of the scales and of likelier ones [nats], and their logs."""
    information = _information(flights, logs, index)
    if not np.all(np.isfinite(information)):
        return np.inf, np.inf, logs
    basis = np.linalg.inv(np.linalg.cholesky(information)).T
    tried: list[tuple[float, np.ndarray]] = []

    def cost(step: np.ndarray) -> tuple[float, np.ndarray]:
        own = logs.copy()
        own[index] += basis @ step
        own = np.clip(own, FLOOR.logs, CEILING.logs)
        value, slopes = _score(flights, own)
        tried.append((value, own))
        return value, slopes[index] @ basis

    least = np.maximum(FLOOR.logs - logs, -_LARGEST_STEP)[index]
    most = np.minimum(CEILING.logs - logs, _LARGEST_STEP)[index]
    minimize(
        cost,
        np.zeros(len(index)),
        jac=True,
        method="SLSQP",
        constraints=LinearConstraint(basis, least, most),
        options={"maxiter": _STEPS, "ftol": tolerance},
    )
    return tried[0][0], *min(tried, key=lambda pair: pair[0])


def _score(
    flights: Sequence[LinearFlight], logs: np.ndarray
) -> tuple[float, np.ndarray]:
    """Returns the cost of such scales with their prior [nats], and its slopes."""
    scales = Scales.from_logs(logs)
    found = in_parallel(lambda f: score(f, scales), flights)
    apart = logs - _USUAL
    return (
        0.5 * float(_PRECISION @ apart**2) + sum(cost for cost, _ in found),
        _PRECISION * apart + sum(slopes for _, slopes in found),
    )


def _information(
    flights: Sequence[LinearFlight], logs: np.ndarray, index: Sequence[int]
) -> np.ndarray:
    """Returns the information of flights and prior on some scales' logarithms."""
    steps = _STEP_OF_LOG * np.eye(len(logs))[index]
    moved = [Scales.from_logs(logs + s) for s in steps]
    scales = Scales.from_logs(logs)
    few = typical_flights(flights)

    @np.errstate(over="ignore", invalid="ignore")  # A model may diverge.
    def one(flight: LinearFlight) -> np.ndarray:
        found = [whiten(flight, own) for own in (scales, *moved)]
        w = np.array([own.innovations.ravel() for own in found])
        v = np.array([own.log_variances.ravel() for own in found])
        half = 0.5 * (v[1:] - v[0]) / _STEP_OF_LOG
        mean = (w[1:] - w[0]) / _STEP_OF_LOG + half * w[0]
        return mean @ mean.T + 2.0 * half @ half.T

    total = np.sum(in_parallel(one, few), axis=0) * (len(flights) / len(few))
    return total + np.diag(_PRECISION[index] + _LEAST_FISHER)
