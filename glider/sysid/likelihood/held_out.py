"""Evidence of candidate effects by cross-validation over flights."""

from collections.abc import Sequence

import numpy as np

from glider.sysid.likelihood.candidates import Candidates
from glider.sysid.likelihood.information import solve_scaled

_MOST_ENTRIES = 1_000_000  # Of matrices that are solved at once, for the memory.
_SLACK = 1e-9  # Rounding by which a bound may be passed.


class HeldOutEvidence:
    """Log-likelihood that columns gain on flights, each held out in turn [nats].

    An error common to all flights is evidence for any effect that imitates it, more of
    it with more flights; cross-validation does not reward that (Stone, J. R. Stat. Soc.
    B 39, 1977). Everything is linear, so that each flight is held out exactly, the
    unknown parameters of the vehicle refitted without it.

    Sets of columns are evaluated together, as arrays (v, m) of v sets of m columns each
    that begin with those that always act.
    """

    def __init__(self, candidates: Candidates, grams: np.ndarray):
        """Takes the information of F flights.

        Args:
            candidates: formulas alone, so that candidate j is column j.
            grams: (F, M + 1, M + 1), that of `Candidates.grams`.
        """
        self._always = np.array(candidates.always, int)
        _, self._prior = candidates.nothing()

        # The information of each flight, of all, and of all others.
        self._own = grams
        self._sum = grams.sum(axis=0, keepdims=True)
        self._rest = self._sum - grams
        self._alone = self._costs(self._always[None])

    def extended(
        self, columns: Sequence[int], more: Sequence[Sequence[int]]
    ) -> list[float]:
        """Returns what columns with each of several others gain over none.

        It is minus infinity where a coefficient is not physical.

        Args:
            columns: those in all sets.
            more: the other columns of each set.
        """
        sets = [[*self._always, *columns, *variant] for variant in more]
        sizes = np.array([len(own) for own in sets])
        gains = np.zeros(len(sets))
        for size in np.unique(sizes[sizes > len(self._always)]):
            # Equally large sets at once, in parts that fit the memory.
            at = np.flatnonzero(sizes == size)
            parts = 1 + len(at) * len(self._own) * size**2 // _MOST_ENTRIES
            for part in np.array_split(at, min(parts, len(at))):
                gains[part] = self._gains(np.array([sets[i] for i in part]))

        return gains.tolist()

    def step(self, columns: Sequence[int]) -> np.ndarray:
        """Returns the coefficients of columns, counted from zero."""
        sets = np.array([[*self._always, *columns]], dtype=int)
        return self._steps(self._sum, sets)[0, 0, len(self._always) :]

    def _gains(self, sets: np.ndarray) -> np.ndarray:
        """Returns what sets of columns (v, m) gain over those that always act, (v,).

        A set is not physical if a coefficient, fitted to all flights, is out of bounds.
        """
        step = self._steps(self._sum, sets)[0]
        lower = self._prior.lower[sets]
        upper = self._prior.upper[sets]
        is_out = step < lower - _SLACK * np.abs(lower)
        is_out |= step > upper + _SLACK * np.abs(upper)

        # Unknown parameters, which always act, may be anywhere.
        is_physical = ~is_out[:, len(self._always) :].any(axis=1)
        gain = np.sum(self._alone - self._costs(sets), axis=0)
        return np.where(is_physical, gain, -np.inf)

    def _steps(self, grams: np.ndarray, sets: np.ndarray) -> np.ndarray:
        """Returns the likeliest changes of coefficients, (n, v, m).

        They solve (G + Λ) δ = g with a set's rows and columns of the information.

        Args:
            grams: n matrices of information, (n, M + 1, M + 1).
            sets: of columns, (v, m).
        """
        precision = self._prior.precision[sets][..., None] * np.eye(sets.shape[1])
        systems = grams[:, sets[..., None], sets[:, None]] + precision
        return solve_scaled(systems, grams[:, sets, -1], 0.0)

    def _costs(self, sets: np.ndarray) -> np.ndarray:
        """Returns the cost (F, v) of each flight, with sets fitted to the others.

        With δ by the other flights it is ½ [-δ; 1]' G [-δ; 1], G the flight's own.
        """
        steps = self._steps(self._rest, sets)

        # The error that is left, as a mix of the set's columns and the error.
        weights = np.concatenate([-steps, np.ones((*steps.shape[:2], 1))], axis=2)

        # The flight's own information on these, (F, v, m + 1, m + 1).
        index = np.pad(sets, ((0, 0), (0, 1)), constant_values=-1)
        own = self._own[:, index[..., None], index[:, None]]
        mixed = (own @ weights[..., None])[..., 0]
        return 0.5 * np.sum(weights * mixed, axis=2)
