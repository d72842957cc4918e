"""Acausal smoothing of measured poses, with the noise level found from the data.

A channel is a Gaussian process whose derivative of some order is white noise, plus a
free polynomial of a lower degree, observed in white noise (the smoothing spline in its
Bayesian form; Wahba 1978, Rasmussen and Williams ch. 6):

    y = f(t) + P(t) β + e,   f ~ N(0, noise² ratio K),   e ~ N(0, noise²)

with K of `_covariance` and P of `_polynomial`. For poses it is the third derivative.
All flights of a campaign share noise and ratio. `estimate_noise` finds them by maximum
restricted likelihood: that of the samples projected onto the orthogonal complement of
the polynomials. `smoothing_maps` evaluates the posterior means of the curve and of its
derivatives. Times may be irregular and rows may be missing.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import rgamma

_NANOSECONDS = 9  # Decimals of times [s] within which two grids are the same.
_GRIDS = 32  # Grids of times whose maps are kept.
_LOG_RATIOS = np.linspace(-10.0, 60.0, 71)  # Those that are tried first.
_POSE_ORDER = 3  # Order of the derivative of a pose that is white noise.
_TINY = 1e-300  # Variance that keeps the logarithm of a perfect fit finite.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Smoothing:
    """Noise found in one channel of a campaign.

    Attributes:
        noise: standard deviation of the measurement [unit of the channel].
        ratio: power of the derivative over noise² [1/s⁵ of a third one].
        evidence: log-likelihood gained over noise about polynomials [nats].
        log_likelihood: of the samples, but for a constant [nats].
    """

    noise: float
    ratio: float
    evidence: float
    log_likelihood: float


def estimate_noise(
    times: Sequence[np.ndarray], values: Sequence[np.ndarray], order: int = _POSE_ORDER
) -> tuple[Smoothing, ...]:
    """Finds noise and smoothness of each channel over flights.

    Args:
        times: of each flight, (n,) [s].
        values: of each flight, (n, channels).
        order: of the derivative that is white noise.

    Returns:
        One Smoothing for each channel.
    """
    eigenvalues = []
    projections = []
    for time, samples in zip(times, values, strict=True):
        own, basis = _spectrum(_grid(time, time[0]), order)
        eigenvalues.append(own)
        projections.append(basis.T @ samples)
    pooled = np.concatenate(eigenvalues)
    projected = np.concatenate(projections)
    return tuple(_restricted_likelihood(pooled, z) for z in projected.T)


@functools.lru_cache(_GRIDS)
def _spectrum(grid: bytes, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Spectrum of the covariance on the complement of the polynomials.

    Args:
        grid: n times, as `_grid` packs them.
        order: of the derivative that is white noise.

    Returns:
        Eigenvalues (n - order,) and orthonormal eigenvectors (n, n - order) of the
        covariance of a process of unit power, projected onto that complement.
    """
    t = np.frombuffer(grid)
    null = np.linalg.qr(_polynomial(t, order), mode="complete").Q[:, order:]
    projected = null.T @ _covariance(t, t, order) @ null
    eigenvalues, vectors = np.linalg.eigh(projected)
    return np.maximum(eigenvalues, 0.0), null @ vectors


def _restricted_likelihood(eigenvalues: np.ndarray, z: np.ndarray) -> Smoothing:
    """Maximizes the likelihood of z ~ N(0, noise² (1 + ratio · eigenvalues)).

    The best noise at a ratio is known in closed form; the ratio is searched on a grid
    of logarithms, then between the neighbors of the best.

    Args:
        eigenvalues: (k,) of the covariances of all flights.
        z: (k,) one channel's samples, projected on the eigenvectors.
    """
    squares = z * z

    def deviance(log_ratio: float) -> float:
        """Minus twice the log-likelihood at the best noise, but for a constant."""
        scale = 1.0 + np.exp(log_ratio) * eigenvalues
        variance = np.mean(squares / scale)
        return len(z) * np.log(variance + _TINY) + np.sum(np.log(scale))

    best = _LOG_RATIOS[np.argmin([deviance(v) for v in _LOG_RATIOS])]
    result = minimize_scalar(
        deviance, bounds=(best - 1.5, best + 1.5), method="bounded"
    )
    ratio = float(np.exp(result.x))
    variance = np.mean(squares / (1.0 + ratio * eigenvalues))
    of_noise = len(z) * np.log(np.mean(squares) + _TINY)
    return Smoothing(
        noise=float(np.sqrt(variance)),
        ratio=ratio,
        evidence=0.5 * float(of_noise - result.fun),
        log_likelihood=-0.5 * float(result.fun),
    )


def smoothing_maps(
    time: np.ndarray, query: np.ndarray, ratio: float, order: int = _POSE_ORDER
) -> np.ndarray:
    """Returns the linear maps from samples to the smoothed curve and its derivatives.

    White noise in the samples has the variance noise² · (sum of squares of a map's row)
    in the curve.

    Args:
        time: (n,) of the samples [s].
        query: (m,) of the points of the curve [s].
        ratio: of a Smoothing.
        order: of the derivative that is white noise, as for the Smoothing.

    Returns:
        Maps (order, m, n): to the value, and of a third order to the first and second
        derivative.
    """
    return _maps(_grid(time, time[0]), _grid(query, time[0]), ratio, order)


@functools.lru_cache(3 * _GRIDS)
def _maps(time: bytes, query: bytes, ratio: float, order: int) -> np.ndarray:
    """The maps of `smoothing_maps`, from times as `_grid` packs them.

    With W = (1 + ratio K)⁻¹ on the complement of the polynomials, the process has the
    posterior mean ratio K(s, t) W y. The polynomial is what is left at the samples,
    y - W y - ratio K(t, t) W y = P(t) β; W y is the noise.
    """
    t = np.frombuffer(time)
    s = np.frombuffer(query)
    eigenvalues, basis = _spectrum(time, order)
    weights = basis / (1.0 + ratio * eigenvalues) @ basis.T
    left = np.eye(len(t)) - weights - ratio * _covariance(t, t, order) @ weights
    free = np.linalg.lstsq(_polynomial(t, order), left, rcond=None)[0]
    curves = []
    for derivative in range(order):
        process = ratio * _covariance(s, t, order, derivative) @ weights
        curves.append(process + _polynomial(s, order, derivative) @ free)
    return np.stack(curves)


def _grid(time: np.ndarray, start: float) -> bytes:
    """Packs times (n,) since a start [s], rounded, as the key of a cache."""
    return np.round(time - start, _NANOSECONDS).tobytes()


def _covariance(
    s: np.ndarray, t: np.ndarray, order: int, derivative: int = 0
) -> np.ndarray:
    """Covariance (m, n) of a derivative at s (m,) and the value at t (n,).

    It is that of a process of unit power, up to polynomials, which are free. With
    k = 2 order - 1, the covariance of two values is (-1)^order |s - t|^k / (2 k!).
    """
    apart = s[:, None] - t
    power = 2 * order - 1 - derivative
    size = np.abs(apart) ** power
    if derivative % 2:
        size *= np.sign(apart)
    return (-1) ** order * size / (2 * math.factorial(power))


def _polynomial(t: np.ndarray, order: int, derivative: int = 0) -> np.ndarray:
    """A derivative of the powers tᵏ / k! of the free polynomial, (n, order).

    1 / Γ(k + 1) is 1 / k!, and zero where the derivative has removed a power.
    """
    powers = np.arange(order) - derivative
    return t[:, None] ** np.maximum(powers, 0) * rgamma(powers + 1.0)
