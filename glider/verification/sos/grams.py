"""Gram matrices close to known ones, by projection instead of by a solver.

From one time of a flight to the next, a certificate hardly changes. Douglas-Rachford
splitting between the matrices that represent the polynomial and those with all
eigenvalues above a margin finds the next one in a few steps of 1 ms.
"""

import numpy as np

from glider.verification.sos.sphere import Sphere

ROUNDS = 300
"""Steps, of 1 ms, after which a program is solved anew instead."""


def represent(
    tables: Sphere, entries: np.ndarray, coefficients: np.ndarray
) -> np.ndarray:
    """Returns the closest Gram matrix (E,) that has exactly these coefficients (C,)."""
    return entries + tables.correction @ (coefficients - tables.map @ entries)


def least_eigenvalue(tables: Sphere, entries: np.ndarray) -> float:
    """Returns the least eigenvalue of a Gram matrix."""
    return float(np.linalg.eigvalsh(tables.matrix(entries))[0])


def nearby_gram(
    tables: Sphere,
    entries: np.ndarray,
    coefficients: np.ndarray,
    margin: float,
    rounds: int = ROUNDS,
) -> np.ndarray | None:
    """Returns a Gram matrix (E,) of a polynomial, starting from another's.

    Args:
        tables: those of the dimension.
        entries: (E,) to start from.
        coefficients: (C,) of the polynomial, odd then even.
        margin: least eigenvalue to have; the search aims at twice that.
        rounds: after which it gives up.

    Returns:
        None where there is none or none was found.
    """
    state = entries
    for _ in range(rounds):
        candidate = represent(tables, state, coefficients)
        if least_eigenvalue(tables, candidate) >= margin:
            return candidate
        values, vectors = np.linalg.eigh(tables.matrix(2.0 * candidate - state))
        raised = (vectors * np.maximum(values, 2.0 * margin)) @ vectors.T
        state = state + tables.entries(raised) - candidate
    return None
