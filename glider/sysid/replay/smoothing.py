"""Acausal smoothing of measured poses, with the noise level found from the data.

Each channel is a Gaussian process whose third derivative is white noise, plus a
free parabola, observed in white noise (the quintic smoothing spline in its
Bayesian form; Wahba 1978, Rasmussen and Williams ch. 6). The ratio of the two
noises is shared by the flights of a campaign and maximises the restricted
likelihood. Times may be irregular and rows may be missing.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from glider.campaign.checks.masks import Masks, no_masks
from glider.campaign.logs import Campaign
from glider.physics.actuator_replay import command_steps, elevator_path
from glider.sysid.constants import FEWEST_ELEVATOR_ROWS

# Least noise of a log [m, rad]; a computed column has no noise at all.
_LEAST_POSITION, _LEAST_ANGLE = 1e-6, 1e-5
_NANOSECONDS = 9  # Decimals of times [s] within which two grids are the same.
_GRIDS = 32  # Grids of times whose maps are kept.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Smoothing:
    """Noise found in one channel of a campaign."""

    noise: float  #: Standard deviation of the measurement [unit of the channel].
    ratio: float  #: Power of the third derivative over noise² [1/s⁵].


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
    elevator, times, errors = 0.0, [], []
    for flight, mask in pairs if campaign.elevator == "servo" else ():
        seen = ~mask.elevator
        if np.count_nonzero(seen) >= FEWEST_ELEVATOR_ROWS:
            assert flight.command is not None and flight.elevator is not None
            tape = command_steps(flight.time, flight.command, campaign.switch_rate)
            error = flight.elevator - elevator_path(*tape, flight.time)
            times.append(flight.time[seen])
            errors.append(error[seen, None])
    if errors:
        elevator = estimate_noise(times, errors)[0].noise
    position = float(np.sqrt(np.mean([s.noise**2 for s in smoothing[:2]])))
    return Noise(
        position=max(position, _LEAST_POSITION),
        pitch=max(smoothing[2].noise, _LEAST_ANGLE),
        elevator=max(elevator, _LEAST_ANGLE),
        smoothing=smoothing,
    )


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
    t, s = np.frombuffer(time), np.frombuffer(query)
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
    zero, one = np.zeros_like(t), np.ones_like(t)
    columns = [zero, zero, one, t, 0.5 * t * t]
    return np.stack(columns[2 - derivative : 5 - derivative], axis=1)
