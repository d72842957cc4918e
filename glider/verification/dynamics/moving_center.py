"""Where the gliders of a confidence set fly, to first order: the center moves along.

A glider whose numbers deviate by δ from the estimate c₀ flies near x₀ + X δ, with
    Ẋ = ∂f/∂x X + ∂f/∂u U + ∂f/∂c,  X(0) = 0,  U = -K X,
where a command that is held keeps the U of its sample (docs/certificate.md). With
x = x₀ + X δ + e its deviation follows
    ė = p(e) + R(e, δ),  p of the estimate,
and R is all that is left, the Taylor remainder and what the glider does otherwise.
"""

import dataclasses

import numpy as np

from glider.physics.confidence import ALONE, ConfidenceSet
from glider.verification.dynamics.nominal import Nominal, advanced, expand

_STEPS = 4
"""Runge-Kutta steps between two times; twice as many change X by less than 1e-5."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class MovingCenter:
    """The center of a funnel for each glider of a confidence set: x₀ + X δ.

    It may be the set of one glider, of which no number deviates.
    """

    confidence: ConfidenceSet  #: Set of the deviations δ (m,).
    times: np.ndarray  #: Times (T,) [s].
    shifts: np.ndarray  #: X (T, n, m).
    slopes: np.ndarray  #: Ẋ (T, n, m) [1/s].
    commands: np.ndarray  #: U (T, m): the command there is u₀ + U δ.

    def part(self, which: slice) -> "MovingCenter":
        """Returns the centers at some of the times."""
        names = "times", "shifts", "slopes", "commands"
        parts = {name: getattr(self, name)[which] for name in names}
        return dataclasses.replace(self, **parts)


def make_moving_center(
    nominal: Nominal, confidence: ConfidenceSet = ALONE, held: bool = False
) -> MovingCenter:
    """Integrates X along a nominal flight; its commands may be held."""
    times = nominal.times
    names = confidence.names
    # For one glider X has no columns, and there is nothing to integrate.
    shares = np.arange(2 * _STEPS + 1) / (2 * _STEPS) if names else ()
    nodes = [_linear(nominal.between(share), names, held) for share in shares]
    A, B, push = _linear(nominal, names, held)
    shifts = np.zeros_like(push)
    commands = np.zeros((len(times), len(names)))
    for number, k in enumerate(nominal.flows if names else ()):
        if held and nominal.starts[k] == k:
            shifts[k] = shifts[max(k - 1, 0)]
            commands[k] = -nominal.gains[k] @ shifts[k]
        U = commands[k]
        X = shifts[k]
        step = (times[k + 1] - times[k]) / _STEPS
        for i in range(_STEPS):

            def rate(share, X, first=2 * i, number=number, U=U):
                A, B, push = (of[number] for of in nodes[first + round(2.0 * share)])
                return A @ X + np.outer(B, U) + push

            X = advanced(rate, X, step)
        shifts[k + 1] = X
        commands[k + 1] = U
    slopes = A @ shifts + B[:, :, None] * commands[:, None] + push
    if not held:
        commands = -np.einsum("ti,tim->tm", nominal.gains, shifts)
    return MovingCenter(
        confidence=confidence,
        times=times,
        shifts=shifts,
        slopes=slopes,
        commands=commands,
    )


def _linear(nominal, names, held):
    """Returns A (T, n, n), B (T, n) and ∂f/∂c (T, n, m) along a flight.

    A is of the closed loop, or of the glider alone if its commands are held.
    """
    n = nominal.states.shape[1]
    still = np.zeros((len(names), len(nominal.times)))
    values = np.vstack([nominal.states.T, nominal.inputs, still])
    slopes = expand(nominal.model, values, 1, names)[..., 1:]
    A, B, push = np.split(slopes, [n, n + 1], axis=2)
    if not held:
        A = A - B * nominal.gains[:, None]
    return A, B[..., 0], push
