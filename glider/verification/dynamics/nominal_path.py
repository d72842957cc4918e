"""The nominal flight between its times, and the feedback about it.

x₀ is the cubic Hermite polynomial through states and slopes; u₀ and the gains are
straight lines. So it is flown, checked and proven.
"""

import dataclasses

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from glider.verification.dynamics.error_dynamics import closed_loop_rates
from glider.verification.dynamics.nominal import Nominal


def nominal_slopes(nominal: Nominal) -> np.ndarray:
    """Returns ẋ₀ (T, n) by the dynamics."""
    x = list(nominal.states.T)
    rates = closed_loop_rates(nominal.model, x, nominal.gains.T, x, nominal.inputs)
    return np.array([np.broadcast_to(rate, len(nominal.times)) for rate in rates]).T


def nominal_path(nominal: Nominal) -> CubicHermiteSpline:
    """Returns x₀ as a function of time."""
    return CubicHermiteSpline(nominal.times, nominal.states, nominal_slopes(nominal))


def nominal_between(nominal: Nominal, share: float) -> Nominal:
    """Returns the flight at one point of each interval, (T - 1) times.

    Args:
        nominal: the flight.
        share: of an interval, where the point is; from 0 to 1.
    """
    times = nominal.times[:-1] + share * np.diff(nominal.times)
    return dataclasses.replace(
        nominal,
        times=times,
        states=nominal_path(nominal)(times),
        inputs=_between(nominal.inputs, share),
        gains=_between(nominal.gains, share),
    )


def _between(values, share):
    return (1.0 - share) * values[:-1] + share * values[1:]
