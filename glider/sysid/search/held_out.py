"""How well sets of effects predict flights that they were not fitted to."""

from collections.abc import Sequence

import numpy as np

from glider.sysid.likelihood.candidates import Candidates
from glider.sysid.likelihood.information import solve_scaled


class HeldOutEvidence:
    """Log-likelihood that columns gain on flights, each held out in turn [nats].

    No formula is exact, and an error common to all flights is evidence for any effect
    that imitates it, more of it with more flights. Held-out flights do not reward that:
    cross-validation is robust to models that are all wrong (Stone, J. R. Stat. Soc.
    B 44, 1977). Everything is linear, so that each flight is held out exactly, the
    unknown parameters of the vehicle refitted without it.
    """

    def __init__(self, candidates: Candidates, grams: np.ndarray, counts: np.ndarray):
        """Takes the flights' information and how often each counts."""
        drawn = np.flatnonzero(counts)
        whole, value, mean, precision = candidates.from_nothing(grams[drawn])
        self._own, self._counts = whole, counts[drawn]
        times = self._counts[:, None, None]
        self._rest = np.sum(times * whole, axis=0) - times * whole
        self._sum = np.sum(times * whole, axis=0)
        self._value, self._mean, self._precision = value, mean, precision
        self._always = list(candidates.always)
        always = set(self._always)
        slots = [d.slot for d in candidates.directions]
        self._place = [j for j in range(len(slots)) if j not in always]
        layout = candidates.task.layout
        self._lower = layout.lower[slots] - value[: len(slots)]
        self._upper = layout.upper[slots] - value[: len(slots)]
        self._alone = self._costs(np.array(self._always, dtype=np.int64))

    def log_marginal(self, columns: Sequence[int]) -> float:
        """Gain of columns over none; -inf where they are not physical."""
        if not columns:
            return 0.0
        own = [self._place[j] for j in columns]
        index = np.array([*self._always, *own])
        step = self.step(columns)
        if np.any(step < self._lower[own] - _SLACK * np.abs(self._lower[own])):
            return -np.inf
        if np.any(step > self._upper[own] + _SLACK * np.abs(self._upper[own])):
            return -np.inf
        return float(self._counts @ (self._alone - self._costs(index)))

    def step(self, columns: Sequence[int]) -> np.ndarray:
        """Returns the coefficients of columns, counted from zero."""
        index = np.array([*self._always, *(self._place[j] for j in columns)])
        return self._steps(self._sum[None], index)[0, len(self._always) :]

    def _steps(self, grams: np.ndarray, index: np.ndarray) -> np.ndarray:
        """Returns the most likely changes of some columns, (n, k)."""
        precision = self._precision[index]
        system = grams[:, index[:, None], index] + np.diag(precision)
        side = grams[:, index, -1] + precision * (self._mean - self._value)[index]
        return solve_scaled(system, side, 0.0)

    def _costs(self, index: np.ndarray) -> np.ndarray:
        """Returns each flight's cost by what the others say of some columns (n,)."""
        steps = self._steps(self._rest, index) if len(index) else None
        last = self._own.shape[-1] - 1
        every = np.append(index, last)
        if steps is None:
            return 0.5 * self._own[:, last, last]
        weights = np.concatenate([-steps, np.ones((len(steps), 1))], axis=1)
        own = self._own[:, every[:, None], every]
        return 0.5 * np.einsum("fi,fij,fj->f", weights, own, weights)


_SLACK = 1e-9
"""Rounding by which a bound may be passed."""
