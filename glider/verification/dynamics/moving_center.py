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

from glider.compiled.runge_kutta import TINY
from glider.physics.confidence import ALONE, ConfidenceSet, theta_at
from glider.verification.dynamics.nominal import Nominal, advanced, open_loop_rates

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
    if not names:  # One glider: X has no columns.
        nothing = np.zeros((*nominal.states.shape, 0))
        return MovingCenter(
            confidence=confidence,
            times=times,
            shifts=nothing,
            slopes=nothing,
            commands=nothing[:, 0],
        )
    shares = np.arange(1, 2 * _STEPS) / (2 * _STEPS)
    between = [_linear(nominal.between(share), names, held) for share in shares]
    ends = _linear(nominal, names, held)
    flows = nominal.flows
    first = [of[flows] for of in ends]
    last = [of[flows + 1] for of in ends]
    nodes = [first, *between, last]
    A, B, push = ends
    shifts = np.zeros_like(push)
    commands = np.zeros((len(times), len(names)))
    for number, k in enumerate(flows):
        if held and nominal.starts[k] == k:
            before = shifts[max(k - 1, 0)]
            shifts[k] = before
            commands[k] = -nominal.gains[k] @ before
        U = commands[k]
        X = shifts[k]
        step = (times[k + 1] - times[k]) / _STEPS
        for i in range(_STEPS):

            def rate(share, X, first=2 * i, number=number, U=U):
                node = first + round(2.0 * share)
                A, B, push = (of[number] for of in nodes[node])
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
    model = nominal.model
    x = list(nominal.states.T)
    push = np.zeros((*nominal.states.shape, len(names)))
    nudges = TINY * 1j * np.eye(len(names))
    for j, nudge in enumerate(nudges):
        theta = theta_at(model, names, nudge)
        rates = open_loop_rates(model, x, nominal.inputs, theta)
        for i, rate in enumerate(rates):
            push[:, i, j] = np.imag(rate) / TINY
    B = nominal.push_slopes[:, :, 0, 0]
    A = nominal.closed_loop[..., 1 : len(x) + 1]
    if held:
        A = A + B[:, :, None] * nominal.gains[:, None]
    return A, B, push
