"""The fit of the scales of noise to flights: Fisher scoring and BFGS.

The scales are fitted by their logarithms. The curvature of the likelihood is at first
its expectation, the Fisher information, and later what changes of the slopes say of it;
steps are damped as by Levenberg and Marquardt where they do not lower the cost.
"""

from collections.abc import Sequence

import numpy as np

from glider.compiled.parallel import in_parallel
from glider.sysid.constants import FEW_FLIGHTS
from glider.sysid.likelihood.filtering import score, whiten
from glider.sysid.likelihood.information import bounded_step
from glider.sysid.likelihood.linear_flight import LinearFlight
from glider.sysid.likelihood.scales import CEILING, FLOOR, NAMES, Scales
from glider.sysid.replay.record import evenly

_MOST_DAMPING = 1e4  # Damping of a step of the scales beyond which none gains.
_STEP_OF_LOG = 1e-3  # Step of a scale's logarithm for slopes.
_LARGEST_STEP = 0.7  # Of a logarithm: a scale at most doubles.
_LEAST_FISHER = 1e-3  # Information on a logarithm that there always is.
# Gain of a step that is cut short, over what its slope promises, at which the curvature
# holds: a quadratic's is as large up to two thirds of the way to its minimum.
_AS_PROMISED = 2.0 / 3.0
_DIVERGED = 1e100  # Slope beyond which squares of errors are numbers no longer.

# Prior of the logarithms. Flights in nearly still air do not determine the gusts' time:
# its range is two standard deviations either way. The others have none.
_USUAL = Scales().logs
_PRECISION = np.where(
    np.array(NAMES) == "air_time", (0.25 * (CEILING.logs - FLOOR.logs)) ** -2.0, 0.0
)


def lifted(scales: Scales) -> Scales:
    """Returns scales at least halfway to their usual ones, in logarithms.

    A fit that begins with little noise keeps to the errors of the model before it.
    """
    least = np.where(_PRECISION == 0.0, 0.5 * (FLOOR.logs + _USUAL), -np.inf)
    return Scales.from_logs(np.maximum(scales.logs, least))


def fit_scales(
    flights: Sequence[LinearFlight],
    scales: Scales,
    free: Sequence[str] = NAMES,
    iterations: int = 8,
    tolerance: float = 0.05,
) -> tuple[Scales, float]:
    """Maximises the likelihood of the scales by Fisher scoring, damped.

    The slopes are exact; the information is that of a few flights, at scales nearby,
    which suffices.

    Args:
        flights: of one column, their error.
        scales: where the fit begins.
        free: names of the scales to fit.
        iterations: the most steps.
        tolerance: the gain below which the fit stops [nats].

    Returns:
        the scales, and the negative log-likelihood and prior there [nats].
    """
    index = np.array([NAMES.index(name) for name in free], dtype=int)
    low = FLOOR.logs
    high = CEILING.logs
    logs = np.clip(scales.logs, low, high)
    value, slopes = _score(flights, logs)
    if not np.all(np.abs(slopes) < _DIVERGED):
        value = np.inf
    if not (flights and free) or not np.isfinite(value):
        return Scales.from_logs(logs), value

    damping = 0.0
    curvature = None
    for _ in range(iterations):
        if curvature is None:
            curvature = _information(flights, logs, index)
        fisher = curvature[np.ix_(index, index)]
        if not np.all(np.isfinite(fisher)):
            break
        fisher += np.diag(_PRECISION[index] + _LEAST_FISHER)

        # The quadratic that a step minimises, and how far a step may go.
        system = np.pad(fisher, (0, 1))
        system[:-1, -1] = -slopes[index]
        least = np.maximum(low - logs, -_LARGEST_STEP)[index]
        most = np.minimum(high - logs, _LARGEST_STEP)[index]

        # Steps with more and more damping, until one lowers the cost.
        gained = 0.0
        while damping <= _MOST_DAMPING:
            system[:-1, :-1] = fisher + (damping + 1e-6) * np.diag(np.diag(fisher))
            own = bounded_step(system, least, most)
            promised = -float(slopes[index] @ own)
            if promised < tolerance:
                break

            moved = logs.copy()
            moved[index] += own
            moved = np.clip(moved, low, high)
            lower, there = _score(flights, moved)
            if not lower < value:
                damping = max(10.0 * damping, 0.1)
                continue

            # After a step that is cut short and gains little, it is another curvature.
            gained = value - lower
            is_far = np.abs(own).max() >= _LARGEST_STEP
            if is_far and gained < _AS_PROMISED * promised:
                curvature = None
            else:
                step = moved - logs
                change = there - slopes - _PRECISION * step
                curvature = _updated(curvature, step, change)
            slopes = there
            logs = moved
            value = lower
            damping = 0.1 * damping if damping > 1e-2 else 0.0
            break

        if gained < tolerance:
            break

    return Scales.from_logs(logs), value


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
    flights: Sequence[LinearFlight], logs: np.ndarray, index: np.ndarray
) -> np.ndarray:
    """Returns the information of flights on logarithms of scales.

    That of normal innovations with mean μ and variance s, by differences:
    Σ μ' μ'ᵀ + ½ (log s)' (log s)'ᵀ, with whitened innovations in place of μ. A few
    flights are taken for all.

    Args:
        flights: of one column, their error.
        logs: of all scales.
        index: places of the scales that are moved; the rows of others are zero.
    """
    steps = _STEP_OF_LOG * np.eye(len(logs))[index]
    moved = [Scales.from_logs(logs + s) for s in steps]
    scales = Scales.from_logs(logs)
    few = evenly(flights, FEW_FLIGHTS)

    def one(flight: LinearFlight) -> np.ndarray:
        base = whiten(flight, scales)
        others = [whiten(flight, own) for own in moved]
        w = base.innovations.ravel()
        with np.errstate(over="ignore", invalid="ignore"):  # A model may diverge.
            by_w = np.array([f.innovations.ravel() - w for f in others]) / _STEP_OF_LOG
            by_v = [(f.log_variances - base.log_variances).ravel() for f in others]
            half = 0.5 * np.array(by_v) / _STEP_OF_LOG

            # Whitened innovations shrink as their deviation grows: that is no change of
            # the mean.
            mean = by_w + half * w
            return mean @ mean.T + 2.0 * half @ half.T

    total = np.sum(in_parallel(one, few), axis=0)
    matrix = np.zeros((len(logs), len(logs)))
    matrix[np.ix_(index, index)] = total * (len(flights) / len(few))
    return matrix


def _updated(matrix: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Returns second derivatives that explain the change of a gradient (BFGS).

    H - H s (H s)' / s' H s + y y' / s' y, where both denominators are positive.

    Args:
        matrix: H, the second derivatives before.
        step: s, of the variables.
        change: y, of the gradient.
    """
    expected = matrix @ step
    along = float(step @ change)
    before = float(step @ expected)
    if not (along > 1e-9 and before > 1e-9):
        return matrix
    lost = np.outer(expected, expected) / before
    return matrix - lost + np.outer(change, change) / along
