"""Columns of a flight that free functions add, see `LinearFlight.with_forces`."""

from typing import NamedTuple

import numpy as np


class AddedColumns(NamedTuple):
    """Columns of functions times some terms, made only when a flight is whitened."""

    basis: np.ndarray  #: (K, M) functions in intervals; of sensors (K + 1, M) at nodes.
    terms: list[int]  #: T indices of the flight's terms; of sensors of the pose.
    mix: np.ndarray  #: (M T, q) mixtures of functions times terms, functions first.
    are_read: bool  #: Whether sensors read them.

    def along(self, change: np.ndarray) -> np.ndarray:
        """Returns the terms (K, T) by a change of the columns (q,)."""
        return self.basis @ (self.mix @ change).reshape(-1, len(self.terms))

    def columns(self, by_term: np.ndarray) -> np.ndarray:
        """Returns the columns (K, n, q) of what the terms move by (K, n, T) each."""
        product = self.basis[:, None, :, None] * by_term[:, :, None]
        return product.reshape(*product.shape[:2], -1) @ self.mix
