"""Acausal smoothing of measured poses, with the noise level found from the data.

Each channel is a Gaussian process whose derivative of some order is white noise, plus
a free polynomial of a lower degree, observed in white noise (the smoothing spline in
its Bayesian form; Wahba 1978, Rasmussen and Williams ch. 6). The third derivative is
that of poses. The ratio of the two noises is shared by the flights of a campaign and
maximises the restricted likelihood. Times may be irregular and rows may be missing.
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
_LOG_RATIOS = np.linspace(-10.0, 60.0, 71)  # That are tried first.
_POSE_ORDER = 3  # Order of the derivative of a pose that is white noise.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Smoothing:
    """Noise found in one channel of a campaign."""

    noise: float  #: Standard deviation of the measurement [unit of the channel].
    ratio: float  #: Power of the derivative over noise² [1/s⁵ of a third one].
    evidence: float  #: Log-likelihood gained over noise about polynomials [nats].
    log_likelihood: float  #: Of the samples, but for a constant [nats].


def estimate_noise(
    times: Sequence[np.ndarray], values: Sequence[np.ndarray], order: int = _POSE_ORDER
) -> tuple[Smoothing, ...]:
    """Finds noise and smoothness of each channel over flights.

    Of each flight, times (n,) [s] and values (n, channels); `order` is that of the
    derivative that is white noise.
    """
    spectra = [_spectrum(_grid(time, time[0]), order) for time in times]
    eigenvalues = np.concatenate([own for own, _ in spectra])
    pairs = zip(spectra, values, strict=True)
    projections = np.concatenate([basis.T @ value for (_, basis), value in pairs])
    return tuple(_restricted_likelihood(eigenvalues, z) for z in projections.T)


@functools.lru_cache(_GRIDS)
def _spectrum(grid: bytes, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Spectrum of the covariance but polynomials.

    Returns eigenvalues (n - order,) and eigenvectors (n, n - order).
    """
    t = np.frombuffer(grid)
    null = np.linalg.qr(_polynomial(t, order), mode="complete")[0][:, order:]
    eigenvalues, vectors = np.linalg.eigh(null.T @ _covariance(t, t, order) @ null)
    return np.maximum(eigenvalues, 0.0), null @ vectors


def _restricted_likelihood(eigenvalues: np.ndarray, z: np.ndarray) -> Smoothing:
    """Maximises the likelihood of z ~ N(0, noise² (1 + ratio · eigenvalues))."""

    def deviance(log_ratio: float) -> float:
        scale = 1.0 + np.exp(log_ratio) * eigenvalues
        return len(z) * np.log(np.mean(z * z / scale) + 1e-300) + np.sum(np.log(scale))

    best = _LOG_RATIOS[np.argmin([deviance(v) for v in _LOG_RATIOS])]
    result = minimize_scalar(
        deviance, bounds=(best - 1.5, best + 1.5), method="bounded"
    )
    ratio = float(np.exp(result.x))
    scale = 1.0 + ratio * eigenvalues
    of_noise = len(z) * np.log(np.mean(z * z) + 1e-300)
    return Smoothing(
        noise=float(np.sqrt(np.mean(z * z / scale))),
        ratio=ratio,
        evidence=0.5 * float(of_noise - result.fun),
        log_likelihood=-0.5 * float(result.fun),
    )


def smoothing_maps(
    time: np.ndarray, query: np.ndarray, ratio: float, order: int = _POSE_ORDER
) -> np.ndarray:
    """Returns the linear maps from samples to smoothed curves, shape (order, m, n).

    From samples at times (n,) to the value at the query times (m,) [s], and of a third
    order to its first and second derivative; order and ratio are those of a Smoothing.
    White noise in the samples has the variance noise² · (sum of squares of a map's row)
    in the curve.
    """
    return _maps(_grid(time, time[0]), _grid(query, time[0]), ratio, order)


@functools.lru_cache(3 * _GRIDS)
def _maps(time: bytes, query: bytes, ratio: float, order: int) -> np.ndarray:
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
    return np.round(time - start, _NANOSECONDS).tobytes()


def _covariance(
    s: np.ndarray, t: np.ndarray, order: int, derivative: int = 0
) -> np.ndarray:
    """Covariance of a derivative at s and the value at t (unit power).

    Up to polynomials, which are free: with k = 2 order - 1, that of the value is
    (-1)^order |s - t|^k / (2 k!).
    """
    apart = s[:, None] - t
    power = 2 * order - 1 - derivative
    size = np.abs(apart) ** power
    if derivative % 2:
        size *= np.sign(apart)
    return (-1) ** order * size / (2 * math.factorial(power))


def _polynomial(t: np.ndarray, order: int, derivative: int = 0) -> np.ndarray:
    """Columns (n, order) of a derivative of the free polynomial tᵏ / k!."""
    powers = np.arange(order) - derivative
    return t[:, None] ** np.maximum(powers, 0) * rgamma(powers + 1.0)
