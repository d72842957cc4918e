"""Where the gliders of a confidence set fly, to first order: the center moves along.

A glider whose numbers deviate by δ from the estimate c₀ flies near x₀ + X δ, with
    Ẋ = F₁ X + ∂f/∂c,  X(0) = 0,
F₁ of the closed loop (docs/certificate.md). With x = x₀ + X δ + e its deviation follows
    ė = p(e) + R(e, δ),  p of the estimate,
and R is all that is left, the Taylor remainder and what the glider does otherwise.
"""

import dataclasses

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from glider.control.predictor import advance
from glider.errors import InputError
from glider.physics.confidence import ConfidenceSet, theta_at
from glider.verification.dynamics.nominal import Nominal, closed_loop_rates

STEPS = 4
"""Runge-Kutta steps between two times; twice as many change X by less than 1e-5."""

_TINY = 1e-30
"""Step of a complex difference quotient."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class MovingCenter:
    """The center of a funnel for each glider of a confidence set: x₀ + X δ."""

    confidence: ConfidenceSet  #: Set of the deviations δ (m,).
    times: np.ndarray  #: Times (T,) [s].
    shifts: np.ndarray  #: X (T, n, m).
    slopes: np.ndarray  #: Ẋ (T, n, m) [1/s].

    def at(self, times: np.ndarray | float, deviation: np.ndarray) -> np.ndarray:
        """Returns X δ (..., n) at times within the flight, for one δ (m,)."""
        curve = CubicHermiteSpline(self.times, self.shifts, self.slopes)
        return curve(np.clip(times, self.times[0], self.times[-1])) @ deviation

    def between(self, first: int, last: int) -> "MovingCenter":
        """Returns the part from one of the times to another, given their indices."""
        here = slice(first, last + 1)
        parts = {k: getattr(self, k)[here] for k in ("times", "shifts", "slopes")}
        return dataclasses.replace(self, **parts)


def make_moving_center(nominal: Nominal, confidence: ConfidenceSet) -> MovingCenter:
    """Integrates X along a nominal flight.

    Raises:
        InputError: its commands are held.
    """
    if len(nominal.flows) < len(nominal.times) - 1:
        raise InputError("A funnel of a set of gliders cannot have held commands.")
    times, names = nominal.times, confidence.names
    starts = _linear(nominal, names)
    shares = np.arange(1, 2 * STEPS) / (2 * STEPS)
    between = [_linear(nominal.between(share), names) for share in shares]
    shifts = np.zeros_like(starts[1])
    for k, step in enumerate(np.diff(times) / STEPS):
        nodes = [(F1[k], push[k]) for F1, push in (starts, *between)]
        nodes.append((starts[0][k + 1], starts[1][k + 1]))
        X = shifts[k]
        for i in range(STEPS):

            def rate(X, since, first=2 * i, step=step, nodes=nodes):
                F1, push = nodes[first + round(2.0 * since / step)]
                return F1 @ X + push

            X = advance(rate, X, step)
        shifts[k + 1] = X
    slopes = starts[0] @ shifts + starts[1]
    return MovingCenter(
        confidence=confidence, times=times, shifts=shifts, slopes=slopes
    )


def _linear(nominal, names):
    """Returns F₁ (T, n, n) and ∂f/∂c (T, n, m) along a flight."""
    x, push = list(nominal.states.T), np.zeros((*nominal.states.shape, len(names)))
    for j, nudge in enumerate(_TINY * 1j * np.eye(len(names))):
        theta = theta_at(nominal.model, names, nudge)
        given = nominal.model, x, nominal.gains.T, x, nominal.inputs, theta
        for i, rate in enumerate(closed_loop_rates(*given)):
            push[:, i, j] = np.imag(rate) / _TINY
    return nominal.closed_loop[..., 1 : len(x) + 1], push
