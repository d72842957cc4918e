"""Is anything left? A calibrated test of a model's errors for slow structure.

An effect that a model lacks bends whole flights, so it shows in the slow
cosines of the errors, while the fast ones are noise. The test compares the two,
channel by channel: it needs no noise level from elsewhere, and no model of what
might be missing.
"""

import dataclasses

import numpy as np
from scipy.fft import dct

from glider.sysid.fit.output_error import in_parallel
from glider.sysid.replay.problem import Problem
from glider.sysid.replay.record import Record
from glider.sysid.replay.sensitivity import (
    fitted_start,
    linearize,
)

SLOW_MODES = 10
"""Cosines of each channel that count as slow: up to five periods a flight."""

_LEAST_VARIANCE = 1e-2
"""Least variance of the fast part, over the noise's: no channel is ten times better
than its noise, but a computed one has none."""

CHANNELS = ("x", "z", "pitch", "elevator")


@dataclasses.dataclass(frozen=True, kw_only=True)
class LackOfFit:
    """Slow energy of the errors beyond what their fast part predicts.

    Attributes:
        excess: Σ (slow coefficient / noise)² - degrees of freedom.
        degrees: of freedom of that sum.
        by_channel: the excess of each of CHANNELS.
    """

    excess: float
    degrees: float
    by_channel: dict[str, float]

    @property
    def std(self) -> float:
        """Standard deviation of the excess under the true model."""
        return float(np.sqrt(2.0 * self.degrees * 1.15))

    @property
    def z(self) -> float:
        """Excess in standard deviations."""
        return self.excess / self.std

    @property
    def bound(self) -> float:
        """Excess, no less than zero, and two of its standard deviations."""
        return max(self.excess, 0.0) + 2.0 * self.std


def flight_errors(problem: Problem, theta: np.ndarray) -> list[np.ndarray]:
    """Returns every flight's errors, (n, channels), launch state fitted.

    They are in standard deviations of the noise.
    """

    def one(record: Record) -> np.ndarray:
        flight = linearize(problem, record, theta)
        error = flight.residual - flight.by_start @ fitted_start(flight)
        n = len(record.time)
        channels = [error[: 3 * n].reshape(n, 3)]
        if record.has_servo:
            channels.append(error[3 * n : 4 * n, None])
        return np.hstack(channels)

    return in_parallel(one, problem.records)


def lack_of_fit(problem: Problem, theta: np.ndarray) -> LackOfFit:
    """Tests a model on flights; see the module's docstring."""
    return spectrum_test(flight_errors(problem, theta))


def spectrum_test(errors: list[np.ndarray]) -> LackOfFit:
    """Compares the slow and the fast cosines of errors, (n, channels) a flight."""
    spectra = [dct(e, axis=0, norm="ortho") for e in errors]
    channels = spectra[0].shape[1]
    modes = [min(SLOW_MODES, len(s) // 4) for s in spectra]
    fast = np.array(
        [
            np.mean(np.concatenate([s[len(s) // 2 :, c] ** 2 for s in spectra]))
            for c in range(channels)
        ]
    )
    slow = np.array(
        [
            sum(np.sum(s[:m, c] ** 2) for s, m in zip(spectra, modes, strict=True))
            for c in range(channels)
        ]
    )
    fast = np.maximum(fast, _LEAST_VARIANCE)
    # A launch state (six numbers, and the elevator's zero) is fitted per flight.
    start = np.array([2.0, 2.0, 2.0, 1.0])[:channels] * len(spectra)
    degrees = float(sum(modes)) - start
    excess = slow / fast - degrees
    return LackOfFit(
        excess=float(excess.sum()),
        degrees=float(degrees.sum()),
        by_channel=dict(zip(CHANNELS, excess.tolist(), strict=False)),
    )
