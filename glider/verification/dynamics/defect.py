"""The defect of a nominal flight: what it lacks to be a flight between its times.

x₀ is the cubic Hermite polynomial through its states and slopes, and u₀ a straight
line. That is a flight except for the defect d = f(x₀, u₀) - ẋ₀, which acts like a
disturbance. On the boundary V = 1 it makes V grow by at most
    2 eᵀ S d <= 2 √(dᵀ S d) <= 2 √(δᵀ |S| δ),  where |d_i| <= δ_i.
Taylor models in time enclose d, so that no time in between is missed.
"""

import numpy as np

from glider.compiled.taylor import INPUT, ROUNDING, WIDER
from glider.verification.dynamics.nominal import Nominal, open_loop_rates
from glider.verification.dynamics.numbers import monomials
from glider.verification.dynamics.taylor_models import Recording, spread

_DEGREE = 5
"""Degree in time; of more, the bounds of the shipped funnels are no lower."""

_PIECES = 4
"""Parts of each interval that are enclosed separately. The bound over a whole one is
five times as large as the defect."""


@np.errstate(all="ignore")  # What is infinite is bounded by infinity.
def defect_bounds(nominal: Nominal) -> np.ndarray:
    """Returns δ (T - 1, n), proven bounds of |d| over each interval of time.

    They are infinite where nothing is proven.
    """
    if not np.all(np.isfinite(nominal.slopes)):
        return np.full_like(nominal.states[1:], np.inf)
    curve = nominal.path.c  # (4, F, n), powers of t - t_k, highest first.
    share = (np.arange(_PIECES) + 0.5) / _PIECES
    steps = np.diff(nominal.times)[nominal.flows]
    table = monomials(1, _DEGREE)
    recording = Recording(table)
    time = recording.add(INPUT, 0)
    values = [(steps[:, None] * share).ravel()]  # Of each input, in the middle.

    def model(powers):
        """Returns Σ powers[j] (t - t_k)ʲ, each (F,), as one Taylor model."""
        total = 0.0
        for power in powers[::-1]:
            total = total * time + recording.add(INPUT, len(values))
            values.append(np.repeat(power, _PIECES))
        return total

    states = []
    slopes = []
    for a3, a2, a1, a0 in np.moveaxis(curve, 2, 0):
        states.append(model([a0, a1, a2, a3]))
        slopes.append(model([a1, 2.0 * a2, 3.0 * a3]))
    u = nominal.inputs[nominal.flows]
    slope = np.diff(nominal.inputs)[nominal.flows] / steps
    rates = open_loop_rates(nominal.model, states, model([u, slope]))
    defects = [rate - slope for rate, slope in zip(rates, slopes, strict=True)]
    inputs = np.zeros((len(values), len(table.degrees), len(values[0])))
    inputs[:, 0] = values
    inputs[0, 1] = np.repeat(steps * (0.5 / _PIECES), _PIECES)
    errors = ROUNDING * (1.0 + np.abs(inputs).sum(axis=1))
    program = recording.program(defects, np.any(inputs != 0.0, axis=2))
    found, left = program.run(inputs, errors)
    sizes = (np.abs(found[:, 0]) + spread(found, left)) * WIDER
    sizes = sizes.reshape(len(sizes), len(steps), _PIECES).max(axis=2)
    bounds = np.zeros_like(nominal.states[1:])
    bounds[nominal.flows] = sizes.T
    return np.where(np.isfinite(bounds), bounds, np.inf)


@np.errstate(all="ignore")
def defect_growth(S: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Returns 2 √(δᵀ |S| δ) at each time (T,), rounded up [1/s].

    At a time, `defect_bounds` (T - 1, n) of both intervals count.
    """
    padded = np.concatenate([bounds[:1], bounds, bounds[-1:]])
    around = np.maximum(padded[:-1], padded[1:])
    square = np.einsum("ti,tij,tj->t", around, np.abs(S), around)
    growth = 2.0 * np.sqrt(square) * WIDER
    return np.where(np.isfinite(growth), growth, np.inf)
