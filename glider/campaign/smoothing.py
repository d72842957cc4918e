"""Acausal smoothing of measured poses, with the noise level found from the data.

Each channel is a Gaussian process whose third derivative is white noise, plus a
free parabola, observed in white noise (the quintic smoothing spline in its
Bayesian form; Wahba 1978, Rasmussen and Williams ch. 6). The ratio of the two
noises is shared by the flights of a campaign and maximises the restricted
likelihood. Times may be irregular and rows may be missing.
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar

_NANOSECONDS = 9  # Decimals of times [s] within which two grids are the same.
_GRIDS = 32  # Grids of times whose maps are kept.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Smoothing:
    """Noise found in one channel of a campaign."""

    noise: float  #: Standard deviation of the measurement [unit of the channel].
    ratio: float  #: Power of the third derivative over noise² [1/s⁵].


def estimate_noise(
    times: Sequence[np.ndarray], values: Sequence[np.ndarray]
) -> tuple[Smoothing, ...]:
    """Finds noise and smoothness of each channel over flights.

    Of each flight, times (n,) [s] and values (n, channels).
    """
    spectra = [_spectrum(_grid(time, time[0])) for time in times]
    eigenvalues = np.concatenate([own for own, _ in spectra])
    pairs = zip(spectra, values, strict=True)
    projections = np.concatenate([basis.T @ value for (_, basis), value in pairs])
    return tuple(_restricted_likelihood(eigenvalues, z) for z in projections.T)


@functools.lru_cache(_GRIDS)
def _spectrum(grid: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (n - 3,) and vectors (n, n - 3) of the covariance but parabolas."""
    t = np.frombuffer(grid)
    null = np.linalg.qr(_parabola(t), mode="complete")[0][:, 3:]
    eigenvalues, vectors = np.linalg.eigh(null.T @ _covariance(t, t) @ null)
    return np.maximum(eigenvalues, 0.0), null @ vectors


def _restricted_likelihood(eigenvalues: np.ndarray, z: np.ndarray) -> Smoothing:
    """Maximises the likelihood of z ~ N(0, noise² (1 + ratio · eigenvalues))."""

    def deviance(log_ratio: float) -> float:
        scale = 1.0 + np.exp(log_ratio) * eigenvalues
        return len(z) * np.log(np.mean(z * z / scale) + 1e-300) + np.sum(np.log(scale))

    coarse = np.linspace(0.0, 60.0, 61)
    best = coarse[np.argmin([deviance(v) for v in coarse])]
    result = minimize_scalar(
        deviance, bounds=(best - 1.5, best + 1.5), method="bounded"
    )
    ratio = float(np.exp(result.x))
    scale = 1.0 + ratio * eigenvalues
    return Smoothing(noise=float(np.sqrt(np.mean(z * z / scale))), ratio=ratio)


def smoothing_maps(time: np.ndarray, query: np.ndarray, ratio: float) -> np.ndarray:
    """Returns the linear maps from samples to smoothed curves, shape (3, m, n).

    From samples at times (n,) to the value and its first and second derivative at
    the query times (m,) [s]; the ratio is that of Smoothing. White noise in the samples
    has the variance noise² · (sum of squares of a map's row) in the curve.
    """
    return _maps(_grid(time, time[0]), _grid(query, time[0]), ratio)


@functools.lru_cache(3 * _GRIDS)
def _maps(time: bytes, query: bytes, ratio: float) -> np.ndarray:
    t = np.frombuffer(time)
    s = np.frombuffer(query)
    eigenvalues, basis = _spectrum(time)
    weights = basis / (1.0 + ratio * eigenvalues) @ basis.T
    left = np.eye(len(t)) - weights - ratio * _covariance(t, t) @ weights
    free = np.linalg.lstsq(_parabola(t), left, rcond=None)[0]
    curves = [[ratio * _covariance(s, t, d), _parabola(s, d)] for d in range(3)]
    return np.stack([curve @ weights + parabola @ free for curve, parabola in curves])


def _grid(time: np.ndarray, start: float) -> bytes:
    return np.round(time - start, _NANOSECONDS).tobytes()


def _covariance(s: np.ndarray, t: np.ndarray, derivative: int = 0) -> np.ndarray:
    """Covariance of a derivative at s and the value at t (unit power).

    Up to parabolas, which are free: that of the value is -|s - t|⁵ / (2 · 5!).
    """
    apart = s[:, None] - t
    square = apart * apart
    cube = np.abs(apart) * square
    return (-square * cube / 240.0, -apart * cube / 48.0, -cube / 12.0)[derivative]


def _parabola(t: np.ndarray, derivative: int = 0) -> np.ndarray:
    """Columns (n, 3) of a derivative of a free parabola."""
    zero = np.zeros_like(t)
    one = np.ones_like(t)
    columns = [zero, zero, one, t, 0.5 * t * t]
    return np.stack(columns[2 - derivative : 5 - derivative], axis=1)
