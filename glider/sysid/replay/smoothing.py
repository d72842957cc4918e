"""Acausal smoothing of measured poses, with the noise level found from the data.

Each channel is a Gaussian process whose third derivative is white noise, plus a
free parabola, observed in white noise (the quintic smoothing spline in its
Bayesian form; Wahba 1978, Rasmussen and Williams ch. 6). The ratio of the two
noises is shared by the flights of a campaign and maximises the restricted
likelihood. Times may be irregular and rows may be missing.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from scipy.optimize import minimize_scalar

from glider.campaign.checks.masks import Masks, no_masks
from glider.campaign.logs import Campaign
from glider.physics.actuator_replay import command_steps, elevator_path

_NUM_POLYNOMIAL = 3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Smoothing:
    """Noise found in one channel of a campaign."""

    noise: float  #: Standard deviation of the measurement [unit of the channel].
    ratio: float  #: Power of the third derivative over noise² [1/s⁵].


def _covariance(s: np.ndarray, t: np.ndarray, derivative: int = 0) -> np.ndarray:
    """Covariance of a derivative at s and the value at t (unit power).

    ∫₀^min(s,t) (s-u)^(2-i)/(2-i)! · (t-u)²/2 du, for the i-th derivative.
    """
    low = np.minimum.outer(s, t)
    at_s, at_t = _power(s[:, None] - low, 2 - derivative), _power(t - low, 2)
    total = np.zeros_like(low)
    for m, u in enumerate(at_s):
        for n, v in enumerate(at_t):
            total += u * v * low ** (m + n + 1) / (m + n + 1)
    return total


def _power(a: np.ndarray, order: int) -> list[np.ndarray]:
    """Coefficients in w of (a + w)^order / order!, with w = low - u."""
    one = np.ones_like(a)
    return [[one], [a, one], [0.5 * a * a, a, 0.5 * one]][order]


def _polynomial(t: np.ndarray, derivative: int = 0) -> np.ndarray:
    zero = np.zeros_like(t)
    columns = [zero, zero, np.ones_like(t), t, 0.5 * t * t]
    return np.stack(columns[2 - derivative : 5 - derivative], axis=1)


def estimate_noise(
    times: list[np.ndarray], values: list[np.ndarray]
) -> tuple[Smoothing, ...]:
    """Finds noise and smoothness of each channel over the flights of a campaign.

    Args:
        times: one array (n,) a flight [s].
        values: one array (n, channels) a flight.
    """
    spectra, data = [], []
    grids: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    for time, value in zip(times, values, strict=True):
        t = time - time[0]
        key = np.round(t, 7).tobytes()
        if key not in grids:
            q, _ = np.linalg.qr(_polynomial(t), mode="complete")
            null = q[:, _NUM_POLYNOMIAL:]
            covariance = null.T @ _covariance(t, t) @ null
            eigenvalues, vectors = np.linalg.eigh(covariance)
            grids[key] = np.maximum(eigenvalues, 0.0), null @ vectors
        eigenvalues, basis = grids[key]
        spectra.append(eigenvalues)
        data.append(basis.T @ value)
    spectrum, projections = np.concatenate(spectra), np.concatenate(data)
    return tuple(_restricted_likelihood(spectrum, z) for z in projections.T)


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

    They give the value and the first and second derivative at the query times.
    White noise in the samples has the variance noise² · (sum of squares of a
    map's row) in the curve.

    Args:
        time: (n,) of the samples [s].
        query: (m,) of the curves [s].
        ratio: as in Smoothing.
    """
    t, s = time - time[0], query - time[0]
    n = len(t)
    system = np.zeros((n + _NUM_POLYNOMIAL, n + _NUM_POLYNOMIAL))
    system[:n, :n] = ratio * _covariance(t, t) + np.eye(n)
    system[:n, n:] = _polynomial(t)
    system[n:, :n] = system[:n, n:].T
    inverse = np.linalg.inv(system)[:, :n]
    curves = [[ratio * _covariance(s, t, d), _polynomial(s, d)] for d in range(3)]
    return np.stack([np.hstack(curve) @ inverse for curve in curves])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Noise:
    """Standard deviation of the measurements, and what smooths them."""

    position: float  #: Of x and z [m].
    pitch: float  #: [rad].
    elevator: float  #: [rad]; 0 without a servo.
    smoothing: tuple[Smoothing, ...]  #: Of the channels x, z, pitch.


def measure_noise(
    campaign: Campaign, masks: Mapping[str, Masks] | None = None
) -> Noise:
    """Finds the noise of a campaign's channels from all its flights."""
    masks = masks or {}
    pairs = [(f, masks.get(f.name) or no_masks(f)) for f in campaign.flights]
    times = [f.time[m.usable] for f, m in pairs]
    smoothing = estimate_noise(times, [f.pose[m.usable] for f, m in pairs])
    position = float(np.sqrt(np.mean([s.noise**2 for s in smoothing[:2]])))
    elevator, times, errors = 0.0, [], []
    for flight, mask in pairs if campaign.elevator == "servo" else ():
        seen = ~mask.elevator
        if np.count_nonzero(seen) >= _FEWEST_ROWS:
            assert flight.command is not None and flight.elevator is not None
            tape = command_steps(flight.time, flight.command, campaign.switch_rate)
            error = flight.elevator - elevator_path(*tape, flight.time)
            times.append(flight.time[seen])
            errors.append(error[seen, None])
    if errors:
        elevator = estimate_noise(times, errors)[0].noise
    return Noise(
        position=max(position, _LEAST_POSITION),
        pitch=max(smoothing[2].noise, _LEAST_ANGLE),
        elevator=max(elevator, _LEAST_ANGLE),
        smoothing=smoothing,
    )


_FEWEST_ROWS = 10
"""Rows of an elevator below which a flight shows nothing of its noise."""

_LEAST_POSITION = 1e-6
_LEAST_ANGLE = 1e-5
"""Least noise of a log [m, rad]; a computed column has no noise at all."""
