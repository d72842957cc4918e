"""Gram matrices close to known ones, by projection instead of by a solver.

From one time of a flight to the next, a certificate hardly changes. Douglas-Rachford
splitting between the matrices that represent the polynomial and those with all
eigenvalues above a margin finds the next one in a few steps of 1 ms.
"""

from collections.abc import Callable

import numpy as np

from glider.verification.sos.sphere import Sphere

ROUNDS = 300
"""Steps, of 1 ms, after which a program is solved anew instead."""


def represent(
    tables: Sphere, entries: np.ndarray, coefficients: np.ndarray
) -> np.ndarray:
    """Returns the closest Gram matrix (E,) that has exactly these coefficients (C,)."""
    return entries + tables.correction @ (coefficients - tables.map @ entries)


def represent_rest(
    tables: Sphere, entries: np.ndarray, block: np.ndarray, coefficients: np.ndarray
) -> np.ndarray:
    """Returns the closest Gram matrix (E,) whose block of z is known.

    Args:
        tables: those of the dimension.
        entries: (E,) of a Gram matrix.
        block: (n, n) Q₁₁, of which nothing is lifted.
        coefficients: (C,) of what the other blocks represent.
    """
    entries = entries.copy()
    own = tables.rows < tables.n
    entries[own] = block[tables.rows[own], tables.columns[own]]
    missing = coefficients - tables.rest_map @ entries
    return entries + tables.rest_correction @ missing


def least_eigenvalue(tables: Sphere, entries: np.ndarray) -> float:
    """Returns the least eigenvalue of a Gram matrix."""
    return float(np.linalg.eigvalsh(tables.matrix(entries))[0])


def nearby_gram(
    tables: Sphere,
    entries: np.ndarray,
    project: Callable[[np.ndarray], np.ndarray],
    margin: float,
    aim: float | None = None,
    rounds: int = ROUNDS,
) -> np.ndarray | None:
    """Returns a Gram matrix (E,) of a polynomial, starting from another's.

    Args:
        tables: those of the dimension.
        entries: (E,) to start from.
        project: from entries (E,) to the closest that represent the polynomial.
        margin: least eigenvalue to have.
        aim: least eigenvalue that the search aims at; twice the margin if None.
        rounds: after which it gives up.

    Returns:
        None where there is none or none was found.
    """
    aim = 2.0 * margin if aim is None else aim
    state = entries
    for _ in range(rounds):
        candidate = project(state)
        if least_eigenvalue(tables, candidate) >= margin:
            return candidate
        values, vectors = np.linalg.eigh(tables.matrix(2.0 * candidate - state))
        raised = (vectors * np.maximum(values, aim)) @ vectors.T
        state = state + tables.entries(raised) - candidate
    return None
